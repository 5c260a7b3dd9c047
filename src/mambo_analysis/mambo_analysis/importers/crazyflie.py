"""
Crazyflie flights with motion capture as bags: ``import_crazyflie LOG.json OUT``.

A log is ``{drone: {name: {time, data}}, mocap: {time, x, y, z, yaw, pitch, roll}}``, as the
flight client of the course AE 483 of the University of Illinois writes it from a Crazyflie 2.x
with flow deck and a motion capture, Qualisys there. Everything is z up and FLU already
(``controller_ae483.c``; yaw, pitch, roll are intrinsic z, y, x). Times are the drone's, since it
was switched on; the parts of one instant come in several packets some ms apart, each possibly
lost. Logs of the course's first years are read, too: ``{name: {time, data}}`` without a motion
capture, whose times are whole milliseconds, and ``o_x`` for ``p_x``. Where the course's signals
are not in the log those of the firmware are taken (:mod:`.crazyflie_names`): ``motor.m1``,
``gyro``, ``acc``, ``stateEstimate``, ``range.zrange``, ``motion``, ``ctrltarget``, ``pm.vbat``.
Where it has both, a line says so.

Inertial sensors
    ``w_*`` is the gyro in rad/s. ``a_z`` is g times the accelerometer, the specific force: at
    rest it reads +9.810 m/s^2 (three logs), in flight it averages 9.75 to 9.83. The course does
    not log the horizontal accelerations: without ``acc.x`` and ``acc.y`` of the firmware they are
    NaN, or 0 with ``--level``: what a rotorcraft feels there is drag alone. ``imu/data_raw``
    stands at the packets of ``w_x``; what came in another packet is interpolated there. Where that
    was lost for long the acceleration is NaN.

Optical flow
    ``n_x, n_y`` are counts of the PMW3901, of which the firmware predicts
    ``n * 0.1 = dt * 35 / 0.71674 * (v_x / h - w_y)`` (crazyflie-firmware,
    ``kalman_core/mm_flow.c``: 35 pixels over 2 sin(21 deg), counts in tenths of a pixel), read
    each 10 ms (``flowdeck_v1v2.c``): 488 counts per radian. That is ``optical_flow`` here; the
    course takes the former 30 pixels over 4.2 deg, 409. Regression on v / h and w of the three
    flights that move (motion capture and range) gives 600 to 700 counts per radian, the flow 30
    to 50 ms behind: ``--counts-per-radian`` sets another value. Rotation is not compensated. The
    firmware keeps the last counts while the sensor sees no motion (a fifth of the logged pairs
    of 5 counts or more repeat): only new pairs are published, or with ``--repeated-flow zero``
    the repeated ones too, as 0. What is left out is the slow part: with zeros two flights give
    404 and 416 counts per radian, the course's 409 (real_recordings.md). After a lost packet
    nothing tells whether counts repeat: with zeros they are then multiplied by the share of the
    counts that is new wherever the packet before is there, about two thirds.

Range
    ``r`` is the VL53L1x, metres along the body's -z, each 40 ms, held between: new values are
    published. 0 is no measurement yet.

Motors
    ``m_1`` to ``m_4`` (0 to 65535, front right, rear right, rear left, front left) are
    ``motor_pwm`` in the order of (3.2), in the drone's own counts.

Motion capture
    ``optitrack/pose`` is the marker deck, some cm above the range sensor. Its clock has another
    zero, found by bringing the range onto z (:mod:`mambo_signals.time_offset`). The
    range is itself
    7 to 35 ms behind the gyro (it averages, and is passed on each 40 ms), and so is a pose stamped
    that way: the standard error that is printed holds 30 ms for it, and the change of the offset
    within the flight; above 50 ms the motion capture is refused. ``--mocap-offset gyro`` takes
    the gyro instead, as does a log without a usable range. Signals that give different clocks
    (:func:`mambo_signals.time_offset.most_precise`) are refused. NaN is marker loss: no pose; nor
    is there one where the tracker flips the body (:mod:`mambo_signals.poses.outliers`).

Contradictions
    A gyro that turns as the drone's own attitude says, but five times as much or more, or less, or
    with its axes in another order or sign, is refused; so is a motion capture that turns otherwise
    than the gyro (:mod:`mambo_signals.gyro_check`), whose clock jumps within the flight or runs
    at a wrong rate (:mod:`mambo_signals.clock_check`), whose height is along another axis
    than z by the range, or whose path is the mirror image of the drone's. With
    ``--mocap-offset SECONDS`` such a motion capture is taken as it is, with a line that says so. A
    scale of it that is wrong by a few percent does not show: the range changes by 0.990 to 1.014 m
    for a metre of height in five real flights. Beyond 5 % a line says so.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
from pathlib import Path
from typing import Any

from mambo_bags.cli.option_types import real
from mambo_bags.command import guard, Parser
from mambo_bags.mcap_reader import BagError
from mambo_bags.writer import BagWriter
from mambo_signals import clock_check, gyro_check, height_check
from mambo_signals.derivative import body_rates
from mambo_signals.motion import Motion
from mambo_signals.poses import frozen, outliers
from mambo_signals.resample import interpolate
from mambo_signals.time_offset import (
    AlignError, most_precise, Offset, offsets, RANGE_LATE, refuse_uncertain, time_offset,
    UncertainError)
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from .checks import bag_doubts, crazyflie_doubts, plausible, same_flight, slips
from .common import (
    estimator_parameters, importer_parser, is_sound, LONGEST, NAMESPACE, new_samples, ONLY_CHANGES,
    provenance, Publisher, read_source, refuse_options, report, Source, stamps_ns, unused)
from .crazyflie_names import (
    ATTITUDE, BATTERY, COURSE, ESTIMATE, FORMER, GOAL, GYRO, HORIZONTAL, like_commands, MOCAP,
    MOTORS, ODOMETRY, RATES, select, USED)

Floats = NDArray[np.float64]
Pair = tuple[Floats, Floats, Floats, Floats]
COUNTS_PER_RADIAN = 10.0 * 35.0 / 0.71674
DATA_SHEET = 409.0  # counts per radian: 30 pixels over 4.2 deg
FLOW_PERIOD = 0.01  # [s] over which a count is taken
FOLLOWS = 1.5  # periods: beyond, the pair of counts before was lost
FULL_QUALITY = 255
RANGE_LIMITS = (0.01, 4.0)  # [m] VL53L1x
RANGE = 'range against z'
NEAR = 0.08  # [s] how far the gyro's offset may be from the range's
SCALE = 1.05  # [-] of the range over the height of the motion capture; 0.990 to 1.014 were seen
GAP = 0.05  # [s] over which the parts of one instant are interpolated
TOPICS = {
    'imu/data_raw': 'sensor_msgs/msg/Imu', 'sonar/range': 'sensor_msgs/msg/Range',
    'optical_flow': 'mambo_interfaces/msg/OpticalFlow',
    'motor_pwm': 'mambo_interfaces/msg/MotorPwm', 'onboard/odom': 'nav_msgs/msg/Odometry',
    'onboard/reference': 'geometry_msgs/msg/PoseStamped',
    'battery': 'sensor_msgs/msg/BatteryState', 'optitrack/pose': 'geometry_msgs/msg/PoseStamped'}


@dataclasses.dataclass(frozen=True)
class Log:
    """
    The finite samples of a log.

    Attributes
    ----------
    drone
        {name of the course without its group: (times (n,) s, values (n,))}, SI.
    origin
        {that name: name in the log}, of signals of the firmware.
    doubled
        A line for each quantity that the log holds under both names.
    mocap : (m, 7)
        s of its own clock, m, rad; without the rows in which markers were lost, and without
        those that cannot be true.
    lost, impossible, still
        How many rows those were; the last repeat a pose while the body moves on.
    ignored
        Names of the signals that nothing is made of.
    former
        Whether the file has the layout of the course's first years.
    steep
        {name: values beyond a quarter turn that were left out}, of the pitches that had some.
    before
        Samples of the drone's position in which its whole pose is 0, before its estimate began.
    turned
        Lines on poses of the motion capture whose body is turned against that of the others.

    """

    drone: dict[str, tuple[Floats, Floats]]
    origin: dict[str, str]
    doubled: list[str]
    mocap: Floats
    lost: int
    impossible: int
    still: int
    ignored: list[str]
    former: bool
    steep: dict[str, int]
    before: int
    turned: list[str]

    def has(self, *names: str) -> bool:
        """Return whether all signals are present."""
        return all(name in self.drone for name in names)

    def at(self, times: Floats, *names: str) -> Floats:
        """Return signals at times, (n, k), interpolated over at most ``GAP``; NaN elsewhere."""
        return _at(self.drone, times, names)

    def source(self, *names: str) -> str:
        """Return the names of signals in the log, without the group of the course."""
        return ', '.join(self.origin.get(name, name) for name in names)


def _at(
    drone: dict[str, tuple[Floats, Floats]], times: Floats, names: tuple[str, ...],
) -> Floats:
    out = np.full((len(times), len(names)), math.nan)
    for column, name in enumerate(names):
        t, v = drone[name]
        out[:, column] = interpolate(times, t, v[:, None], GAP)[:, 0]
    return out


def _numbers(path: Path, name: str, values: Any) -> Floats:
    try:
        return np.asarray(values, float)
    except (TypeError, ValueError, OverflowError):
        raise BagError(f'{path}: {name} holds what is no number') from None


def _series(path: Path, name: str, times: Any, data: Any) -> tuple[Floats, Floats]:
    """Return one signal, checked."""
    t, v = _numbers(path, name, times), _numbers(path, name, data)
    if t.ndim != 1 or t.shape != v.shape:
        raise BagError(f'{path}: {name} has {t.size} times and {v.size} values')
    if not np.isfinite(t).all() or (t < 0.0).any():
        raise BagError(f'{path}: {name} has a time that is no number or negative')
    if t.size and t.max() > LONGEST or not is_sound(v[np.isfinite(v)]):
        raise BagError(f'{path}: {name} has a time or a value that is absurdly large')
    back = np.flatnonzero(np.diff(t) <= 0.0)
    if len(back):
        raise BagError(f'{path}: the times of {name} do not increase after {t[back[0]]:g} s')
    return t, v


def _is_signal(entry: Any) -> bool:
    return isinstance(entry, dict) and {'time', 'data'} <= set(entry)


def _former(path: Path, entries: dict[str, Any]) -> dict[str, Any]:
    """Return the signals of a log of the course's first years, whose times are whole ms, in s."""
    out = {}
    for name, entry in entries.items():
        if _is_signal(entry):
            times = _numbers(path, name, entry['time'])
            whole = np.isfinite(times).all() and (times == np.round(times)).all()
            entry = entry | {'time': times / (1e3 if whole else 1.0)}
        out[name] = entry
    return out


