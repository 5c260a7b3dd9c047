"""
Poses of the motion capture for the steps of an offline replay, paired as in the live estimator.

A step waits for the first watermark of the motion capture that is not older than itself, and gets
the newest pose that this watermark announces (:mod:`mambo_estimation.capture.pose_queue`). For a
bag without watermarks, e.g. of real hardware, the poses are paired as in ``replay_node``: a pose
that was logged before the next inertial sample belongs to the current one.
"""

from __future__ import annotations

from typing import NamedTuple

from mambo_bags.reader import Bag
from mambo_model import frames
from mambo_ros import topics
import numpy as np
from numpy.typing import NDArray


class Poses(NamedTuple):
    """A pose for each step; NaN: no pose."""

    age: NDArray[np.float64]   # (n,) s, age of the stamp
    pose: NDArray[np.float64]  # (n, 7) position m, quaternion w x y z; map, NED and FRD


def none(steps: int) -> Poses:
    """Return no poses, for a number of steps."""
    return Poses(np.full(steps, np.nan), np.full((steps, 7), np.nan))


def _announced(bag: Bag, t: NDArray[np.int64], logged: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the number of poses announced by each step, -1 without a watermark."""
    if topics.CAPTURE_TICK.name in bag:
        ticks = bag[topics.CAPTURE_TICK.name]
        count = ticks['poses'].astype(np.int64)
        if count[0] > 1:  # the recording began in flight: count from its first watermark
            count += np.searchsorted(logged, ticks.log_time[0], 'right') - count[0]
        first = np.searchsorted(ticks.stamp, t, 'left')
        return np.append(count, -1)[first]
    imu = bag[topics.IMU.name]
    new = np.flatnonzero(imu.stamp > np.maximum.accumulate(np.append(-1, imu.stamp))[:-1])
    nexts = np.append(imu.log_time[new[1:]], np.iinfo(np.int64).max)
    at = np.searchsorted(imu.stamp[new], t, 'left')
    return np.searchsorted(logged, nexts[np.minimum(at, len(nexts) - 1)], 'left')


def poses(bag: Bag, t: NDArray[np.int64]) -> tuple[Poses, int]:
    """
    Return the pose of each step of a bag, and the number of steps whose poses are complete.

    Parameters
    ----------
    bag
        Read with ``optitrack/pose``, ``optitrack/tick`` and ``imu/data_raw``.
    t : (n,) ns
        Stamps of the steps, increasing.

    """
    out = none(len(t))
    if topics.OPTITRACK.name not in bag:
        return out, len(t)
    seen = bag[topics.OPTITRACK.name]
    due = _announced(bag, t, seen.log_time)
    lost = np.flatnonzero((due < 0) | (due > len(seen.stamp)))
    whole = int(lost[0]) if len(lost) else len(t)
    rows = np.flatnonzero(np.diff(due[:whole], prepend=0) > 0)
    which = due[rows] - 1
    out.age[rows] = (t[rows] - seen.stamp[which]) * 1e-9
    out.pose[rows, :3] = np.stack(
        frames.flip_vector(tuple(seen.position[which].T)), axis=1)
    out.pose[rows, 3:] = np.stack(
        frames.body_quaternion(*seen.orientation[which].T), axis=1)
    return out, whole
