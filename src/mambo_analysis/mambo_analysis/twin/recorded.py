"""
A recorded flight on one uniform grid: motion, inertial sensor, motor commands and battery.

Axes are those of ROS: the world has z up, the body is FLU. The inertial sensor and the
markers are not mounted exactly alike. The two small angles between them come from the flight: in
the mean over ``STRETCH`` seconds, the measured specific force turned into the world, less gravity,
must be the change of the measured velocity. A turn about the vertical stays unknown. Along z the
same mean gives the bias of the accelerometer, which would else count as thrust. A bias along x
and y looks like a turned sensor; along z they differ in second order (:func:`bias_doubt`).

Signals that contradict each other are refused (:mod:`.contradictions`,
:mod:`mambo_signals.gyro_check`), poses that are late against the gyro are moved.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import NamedTuple

from mambo_bags.reader import Bag, read_bag
from mambo_signals import derivative, gyro_check, motion, resample, stamps
from mambo_signals.time_offset import AlignError
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from . import contradictions
from ..compare import losses
from ..identify.regression import IdentifyError

Floats = NDArray[np.float64]

STEP = 0.01            # s, of the grid
_READ = ('imu/data_raw', 'motor_pwm', *motion.TRUTH)
REFERENCE, ESTIMATE = 'onboard/reference', 'onboard/odom'
GAP = 0.1              # s, over which samples are connected
BATTERY_GAP = 2.5      # s, over which voltages are connected: some logs have one a second
LEAST_VOLTS = 1.0      # V, of a battery that was measured
LEAST_REST = 0.9       # s before take-off that show biases and noise; a second has 0.99
STILL_SPEED = 0.03     # m/s, of a vehicle at rest, not carried around
STILL_RATE = 0.1       # rad/s
STRETCH = 0.5          # s, over which force and change of velocity are compared
GRAVITY = 9.80665      # m/s^2
LEAST_FLIGHT = 5.0     # s in the air
FLYING = 0.3           # [-] of the usual command in flight: below, no motor flies
STEADY = 0.8           # [-] of the usual command: a vehicle in the air never commands less
CLEAR = 0.2            # m above the start: below, the floor acts
EDGE = 0.3             # s of the flight left out at both ends, while it still jumps
LATE = 0.03            # s: below, poses move no drag by as much as its interval
LATEST = 0.3           # s: cameras and network take 0.1 s, more is another clock
WIDEST = 60.0          # s, gap of the inertial samples: a flight has none that is nearly as long
LONGEST = 7200.0       # s, of a recording: batteries of such vehicles last a quarter of that
MIX = np.array([[1.0, -1.0, -1.0, 1.0], [-1.0, -1.0, 1.0, 1.0], [1.0, -1.0, 1.0, -1.0]])
"""Roll, pitch and yaw from thrusts in the order of (3.2), FLU."""


class Onboard(NamedTuple):
    """
    What the drone itself followed and believed, on the grid of a flight; NaN where not known.

    Attributes
    ----------
    reference : (n, 3) m
        Wanted position, held until the next one.
    position, velocity : (n, 3) m, m/s
        Estimate, inertial; NaN throughout if the recording has none.
    attitude : (n, 4)
        x y z w.

    """

    reference: Floats
    position: Floats
    velocity: Floats
    attitude: Floats


class Recorded(NamedTuple):
    """
    A flight on a grid of ``STEP``.

    Attributes
    ----------
    name
        Of the bag.
    t : (n,) s
    position, velocity : (n, 3) m, m/s
        Inertial, z up; NaN where the motion is not known.
    attitude : (n, 4)
        x y z w, body to inertial, of the inertial sensor: the mounting is taken out.
    force, gyro : (n, 3) m/s^2, rad/s
        Specific force and body rate in the axes of the inertial sensor, FLU.
    command : (n, 4)
        Motor commands in the order of (3.2), in the unit of the recording.
    voltage : (n,) V
        Of the battery; NaN if the recording has none.
    air, rest
        Rows in the air and at rest before take-off; ``rest`` may be empty.
    mounting : (3,) rad
        Rotation vector from the inertial sensor to the marker body.
    has_flow
        Whether the recording has optical flow, too.
    onboard
        None without a reference in the recording.
    bias
        Of the accelerometer along z, m/s^2, which is taken out of ``force``.
    late
        Of the poses against the gyro, s, which is taken out of their stamps.
    has_ground
        Whether the recording shows the vehicle on the ground.
    gain : (3, 2)
        Of the tracked acceleration along x, y, z of the world over that of ``force``, lowest and
        highest.
    askew : rad
        Angle about z from the axes of the gyro to those of the tracked body.
    unused
        Time in the air outside of ``air``, s: in other stretches, long enough to be a flight.
    battery_pace
        Time between new readings of the battery, s; NaN if it has none or one.
    pace
        Usual time between samples of the IMU or the motor commands, the longer one, s.
    absent
        A line about each signal that begins late in the flight or ends early: none of it is used
        there.

    """

    name: str
    t: Floats
    position: Floats
    velocity: Floats
    attitude: Floats
    force: Floats
    gyro: Floats
    command: Floats
    voltage: Floats
    air: slice
    rest: slice
    mounting: Floats
    has_flow: bool = False
    onboard: Onboard | None = None
    bias: float = 0.0
    late: float = 0.0
    has_ground: bool = True
    unused: float = 0.0
    battery_pace: float = np.nan
    gain: Floats = np.ones((3, 2))
    askew: float = 0.0
    pace: float = np.nan
    absent: tuple[str, ...] = ()

    @property
    def turn(self) -> Rotation:
        """Return the attitudes; unknown ones are upright."""
        known = np.isfinite(self.attitude).all(axis=1)
        return Rotation.from_quat(np.where(known[:, None], self.attitude, [0.0, 0.0, 0.0, 1.0]))

    @property
    def body_velocity(self) -> Floats:
        """Return the velocity in the axes of the body, (n, 3) m/s."""
        return self.turn.inv().apply(self.velocity)


def _motion(bag: Bag) -> motion.Motion:
    """Return the measured motion of a bag; motion capture has priority over the truth."""
    for topic in reversed(motion.TRUTH):
        if topic in bag and len(bag[topic]):
            return motion.read(bag, topic)
    raise IdentifyError(f'{bag.path}: no motion: neither {" nor ".join(motion.TRUTH)} in the bag')


def _onboard(bag: Bag, t: Floats) -> Onboard | None:
    """Return reference and estimate of the drone at times t, (n,) s; None without a reference."""
    if REFERENCE not in bag or not len(bag[REFERENCE]):
        return None
    given = bag[REFERENCE]
    last = np.searchsorted(given.t, t, side='right') - 1
    wanted = np.where(last[:, None] >= 0, given.position[np.maximum(last, 0)], np.nan)
    unknown = np.full((len(t), 3), np.nan)
    if ESTIMATE not in bag or len(bag[ESTIMATE]) < 2:
        return Onboard(wanted, unknown, unknown, np.full((len(t), 4), np.nan))
    there = motion.read(bag, ESTIMATE).at(np.rint(t * 1e9).astype(np.int64))
    return Onboard(wanted, there.position,
                   unknown if there.velocity is None else there.velocity, there.quaternion)


def _mounting(
    path: Path, found: dict[str, Floats], air: slice,
) -> tuple[Floats, float, Floats]:
    r"""
    Return the rotation vector r from the inertial sensor to the markers, and its bias along z.

    And the gains that are left (:func:`.contradictions.gains`).

    Least squares over stretches of the flight, R being the attitude of the markers:
    :math:`\\overline{R f} + \\overline{R (r \\times f)} - b \\overline{R e_3} - g e_3
    = \\overline{\\dot v}`.

    Returns
    -------
    rotation : (3,) rad
        With r_z = 0.
    bias : m/s^2
    gains : (3, 2)

    Raises
    ------
    IdentifyError
        If the accelerometer does not show this motion.

    """
    count = round(STRETCH / STEP)
    length = (air.stop - air.start) // count * count
    rows = slice(air.start, air.start + length)
    turn = Rotation.from_quat(found['attitude'][rows])
    force = found['force'][rows]

    def mean(x: Floats) -> Floats:
        return x.reshape(-1, count, 3).mean(axis=1)
    turned = mean(turn.apply(force))
    contradictions.refuse_upward(path, float(turned[:, 2].mean()), GRAVITY)
    effect = [mean(turn.apply(np.cross(axis, force))) for axis in np.eye(3)[:2]]
    effect.append(mean(turn.apply(np.tile([0.0, 0.0, -1.0], (length, 1)))))
    v = found['velocity'][rows].reshape(-1, count, 3)
    change = (v[:, -1] - v[:, 0]) / (STEP * (count - 1))
    rest = change + [0.0, 0.0, GRAVITY] - turned
    columns = np.stack([e.ravel() for e in effect], axis=1)
    r = np.linalg.lstsq(columns, rest.ravel())[0]
    doubled = GRAVITY * float(r[0] ** 2 + r[1] ** 2)
    # the fit has a bias along x, y turn the force up by all of this, a turned sensor by half of it
    mounting, bias = np.array([r[0], r[1], 0.0]), float(r[2]) - 0.75 * doubled
    contradictions.refuse_steep(path, mounting)
    turned += (columns @ r).reshape(-1, 3)
    contradictions.refuse_other_motion(path, turned, change)
    return mounting, bias, contradictions.gains(turned, change)


def bias_doubt(mounting: Floats) -> float:
    """
    Return half of the difference of the biases along z, m/s^2, that a mounting (3,) rad admits.

    If it is a bias along x and y in truth, or a turned sensor.
    """
    return 0.25 * GRAVITY * float(mounting[:2] @ mounting[:2])


def _jump(*times: Floats) -> str:
    """Return where a recording that is too long jumps, or that it does not."""
    k = int(np.argmax([np.diff(t).max() for t in times]))
    t, name = times[k], ('imu/data_raw', 'motor_pwm', 'the motion')[k]
    return (f'{name} lasts {t[-1] - t[0]:.0f} s, {LONGEST:g} s are allowed, '
            f'{resample.describe_gap(t)}')


def _grid(bag: Bag, path: motion.Motion) -> dict[str, Floats]:
    """Return every signal on a common grid, where all are available."""
    imu, pwm = bag['imu/data_raw'], bag['motor_pwm']
    start = max(imu.t.min(), pwm.t.min(), path.t.min())
    end = min(imu.t.max(), pwm.t.max(), path.t.max())
    if end - start < LEAST_FLIGHT:
        raise IdentifyError(
            f'{bag.path}: motion, IMU and motor commands overlap for '
            f'{max(end - start, 0.0):.1f} s, {LEAST_FLIGHT:g} s are needed')
    if end - start > LONGEST:
        raise IdentifyError(f'{bag.path}: {_jump(imu.t, pwm.t, path.t)}')
    inside = np.sort(imu.t[(imu.t >= start) & (imu.t <= end)])
    if len(inside) > 1 and np.diff(inside).max() > WIDEST:
        raise IdentifyError(f'{bag.path}: imu/data_raw, {resample.describe_gap(inside)}')
    t = np.arange(round(start / STEP) + 1, int(end / STEP)) * STEP

    def at(times: Floats, values: Floats) -> Floats:
        return resample.interpolate(t, times, values, GAP)
    position, velocity = derivative.local_fit(path.t, path.position, t, derivative.POSITION)
    q = at(path.t, path.quaternion)
    voltage = np.full(len(t), np.nan)
    if 'battery' in bag and len(bag['battery']):
        voltage = resample.interpolate(
            t, bag['battery'].t, bag['battery'].voltage[:, None].astype(float), BATTERY_GAP)[:, 0]
        voltage[voltage < LEAST_VOLTS] = np.nan  # not measured
    return {'t': t, 'position': position, 'velocity': velocity,
            'attitude': q / np.linalg.norm(q, axis=1, keepdims=True),
            'force': at(imu.t, imu.acceleration), 'gyro': at(imu.t, imu.angular_velocity),
            'command': at(pwm.t, pwm.pwm.astype(float)), 'voltage': voltage}


def battery_pace(bag: Bag) -> float:
    """Return the median time between new readings of the battery, s; NaN without two."""
    if 'battery' not in bag:
        return np.nan
    battery = bag['battery']
    known = np.isfinite(battery.voltage)
    t, volts = battery.t[known], battery.voltage[known]
    new = t[np.flatnonzero(np.diff(volts, prepend=np.nan) != 0.0)]
    return float(np.median(np.diff(new))) if len(new) > 1 else np.nan


def _pace(bag: Bag) -> float:
    """Return the median time between samples of IMU or motor commands, the longer one, s."""
    return max(float(np.median(np.diff(bag[topic].t))) for topic in ('imu/data_raw', 'motor_pwm'))


def _has_ground(found: dict[str, Floats], known: NDArray[np.bool_]) -> bool:
    """
    Return whether the vehicle may be on the ground somewhere in the known rows.

    It is in the air throughout if it moves and its motors never get weak for half a second.
    """
    count = round(STRETCH / STEP)
    mean = found['command'].mean(axis=1)[known]
    if len(mean) < count:
        return True
    weakest = np.convolve(mean, np.full(count, 1.0 / count), 'valid').min()
    speed = np.median(np.linalg.norm(found['velocity'][known], axis=1))
    return bool(weakest < STEADY * np.median(mean) or speed < STILL_SPEED)


class _Rows(NamedTuple):
    """Which rows of the grid are used; each value is described in :class:`Recorded`."""

    air: slice
    rest: slice
    has_ground: bool
    unused: float


def _refuse_thin(
    path: Path, known: dict[str, NDArray[np.bool_]], on: NDArray[np.bool_],
) -> None:
    """Raise IdentifyError if the signals are not known for long enough while the motors run."""
    def longest(rows: NDArray[np.bool_]) -> float:
        run = resample.longest_run(rows)
        return (run.stop - run.start) * STEP
    least, all_ = LEAST_FLIGHT + 2.0 * EDGE, np.all(list(known.values()), axis=0)
    first, last = np.flatnonzero(on)[[0, -1]]
    if longest(all_ & on) < least <= (last - first) * STEP:
        name = min(known, key=lambda one: known[one][first:last].sum())
        raise IdentifyError(
            f'{path}: from the first to the last command {(last - first) * STEP:.1f} s pass, but '
            f'all signals are known for {longest(all_ & on):.1f} s on end at most, {least:g} s '
            f'are needed: the {name} has too few samples, or gaps; {GAP:g} s between two is too '
            'much')


def _rows(path: Path, found: dict[str, Floats]) -> _Rows:
    """Return the rows in the air, the longest stretch without a gap, and those at rest."""
    mean = found['command'].mean(axis=1)
    on = mean > FLYING * np.nanmedian(mean[mean > 0.0]) if (mean > 0.0).any() else mean > 0.0
    if not on.any():
        raise IdentifyError(f'{path}: the motors never run: this is no flight')
    parts = {name: np.isfinite(found[name]).reshape(len(mean), -1).all(axis=1) for name in (
        'position', 'velocity', 'attitude', 'force', 'gyro', 'command')}
    known = np.all(list(parts.values()), axis=0)
    height = found['position'][:, 2]
    has_ground = _has_ground(found, known)
    floor = np.nanmin(height) if has_ground else -np.inf
    flying = known & on & (found['command'].min(axis=1) > 0.0) & (height > floor + CLEAR)
    air = resample.longest_run(flying)
    runs = np.diff(resample.runs(flying))[:, 0] * STEP
    unused = float(runs[runs >= LEAST_FLIGHT].sum()) - (air.stop - air.start) * STEP
    edge = round(EDGE / STEP)
    air = slice(air.start + edge, air.stop - edge)
    if (air.stop - air.start) * STEP < LEAST_FLIGHT:
        _refuse_thin(path, parts, on)
        raise IdentifyError(
            f'{path}: {max((air.stop - air.start) * STEP, 0.0):.1f} s in the air with all '
            f'signals, {LEAST_FLIGHT:g} s are needed; the lowest pose is taken as that on the '
            'ground: keep a second before take-off or after landing')
    first = int(np.flatnonzero(on)[0])
    still = np.isfinite(found['force']).all(axis=1) & np.isfinite(found['gyro']).all(axis=1)
    still &= found['command'].max(axis=1) <= 0.0
    still &= np.linalg.norm(found['velocity'], axis=1) < STILL_SPEED  # not where it is not known
    still &= np.linalg.norm(found['gyro'], axis=1) < STILL_RATE
    rest = resample.longest_run(still[:first])
    if (rest.stop - rest.start) * STEP < LEAST_REST:
        rest = slice(0, 0)
    return _Rows(air, rest, has_ground, unused)


def _beside_gyro(bag: Bag, track: motion.Motion, air: Floats) -> tuple[float, float]:
    """
    Return how poses are beside the gyro, in the air at times (n,) s.

    Returns
    -------
    late : s
    askew : rad
        Of the tracked axes, about z.

    Raises
    ------
    IdentifyError
        If the gyro contradicts the tracked attitude.

    """
    imu = bag['imu/data_raw']
    there = (track.t >= air[0]) & (track.t <= air[-1])
    turning = gyro_check.compare(
        imu.t, imu.angular_velocity, track.t[there], track.quaternion[there])
    try:
        gyro_check.refuse(turning)
    except AlignError as error:
        raise IdentifyError(f'{bag.path}: {error}') from None
    if turning is None:
        return 0.0, 0.0
    if abs(turning.late) > LATEST:
        raise IdentifyError(
            f'{bag.path}: the poses are {abs(turning.late):.2g} s or more '
            f'{"late" if turning.late > 0.0 else "early"} against the gyro: the clocks differ; '
            'align them with mambo join')
    return turning.late, gyro_check.askew(turning)


def read_flight(path: Path, namespace: str | None = None) -> Recorded:
    """
    Read a bag with ``imu/data_raw``, ``motor_pwm`` and a motion (capture or truth).

    Raises
    ------
    IdentifyError
        If it is no flight of at least ``LEAST_FLIGHT`` s, or lacks a signal.
    mambo_bags.reader.BagError
        If it cannot be read.

    """
    bag = read_bag(path, None, namespace)
    for topic in ('imu/data_raw', 'motor_pwm'):
        if topic not in bag or not len(bag[topic]):
            raise IdentifyError(f'{path}: no {topic} in the bag')
    stamps.refuse_wrong(bag, _READ)
    stamps.refuse_mixed(bag)
    if not np.isfinite(bag['imu/data_raw'].acceleration).all(axis=1).any():
        raise IdentifyError(f'{path}: imu/data_raw lacks an acceleration on some axis')
    track = _motion(bag)
    found = _grid(bag, track)
    rows = _rows(path, found)
    late, askew = _beside_gyro(bag, track, found['t'][rows.air])
    if abs(late) > LATE:
        track = dataclasses.replace(track, stamps=track.stamps - round(late * 1e9))
        found = _grid(bag, track)
        rows = _rows(path, found)
    air = rows.air
    if not contradictions.silent(found['force'][air], found['gyro'][air], STEP):
        for name, sensor, unit in (('force', 'accelerometer', 'm/s^2'),
                                   ('gyro', 'gyro', 'rad/s')):
            contradictions.refuse_stuck(path, sensor, unit, found[name][air], STEP)
    contradictions.refuse_still_motor(path, found['command'][air])
    contradictions.refuse_doubled_motor(path, found['command'][air])
    mounting, bias, gain = _mounting(path, found, air)
    found['force'] = found['force'] - [0.0, 0.0, bias]
    known = np.isfinite(found['attitude']).all(axis=1)
    found['attitude'][known] = (Rotation.from_quat(found['attitude'][known])
                                * Rotation.from_rotvec(mounting)).as_quat()
    return Recorded(path.name, **found, **rows._asdict(), mounting=mounting,
                    has_flow='optical_flow' in bag, onboard=_onboard(bag, found['t']), bias=bias,
                    gain=gain, askew=askew, late=late if abs(late) > LATE else 0.0,
                    battery_pace=battery_pace(bag), pace=_pace(bag),
                    absent=tuple(losses.describe(
                        bag, losses.span(bag), ('imu/data_raw', 'motor_pwm', track.name))))
