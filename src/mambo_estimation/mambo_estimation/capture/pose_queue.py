"""
Poses of the motion capture for the steps of the filter, whatever the order of arrival.

The watermark of the motion capture says how many poses have been published up to its stamp. A
step waits for the first watermark that is not older, and gets the newest pose that this one
announces. So what the filter computes is a function of stamped data, as of
:mod:`mambo_estimation.synchroniser`.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from mambo_model.motion.quaternion import Quat
from mambo_model.motion.vector import Vec3

from ..synchroniser import Step


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

    """

    def __init__(self, watermark: bool = True) -> None:
        self._watermark = watermark
        self._steps: deque[Step] = deque()
        self._poses: deque[SeenPose | None] = deque()  # not yet announced
        self._ticks: deque[tuple[int, int]] = deque()
        self._received = 0
        self._offset: int | None = None

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
        return self._completed()

    def _add(self, pose: SeenPose | None) -> list[tuple[Step, SeenPose | None]]:
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
        return due if self._received >= due else None

    def _newest(self, due: int) -> SeenPose | None:
        """Return the newest of the poses up to one, and forget these."""
        found = None
        for _ in range(due - self._received + len(self._poses)):
            found = self._poses.popleft() or found
        return found