def _signals(
    path: Path, entries: dict[str, Any],
) -> tuple[dict[str, tuple[Floats, Floats]], list[str]]:
    """Return the finite samples of each signal, and the names of damaged ones, if not used."""
    drone, damaged = {}, []
    for name, entry in entries.items():
        group, _, short = name.partition('.')
        short = FORMER.get(short, short) if group == COURSE else name
        try:
            if not _is_signal(entry):
                raise BagError(f'{path}: {name} is not built as {{time, data}}')
            t, v = _series(path, name, entry['time'], entry['data'])
        except BagError:
            if short in (*USED, *GYRO):
                raise
            damaged.append(name)
            continue
        good = np.isfinite(v)
        if good.any():
            drone[short] = t[good], v[good]
    return drone, damaged


def read_log(source: Source) -> Log:
    """
    Read a log.

    Raises
    ------
    BagError
        If the file is no such log, or is damaged or cut off.

    """
    path = source.path
    try:
        found = json.loads(source.text())
    except RecursionError:
        raise BagError(f'{path}: its lists are nested too deeply for a log') from None
    except ValueError as error:
        raise BagError(f'{path}: no JSON file, or cut off ({error})') from None
    former = isinstance(found, dict) and 'drone' not in found and any(
        map(_is_signal, found.values()))
    if former:
        found = {'drone': _former(path, found)}
    if not isinstance(found, dict) or not isinstance(found.get('drone'), dict):
        raise BagError(f'{path}: no Crazyflie log: it has no "drone" with signals')
    signals, damaged = _signals(path, found['drone'])
    chosen = select(signals)
    drone = _into_body(chosen.signals) if 'v_x' in chosen.origin else chosen.signals
    mocap, turned, lost, impossible, still, pitches = _mocap(path, found.get('mocap') or {})
    steep = {'mocap pitch': pitches}
    if 'theta' in drone:
        wrong = plausible.refuse_steep(
            f'{path}: {chosen.origin.get("theta", "theta")}', *drone['theta'])
        steep['theta'] = int(wrong.sum())
        drone['theta'] = drone['theta'][0][~wrong], drone['theta'][1][~wrong]
    before = _leave_out_before(drone)
    log = Log(drone, chosen.origin, chosen.doubled, mocap, lost, impossible, still,
              damaged + chosen.ignored, former,
              {name: count for name, count in steep.items() if count}, before, turned)
    if not log.has(*RATES):
        raise BagError(f'{path}: no gyro (ae483log.w_x, w_y, w_z or gyro.x, y, z) with finite '
                       f'values; it has {", ".join(found["drone"]) or "no signals"}')
    _check(path, log)
    return log


