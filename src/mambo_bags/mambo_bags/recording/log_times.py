"""
Log time of a recorded message, limited by ``/clock`` (no ROS here).

A message is logged at its own stamp, so that a flight has the same bag at any speed. But any node
may publish any stamp: one of the year 2026 in a flight that began at 0 would make a bag of fifty
years. A stamp is therefore accepted only from 10 s before the first ``/clock`` to 10 s after the
newest, the longest that a queue of 2000 messages lets a topic run ahead. Other messages are logged
at the time of ``/clock``. A larger leap of ``/clock`` is accepted when 20 messages in a row agree.
Before the first ``/clock`` messages are held back, as nobody knows their time.
"""

from __future__ import annotations

from collections.abc import Callable
import time

SECOND = 1_000_000_000  # ns
WINDOW = 10 * SECOND  # ns
AGREEING = 20  # messages of /clock that confirm a leap
MOST_EARLY = 2000  # messages that are held back before the first /clock
LARGEST_EARLY = 1 << 24  # bytes of them


class LogTimes:
    """
    Log times of one recording.

    Attributes
    ----------
    now : int or None
        Newest time of ``/clock``, ns; None before the first one.
    low, high : int
        Range of stamps accepted without further checks, ns, inclusive; empty if ``low > high``.

    """

    def __init__(self) -> None:
        self.now: int | None = None
        self.low, self.high = 1, 0
        self._first = 0
        self._wall = False
        self._leapt: list[int] = []  # time to which /clock leaps, until the leap is accepted

    def update(self, stamp: int | None) -> bool:
        """Update from a ``/clock`` stamp in ns, None if unreadable; return if it is accepted."""
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
        """Limit stamps by the clock of this machine, because there is no ``/clock``."""
        self._wall, self.now = True, time.time_ns()
        self._first = self.now

    def of(self, stamp: int | None) -> tuple[int, bool]:
        """
        Return the log time of a message and whether that is its own stamp.

        Parameters
        ----------
        stamp : ns
            Stamp of the message; None if it has no readable one.

        """
        if self._wall:
            self.now = max(self.now, time.time_ns())
        if stamp is not None and 0 <= stamp and (
                self._first - WINDOW <= stamp <= self.now + WINDOW):
            return stamp, True
        return self.now, False


class EarlyMessages:
    """Messages before the first ``/clock``, held back in the order of their arrival."""

    def __init__(self) -> None:
        self._held: list[tuple[str, Callable[[bytes], None], bytes]] = []
        self._size = 0  # bytes

    def __len__(self) -> int:
        return len(self._held)

    def hold(self, topic: str, record: Callable[[bytes], None], data: bytes) -> bool:
        """Hold a message until :meth:`release` records it; return whether no more can be held."""
        self._held.append((topic, record, bytes(data)))
        self._size += len(data)
        return len(self._held) >= MOST_EARLY or self._size > LARGEST_EARLY

    def release(self) -> None:
        """Record every message that is held."""
        held, self._held = self._held, []
        for _, record, data in held:
            record(data)

    def forget(self, topic: str) -> int:
        """Drop the messages of a topic; return how many there were."""
        dropped = [data for name, _, data in self._held if name == topic]
        self._held = [one for one in self._held if one[0] != topic]
        self._size -= sum(map(len, dropped))
        return len(dropped)
