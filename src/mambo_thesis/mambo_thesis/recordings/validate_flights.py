r"""
Errors of the estimator on recorded flights of the Crazyflie and the Rolling Spider.

The Crazyflie is compared with motion capture, the Rolling Spider with its onboard estimate. The
sensor parameters of the Crazyflie are identified on one flight and then used for all of them:

Flow
    The factor Q of (5.2) and the share of the rotation left in the signal are fitted together.
    The residual of the fit is the noise of a sample.
Range
    The noise is the residual of the range against the height from motion capture.
Missing accelerations
    The logs hold the specific force along b3 only. Along b1 and b2 it is mainly drag and is
    assumed to be 0. The neglected part follows from motion capture, :math:`R^T (\dot v - g)`: its
    density at low frequency is the noise of the acceleration, and its mean over a second is the
    noise of a gravity window.
Inertial samples
    The logs hold them every 10 or 20 ms, and packets are lost. The import interpolates gaps of up
    to 50 ms, and the interpolated samples count as measured.

The limits of the sensors come from their data sheets: VL53L1x from 0.04 m, PMW3901 from 0.08 m.
No flight stays at 0.08 m, so 0.1 m is used. No parameter is tuned to an error reported here.

The joint filter takes its parameters from the file that the importers attach to a bag
(``mambo_analysis/importers/estimators/``), for every flight of the vehicle.
"""

from __future__ import annotations

from dataclasses import replace
import math
from pathlib import Path
from typing import NamedTuple

from mambo_analysis.capture.captured import (
    airborne, mocap_truth, Odometry, range_offset, replayed)
from mambo_analysis.compare.compare import align
from mambo_analysis.identify import flow
from mambo_analysis.importers.common import ESTIMATORS
from mambo_analysis.importers.crazyflie import (
    COUNTS_PER_RADIAN, DATA_SHEET, GAP, import_crazyflie)
from mambo_analysis.importers.minidrone import import_minidrone
from mambo_bags.reader import read_bag
from mambo_estimation import filters
from mambo_estimation.joint.joint_parameters import JointParams
from mambo_estimation.kalman import EstimatorParams
from mambo_flight import offline_replay
from mambo_flight.scenario import from_yaml, load
from mambo_signals.derivative import local_fit
from mambo_signals.resample import interpolate, longest_run, longest_step
import numpy as np
from numpy.typing import NDArray
from scipy.signal import welch
from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]
GRAVITY = 9.81   # m/s^2
SLOW_BAND = (0.2, 1.0)   # Hz, band of the density of the missing acceleration
GRAVITY_WINDOW = 1.0     # s
MIN_FIT_HEIGHT = 0.3     # m
MIN_FIT_SPEED = 0.02     # m/s: low, so that hovering flights are fitted too; see their intervals
MIN_FLOW_HEIGHT = 0.1    # m
MIN_RANGE = 0.04         # m
JOINT_COUNTS = DATA_SHEET  # flow counts per radian for the joint filter
SQUARE_DURATION = 15.0   # s from take-off: the square is flown, the landing has not begun
MEDIAN_WINDOW = 0.25     # s: the sonar height is the median of the ranges within this time
NEAR = 0.3               # m: a height this near to that median agrees with it
FLOW_LAGS = np.arange(-0.02, 0.1001, 0.02)  # s, lags of the flow behind the motion capture to try


class Identified(NamedTuple):
    """Sensor parameters identified on one flight."""

    factor: flow.Factor
    height: float       # m, mean height of the flow sensor
    lag: float          # s, lag of the flow
    range_noise: float  # m
    missing_density: float  # m/s^2/sqrt(Hz)
    missing_mean: float     # m/s^2