def _into_body(drone: dict[str, tuple[Floats, Floats]]) -> dict[str, tuple[Floats, Floats]]:
    """Return the signals with a velocity that is in the axes of the position turned into FLU."""
    names = ESTIMATE[6:]
    if not all(name in drone for name in (*ATTITUDE, *names)):
        return drone
    t = drone[names[0]][0]
    angles, velocity = _at(drone, t, ATTITUDE), _at(drone, t, names)
    known = np.isfinite(np.hstack([angles, velocity])).all(axis=1)
    turned = np.empty((0, 3))
    if known.any():
        turned = Rotation.from_euler('ZYX', angles[known]).inv().apply(velocity[known])
    return drone | {name: (t[known], v) for name, v in zip(names, turned.T)}


def _leave_out_before(drone: dict[str, tuple[Floats, Floats]]) -> int:
    """
    Leave out what the drone "estimates" before its estimate begins: all of the pose is 0 there.

    Returns
    -------
    Number of samples of the position that are left out.

    """
    if not all(name in drone for name in ODOMETRY):
        return 0
    begins = [t[np.argmax(v != 0.0)] for t, v in map(drone.get, ODOMETRY[:6]) if v.any()]
    if not begins:
        return 0
    count = int((drone[ODOMETRY[0]][0] < min(begins)).sum())
    for name in ESTIMATE:
        t, v = drone.pop(name)
        if (after := t >= min(begins)).any():
            drone[name] = t[after], v[after]
    return count


def _check(path: Path, log: Log) -> None:
    """Raise BagError for signals of the drone that are not in the units of their names."""
    for name in USED:
        if log.has(name):
            plausible.refuse_pace(f'{path}: {log.source(name)}', log.drone[name][0])
    if 'w_x' not in log.origin:
        times = log.drone['w_x'][0]
        rates = log.at(times, *RATES)
        known = np.isfinite(rates).all(axis=1)
        plausible.refuse_degrees(f'{path}: w_x, w_y, w_z', times[known], rates[known])
    _check_unit(path, log)
    if log.has('a_z'):
        name = log.source('a_z')
        plausible.refuse_g(f'{path}: {name}', log.drone['a_z'][1],
                           'give it in g' if 'a_z' in log.origin else 'give it in m/s^2')
        if (usual := float(np.median(log.drone['a_z'][1]))) < -plausible.NEVER:
            raise BagError(f'{path}: {name} has a median of {usual:.4g} m/s^2: it is along z up, '
                           'where it reads +9.8 at rest: turn its sign')
    if log.has(*MOTORS):
        times = log.drone[MOTORS[0]][0]
        commands = log.at(times, *MOTORS)
        plausible.refuse_commands(f'{path}: {log.source(*MOTORS)}', commands)
    if log.has('r'):
        plausible.refuse_ranges(f'{path}: {log.source("r")}', log.drone['r'][1])


