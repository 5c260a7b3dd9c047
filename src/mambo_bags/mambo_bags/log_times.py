"""
The time under which a message is recorded, bounded by ``/clock`` (no ROS here).

A message is logged at its own stamp, so that a flight has the same bag however fast it is flown.
What anybody may publish has any stamp: one of 2026 in a flight that began at 0 would make a bag of
fifty years. So a stamp counts only from 10 s before the first ``/clock`` to 10 s after the newest,
the longest that a queue of 2000 messages lets a topic run ahead; anything else is logged at the
time of ``/clock``. A ``/clock`` that leaps by more than that is believed when 20 in a row agree.
"""

from __future__ import annotations

import time

SECOND = 1_000_000_000  # ns
WINDOW = 10 * SECOND  # ns
AGREEING = 20  # messages of /clock


class LogTimes:
    """
    Log times of one recording.

    Attributes
    ----------
    now : int or None
        Newest time of ``/clock``, ns; None before the first one.
    low, high : int
        Stamps that certainly count, ns, both included; none where ``low`` is larger.

    """

    def __init__(self) -> None:
        self.now: int | None = None
        self.low, self.high = 1, 0
        self._first = 0
        self._wall = False
        self._leapt: list[int] = []  # to where /clock leaps, while that is not believed

    def update(self, stamp: int | None) -> bool:
        """Take a stamp of ``/clock`` in ns, None if it is not readable; return if it counts."""
        if stamp is None or stamp < 0:
            return False
        if self.now is None or self._wall:
            self.now = self._first = stamp
            self._wall = False
        elif abs(stamp - self.now) <= WINDOW:
            self.now, self._leapt = max(self.now, stamp), []
        else:
            if self._leapt and abs(stamp - self._leapt[-1]) > WINDOW:
                self._leapt = []
            self._leapt.append(stamp)
            if len(self._leapt) < AGREEING:
                return False
            self.now, self._first = stamp, min(self._first, stamp)
            self._leapt = []
        self.low, self.high = max(self._first - WINDOW, 0), self.now + WINDOW
        return True

    def use_wall_clock(self) -> None:
        """Bound stamps by the clock of this machine, as there is no ``/clock``."""
        self._wall, self.now = True, time.time_ns()
        self._first = self.now

    def of(self, stamp: int | None) -> tuple[int, bool]:
        """
        Return the log time of a message and whether it is its own stamp.

        Parameters
        ----------
        stamp : ns
            Of the message; None if it has no readable one.

        """
        if self._wall:
            self.now = max(self.now, time.time_ns())
        if stamp is not None and 0 <= stamp and (
                self._first - WINDOW <= stamp <= self.now + WINDOW):
            return stamp, True
        return self.now, False
