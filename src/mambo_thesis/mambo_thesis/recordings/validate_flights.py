r"""
The estimator on recorded flights: Crazyflie against motion capture, Rolling Spider against itself.

Everything the estimator is told about a Crazyflie is measured on one flight, then applied to the
others:

Flow
    The factor Q of (5.2) and the share of the rotation in the signal, fitted together; the
    residual is the noise of a sample.
Range
    Its noise is the residual of the range against the height of the motion capture.
Missing accelerations
    The logs hold the specific force along b3 alone; along the other two it is drag and taken
    for 0. What that leaves out follows from the motion capture, :math:`R^T (\dot v - g)`: its
    density at low frequency is the noise of the acceleration, its mean over a second that of
    a gravity window.

Inertial samples
    The logs have them each 10 or 20 ms, packets lost. Up to the 50 ms over which the import
    interpolates they count as measured.

Limits of the sensors are those of their data sheets (VL53L1x from 0.04 m, PMW3901 from 0.08 m,
at which no flight stays, hence 0.1 m). Nothing is adjusted to an error that is then reported.

The joint filter reads what it is told of a Crazyflie from ``crazyflie.yaml`` beside this module:
the same for every flight.
"""

from __future__ import annotations

from dataclasses import replace
import math
from pathlib import Path
from typing import NamedTuple

from mambo_analysis.compare.compare import align as made_equal
from mambo_analysis.identify import flow
from mambo_analysis.importers.crazyflie import COUNTS_PER_RADIAN, GAP, import_crazyflie
from mambo_analysis.importers.minidrone import import_minidrone
from mambo_bags.reader import Bag, read_bag
from mambo_estimation import filters
from mambo_estimation.joint.joint_parameters import JointParams
from mambo_estimation.kalman import EstimatorParams
from mambo_flight import offline_replay
from mambo_flight.scenario import from_yaml, load
from mambo_model.frames import flip_vector, wire_quaternion
from mambo_signals import motion, time_offset
from mambo_signals.derivative import local_fit, POSITION
from mambo_signals.resample import columns_at, interpolate, longest_run, longest_step
import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch
from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]
GRAVITY = 9.81   # m/s^2
SLOW = (0.2, 1.0)  # Hz, where the density of the missing acceleration is taken
WINDOW = 1.0     # s, of a gravity window
LOWEST, SLOWEST = 0.3, 0.02  # m, m/s: all that hovers is fitted, the interval says how well
DECK = 0.1       # m, lowest flow
NEAREST = 0.04   # m, shortest range
COUNTS = 409.0   # of the flow per radian, as the joint filter is told: 30 pixels over 4.2 deg
SQUARE = 15.0    # s after take-off: a square, before the landing
NEAR = 0.25      # s, of ranges whose median is the height of the sonar
SHIFTS = np.arange(-0.02, 0.1001, 0.02)  # s, of the flow behind the motion capture


class Odometry(NamedTuple):
    """Stamps (n,) ns, position (n, 3) m, velocity (n, 3) m/s (FLU), orientation (n, 4) x y z w."""

    stamp: NDArray[np.int64]
    position: Floats
    velocity: Floats
    orientation: Floats


class Errors(NamedTuple):
    """Of an estimate against the motion capture, from take-off to landing."""

    duration: float    # s
    horizontal: float  # m, rms
    drift: float       # m, horizontal, at the end
    height: float      # m, rms
    velocity: float    # m/s, rms of the two horizontal components, body axes
    tilt: float        # deg, rms


class Identified(NamedTuple):
    """What one flight says of sensors."""

    factor: flow.Factor
    height: float       # m, mean of the sensor in the samples
    lag: float          # s, by which the flow is behind
    range_noise: float  # m
    missing_density: float  # m/s^2/sqrt(Hz)
    missing_mean: float     # m/s^2


def replayed(bag: Bag, params: filters.Params) -> Odometry:
    """Return what the estimator makes of a bag, z up."""
    found = offline_replay.estimate(bag, params)
    columns = tuple(found.state.T)
    return Odometry(found.t, *(np.stack(vector, axis=1) for vector in (
        flip_vector(columns[:3]), flip_vector(columns[3:6]), wire_quaternion(columns[6:10]))))


def seen(bag: Bag) -> Odometry:
    """
    Return the motion capture of a bag on an even grid of its own period, with velocity.

    NaN in gaps; poses that cannot be true are left out
    (:func:`mambo_signals.motion.read`).
    """
    poses = motion.read(bag, 'optitrack/pose')
    told = np.isfinite(poses.quaternion).all(axis=1)
    times = poses.t[told]
    t = np.arange(times[0], times[-1], float(np.median(np.diff(times))))
    pose = columns_at(t, times, np.hstack([poses.position, poses.quaternion])[told])
    _, v = local_fit(times, poses.position[told], t, POSITION)
    known = np.isfinite(np.hstack([pose, v])).all(axis=1)
    q, velocity = pose[:, 3:], np.full(v.shape, np.nan)
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    velocity[known] = Rotation.from_quat(q[known]).inv().apply(v[known])
    return Odometry(np.rint(t * 1e9).astype(np.int64), pose[:, :3], velocity, q)