def _check_unit(path: Path, log: Log) -> None:
    """Raise BagError for a gyro in another unit than the drone's own attitude shows."""
    if not log.has(*ATTITUDE):
        return
    times, t = log.drone['w_x'][0], log.drone['psi'][0]
    rates, angles = log.at(times, *RATES), log.at(t, *ATTITUDE)
    known = np.isfinite(angles).all(axis=1)
    turning = gyro_check.compare(
        times, rates, t[known], np.array(_attitude(angles[known])).reshape(-1, 4))
    gyro, attitude = log.source(*RATES), log.source(*ATTITUDE)
    if said := gyro_check.other_axes(turning):
        raise BagError(f'{path}: {gyro}: {said} of the attitude {attitude}: '
                       'check names and signs')
    gain = gyro_check.other_unit(turning)
    if gain is not None:
        units = ['deg' if name in log.origin else 'rad' for name in ('w_x', 'psi')]
        raise BagError(
            f'{path}: {gyro}: the gyro shows {gain:.3g} times the turning of the '
            f'attitude {attitude}: give it in {units[0]}/s, and these in {units[1]}')


def _mocap(path: Path, found: Any) -> tuple[Floats, list[str], int, int, int, int]:
    """
    Return the poses, lines on turned ones, and how many were left out.

    Those are lost, impossible, frozen, and had an impossible pitch.
    """
    if not isinstance(found, dict) or (found and not {'time', *MOCAP} <= set(found)):
        raise BagError(f'{path}: mocap is not built as {{time, {", ".join(MOCAP)}}}')
    if not found or not found['time']:
        return np.empty((0, 7)), [], 0, 0, 0, 0
    columns = [_series(path, f'mocap {name}', found['time'], found[name]) for name in MOCAP]
    table = np.column_stack([columns[0][0], *(v for _, v in columns)])
    seen = np.isfinite(table).all(axis=1)
    poses = table[seen]
    plausible.refuse_pace(f'{path}: mocap time', poses[:, 0])
    steep = plausible.refuse_steep(f'{path}: mocap pitch', poses[:, 0], poses[:, 5])
    poses = poses[~steep]
    still, wrong, turned = plausible.doubtful_poses(
        f'{path}: mocap', 'motion capture', poses[:, 0], poses[:, 1:4],
        np.array(_attitude(poses[:, 4:])).reshape(-1, 4))
    counts = (~seen, wrong, still, steep)
    return poses[~(still | wrong)], turned, *(int(each.sum()) for each in counts)


def mocap_offset(log: Log) -> Offset:
    """
    Return the offset to add to the clock of the motion capture, by aligning the range with z.

    Raises
    ------
    AlignError
        If range and height do not determine it.

    """
    if not len(log.mocap):
        raise AlignError('there is no motion capture in the log')
    if not log.has('r'):
        raise AlignError('there is no range (ae483log.r) to align with')
    if not (log.drone['r'][1] > 0.0).any():
        raise AlignError('the range (ae483log.r) is never above 0')
    return time_offset(*_heights(log))


def _heights(log: Log) -> Pair:
    """Return the new ranges above 0 and the heights of the motion capture, each with times."""
    t, r = log.drone['r']
    new = new_samples(r)
    new = new[r[new] > 0.0]
    return t[new], r[new], log.mocap[:, 0], log.mocap[:, 3]


def _turn_rates(log: Log) -> dict[str, Pair]:
    """Return each axis of the gyro and of the motion capture's turning, rad/s, with times."""
    if not log.has(*RATES):
        return {}
    times, rates = body_rates(log.mocap[:, 0], np.array(_attitude(log.mocap[:, 4:])))
    return {name: (*log.drone[name], times, rates[:, axis]) for axis, name in enumerate(RATES)}


def _moving(log: Log) -> dict[str, Pair]:
    """Return the same, and the climb rate in m/s, while the motors run."""
    return clock_check.while_flying(
        _turn_rates(log), _heights(log) if log.has('r') else None, *_motors_run(log))


def _gyro_offsets(
    log: Log, limits: tuple[float, float] | None = None,
) -> tuple[dict[str, Offset], dict[str, AlignError]]:
    """Return the offset by each gyro axis, and the reason for axes without one, by name."""
    if not log.has(*RATES):
        return {}, {'gyro': AlignError(
            'there is no gyro (ae483log.w_x, w_y, w_z) to align with')}
    return offsets(_turn_rates(log), limits)


def gyro_offset(log: Log, near: float | None = None) -> Offset:
    """
    Return the same by the gyro, which has no delay, searched near another offset.

    Of the three axes the one with the highest correlation. Real flights leave it at 0.73 to 0.86,
    and the axes then differ by up to 10 ms, more than their standard errors say: ``sigma`` is
    then the root mean square of the distances of the others.

    Raises
    ------
    AlignError
        If no axis determines it.

    """
    found, reasons = _gyro_offsets(log, None if near is None else (near - NEAR, near + NEAR))
    if not found:
        raise AlignError('; '.join(f'{name}: {text}' for name, text in reasons.items()))
    best = max(found.values(), key=lambda offset: offset.quality)
    others = [one.offset - best.offset for one in found.values() if one is not best]
    apart = math.sqrt(sum(x * x for x in others) / len(others)) if others else 0.0
    return best._replace(sigma=max(best.sigma, apart))


def _other_scale(log: Log, offset: float | None) -> list[str]:
    """Return a line about a motion capture in another scale than the drone's own path."""
    if offset is None or not log.has('p_x', 'p_y'):
        return []
    said = plausible.other_scale(*_paths(log, offset))
    return [f'optitrack/pose: {said}'] if said else []


