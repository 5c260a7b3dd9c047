"""
Poses of the motion capture for the steps of the filter, whatever the order of arrival.

The watermark of the motion capture says how many poses have been published up to its stamp. A
step waits for the first watermark that is not older, and gets the newest pose that this one
announces. So what the filter computes is a function of stamped data, as of
:mod:`mambo_estimation.synchroniser`, and a lost pose is waited for no longer than there.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

from mambo_model.limits import AHEAD_NS
from mambo_model.motion.quaternion import Quat
from mambo_model.motion.vector import Vec3

from ..synchroniser import Step


def _nothing() -> None:
    """Do nothing."""


class SeenPose(NamedTuple):
    """A pose as it came."""

    t: int     # ns, its stamp
    rho: Vec3  # (3,) m, map, axes as of NED
    q: Quat    # (4,) w x y z, body to map


class PoseQueue:
    """
    Steps in, the same steps out, each with its pose or None.

    Parameters
    ----------
    watermark
        True: a step waits for the watermark. False (a driver that sends none): a step has the
        newest pose that has arrived.

    Attributes
    ----------
    pull
        As of :class:`mambo_estimation.synchroniser.Synchroniser`.

    """

    def __init__(self, watermark: bool = True) -> None:
        self._watermark = watermark
        self._steps: deque[Step] = deque()
        self._poses: deque[SeenPose | None] = deque()  # not yet announced
        self._ticks: deque[tuple[int, int]] = deque()
        self._received = 0
        self._offset: int | None = None
        self._bound = -1  # ns, above which a pose is ahead of the newest watermark
        self.pull: Callable[[], Any] = _nothing

    def add_steps(self, steps: list[Step]) -> list[tuple[Step, SeenPose | None]]:
        """Queue steps; return those that are complete."""
        self._steps.extend(steps)
        return self._completed()

    def add_pose(self, t: int, rho: Vec3, q: Quat) -> list[tuple[Step, SeenPose | None]]:
        """Queue a pose; stamp in ns, then as of :class:`SeenPose`."""
        return self._add(SeenPose(t, rho, q))

    def skip(self) -> list[tuple[Step, SeenPose | None]]:
        """Count a pose that arrived but cannot be read."""
        return self._add(None)

    def add_tick(self, t: int, count: int) -> list[tuple[Step, SeenPose | None]]:
        """
        Queue a watermark: ``count`` poses were published up to ``t``, ns.

        A consumer that joins a running flight takes what it has seen by its first watermark as
        complete.
        """
        if self._offset is None:
            self._offset = 0 if count <= 1 else count - self._received
        self._ticks.append((t, count))
        self._bound = t + AHEAD_NS
        return self._completed()

    def _add(self, pose: SeenPose | None) -> list[tuple[Step, SeenPose | None]]:
        if pose is not None and pose.t > self._bound:
            self.pull()
        self._received += 1
        self._poses.append(pose)
        return self._completed()

    def _completed(self) -> list[tuple[Step, SeenPose | None]]:
        """Return every step whose poses are complete."""
        out: list[tuple[Step, SeenPose | None]] = []
        while self._steps:
            due = self._due(self._steps[0].t)
            if due is None:
                break
            out.append((self._steps.popleft(), self._newest(due)))
        return out

    def _due(self, t: int) -> int | None:
        """Return how many poses a step has at most; None: that is not known yet."""
        if not self._watermark:
            return self._received
        while len(self._ticks) > 1 and self._ticks[0][0] < t:
            self._ticks.popleft()
        if not self._ticks or self._ticks[0][0] < t:
            return None
        due = self._ticks[0][1] - (self._offset or 0)
        return due if self._received >= due or any(map(self._is_later, self._poses)) else None

    def _is_later(self, pose: SeenPose | None) -> bool:
        """Return whether a pose was published after the watermark of the next step."""
        return pose is not None and self._ticks[0][0] < pose.t <= self._bound

    def _newest(self, due: int) -> SeenPose | None:
        """Return the newest of the poses up to one, and forget these."""
        found = None
        for missing in range(due - self._received + len(self._poses), 0, -1):
            if self._watermark and self._is_later(self._poses[0]):
                self._offset += missing  # as many were lost
                break
            pose = self._poses.popleft()
            if pose is not None and not (
                    self._watermark and pose.t > self._ticks[0][0] + AHEAD_NS):
                found = pose
        return found