def airborne(truth: Odometry) -> tuple[float, float]:
    """Return take-off and landing, s; the ends of the recording where it does not show them."""
    t = truth.stamp * 1e-9
    found = time_offset.flight_by_height(t, truth.position[:, 2])
    return (t[0] if found.takeoff is None else found.takeoff,
            t[-1] if found.landing is None else found.landing)


def errors(estimate: Odometry, truth: Odometry, longest: float = math.inf) -> Errors:
    """
    Compare an estimate with the motion capture, from take-off to landing, or for ``longest`` s.

    Position and yaw are made equal at take-off: nothing that is measured tells them.
    """
    gap = longest_step(truth.stamp)
    start, end = airborne(truth)
    end = min(end, start + longest)
    inside = (estimate.stamp * 1e-9 >= start) & (estimate.stamp * 1e-9 <= end)
    stamps = estimate.stamp[inside]
    columns = [interpolate(stamps, truth.stamp, x, gap) for x in truth[1:]]
    whole = np.isfinite(np.hstack(columns)).all(axis=1)
    position, velocity, q = (x[whole] for x in columns)
    own = [x[inside][whole] for x in estimate[1:]]
    ours, theirs = Rotation.from_quat(own[2]), Rotation.from_quat(q)
    turn = float(theirs[0].as_euler('ZYX')[0] - ours[0].as_euler('ZYX')[0])
    moved = Rotation.from_euler('z', turn).apply(own[0] - own[0][0])
    off = moved - (position - position[0])
    aside = np.hypot(off[:, 0], off[:, 1])
    upright = ours.inv().apply([0.0, 0.0, 1.0]) - theirs.inv().apply([0.0, 0.0, 1.0])
    tilt = upright - upright[0]  # the marker deck is not mounted exactly level
    return Errors(
        float(stamps[-1] - stamps[0]) * 1e-9, _rms(aside), float(aside[-1]), _rms(off[:, 2]),
        _rms(np.linalg.norm((own[1] - velocity)[:, :2], axis=1)),
        math.degrees(_rms(np.linalg.norm(tilt, axis=1))))


