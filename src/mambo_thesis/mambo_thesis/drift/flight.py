"""
A flight as evidence: the true motion from Optitrack at each sample of the optical flow.

The velocity is the derivative of a local cubic over about 0.13 s
(:func:`mambo_signals.derivative.local_fit`), which has no time lag. The angular rate comes from
the gyro, with its bias removed by comparison with Optitrack, or from Optitrack if there is no
gyro. The gyro is averaged over 15 ms, which leaves a third of its vibration from sample to sample.
A longer average would be correlated with the flow noise: this noise steers the vehicle, and the
average contains later samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
import math
from pathlib import Path
from typing import NamedTuple

from mambo_analysis.identify import flow_doubts
from mambo_analysis.identify.flow import check_axes, Samples
from mambo_analysis.identify.recording import read_sensors, Stream
from mambo_analysis.identify.regression import IdentifyError
from mambo_analysis.identify.sensors.statistics import jackknife
from mambo_bags.mcap_reader import BagError
from mambo_bags.reader import Bag, read_bag
from mambo_flight.closed_loop import Recording
from mambo_model.frames import flip_vector
from mambo_signals import motion
from mambo_signals.derivative import body_rates, local_fit
from mambo_signals.resample import columns_at, inside_gaps
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.signal import savgol_coeffs
from scipy.spatial.transform import Rotation, Slerp

from .mechanisms import level_part
from .paths import Array, Track

SMOOTH = 0.13        # s, window of the local cubic
GYRO_MEAN = 0.015    # s, window of the average of the gyro
MIN_HEIGHT = 0.45    # m: the sensor measures nothing below 0.4 m
MIN_COSINE = 0.7     # of the tilt, the limit of the estimator
MIN_SAMPLES = 100
LAGS = np.arange(-0.02, 0.1501, 0.0025)  # s
EDGE = 0.8           # residual's power at an end of LAGS over that in the middle: it lags more
RATIOS = (0.6, 1.7)
"""Flow over velocity by height, of any sensor [-]: those known have 0.94 (Parrot) to 1.52 (a
Crazyflie's, of Q = 0.66); half and twice are another unit."""


class Flight(NamedTuple):
    """
    Flow and true motion of one flight.

    Attributes
    ----------
    name
        Name of the bag.
    track : n instants
        True motion at the samples of the flow, in time order.
    flow : (n, 2) rad/s, body x forward and y right
        Measured flow, or the flow equivalent to an estimate (:func:`from_estimate`).
    heights : (m, 2) s, m
        Height over time, sampled more densely than the track, to look up earlier heights.
    velocity_noise : m/s
        Standard deviation of a velocity component, from the residuals of the local cubic.
    rate_noise : rad/s
        Standard deviation of the angular rate about x and y, from third differences of means.
    impossible
        Number of impossible Optitrack poses that were rejected.

    """

    name: str
    track: Track
    flow: Array
    heights: Array
    velocity_noise: float
    rate_noise: float = 0.0
    impossible: int = 0

    def height_before(self, lag: float) -> Array:
        """Return the height ``lag`` seconds earlier, (n,) m."""
        return np.interp(self.track.t - lag, *self.heights.T) if lag else self.track.height


class Poses(NamedTuple):
    """Poses of the vehicle in time order, inertial NED and body FRD."""

    t: Array          # (n,) s
    position: Array   # (n, 3) m
    rotation: Rotation


class Smooth(NamedTuple):
    """Positions on an even grid with their velocity, NaN in gaps."""

    t: Array         # (n,) s
    position: Array  # (n, 3) m
    velocity: Array  # (n, 3) m/s
    known: NDArray[np.bool_]  # (n,), False in gaps
    noise: float     # m/s, standard deviation of a velocity component


def smoothed(poses: Poses) -> Smooth:
    """
    Return positions on an even grid with their velocity.

    Raises
    ------
    BagError
        If the poses cover less than a second or are fewer than 30.

    """
    period = float(np.median(np.diff(poses.t))) if len(poses.t) > 1 else 1.0
    if len(poses.t) * period < 1.0 or len(poses.t) < 30:
        raise BagError(f'only {len(poses.t)} Optitrack poses: at least 1 s and 30 poses are '
                       'needed')
    t = np.arange(poses.t[0], poses.t[-1], period)
    width = max(2 * round(0.5 * SMOOTH / period) + 1, 7)
    position, velocity = local_fit(poses.t, poses.position, t, width * period, 3)
    known = np.isfinite(velocity).all(axis=1)
    if not known.any():
        raise BagError('Optitrack poses have too many gaps: 0.13 s without a gap are needed')
    middle, slope = (savgol_coeffs(width, 3, deriv=d, delta=period) for d in (0, 1))
    raw = columns_at(t, poses.t, poses.position)
    residual = np.nanmedian(np.abs(raw - position)) / 0.6745
    noise = residual / np.sqrt(max(1.0 - middle[width // 2], 1e-3))  # of a single pose
    return Smooth(t, position, velocity, known, float(noise * np.linalg.norm(slope)))


def _rates(poses: Poses, gyro: Stream | None) -> tuple[Array, Array, float]:
    """Return times, body rates, (n, 3) rad/s, and their noise: gyro minus bias, or Optitrack."""
    t, tracked = body_rates(poses.t, poses.rotation.as_quat())
    if gyro is None or len(gyro.t) < 2:
        return t, tracked, rate_noise(tracked)
    count = 2 * int(0.5 * GYRO_MEAN / np.median(np.diff(gyro.t))) + 1
    means = uniform_filter1d(gyro.values, count, axis=0)
    return gyro.t, means - np.nanmedian(
        columns_at(t, gyro.t, gyro.values) - tracked, axis=0), rate_noise(means[::count])


def rate_noise(rates: Array) -> float:
    """Return the white noise of rates, (n, 3) rad/s, about x and y; slow motion does not count."""
    differences = np.diff(rates[:, :2], n=3, axis=0)
    return float(np.median(np.abs(differences)) / 0.6745 / np.sqrt(20.0))  # 1 + 9 + 9 + 1


def assemble(
    name: str, poses: Poses, flow: Stream, gyro: Stream | None = None, lag: float = 0.0,
    height: Stream | None = None, min_height: float = MIN_HEIGHT,
) -> Flight:
    """
    Assemble a flight from poses, flow and gyro.

    Parameters
    ----------
    name
        Name of the flight, for messages.
    poses
        Poses from Optitrack.
    flow : values (n, 2) rad/s, body FRD; NaN: no value
    gyro : values (m, 3) rad/s, body FRD
    lag : s
        Lag of the flow: a sample belongs to the motion this much before its stamp.
    height : values (k,) m
        Height above the floor; None: -z of Optitrack.
    min_height : m
        Samples below this height are left out.

    Raises
    ------
    BagError
        If fewer than ``MIN_SAMPLES`` samples of the flow have a pose or are above min_height.

    """
    try:
        grid = smoothed(poses)
    except BagError as error:
        raise BagError(f'{name}: {error}') from None
    valid = np.isfinite(flow.values).all(axis=1)
    t, values = flow.t[valid] - lag, flow.values[valid]
    heights = np.column_stack([grid.t, -grid.position[:, 2]])[grid.known]
    if height is not None:
        valid = np.isfinite(height.values)
        heights = np.column_stack([height.t[valid], height.values[valid]])
    inside = (t > max(grid.t[0], poses.t[0])) & (t < min(grid.t[-1], poses.t[-1]))
    t, values = t[inside], values[inside]
    rates = _rates(poses, gyro)
    track = columns_at(t, grid.t, np.hstack([grid.position, grid.velocity]))
    turning = columns_at(t, *rates[:2])
    known = np.isfinite(np.hstack([track, turning])).all(axis=1)
    known &= ~inside_gaps(poses.t, t)
    t, values, turning = t[known], values[known], turning[known]
    position, velocity = track[known, :3], track[known, 3:]
    if len(t) < MIN_SAMPLES:
        raise BagError(f'{name}: only {len(t)} samples of optical flow have an Optitrack pose; '
                       f'{MIN_SAMPLES} are needed')

    position[:, 2] = -np.interp(t, *heights.T)
    track = Track(t, position, velocity, Slerp(poses.t, poses.rotation)(t).as_matrix(), turning)
    flying = (track.height > min_height) & (track.R[:, 2, 2] > MIN_COSINE)
    if flying.sum() < MIN_SAMPLES:
        raise BagError(f'{name}: only {flying.sum()} samples of optical flow are above '
                       f'{min_height:g} m and not tilted too far; {MIN_SAMPLES} are needed')
    return Flight(name, track.part(flying), values[flying], heights, grid.noise,
                  rates[2])


class Source(NamedTuple):
    """The streams of a bag from which a flight is assembled; see :func:`assemble`."""

    name: str
    poses: Poses
    flow: Stream
    gyro: Stream | None
    height: Stream | None = None
    impossible: int = 0  # number of rejected poses

    def flight(self, lag: float, min_height: float = MIN_HEIGHT) -> Flight:
        """Return the flight for a given lag of the flow, s."""
        found = assemble(
            self.name, self.poses, self.flow, self.gyro, lag, self.height, min_height)
        return found._replace(impossible=self.impossible)


def _log_residual(f: Flight) -> float:
    """Return ln of the mean square residual of the flow, fitted by terms of all mechanisms."""
    omega, nu, Z = f.track.omega, f.track.nu[:, :2], f.track.depth[:, None]
    rotation, exact, power = np.column_stack([omega[:, 1], -omega[:, 0]]), nu / Z, 0.0
    for axis in range(2):
        terms = np.column_stack([term[:, axis] for term in (
            exact, nu, exact / Z, exact**3, rotation, level_part(f.track) / Z,
            np.ones_like(nu))])
        best = np.linalg.lstsq(terms, f.flow[:, axis], rcond=None)[0]
        power += float(np.mean((f.flow[:, axis] - terms @ best)**2))
    return float(np.log(max(power, 1e-12)))


def flow_lag(sources: Sequence[Source], min_height: float = MIN_HEIGHT) -> float:
    """
    Return the lag of the flow behind the motion, s: the one with the smallest residual.

    The lag belongs to the sensor and is the same in all flights. A slow flight alone hardly
    determines it.

    Raises
    ------
    BagError
        If flights that determine it clearly have a lag outside of ``LAGS``.

    """
    cost = [sum(len(s.flow.t) * _log_residual(
        s._replace(height=None).flight(float(lag), min_height)) for s in sources) for lag in LAGS]
    best, count = int(np.argmin(cost)), sum(len(s.flow.t) for s in sources)
    if best in (0, len(cost) - 1) and (
            cost[best] - cost[len(cost) // 2] < count * math.log(EDGE)):
        raise BagError(
            f'{", ".join(s.name for s in sources)}: the flow lags by {1e3 * LAGS[best]:.0f} ms or '
            f'{"less" if best == 0 else "more"}, the end of the search: align the clocks with '
            'mambo join, check the nose of the tracked body, or give --flow-lag')
    k = int(np.clip(best, 1, len(cost) - 2))
    before, here, after = cost[k - 1:k + 2]
    bend = before - 2.0 * here + after
    return float(LAGS[k] + (0.5 * (before - after) / bend if bend > 0.0 else 0.0) * 0.0025)


def from_recording(name: str, r: Recording, begin: float = 8.0) -> Flight:
    """Return a flight of :func:`mambo_flight.closed_loop.fly` from the time ``begin`` [s] on."""
    t = r.t * 1e-9
    on = t >= begin
    posed = on & np.isfinite(r.pose[:, 0])
    w, x, y, z = r.pose[posed, 3:].T
    poses = Poses(r.pose_t[posed] * 1e-9, r.pose[posed, :3],
                  Rotation.from_quat(np.column_stack([x, y, z, w])))
    new = on & (r.flow[:, 2] > 0.0)
    return assemble(name, poses, Stream(t[new], r.flow[new, :2]), Stream(t[on], r.imu[on, :3]))


def from_estimate(flight: Flight, t: Array, position: Array) -> Flight:
    """
    Return a flight whose flow is replaced by the flow equivalent to a position estimate.

    The velocity of the estimate is rotated to body axes with the attitude from Optitrack and
    divided by the depth. If the estimator applied (5.2) without error, this is the exact flow.

    Parameters
    ----------
    flight
        Flight with the true motion.
    t, position : (m,) s, (m, 3) m, inertial NED
        Estimated positions in the axes of Optitrack.

    """
    level = Rotation.from_quat(np.tile([0.0, 0.0, 0.0, 1.0], (len(t), 1)))
    grid = smoothed(Poses(t, position, level))
    velocity = columns_at(flight.track.t, grid.t, grid.velocity[:, :2])
    known = np.isfinite(velocity).all(axis=1)
    track = flight.track.part(known)
    return flight._replace(track=track, flow=flow_of(track, velocity[known]))


def flow_of(track: Track, velocity: Array) -> Array:
    """Return the flow, (n, 2) rad/s, for which (5.2) gives a horizontal velocity, (n, 2) m/s."""
    inertial = np.column_stack([velocity, track.velocity[:, 2]])
    return np.einsum('nji,nj->ni', track.R, inertial)[:, :2] / track.depth[:, None]


def check(f: Flight) -> None:
    """
    Check that flow and motion capture saw one motion, in one unit and in the same axes.

    A mechanism changes the flow by a few percent; a probability over mechanisms means nothing of a
    flow that is another multiple of the motion, or turned against it.

    Raises
    ------
    BagError
        In one line that names the flight and what is wrong.

    """
    track = f.track
    seen = Samples(track.t, f.flow, track.nu[:, :2], track.height, track.depth,
                   np.column_stack([track.omega[:, 1], -track.omega[:, 0]]))
    try:
        check_axes(seen, leak=True)
    except IdentifyError as error:
        raise BagError(f'{f.name}: {error}') from None
    geometric = seen.velocity / seen.depth[:, None]
    terms = np.stack([geometric, geometric ** 3, seen.rotation], axis=-1)  # of F and D
    terms, flow = terms - terms.mean(axis=0), f.flow - f.flow.mean(axis=0)

    def ratio(keep: NDArray[np.int64]) -> float:
        return float(np.linalg.lstsq(
            terms[keep].reshape(-1, 3), flow[keep].ravel(), rcond=None)[0][0])
    found = jackknife(ratio, len(flow))
    if found.high < RATIOS[0] or found.low > RATIOS[1]:
        raise BagError(
            f'{f.name}: the flow is {found.value:.2f} times velocity over height of the motion '
            f'capture, possible are {RATIOS[0]:g} to {RATIOS[1]:g}: check the units of both, or '
            'fly a larger motion')


def _source(path: Path, namespace: str | None, height: str, bag: Bag) -> Source:
    """Read the streams of a bag; raise BagError if flow, poses or sonar are missing."""
    sensors = read_sensors(path, namespace)
    if sensors.flow is None or 'optitrack/pose' not in bag:
        topic = 'optical_flow' if sensors.flow is None else 'optitrack/pose'
        raise BagError(f'{path}: no topic {topic}; optical_flow and optitrack/pose are needed')
    tracked = motion.read(bag, 'optitrack/pose')
    good = np.isfinite(tracked.quaternion).all(axis=1)
    if not good.any():
        raise BagError(f'{path}: optitrack/pose has no attitude; record the orientation too')
    x, y, z, w = tracked.quaternion[good].T
    position = np.column_stack(flip_vector(tuple(tracked.position[good].T)))
    poses = Poses(tracked.t[good], position, Rotation.from_quat(np.column_stack([x, -y, -z, w])))
    sonar_height = None
    if height == 'sonar':
        if sensors.sonar is None:
            raise BagError(f'{path}: no topic sonar/range; use --height optitrack')
        upright = poses.rotation.as_matrix()[:, 2, 2]
        cosine = columns_at(sensors.sonar.t, poses.t, upright[:, None])[:, 0]
        sonar_height = Stream(sensors.sonar.t, sensors.sonar.values * cosine)
    return Source(path.name, poses, sensors.flow, sensors.gyro, sonar_height, tracked.impossible)


def read(paths: Sequence[Path], namespace: str | None = None, lag: float | None = None,
         height: str = 'optitrack', min_height: float = MIN_HEIGHT,
         estimate: str | None = None) -> tuple[list[Flight], float]:
    """
    Read bags of one drone as evidence; return the flights and the lag of their flow, s.

    Parameters
    ----------
    paths, namespace
        See :func:`mambo_bags.reader.read_bag`.
    lag : s
        Lag of the flow, the same in all flights; None: find it.
    height
        ``optitrack``, or ``sonar`` to use the slant range as the depth Z.
    min_height : m
        Samples below this height are left out.
    estimate
        Topic of an estimate to examine in place of the flow.

    Raises
    ------
    BagError
        If flow or Optitrack is missing, too short, or of another motion (:func:`check`).

    """
    topics = ('optical_flow', 'optitrack/pose', 'sonar/range', 'imu/data_raw',
              *([estimate] if estimate else []))
    bags = [read_bag(path, topics, namespace) for path in paths]
    for bag in bags:
        if 'optical_flow' in bag and 'optitrack/pose' in bag:
            try:
                flow_doubts.refuse(bag)
            except IdentifyError as error:
                raise BagError(f'{bag.path}: {error}') from None
    sources = [_source(path, namespace, height, bag)
               for path, bag in zip(paths, bags, strict=True)]
    for (path, one), (again, other) in combinations(zip(paths, sources, strict=True), 2):
        if np.array_equal(one.flow.values, other.flow.values, equal_nan=True) and (
                np.array_equal(one.poses.position, other.poses.position)):
            raise BagError(f'{again}: the same flight as {path}: each is evidence once')
    if lag is None:
        lag = flow_lag(sources, min_height)
    flights = [source.flight(lag, min_height) for source in sources]
    if estimate:
        estimates = [motion.read(bag, estimate) for bag in bags]
        flights = [from_estimate(f, e.t, np.column_stack(flip_vector(tuple(e.position.T))))
                   for f, e in zip(flights, estimates, strict=True)]
    for one in flights:
        check(one)
    return flights, lag