def _rms(x: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


def samples_of(path: Path, shift: float = 0.0) -> flow.Samples:
    """Return flow and motion of a Crazyflie bag, with the poses delayed by ``shift`` seconds."""
    deck = range_offset(read_bag(path, ()))
    return flow.read(path, deck, -np.inf, np.inf, shift, None, MIN_FIT_HEIGHT)


def factor_of(samples: flow.Samples, law: str = 'constant') -> flow.Factor:
    """Fit the flow factor together with the share of the rotation left in the flow."""
    return flow.fit_factor(samples, law, True, MIN_FIT_SPEED)


def missing_force(truth: Odometry) -> tuple[float, float]:
    """
    Return density [m/s^2/sqrt(Hz)] and RMS window mean [m/s^2] of the force along b1 and b2.

    The force is the specific force that the logs do not hold. Its mean over the flight is removed,
    because it comes from the tilt at which the markers are mounted. If the motion capture has
    gaps, the longest part without one is used.
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
    low = power[(f >= SLOW_BAND[0]) & (f <= SLOW_BAND[1])].mean()
    count = round(GRAVITY_WINDOW / period)
    means = force[:len(force) // count * count].reshape(-1, count, 2).mean(axis=1)
    return math.sqrt(0.5 * low), _rms(means)


def identify(path: Path) -> Identified:
    """Identify the sensor parameters on a Crazyflie bag."""
    bag = read_bag(path)
    truth = mocap_truth(bag)
    found = [factor_of(samples_of(path, shift)) for shift in FLOW_LAGS]
    lag = float(FLOW_LAGS[int(np.argmin([one.fit.rms for one in found]))])
    samples = samples_of(path)
    ranges = bag['sonar/range']
    at = interpolate(ranges.stamp, truth.stamp, np.hstack(
        [truth.position, truth.orientation]), longest_step(truth.stamp))
    good = np.isfinite(at).all(axis=1)
    cosine = Rotation.from_quat(at[good, 3:]).as_matrix()[:, 2, 2]
    error = ranges['range'][good] * cosine - at[good, 2]
    return Identified(
        factor_of(samples), float(samples.height.mean()), lag,
        float(1.4826 * np.median(np.abs(error - np.median(error)))), *missing_force(truth))


def calibrated_params(found: Identified) -> EstimatorParams:
    """Return the estimator parameters for the identified sensors."""
    p = EstimatorParams()
    return replace(
        p, imu=replace(p.imu, max_interval=GAP),
        sonar=replace(p.sonar, min_range=MIN_RANGE, noise=found.range_noise),
        optical_flow=replace(
            p.optical_flow, min_height=MIN_FLOW_HEIGHT, constant=found.factor.offset.value,
            rotation_leak=found.factor.leak.value, noise=found.factor.fit.rms),
        velocity=replace(p.velocity, accel_noise=found.missing_density),
        attitude=replace(p.attitude, window_accel_noise=found.missing_mean))


def variants(found: Identified) -> dict[str, EstimatorParams]:
    """Return the estimator parameters to compare, by the name of their row."""
    full = calibrated_params(found)

    def with_flow(**changed: float | bool) -> EstimatorParams:
        return replace(full, optical_flow=replace(full.optical_flow, **changed))
    return {
        'as for the Mambo': EstimatorParams(),
        'Q = 1': with_flow(constant=1.0, rotation_leak=0.0),
        'identified Q': with_flow(rotation_leak=0.0),
        'identified Q and rotation': full,
        'the same without height': with_flow(
            constant=full.optical_flow.constant * found.height, height_scaling=False)}


def joint_params(vehicle: str) -> JointParams:
    """Return the parameters of the joint filter, the same for every flight of a vehicle."""
    return load(ESTIMATORS / f'{vehicle}.yaml').estimator_node.joint


def import_crazyflies(
    logs: list[Path], folder: Path, repeated_flow: str, counts: float = COUNTS_PER_RADIAN,
) -> dict[str, Path]:
    """Import logs that hold motion capture; return {name: bag}."""
    out = {}
    for log in logs:
        name = recording_name(log)
        out[name] = folder / f'{name}_{repeated_flow}_{counts:.0f}'
        import_crazyflie(log, out[name], counts, level=True, repeated_flow=repeated_flow)
    return out


def recording_name(path: Path) -> str:
    """Return the name of a recording without the name of the repository it comes from."""
    return path.stem.rsplit('__', 1)[0].removeprefix('crazyflie-client_')


class Height(NamedTuple):
    """Estimated height of a minidrone flight, compared with its sonar."""

    rms_error: float  # m, against the median of the sonar heights near in time
    near: float       # %, of the ranges whose median is within ``NEAR`` of it
    lowest: float     # m
    highest: float    # m
    t: Floats         # (n,) s, of the valid ranges
    error: Floats     # (n,) m, at each


def height_errors(log: Path, folder: Path) -> tuple[Height, Height]:
    """Return the height errors of the three cascaded filters and of the joint filter."""
    target = folder / f'{recording_name(log)}_heights'
    import_minidrone(log, target)
    bag = read_bag(target)
    node = from_yaml(bag.attachments['scenario.yaml']).estimator_node
    cascaded, joint = (_height(offline_replay.steps(bag), params)
                       for params in (node.kalman, node.joint))
    return cascaded, joint


def _height(found: offline_replay.Steps, params: filters.Params) -> Height:
    """Return the error of the estimated height against the sonar, and its range."""
    p = JointParams().sonar
    made = offline_replay.run(found, params)
    upright = Rotation.from_quat(made.state[:, [7, 8, 9, 6]]).as_matrix()[:, 2, 2]
    at = np.flatnonzero(
        (found.sonar >= p.min_range) & (found.sonar <= p.max_range) & (upright > p.min_tilt_cos))
    t, measured = found.t[at] * 1e-9, found.sonar[at] * upright[at]
    smoothed = [np.median(measured[np.abs(t - now) <= MEDIAN_WINDOW]) for now in t]
    height = made.estimator[:, 1]
    off = height[at] - smoothed
    return Height(_rms(off), 100.0 * float(np.mean(np.abs(off) <= NEAR)), float(height.min()),
                  float(height.max()), t, off)


def against_onboard(log: Path, folder: Path, flow_scale: float) -> list[float]:
    """
    Compare what the three filters make of a minidrone flight with the onboard estimate.

    Returns
    -------
    Duration in s, then RMS differences: horizontal position and height in m, horizontal velocity
    in m/s, tilt (roll and pitch) and yaw in deg.

    """
    target = folder / f'{recording_name(log)}_{flow_scale:g}'
    import_minidrone(log, target, flow_scale)
    bag = read_bag(target)
    params = from_yaml(bag.attachments['scenario.yaml']).estimator_node.kalman
    error = align(replayed(bag, params), bag['onboard/odom'])
    position, velocity, tilt = (_rms(np.linalg.norm(x[:, :2], axis=1)) for x in (
        error.position, error.velocity, error.attitude))
    return [float(error.stamps[-1] - error.stamps[0]) * 1e-9, position,
            _rms(error.position[:, 2]), velocity, tilt, _rms(error.attitude[:, 2])]