def _paths(log: Log, offset: float) -> tuple[Floats, Floats]:
    """Return the horizontal paths, (n, 2) m, of the drone and of its capture where both are."""
    t = log.drone['p_x'][0]
    rows = np.hstack([log.at(t, 'p_x', 'p_y'), interpolate(
        t, log.mocap[:, 0] + offset, log.mocap[:, 1:3], 2.0 * GAP)])
    rows = rows[np.isfinite(rows).all(axis=1)]
    return rows[:, :2], rows[:, 2:]


def _publish_imu(log: Log, out: Publisher, level: bool) -> None:
    times = log.drone['w_x'][0]
    omega = log.at(times, *RATES)
    force = np.full((len(times), 3), math.nan)
    if log.has('a_z'):
        force[:, 2] = log.at(times, 'a_z')[:, 0]
    if log.has(*HORIZONTAL):
        force[:, :2] = log.at(times, *HORIZONTAL)
    if level:
        force[np.isfinite(force[:, 2]), :2] = 0.0
    use = np.isfinite(omega).all(axis=1)
    for stamp, w, a in zip(stamps_ns(times[use]).tolist(), omega[use].tolist(),
                           force[use].tolist()):
        out.publish('imu/data_raw', stamp, 'base_link', **out.imu(w, a))


def _publish_sensors(
    log: Log, out: Publisher, counts_per_radian: float, repeated_flow: str,
) -> None:
    if log.has('r'):
        t, r = log.drone['r']
        stamps = stamps_ns(t).tolist()
        for i in new_samples(r).tolist():
            if r[i] > 0.0:
                out.publish('sonar/range', stamps[i], 'base_link', radiation_type=1,
                            min_range=RANGE_LIMITS[0], max_range=RANGE_LIMITS[1],
                            range=float(r[i]))
    if log.has('n_x', 'n_y'):
        t = log.drone['n_x'][0]
        counts, stamps = log.at(t, 'n_x', 'n_y'), stamps_ns(t).tolist()
        known, new = np.isfinite(counts).all(axis=1), np.zeros(len(t), bool)
        new[new_samples(counts)] = True
        if repeated_flow == 'zero':
            counts = counts * _share_new(t, counts, new)[:, None]
        rates = counts / (FLOW_PERIOD * counts_per_radian)
        for i in range(len(t)):
            if known[i] and (new[i] or repeated_flow == 'zero'):
                out.publish('optical_flow', stamps[i], 'base_link', rate_x=float(rates[i, 0]),
                            rate_y=float(rates[i, 1]), integration_time=FLOW_PERIOD,
                            quality=FULL_QUALITY)


def _share_new(t: Floats, counts: Floats, new: NDArray[np.bool_]) -> Floats:
    """
    Return the share of new motion in each pair of counts, (n,); 0 for a repeated one.

    Where the pair before was lost nothing tells whether a pair repeats it: it counts by the share
    of motion that is new where the pair before is there.
    """
    follows = np.diff(t, prepend=t[:1]) < FOLLOWS * FLOW_PERIOD
    size = np.nan_to_num(np.abs(counts).sum(axis=1))
    whole = size[follows].sum()
    return np.where(
        follows, new.astype(float), size[follows & new].sum() / whole if whole else 1.0)


def _publish_onboard(log: Log, out: Publisher) -> None:
    if log.has(*MOTORS):
        t = log.drone[MOTORS[0]][0]
        pwm = log.at(t, *MOTORS)
        for stamp, row in zip(stamps_ns(t).tolist(), pwm):
            if np.isfinite(row).all():
                out.publish('motor_pwm', stamp, '', pwm=row)
    if log.has(*ODOMETRY):
        t, state = _state(log)
        attitude = _attitude(state[:, 3:6])
        for stamp, row, q in zip(stamps_ns(t).tolist(), state.tolist(), attitude):
            out.publish('onboard/odom', stamp, 'odom',
                        **out.odometry(out.pose(row[:3], q), row[6:9], row[9:]))
    if log.has(*GOAL):
        t = log.drone[GOAL[0]][0]
        for stamp, row in zip(stamps_ns(t).tolist(), _nearest(log, t, GOAL).tolist()):
            if all(map(math.isfinite, row)):
                out.publish('onboard/reference', stamp, 'odom',
                            pose=out.pose(row, (0.0, 0.0, 0.0, 1.0)))
    if log.has(BATTERY):
        t, volts = log.drone[BATTERY]
        for stamp, v in zip(stamps_ns(t).tolist(), volts.tolist()):
            out.publish('battery', stamp, '', **out.battery(v, math.nan))


def _nearest(log: Log, times: Floats, names: tuple[str, ...]) -> Floats:
    """Return signals that jump at times, (n, k): the nearest sample within ``GAP``, else NaN."""
    out = np.full((len(times), len(names)), math.nan)
    for column, name in enumerate(names):
        t, v = log.drone[name]
        after = np.clip(np.searchsorted(t, times), 1, max(len(t) - 1, 1))
        after = np.minimum(after, len(t) - 1)
        before = np.maximum(after - 1, 0)
        index = np.where(times - t[before] < t[after] - times, before, after)
        near = np.abs(t[index] - times) <= GAP
        out[near, column] = v[index[near]]
    return out


