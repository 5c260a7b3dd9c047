"""
Poses of the motion capture for the steps of an offline replay, paired as in the live estimator.

A step waits for the first watermark of the motion capture that is not older than itself, and gets
the newest pose that this watermark announces (:mod:`mambo_estimation.capture.pose_queue`). For a
bag without watermarks, e.g. of real hardware, the poses are paired as in ``replay_node``: a pose
that was logged before the next inertial sample belongs to the current one, or to that of its stamp
if it is ahead.
"""

from __future__ import annotations

from typing import NamedTuple

from mambo_bags import playback
from mambo_bags.reader import Bag
from mambo_estimation.capture.pose_queue import PoseQueue
from mambo_model import frames
from mambo_ros import topics
import numpy as np
from numpy.typing import NDArray


class Poses(NamedTuple):
    """A pose for each step; NaN: no pose."""

    age: NDArray[np.float64]   # (n,) s, age of the stamp
    pose: NDArray[np.float64]  # (n, 7) position m, quaternion w x y z; map, NED and FRD


class _Row(NamedTuple):
    """A step, as the queue of poses takes it."""

    t: int  # ns
    k: int  # its row


class _Seen(NamedTuple):
    """The poses of a bag, in the order of the log."""

    stamp: NDArray[np.int64]  # (n,) ns
    log_time: NDArray[np.int64]  # (n,) ns
    position: NDArray[np.float64]  # (n, 3) m, map
    orientation: NDArray[np.float64]  # (n, 4) x y z w


def none(steps: int) -> Poses:
    """Return no poses, for a number of steps."""
    return Poses(np.full(steps, np.nan), np.full((steps, 7), np.nan))


def _read(bag: Bag) -> tuple[_Seen, playback.Marks | None]:
    """Return the poses of a bag without uncounted repeats, and its watermarks, None without."""
    found = bag[topics.OPTITRACK.name]
    seen = _Seen(found.stamp, found.log_time, found.position, found.orientation)
    if topics.CAPTURE_TICK.name not in bag:
        return seen, None
    marks = playback.watermarks(bag, topics.CAPTURE_TICK)
    if (kept := playback.kept(found, marks, 0)) is not None:
        seen = _Seen(*(column[kept] for column in seen))
    return seen, marks


def poses_announced(bag: Bag) -> tuple[int, int]:
    """Return how many poses the watermarks of a bag announce in all, and how many it has."""
    if topics.OPTITRACK.name not in bag:
        return int(bag[topics.CAPTURE_TICK.name]['poses'].max()), 0
    seen, marks = _read(bag)
    return 0 if marks is None else int(marks.due.max(initial=0)), len(seen.stamp)


def _announced(
    bag: Bag, seen: _Seen, marks: playback.Marks | None, t: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Return the number of poses announced by each step, -1 without a watermark."""
    if marks is not None:
        return np.append(marks.due[:, 0], -1)[np.searchsorted(marks.t, t, 'left')]
    imu = bag[topics.IMU.name]
    new = np.flatnonzero(playback.newer(imu.stamp))
    nexts = np.append(imu.log_time[new[1:]], np.iinfo(np.int64).max)
    counts = playback.announced(
        imu.stamp[new], np.searchsorted(seen.log_time, nexts, 'left')[:len(new), None],
        [seen.stamp])[:, 0]
    at = np.searchsorted(imu.stamp[new], t, 'left')
    return counts[np.minimum(at, len(counts) - 1)]


def _has_lost(
    seen: _Seen, marks: playback.Marks, t: NDArray[np.int64], due: NDArray[np.int64],
) -> bool:
    """Return whether a watermark announces a pose that is not in the bag, or is newer than it."""
    if (due > len(seen.stamp)).any():
        return True
    rows = np.flatnonzero(due > 0)
    at = np.searchsorted(marks.t, t[rows], 'left')
    return bool((seen.stamp[due[rows] - 1] > marks.t[at]).any())


def _queued(
    seen: _Seen, marks: playback.Marks, t: NDArray[np.int64],
) -> tuple[NDArray[np.int64], NDArray[np.int64], int]:
    """
    Return rows of steps, the pose of each, and the complete steps, as the live queue finds them.

    Poses and watermarks arrive in the order of the log, a step with the first watermark that is
    not older.
    """
    ready = np.searchsorted(t, marks.t, 'right').tolist()
    queue, found, pose, step = PoseQueue(), [], 0, 0
    for stamp, count, last, end in zip(
            marks.t.tolist(), marks.due[:, 0].tolist(), marks.logged[:, 0].tolist(), ready,
            strict=True):
        for k in range(pose, last):
            found += queue.add_pose(int(seen.stamp[k]), k, None)
        found += queue.add_steps([_Row(int(t[k]), k) for k in range(step, end)])
        found += queue.add_tick(stamp, count)
        pose, step = max(pose, last), max(step, end)
    for k in range(pose, len(seen.stamp)):
        found += queue.add_pose(int(seen.stamp[k]), k, None)
    pairs = [(row.k, pose.rho) for row, pose in found if pose is not None]
    rows, which = np.array(pairs, np.int64).reshape(-1, 2).T
    return rows, which, len(found)


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
    seen, marks = _read(bag)
    due = _announced(bag, seen, marks, t)
    if marks is not None and _has_lost(seen, marks, t, due):
        rows, which, whole = _queued(seen, marks, t)
    else:
        late = np.flatnonzero(due < 0)
        whole = int(late[0]) if len(late) else len(t)
        rows = np.flatnonzero(np.diff(due[:whole], prepend=0) > 0)
        which = due[rows] - 1
    out.age[rows] = (t[rows] - seen.stamp[which]) * 1e-9
    out.pose[rows, :3] = np.stack(
        frames.flip_vector(tuple(seen.position[which].T)), axis=1)
    out.pose[rows, 3:] = np.stack(
        frames.body_quaternion(*seen.orientation[which].T), axis=1)
    return out, whole
