"""What the page shows of a drone: its last poses, motors and health, and their history."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
import math
from typing import NamedTuple

from mambo_model import palette
import numpy as np
from numpy.typing import NDArray

TRUTH, ESTIMATE, MEASURED, REFERENCE = 'truth', 'estimate', 'optitrack', 'reference'
ROLES = {TRUTH: 'ground truth', ESTIMATE: 'estimate', MEASURED: 'motion capture',
         REFERENCE: 'reference'}
"""Roles of ``mambo_model.palette`` with their labels."""
NOWHERE = (math.nan, math.nan, math.nan)


def rgb(role: str) -> tuple[int, int, int]:
    """Return the colour of a role on white as numbers from 0 to 255."""
    text = palette.COLOURS[role]
    return int(text[1:3], 16), int(text[3:5], 16), int(text[5:7], 16)


class Pose(NamedTuple):
    """A pose in the world, z up (REP-103)."""

    position: tuple[float, float, float]  # m
    attitude: tuple[float, float, float, float]  # w x y z, body FLU to world


@dataclass
class DroneState:
    """
    The newest values of one drone.

    Attributes
    ----------
    t : float
        Time of the flight, s; NaN before the first message.
    poses : dict[str, Pose]
        By role.
    pwm : (4,) float
        Motor commands.
    health : dict[str, tuple[int, str]]
        Level (0 OK, 1 WARN, 2 ERROR) and message of each node.
    heard : dict[str, float]
        When each node reported its health, monotonic wall time, s; empty for a recording.

    """

    t: float = math.nan
    poses: dict[str, Pose] = field(default_factory=dict)
    pwm: tuple[float, ...] = (math.nan,) * 4
    health: dict[str, tuple[int, str]] = field(default_factory=dict)
    heard: dict[str, float] = field(default_factory=dict)

    def position(self, role: str) -> tuple[float, float, float]:
        """Return the position of a role, m; NaN if it is not known."""
        pose = self.poses.get(role)
        return NOWHERE if pose is None else pose.position

    def tilt(self, role: str) -> float:
        """Return the angle between the body's z axis and the vertical, degrees."""
        pose = self.poses.get(role)
        if pose is None:
            return math.nan
        _, x, y, _ = pose.attitude
        return math.degrees(math.acos(max(-1.0, min(1.0, 1.0 - 2.0 * (x * x + y * y)))))

    def distance(self, one: str, other: str) -> float:
        """Return the distance between the positions of two roles, m."""
        return math.dist(self.position(one), self.position(other))


class Curve(NamedTuple):
    """One curve of a plot."""

    label: str
    role: str  # of the palette
    value: Callable[[DroneState], float]


def _axis(index: int) -> tuple[Curve, ...]:
    """Return the curves of one coordinate."""
    return tuple(Curve(label, role, lambda state, role=role: state.position(role)[index])
                 for role, label in ROLES.items())


SIGNALS: dict[str, tuple[Curve, ...]] = {
    'height, m': _axis(2), 'x, m': _axis(0), 'y, m': _axis(1),
    'errors, m': (
        Curve('estimate to truth', ESTIMATE, lambda state: state.distance(ESTIMATE, TRUTH)),
        Curve('truth to reference', REFERENCE, lambda state: state.distance(TRUTH, REFERENCE))),
    'tilt, degrees': tuple(Curve(ROLES[role], role, lambda state, role=role: state.tilt(role))
                           for role in (TRUTH, ESTIMATE, REFERENCE)),
    'motors, PWM': tuple(Curve(f'motor {i + 1}', role, lambda state, i=i: state.pwm[i])
                         for i, role in enumerate(('onboard', 'sonar', 'flow', 'estimate')))}
"""Curves by the name of their plot."""
_CURVES = tuple(curve for curves in SIGNALS.values() for curve in curves)


class History:
    """
    The last values of every curve, and the paths that were flown.

    Parameters
    ----------
    length : int
        Number of samples that are kept.

    Attributes
    ----------
    version : int
        Changes with every sample that is added.

    """

    def __init__(self, length: int) -> None:
        self.version = 0
        self._rows: deque[tuple[float, ...]] = deque(maxlen=length)
        self._paths = {role: deque[tuple[float, float, float]](maxlen=length) for role in ROLES}

    def add(self, state: DroneState) -> None:
        """Keep the values of now; a time before the last one begins a new history."""
        if self._rows and not state.t > self._rows[-1][0]:
            if state.t == self._rows[-1][0]:
                return
            self.clear()
        self.version += 1
        self._rows.append((state.t, *(curve.value(state) for curve in _CURVES)))
        for role, path in self._paths.items():
            position = state.position(role)
            if math.isfinite(sum(position)) and (not path or path[-1] != position):
                path.append(position)

    def clear(self) -> None:
        """Forget everything."""
        self._rows.clear()
        for path in self._paths.values():
            path.clear()

    def columns(self, name: str) -> tuple[NDArray[np.float64], ...]:
        """Return the time, s, and the curves of a plot of :data:`SIGNALS`, (n,) each."""
        first = 1 + _CURVES.index(SIGNALS[name][0])
        table = np.array(self._rows, float).reshape(-1, 1 + len(_CURVES))
        wanted = (0, *range(first, first + len(SIGNALS[name])))
        return tuple(np.ascontiguousarray(table[:, one]) for one in wanted)

    def segments(self, role: str) -> NDArray[np.float32]:
        """Return the path of a role as line segments, (n, 2, 3) m."""
        points = np.array(self._paths[role], np.float32).reshape(-1, 3)
        return np.stack([points[:-1], points[1:]], axis=1)
