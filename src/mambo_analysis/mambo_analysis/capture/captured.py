"""Errors of an estimate against motion capture, where the true sensors are not known."""

from __future__ import annotations

import math
from typing import NamedTuple

from mambo_bags.reader import Bag
from mambo_estimation import filters
from mambo_flight import offline_replay
from mambo_model.frames import flip_vector, wire_quaternion
from mambo_signals import motion, time_offset
from mambo_signals.derivative import local_fit, POSITION
from mambo_signals.resample import columns_at, interpolate, longest_step
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Floats = NDArray[np.float64]
REST = (1.0, 0.3)   # s before take-off: begin and end of the rest that aligns the tilt


class Odometry(NamedTuple):
    """Stamps (n,) ns, position (n, 3) m, velocity (n, 3) m/s (FLU), orientation (n, 4) x y z w."""

    stamp: NDArray[np.int64]
    position: Floats
    velocity: Floats
    orientation: Floats


class Errors(NamedTuple):
    """Errors of an estimate against motion capture, from take-off to landing."""

    duration: float    # s
    horizontal: float  # m, rms
    drift: float       # m, horizontal, at the end
    height: float      # m, rms
    velocity: float    # m/s, rms of the two horizontal components, body axes
    tilt: float        # deg, rms


def replayed(bag: Bag, params: filters.Params) -> Odometry:
    """Replay a bag through an estimator and return its estimate, z up."""
    found = offline_replay.estimate(bag, params)
    columns = tuple(found.state.T)
    return Odometry(found.t, *(np.stack(vector, axis=1) for vector in (
        flip_vector(columns[:3]), flip_vector(columns[3:6]), wire_quaternion(columns[6:10]))))


def mocap_truth(bag: Bag) -> Odometry:
    """
    Return the motion capture of a bag on an even grid of its own period, with velocity.

    Values in gaps are NaN. Impossible poses are rejected (:func:`mambo_signals.motion.read`).
    """
    poses = motion.read(bag, 'optitrack/pose')
    posed = np.isfinite(poses.quaternion).all(axis=1)
    times = poses.t[posed]
    t = np.arange(times[0], times[-1], float(np.median(np.diff(times))))
    pose = columns_at(t, times, np.hstack([poses.position, poses.quaternion])[posed])
    _, v = local_fit(times, poses.position[posed], t, POSITION)
    known = np.isfinite(np.hstack([pose, v])).all(axis=1)
    q, velocity = pose[:, 3:], np.full(v.shape, np.nan)
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    velocity[known] = Rotation.from_quat(q[known]).inv().apply(v[known])
    return Odometry(np.rint(t * 1e9).astype(np.int64), pose[:, :3], velocity, q)


def range_offset(bag: Bag) -> float:
    """Return the height of the markers above the range sensor, m, that an import found; or NaN."""
    found = bag.metadata.get('import', {}).get('range_minus_mocap_z_m', math.nan)
    return -float(found)


def airborne(truth: Odometry) -> tuple[float, float]:
    """Return the times of take-off and landing, s; an end of the recording if one is missing."""
    t = truth.stamp * 1e-9
    return time_offset.flight_by_position(t, truth.position).within(t[0], t[-1])


class ErrorSeries(NamedTuple):
    """Error of an estimate at each of its steps that the motion capture saw, from take-off."""

    duration: float    # s
    t: Floats          # (n,) s
    horizontal: Floats  # (n, 2) m
    height: Floats     # (n,) m
    velocity: Floats   # (n, 2) m/s, body axes
    tilt: Floats       # (n, 3) rad, of the vertical in body axes


def error_series(
    estimate: Odometry, truth: Odometry, longest: float = math.inf, markers: float = math.nan,
) -> ErrorSeries:
    """
    Compare an estimate with motion capture from take-off to landing.

    Horizontal position and yaw are aligned at take-off, because no sensor measures them. The tilt
    is aligned at rest before take-off, because the marker deck is not mounted exactly level.

    Parameters
    ----------
    estimate, truth
        What is compared.
    longest : s
        End of the comparison after take-off.
    markers : m
        Height of the markers above the sensor whose height is estimated; NaN: unknown, and the
        heights are aligned at take-off, too.

    """
    gap, t = longest_step(truth.stamp), estimate.stamp * 1e-9
    start, end = airborne(truth)
    end = min(end, start + longest)
    columns = [interpolate(estimate.stamp, truth.stamp, x, gap) for x in truth[1:]]
    seen = np.isfinite(np.hstack(columns)).all(axis=1)
    inside = (t >= start) & (t <= end)
    whole, rest = inside & seen, seen & (t >= start - REST[0]) & (t <= start - REST[1])
    position, velocity, q = (x[whole] for x in columns)
    own = [x[whole] for x in estimate[1:]]
    ours, theirs = Rotation.from_quat(own[2]), Rotation.from_quat(q)
    turn = float(theirs[0].as_euler('ZYX')[0] - ours[0].as_euler('ZYX')[0])
    moved = Rotation.from_euler('z', turn).apply(own[0] - own[0][0])
    error = moved - (position - position[0])
    height = error[:, 2] if math.isnan(markers) else own[0][:, 2] - (position[:, 2] - markers)
    tilt = _tilt_error(own[2], q)
    mounted = _tilt_error(estimate.orientation[rest], columns[2][rest]) if rest.any() else tilt[:1]
    return ErrorSeries(
        float(t[inside][-1] - t[inside][0]), t[whole], error[:, :2], height,
        (own[1] - velocity)[:, :2], tilt - mounted.mean(axis=0))


def _tilt_error(own: Floats, true: Floats) -> Floats:
    """Return the difference of two verticals in body axes, (n, 3), of quaternions (n, 4)."""
    ours, theirs = Rotation.from_quat(own), Rotation.from_quat(true)
    return ours.inv().apply([0.0, 0.0, 1.0]) - theirs.inv().apply([0.0, 0.0, 1.0])


def errors(
    estimate: Odometry, truth: Odometry, longest: float = math.inf, markers: float = math.nan,
) -> Errors:
    """Return the errors of an estimate; arguments as of :func:`error_series`."""
    e = error_series(estimate, truth, longest, markers)
    off = np.linalg.norm(e.horizontal, axis=1)
    return Errors(
        e.duration, _rms(off), float(off[-1]), _rms(e.height),
        _rms(np.linalg.norm(e.velocity, axis=1)),
        math.degrees(_rms(np.linalg.norm(e.tilt, axis=1))))


def _rms(x: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(x))))
