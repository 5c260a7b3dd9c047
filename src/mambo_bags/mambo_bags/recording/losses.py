"""What the bag of a flight lacks at its end, which no later message shows."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping

from mambo_ros.layout import LayoutError
from mambo_ros.messages import decode_sensor_tick

LATE = 250_000_000
"""Time in ns by which a topic of every step may end before the ``/clock`` of its node."""


class Losses:
    """
    Losses of one recording.

    Parameters
    ----------
    counted
        Full names of the topics that the watermark counts, in its order.
    steady
        Full names of the topics with a message at every step, of the node of ``/clock``: others
        may have ended by themselves.

    Attributes
    ----------
    ends : dict[str, int]
        Log time of the newest message of each topic, ns; filled by the recorder.

    """

    def __init__(self, counted: Collection[str], steady: Collection[str]) -> None:
        self._counted, self._steady = tuple(counted), tuple(steady)
        self.ends: dict[str, int] = {}
        self._from_start: bool | None = None  # whether the first watermark was of the first step
        self._published: tuple[int, ...] = ()

    def counting(self, take: Callable[[bytes], None]) -> Callable[[bytes], None]:
        """Return the callback of the watermark, which counts the samples; take: what records."""
        def count(data: bytes) -> None:
            """Record a watermark and keep its counts."""
            take(data)
            try:
                _, self._published = decode_sensor_tick(data)
            except LayoutError:  # too short: a stranger's
                return
            if self._from_start is None:
                self._from_start = self._published[0] <= 1
        return count

    def lines(self, received: Mapping[str, int], now: int | None) -> Iterator[str]:
        """
        Yield what is missing, one line each.

        Samples are only counted in a recording from the first step on. The count then decides also
        about a topic of every step: a sensor that has failed sends no more.

        Parameters
        ----------
        received
            Messages by topic.
        now : ns
            Newest time of ``/clock``; None: there was none.

        """
        counts = dict(zip(self._counted, self._published, strict=True)) if self._from_start else {}
        for name, count in counts.items():
            if name in received and received[name] < count:
                yield (f'{name}: the bag has {received[name]} of the {count} messages that '
                       'were published')
        for name in self._steady:
            end = None if name in counts else self.ends.get(name)
            if now is not None and end is not None and end < now - LATE:
                yield (f'{name}: the bag has no message after {1e-9 * end:.3f} s, '
                       f'and the flight went on to {1e-9 * now:.3f} s')
