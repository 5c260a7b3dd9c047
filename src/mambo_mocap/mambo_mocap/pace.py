"""When the frames of a simulated flight are due by the system's clock."""

from __future__ import annotations

SPAN = 2_000_000_000  # ns of the flight, over which the least delay is looked for


class Pace:
    """
    Follows the clock of a flight in real time from messages that arrive late by varying delays.

    Attributes
    ----------
    offset : int
        ns, system time when the flight's clock was 0, if it had always run as lately. From the
        least delayed messages of the last one to two spans, so a flight that fell behind or stood
        still is followed.

    """

    def __init__(self) -> None:
        self.offset = 0
        self._span, self._least, self._before = -1, 0, 0

    def add(self, t: int, arrived: int) -> None:
        """Add a message with a stamp of the flight, ns, that arrived at a system time, ns."""
        offset = arrived - t
        if t // SPAN != self._span:
            self._before = offset if self._span < 0 else self._least
            self._span, self._least = t // SPAN, offset
        self._least = min(self._least, offset)
        self.offset = min(self._least, self._before)
