"""From a bag to the state of a drone at any time."""

from __future__ import annotations

from bisect import bisect_right
from pathlib import Path
from typing import NamedTuple

from mambo_bags.reader import Bag, BagError, Messages, read_bag
import numpy as np
from numpy.typing import NDArray

from .drone_state import DroneState, ESTIMATE, MEASURED, Pose, REFERENCE, TRUTH

Floats = NDArray[np.float64]
POSES = {TRUTH: ('ground_truth/odom',), MEASURED: ('optitrack/pose',), REFERENCE: ('reference',),
         ESTIMATE: ('estimate/map', 'estimate/odom', 'onboard/odom')}
"""Topics of a role; the first one that the bag has is shown."""
PWM, HEALTH = 'motor_pwm', '/diagnostics'
_STALE = 0.5  # s without a message after which a pose is not shown any more


class _Track(NamedTuple):
    """A column over time."""

    t: Floats  # (n,) s
    values: Floats  # (n, k)

    def at(self, t: float, longest: float = np.inf) -> Floats | None:
        """Return the last row not after a time, unless it is older than ``longest`` s."""
        index = int(np.searchsorted(self.t, t, 'right')) - 1
        return None if index < 0 or t - self.t[index] > longest else self.values[index]


def _track(messages: Messages, *fields: str) -> _Track:
    """Return finite rows of fields, ordered by stamp."""
    values = np.column_stack([messages[one] if '.' in one else getattr(messages, one)
                              for one in fields]).astype(float)
    usable = np.isfinite(values).all(axis=1) & np.isfinite(messages.t)
    order = np.argsort(messages.t[usable], kind='stable')
    return _Track(messages.t[usable][order], values[usable][order])


def _reports(bag: Bag) -> dict[str, tuple[list[float], list[tuple[int, str]]]]:
    """Return the times, s, and the (level, message) of the health that each node reported."""
    out: dict[str, tuple[list[float], list[tuple[int, str]]]] = {}
    if HEALTH in bag:
        messages = bag[HEALTH]
        for t, report in zip(messages.t.tolist(), messages.objects(), strict=True):
            for one in report.status:
                times, reports = out.setdefault(str(one.name), ([], []))
                times.append(t)
                reports.append((int(one.level), str(one.message)))
    return out


class Recording:
    """
    The flight of one drone in a bag.

    Parameters
    ----------
    path : Path
        rosbag2 directory or MCAP file.
    namespace : str, optional
        Of the drone, if the bag has several.

    Attributes
    ----------
    start, end : float
        Times of the first and last pose, s.

    Raises
    ------
    mambo_bags.reader.BagError
        If it cannot be read, or has no pose.

    """

    def __init__(self, path: Path, namespace: str | None = None) -> None:
        bag = read_bag(path, namespace=namespace)
        self._poses: dict[str, _Track] = {}
        for role, topics in POSES.items():
            found = next((topic for topic in topics if topic in bag), None)
            if found is not None:
                track = _track(bag[found], 'position', 'orientation')
                lengths = np.linalg.norm(track.values[:, 3:], axis=1)
                good = lengths > 0.5
                if good.any():
                    self._poses[role] = _Track(track.t[good], track.values[good])
        if not self._poses:
            raise BagError(f'{path}: no pose to show; it has '
                           f'{", ".join(sorted(bag.topics)) or "no topic"}')
        self.start = min(float(track.t[0]) for track in self._poses.values())
        self.end = max(float(track.t[-1]) for track in self._poses.values())
        self._pwm = _track(bag[PWM], 'pwm') if PWM in bag else None
        self._health = _reports(bag)

    def state(self, t: float) -> DroneState:
        """Return what was known at a time, s."""
        out = DroneState(t)
        for role, track in self._poses.items():
            row = track.at(t, _STALE)
            if row is not None:
                x, y, z, w = row[3:].tolist()
                out.poses[role] = Pose(tuple(row[:3].tolist()), (w, x, y, z))
        command = None if self._pwm is None else self._pwm.at(t)
        if command is not None and len(command) == 4:
            out.pwm = tuple(command.tolist())
        for node, (times, reports) in self._health.items():
            if index := bisect_right(times, t):
                out.health[node] = reports[index - 1]
        return out