def _attitude(yaw_pitch_roll: ArrayLike) -> list[list[float]]:
    """Return x y z w of (n, 3) rad."""
    angles = np.asarray(yaw_pitch_roll, float).reshape(-1, 3)
    return Rotation.from_euler('ZYX', angles).as_quat().tolist() if len(angles) else []


def _publish_mocap(log: Log, out: Publisher, offset: float) -> None:
    times = log.mocap[:, 0] + offset
    rows = log.mocap[times >= 0.0]
    attitude = _attitude(rows[:, 4:])
    stamps = stamps_ns(times[times >= 0.0]).tolist()
    for stamp, row, q in zip(stamps, rows.tolist(), attitude):
        out.publish('optitrack/pose', stamp, 'map', pose=out.pose(row[1:4], q))


def _range_offset(log: Log, asked: str) -> tuple[Offset | None, str]:
    """Return the offset by the range; None and why if only the gyro is usable, else AlignError."""
    if not log.has('r'):
        return None, 'there is none'
    try:
        return mocap_offset(log), ''
    except AlignError as error:
        if isinstance(error, UncertainError) and asked != 'gyro':
            raise AlignError(
                f'{RANGE}: {error}, though both change alike: a clock jumps or runs at a wrong '
                'rate, or many ranges are wrong; give --mocap-offset gyro to trust the gyro'
            ) from None
        if not _gyro_offsets(log)[0]:
            raise
        return None, str(error)


def _check_offset(path: Path, log: Log, offset: float) -> None:
    """Raise BagError if an offset leaves no pose of the motion capture within the flight."""
    times = log.mocap[:, 0] + offset
    first = min(float(t[0]) for t, _ in log.drone.values())
    last = max(float(t[-1]) for t, _ in log.drone.values())
    if not ((times >= first) & (times <= last)).any():
        raise BagError(
            f'{path}: with --mocap-offset {offset:g} all of the motion capture, {times[0]:.3f} to '
            f'{times[-1]:.3f} s, is outside of the flight, {first:.3f} to {last:.3f} s')


def _refuse_unused(
    path: Path, log: Log, counts_per_radian: float, mocap: str, level: bool, repeated_flow: str,
) -> None:
    """Raise BagError for an option about something that the log does not hold."""
    for there, what, given in (
            (log.has('n_x', 'n_y'), 'optical flow',
             {'counts-per-radian': counts_per_radian != COUNTS_PER_RADIAN,
              'repeated-flow': repeated_flow != 'leave'}),
            (log.has('a_z'), 'accelerometer', {'level': level}),
            (len(log.mocap), 'motion capture', {'mocap-offset': mocap not in ('auto', 'none')})):
        if not there:
            refuse_options(path, given, f'the log has no {what}')
    if log.has(*HORIZONTAL):
        refuse_options(path, {'level': level}, 'the log has the horizontal accelerations')


def _contradictions(log: Log, moving: dict[str, Pair], offset: float) -> list[str]:
    """Return what of the drone contradicts its motion capture with an offset, in words."""
    times, out = log.mocap[:, 0] + offset, []
    if log.has('r'):
        t, r = log.drone['r']
        position = interpolate(t, times, log.mocap[:, 1:4], 2.0 * GAP)
        both = np.isfinite(position).all(axis=1) & (r > 0.0)
        out.append(height_check.other_axis(r[both], position[both]))
    if log.has('p_x', 'p_y'):
        out.append(plausible.mirrored(*_paths(log, offset)))
    if log.has(*RATES):
        t = log.drone['w_x'][0]
        run = _motors_run(log)
        t = t[(t >= run[0]) & (t <= run[1])]
        try:
            gyro_check.refuse(gyro_check.compare(
                t, log.at(t, 'w_x', 'w_y', 'w_z'), times, np.array(_attitude(log.mocap[:, 4:]))))
        except AlignError as error:
            out.append(str(error))
    out.append(clock_check.contradiction(moving, offset))
    return [text for text in out if text]


def _same_flight(log: Log, offset: float) -> same_flight.Verdict:
    """Return what of the drone is not of the flight of its motion capture with an offset."""
    tracked = Motion('optitrack/pose', stamps_ns(log.mocap[:, 0] + offset), log.mocap[:, 1:4],
                     np.array(_attitude(log.mocap[:, 4:])))
    gyro, own = None, []
    if log.has(*RATES):
        t, (begin, end) = log.drone['w_x'][0], _motors_run(log)
        t = t[(t >= begin) & (t <= end)]
        gyro = t, log.at(t, *RATES)
    if log.has(*ODOMETRY):
        t, state = _state(log)
        own.append(Motion('onboard/odom', stamps_ns(t), state[:, :3],
                          np.array(_attitude(state[:, 3:6])).reshape(-1, 4)))
    return same_flight.check(tracked, gyro, _heights(log)[:2] if log.has('r') else None, own)


def _state(log: Log) -> tuple[Floats, Floats]:
    """Return when the drone estimates its state, s, and ``ODOMETRY`` then, (n, 12)."""
    t = log.drone[ODOMETRY[0]][0]
    state = log.at(t, *ODOMETRY)
    known = np.isfinite(state).all(axis=1)
    return t[known], state[known]


def _motors_run(log: Log) -> tuple[float, float]:
    """Return from when to when the motors run, s; a vehicle that is carried away is hidden."""
    if log.has(*MOTORS):
        t = log.drone[MOTORS[0]][0]
        on = t[(np.nan_to_num(log.at(t, *MOTORS)) > 0.0).any(axis=1)]
        if len(on):
            return float(on[0]), float(on[-1])
    return -math.inf, math.inf


