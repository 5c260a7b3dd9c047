"""From messages of the graph, as they come, to the newest state of a drone."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import math
import struct
import time
from typing import Any

from mambo_model.frames import flip_vector, wire_quaternion
from mambo_ros import messages, topics

from .drone_state import DroneState, ESTIMATE, MEASURED, Pose, REFERENCE, TRUTH

_LARGEST = 65_536  # bytes of a message that is shown
_MOST = 64  # nodes whose health is kept
_UNREADABLE = (struct.error, ValueError, IndexError, OverflowError, RuntimeError)


def _pose(rho: Any, q: Any) -> Pose:
    """Return a pose of the inside (NED, FRD) in the world of the page."""
    x, y, z, w = wire_quaternion(q)
    return Pose(flip_vector(rho), (w, x, y, z))


def _odometry(data: bytes) -> tuple[int, Pose]:
    t, state = messages.decode_odometry(data)
    return t, _pose(state.rho, state.q)


def _capture(data: bytes) -> tuple[int, Pose]:
    t, rho, q = messages.decode_pose(data)
    return t, _pose(rho, q)


def _reference(data: bytes) -> tuple[int, Pose]:
    t, ref, _ = messages.decode_reference(data)
    return t, _pose(ref.rho, ref.q)


POSES: dict[topics.Topic, tuple[str, Callable[[bytes], tuple[int, Pose]]]] = {
    topics.GROUND_TRUTH: (TRUTH, _odometry), topics.ESTIMATE: (ESTIMATE, _odometry),
    topics.LOCATED: (ESTIMATE, _odometry), topics.OPTITRACK: (MEASURED, _capture),
    topics.REFERENCE: (REFERENCE, _reference)}
"""Topics with a pose: its role, and the function that decodes it."""
SHOWN = (*POSES, topics.MOTOR_PWM, topics.DIAGNOSTICS)


class Mailbox:
    """
    The last message of each topic of a drone, undecoded until the page needs it.

    Anybody may publish: messages that are too large, cannot be read or are not finite are counted
    and not shown.

    Parameters
    ----------
    statuses : callable
        Returns (node, level, message) for each status in the bytes of ``/diagnostics``.

    Attributes
    ----------
    state : DroneState
        As of the last :meth:`read`.
    refused : int
        Number of messages that were not shown.

    """

    def __init__(self, statuses: Callable[[bytes], Sequence[tuple[str, int, str]]]) -> None:
        self._statuses = statuses
        self.state = DroneState()
        self.refused = 0
        self._new: dict[topics.Topic, bytes] = {}
        self._reports: list[bytes] = []
        self._located = False  # poses in map are shown instead of those in odom

    def put(self, topic: topics.Topic, data: bytes) -> None:
        """Keep a message as the last one of its topic; every report of health."""
        if len(data) > _LARGEST:
            self.refused += 1
        elif topic is not topics.DIAGNOSTICS:
            self._new[topic] = bytes(data)
        elif len(self._reports) < _MOST:
            self._reports.append(bytes(data))

    def read(self) -> bool:
        """Decode what has come; return whether there was anything."""
        new, self._new = self._new, {}
        reports, self._reports = self._reports, []
        for topic, data in new.items():
            self._try(self._pwm if topic is topics.MOTOR_PWM else self._move, topic, data)
        for data in reports:
            self._try(self._report, topics.DIAGNOSTICS, data)
        return bool(new or reports)

    def _try(self, use: Callable[[topics.Topic, bytes], None], topic: topics.Topic,
             data: bytes) -> None:
        try:
            use(topic, data)
        except _UNREADABLE:
            self.refused += 1

    def _move(self, topic: topics.Topic, data: bytes) -> None:
        """Take a pose."""
        role, decode = POSES[topic]
        t, pose = decode(data)
        if not all(map(math.isfinite, (*pose.position, *pose.attitude))) or not any(pose.attitude):
            raise ValueError('not a pose')
        self._located = self._located or topic is topics.LOCATED
        if topic is topics.ESTIMATE and self._located:
            return
        self.state.poses[role] = pose
        if topic in (topics.GROUND_TRUTH, topics.ESTIMATE):
            self.state.t = 1e-9 * t

    def _pwm(self, _: topics.Topic, data: bytes) -> None:
        """Take a motor command."""
        _, pwm, _ = messages.decode_motor_pwm(data)
        if not all(map(math.isfinite, pwm)):
            raise ValueError('not a command')
        self.state.pwm = tuple(pwm)

    def _report(self, _: topics.Topic, data: bytes) -> None:
        """Take a report of health."""
        for name, level, message in self._statuses(data)[:_MOST]:
            if name in self.state.health or len(self.state.health) < _MOST:
                self.state.health[name] = (level, message)
                self.state.heard[name] = time.monotonic()