def _rms(x: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


def bias_of_range(bag: Bag) -> float:
    """Return the height of the markers above the range sensor, m, as the import found it."""
    return -float(bag.metadata['import']['range_minus_mocap_z_m'])


def samples_of(path: Path, shift: float = 0.0) -> flow.Samples:
    """Return flow and motion of a Crazyflie bag, the poses ``shift`` s later."""
    deck = bias_of_range(read_bag(path, ()))
    return flow.read(path, deck, -np.inf, np.inf, shift, None, LOWEST)


def factor_of(samples: flow.Samples, law: str = 'constant') -> flow.Factor:
    """Return the factor of the flow, fitted with the share of the rotation."""
    return flow.fit_factor(samples, law, True, SLOWEST)


def missing(truth: Odometry) -> tuple[float, float]:
    """
    Return density [m/s^2/sqrt(Hz)] and mean over a window [m/s^2] of the force along b1 and b2.

    Its mean over the flight is left out: it is the tilt at which the markers are mounted. Of a
    flight with gaps the longest part without one counts.
    """
    start, end = airborne(truth)
    t = truth.stamp * 1e-9
    period = float(np.median(np.diff(t)))
    known = np.isfinite(truth.velocity).all(axis=1)
    v = Rotation.from_quat(truth.orientation[known]).apply(truth.velocity[known])
    _, a = local_fit(t[known], v, t, 0.0)
    inside = known & np.isfinite(a).all(axis=1) & (t >= start + 1.0) & (t <= end - 1.0)
    whole = longest_run(inside)
    force = Rotation.from_quat(truth.orientation[whole]).inv().apply(
        a[whole] + np.array([0.0, 0.0, GRAVITY]))[:, :2]
    force = force - force.mean(axis=0)
    f, power = welch(force, 1.0 / period, nperseg=min(len(force), round(8.0 / period)), axis=0)
    low = power[(f >= SLOW[0]) & (f <= SLOW[1])].mean()
    count = round(WINDOW / period)
    means = force[:len(force) // count * count].reshape(-1, count, 2).mean(axis=1)
    return math.sqrt(0.5 * low), _rms(means)


def identify(path: Path) -> Identified:
    """Return what a Crazyflie bag says of its sensors."""
    bag = read_bag(path)
    truth = seen(bag)
    found = [factor_of(samples_of(path, shift)) for shift in SHIFTS]
    lag = float(SHIFTS[int(np.argmin([one.fit.rms for one in found]))])
    samples = samples_of(path)
    ranges = bag['sonar/range']
    at = interpolate(ranges.stamp, truth.stamp, np.hstack(
        [truth.position, truth.orientation]), longest_step(truth.stamp))
    good = np.isfinite(at).all(axis=1)
    cosine = Rotation.from_quat(at[good, 3:]).as_matrix()[:, 2, 2]
    off = ranges['range'][good] * cosine - at[good, 2]
    return Identified(
        factor_of(samples), float(samples.height.mean()), lag,
        float(1.4826 * np.median(np.abs(off - np.median(off)))), *missing(truth))


def told(found: Identified) -> EstimatorParams:
    """Return the estimator of a drone whose sensors are known so."""
    p = EstimatorParams()
    return replace(
        p, imu=replace(p.imu, max_interval=GAP),
        sonar=replace(p.sonar, min_range=NEAREST, noise=found.range_noise),
        optical_flow=replace(
            p.optical_flow, min_height=DECK, constant=found.factor.offset.value,
            rotation_leak=found.factor.leak.value, noise=found.factor.fit.rms),
        velocity=replace(p.velocity, accel_noise=found.missing_density),
        attitude=replace(p.attitude, window_accel_noise=found.missing_mean))


def variants(found: Identified) -> dict[str, EstimatorParams]:
    """Return the estimators to be compared, by what they are told."""
    full = told(found)

    def with_flow(**changed: float | bool) -> EstimatorParams:
        return replace(full, optical_flow=replace(full.optical_flow, **changed))
    return {
        'as for the Mambo': EstimatorParams(),
        'Q = 1': with_flow(constant=1.0, rotation_leak=0.0),
        'identified Q': with_flow(rotation_leak=0.0),
        'identified Q and rotation': full,
        'the same without height': with_flow(
            constant=full.optical_flow.constant * found.height, height_scaling=False)}


def joint() -> JointParams:
    """Return what the joint filter is told of every Crazyflie."""
    return load(Path(__file__).with_name('crazyflie.yaml')).estimator_node.joint


def crazyflies(
    logs: list[Path], folder: Path, repeated_flow: str, counts: float = COUNTS_PER_RADIAN,
) -> dict[str, Path]:
    """Import logs with motion capture; return {name: bag}."""
    out = {}
    for log in logs:
        name = short(log)
        out[name] = folder / f'{name}_{repeated_flow}_{counts:.0f}'
        import_crazyflie(log, out[name], counts, level=True, repeated_flow=repeated_flow)
    return out


def short(path: Path) -> str:
    """Return the name of a recording without what tells the repository it comes from."""
    return path.stem.rsplit('__', 1)[0].removeprefix('crazyflie-client_')


def _calibrated(bag: Bag) -> EstimatorParams:
    """Return the parameters of the three filters with the calibration that a log holds."""
    own = bag.attachments.get('scenario.yaml')
    return from_yaml(own).estimator_node.kalman if own else EstimatorParams()


class Height(NamedTuple):
    """Of an estimate of a minidrone flight, beside its sonar."""

    off: float      # m, rms from the median of the ranges near in time, wherever one is valid
    lowest: float   # m
    highest: float  # m


def heights(log: Path, folder: Path) -> tuple[Height, Height]:
    """Return the heights by the three filters in a row and by the joint filter."""
    target = folder / f'{short(log)}_heights'
    import_minidrone(log, target)
    bag = read_bag(target)
    kalman = _calibrated(bag)
    first, second = (_height(offline_replay.steps(bag), params) for params in (
        kalman, replace(JointParams(), alignment=kalman.alignment)))
    return first, second


def _height(found: offline_replay.Steps, params: filters.Params) -> Height:
    """Return how far the height is from the sonar, and where it has been."""
    p = JointParams().sonar
    made = offline_replay.run(found, params)
    upright = Rotation.from_quat(made.state[:, [7, 8, 9, 6]]).as_matrix()[:, 2, 2]
    at = np.flatnonzero(
        (found.sonar >= p.min_range) & (found.sonar <= p.max_range) & (upright > p.min_tilt_cos))
    t, seen_from = found.t[at] * 1e-9, found.sonar[at] * upright[at]
    usual = [np.median(seen_from[np.abs(t - now) <= NEAR]) for now in t]
    height = made.estimator[:, 1]
    return Height(_rms(height[at] - usual), float(height.min()), float(height.max()))


def against_onboard(log: Path, folder: Path, flow_scale: float) -> list[float]:
    """
    Return how far the estimate of a minidrone flight is from the onboard one.

    Returns
    -------
    Duration in s; rms of the horizontal position and of the height in m, of the horizontal
    velocity in m/s, of roll and pitch and of yaw in deg.

    """
    target = folder / f'{short(log)}_{flow_scale:g}'
    import_minidrone(log, target, flow_scale)
    bag = read_bag(target)
    params = _calibrated(bag)
    off = made_equal(replayed(bag, params), bag['onboard/odom'])
    across = [_rms(np.linalg.norm(x[:, :2], axis=1)) for x in (off.position, off.velocity)]
    return [float(off.stamps[-1] - off.stamps[0]) * 1e-9, across[0], _rms(off.position[:, 2]),
            across[1], _rms(np.linalg.norm(off.attitude[:, :2], axis=1)),
            _rms(off.attitude[:, 2])]