def _aligned(path: Path, log: Log, asked: str) -> tuple[float | None, dict[str, Any]]:
    """Return the offset of the motion capture, None to leave it out, with a remark."""
    if asked == 'none' or not len(log.mocap):
        return None, {'mocap': 'none in the log' if asked != 'none' else 'left out'}
    if asked not in ('auto', 'gyro'):
        _check_offset(path, log, float(asked))
        return float(asked), {'mocap_offset_s': float(asked), 'mocap_offset_from': 'given'}
    details: dict[str, Any] = {'mocap_offset_from': 'gyro'}
    try:
        by_range, reason = _range_offset(log, asked)
        if by_range is not None:
            found = by_range
            most_precise({RANGE: found, **_gyro_offsets(log)[0]}, {RANGE: RANGE_LATE})
            height = float(np.median(log.mocap[:, 3]))
            details['range_minus_mocap_z_m'] = found.bias + (found.factor - 1.0) * height
            if not 1.0 / SCALE < found.factor < SCALE:
                details['range_over_mocap_z'] = (
                    f'{found.factor:.3f}, not 1: check the scale of the motion capture')
            if asked == 'gyro':
                found = gyro_offset(log, found.offset)
            else:
                found = found._replace(sigma=math.hypot(found.sigma, RANGE_LATE))
                details['mocap_offset_from'] = RANGE
        else:
            found, details['range_not_used'] = gyro_offset(log), reason
    except AlignError as error:
        raise BagError(f'{path}: the motion capture cannot be aligned: {error}; give '
                       '--mocap-offset SECONDS, or none to leave it out') from None
    return found.offset, {
        'mocap_offset_s': found.offset, 'mocap_offset_sigma_s': found.sigma,
        'mocap_offset_correlation': found.quality, **details}


def _checked(path: Path, log: Log, asked: str) -> tuple[float | None, dict[str, Any]]:
    """Return the same if nothing of the drone contradicts it; a given offset with a remark."""
    given = asked not in ('auto', 'gyro')
    if asked == 'none' or not len(log.mocap):
        return _aligned(path, log, asked)
    moving = _moving(log)
    rate = clock_check.wrong_rate(moving)
    if rate and not given:
        raise BagError(f'{path}: {rate}, or give --mocap-offset SECONDS to take the motion '
                       'capture as it is, or none to leave it out')
    offset, details = _aligned(path, log, asked)
    beside = _same_flight(log, offset)
    doubts = [text for text in (rate, *_contradictions(log, moving, offset), beside.refuted)
              if text]
    if doubts and not given:
        raise BagError(f'{path}: {doubts[0]}; or give --mocap-offset {offset:.3f} to take the '
                       'motion capture as it is, or none to leave it out')
    if doubts:
        details['mocap_taken_as_it_is'] = '; '.join(doubts)
    if beside.doubts:
        details['mocap_doubtful'] = '; '.join(beside.doubts)
    if not given:
        details['mocap_offset_sigma_s'] = _sigma(path, log, details)
    return offset, details


def _sigma(path: Path, log: Log, details: dict[str, Any]) -> float:
    """Return the standard error of the offset, s, with its change within the flight."""
    alike = [_turn_rates(log)]
    if 'range_not_used' not in details:
        alike.append({RANGE: _heights(log)})
    offset, sigma = details['mocap_offset_s'], details['mocap_offset_sigma_s']
    try:
        sigma = math.hypot(sigma, max(clock_check.change(pairs, offset, {})
                                      for pairs in alike))
        refuse_uncertain(offset, sigma)
    except AlignError as error:
        raise BagError(f'{path}: {error}; give --mocap-offset SECONDS, or none to leave the '
                       'motion capture out') from None
    return sigma


def _left_out(log: Log) -> list[str]:
    """Return a line for each pitch of which values beyond a quarter turn are left out."""
    return [f'{log.source(name)}: {count} value{"s" * (count != 1)} beyond a quarter turn left out'
            for name, count in log.steep.items()]


def _not_read(log: Log) -> list[str]:
    """Return a line about signals that may be the motor commands, where none are read."""
    if any(map(log.has, MOTORS)) or not (found := like_commands(log.ignored)):
        return []
    return [f'motor_pwm: none is read, but {", ".join(found)} may be commands: rename them to '
            'motor.m1 to motor.m4 if they are the counts of the firmware, 0 to 65535']


def _parameters(counts_per_radian: float) -> dict[str, str]:
    """Return the estimator's parameter file, which takes a radian for ``DATA_SHEET`` counts."""
    factor = min(max(counts_per_radian / DATA_SHEET, 0.1), 10.0)  # range of the parameter
    return estimator_parameters('crazyflie', {'joint': {'optical_flow': {'scale': factor}}})


def import_crazyflie(
    source: Path, target: Path, counts_per_radian: float = COUNTS_PER_RADIAN,
    mocap: str = 'auto', level: bool = False, repeated_flow: str = 'leave',
) -> tuple[dict[str, int], dict[str, str]]:
    """
    Write a bag from a Crazyflie log.

    Parameters
    ----------
    source
        JSON file.
    target
        Directory to make.
    counts_per_radian
        Counts of the flow sensor per radian.
    mocap
        What to add to the clock of the motion capture, s; ``auto``: found by the range;
        ``gyro``: by the gyro; ``none``: leave the motion capture out.
    level
        Whether the horizontal accelerations, not in the log, are 0 instead of NaN.
    repeated_flow
        ``leave`` out counts that repeat, or take them for ``zero``: the sensor saw no motion.

    Returns
    -------
    {topic: messages}; the metadata record ``import``.

    Raises
    ------
    BagError
        If the log is not usable or cannot be aligned; nothing is written then.
    mambo_bags.writer.BagWriterError
        If the target exists.

    """
    file = read_source(source)
    log = read_log(file)
    _refuse_unused(source, log, counts_per_radian, mocap, level, repeated_flow)
    offset, details = _checked(source, log, mocap)
    if offset is not None and (slip := slips.describe(
            'motion capture', log.mocap[:, 0] + offset, log.mocap[:, 1:4])):
        details['mocap_slip'] = slip[0]
    if log.has('a_z') and (unusual := plausible.unusual(
            log.source('a_z'), 'accel', log.drone['a_z'][1])):
        details['accelerometer'] = unusual[0]
    record = provenance(source.name, file.sha256, 'import_crazyflie', 'Crazyflie JSON log', {
        'counts_per_radian': counts_per_radian, 'flow_period_s': FLOW_PERIOD,
        'flow_rotation': 'not compensated', 'horizontal_acceleration': '0' if level else 'NaN',
        ONLY_CHANGES: 'sonar/range' + (', optical_flow' if repeated_flow != 'zero' else ''),
        'repeated_flow': repeated_flow, 'motor_pwm_unit': 'counts, 0 to 65535',
        'mocap_frames_lost': log.lost, 'mocap_poses_impossible': log.impossible,
        **({'mocap_poses_frozen': log.still} if log.still else {}),
        **({'mocap_poses_turned': '; '.join(log.turned)} if log.turned else {}),
        'ignored': ', '.join(log.ignored) or 'nothing', **details,
        **({'layout': "of the course's first years: times in ms, o_x for p_x"}
           if log.former else {}),
        **({'beyond_quarter_turn': '; '.join(_left_out(log))} if log.steep else {}),
        **({'not_begun': f'onboard/odom: {log.before} samples left out at the start: its pose is '
                         '0 there, as its estimate has not begun'} if log.before else {}),
        **{key: '; '.join(lines) for key, lines in (
            ('two_sources', log.doubled), ('commands', _not_read(log)),
            ('incomplete', crazyflie_doubts.incomplete(log)),
            ('unusual', crazyflie_doubts.unusual(log) + _other_scale(log, offset))) if lines}})
    with BagWriter(target, _parameters(counts_per_radian), record) as writer:
        out = Publisher(writer, {name: kind for name, kind in TOPICS.items()
                                 if name != 'battery' or log.has(BATTERY)})
        _publish_imu(log, out, level)
        _publish_sensors(log, out, counts_per_radian, repeated_flow)
        _publish_onboard(log, out)
        if offset is not None:
            _publish_mocap(log, out, offset)
        if not writer.counts[f'{NAMESPACE}/imu/data_raw']:
            raise BagError(f'{source}: the three axes of the gyro are never within {GAP:g} s of '
                           'each other: check their times, in s')
        return writer.counts, record['import']


def _offset(text: str) -> str:
    if text not in ('auto', 'gyro', 'none') and not abs(float(text)) <= LONGEST:
        raise argparse.ArgumentTypeError(
            f'{text} is neither auto, gyro, none nor up to {LONGEST:g} seconds')
    return text


def parser() -> Parser:
    """Return the command line."""
    out = importer_parser('import_crazyflie', __doc__, 'log', 'JSON file of a flight')
    out.add_argument('--counts-per-radian', type=real(1.0, 1e5), default=COUNTS_PER_RADIAN,
                     metavar='N', help='of the flow sensor (default: %(default).4g)')
    out.add_argument('--mocap-offset', type=_offset, default='auto', metavar='SECONDS',
                     help='to add to its clock; auto: by the range, gyro: by the gyro, none: '
                          'leave it out (default: %(default)s)')
    out.add_argument('--level', action='store_true',
                     help='take the horizontal accelerations, where not in the log, for 0')
    out.add_argument('--repeated-flow', choices=('leave', 'zero'), default='leave',
                     help='counts that repeat: leave them out, or take them for zero, the '
                          'sensor having seen no motion (default: %(default)s)')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``import_crazyflie``; return the exit code."""
    options = parser().parse_args(arguments)

    def work() -> None:
        """Import, and print a summary."""
        counts, details = import_crazyflie(
            options.log, options.output, options.counts_per_radian, options.mocap_offset,
            options.level, options.repeated_flow)
        notes = [f'{key}: {details[key]}' for key in details if key.startswith(
            ('layout', 'mocap', 'range', 'accelerometer'))]
        for key in ('beyond_quarter_turn', 'not_begun', 'two_sources', 'commands', 'incomplete',
                    'unusual'):
            notes += details[key].split('; ') if key in details else []
        ignored = [] if details['ignored'] == 'nothing' else details['ignored'].split(', ')
        notes += [about.describe('optitrack/pose', count) for about, key in (
            (outliers, 'impossible'), (frozen, 'frozen'))
            if (count := int(details.get(f'mocap_poses_{key}', 0)))]
        told = {line.partition(':')[0] for line in details.get('unusual', '').split('; ')}
        notes += [line for line in bag_doubts.imported(options.output, True)
                  if line.partition(':')[0] not in told]  # there by the names in the log
        report(options.log, options.output, counts, *notes, *unused(ignored))

    return guard('import_crazyflie', work)


if __name__ == '__main__':
    raise SystemExit(main())
