"""
Accept one publisher of a topic, refuse the others, report a flood.

The middleware identifies the publisher of a message by its global identifier (GID). The first
publisher is accepted; messages of any other are refused and counted before anything is decoded.
Another one takes over when the first has been absent from the graph for ``ABSENT``, unless the
node says that the flight is over (``replaceable``).

A second publisher that sends much more than the first fills the queue that both share, until
messages of the first are lost. So it is reported (``flooded``) as soon as ``FLOOD`` of its
messages have come within a second, twice as many as were accepted meanwhile.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
import math
import time
from typing import Any

ABSENT = 0.5  # s of wall time
LARGEST = 65_536  # bytes of any message; the largest message of the graph has 0.8 kB
FLOOD = 500  # messages; a queue holds four times as many (topics.QUEUE)
SECOND_PUBLISHER = 'from a second publisher'
LOST = 'lost on the way (full queue or broken connection)'
UNREAD = 'not read, as the node was ended before'
REPLACED = 'refused while the publisher before it was accepted'
_LOOK_EVERY = 0.1  # s of wall time between looks at the graph
_LAGS = 0.3  # s of wall time by which the graph may lag behind the matched publishers
_PREFIX = 12  # bytes of a GID that all endpoints of a participant share
_KNOWN = 64  # refused publishers that are remembered
_WINDOW = 1.0  # s of wall time in which the messages of a flood are counted


def _nobody() -> set[bytes]:
    """Return no publisher: of an input that no other process can reach."""
    return set()


def _always(_: float | bytes) -> bool:
    """Return that another publisher may take over, or that any is the right one."""
    return True


def same_process(gid: bytes, other: bytes) -> bool:
    """
    Return whether two publishers are of one process; yes where one is not known.

    A GID begins with the prefix of its participant in 12 bytes (RTPS 2.5, 9.3.1).
    """
    return not gid or not other or gid[:_PREFIX] == other[:_PREFIX]


def _nothing(*_: Any) -> None:
    """Do nothing."""


class PublisherGuard:
    """
    Guard of one input that accepts one publisher; called with each message as it arrives.

    Parameters
    ----------
    topic : str
        Full name.
    use
        Called for each accepted message, here with its bytes.
    largest
        Bytes of a message that can be used.

    Attributes
    ----------
    last : int
        Newest stamp accepted, ns; -1: none, or stamps are of no concern.
    accepted : int
        Messages accepted.
    refused : collections.Counter
        Messages refused or lost, by reason.
    publishers
        Returns the GIDs of the topic's publishers in the graph; set by the node.
    latest : s
        Wall time of the last message accepted.
    replaceable
        Returns whether another publisher may take over from one that has been absent since a wall
        time in s; set by the node.
    belongs
        Returns whether a publisher may be the first, by its GID; set by the node.
    pull
        Handles messages that have arrived but not yet been served; set by the loop.
    flooded
        Called with this guard and the GID of a publisher that floods the input; set by the loop.
    incomplete
        Called with this guard and the reason when messages of the accepted publisher are missing;
        set by the node.
    forgotten
        Called with this guard when the accepted publisher has left and another may come; likewise.

    """

    def __init__(self, topic: str, use: Callable[..., Any], largest: int) -> None:
        self.topic, self.use, self.largest = topic, use, largest
        self.last, self.accepted, self.latest = -1, 0, -math.inf
        self.refused: Counter[str] = Counter()
        self.publishers: Callable[[], set[bytes]] = _nobody
        self.replaceable: Callable[[float], bool] = _always
        self.belongs: Callable[[bytes], bool] = _always
        self.pull: Callable[[], Any] = _nothing
        self.flooded: Callable[[PublisherGuard, bytes], Any] = _nothing
        self.incomplete: Callable[[PublisherGuard, str], Any] = _nothing
        self.forgotten: Callable[[PublisherGuard], Any] = _nothing
        self._first = b''  # GID of the accepted publisher, empty before the first
        self._number, self._numbered = 0, b''  # of its last message, and who sent that
        self._next_look = 0.0  # s of wall time of the next look at the graph
        self._missed = b''  # publisher looked for last
        self._absent_since = math.inf  # s of wall time since when it is not in the graph
        self._looked = (0, b'')  # number of publishers and the accepted one
        self._look_until = 0.0  # s of wall time until which the graph may not know of their change
        self._since, self._until = 0, 0.0  # accepted before the window; end of the window, s
        self._foreign: Counter[bytes] = Counter()  # messages in the window, by publisher
        self._known: set[bytes] = set()  # publishers that were refused

    def __call__(self, data: bytes, publisher: bytes = b'') -> None:
        """
        Take a message.

        Parameters
        ----------
        data
            Its bytes.
        publisher
            GID of its publisher; empty: a node of this process.

        """
        if publisher != self._first and self._is_foreign(publisher):
            return
        self._first = publisher
        self.accepted += 1
        self.latest = time.monotonic()
        self.use(data)

    def follow(self, number: int) -> None:
        """
        Count messages of the accepted publisher that were lost before this one.

        Parameters
        ----------
        number
            Of the message among all of its publisher; always the same where the middleware does
            not count. A smaller one than before has no effect: ``use`` of the first message has
            taken the next ones already.

        """
        if self._numbered != self._first:
            self._number, self._numbered = number, self._first
        elif number > self._number:
            missing, self._number = number - self._number - 1, number
            if missing:
                self.refused[LOST] += missing
                self.incomplete(self, LOST)

    @property
    def first(self) -> bytes:
        """GID of the accepted publisher, empty before the first."""
        return self._first

    @property
    def local(self) -> Callable[[bytes], None]:
        """What takes messages of the same process."""
        return self.use

    def _is_foreign(self, publisher: bytes) -> bool:
        """Return whether a message is to be refused for its publisher; count it if so."""
        now = time.monotonic()
        if self._first and self._has_left(now):
            self._forget()
        if not self._first and self.belongs(publisher):
            if publisher in self._known:
                self.incomplete(self, REPLACED)
            return False
        self.refused[SECOND_PUBLISHER] += 1
        if len(self._known) < _KNOWN:
            self._known.add(publisher)
        if now >= self._until:
            self._until, self._since = now + _WINDOW, self.accepted
            self._foreign.clear()
        self._foreign[publisher] += 1
        if self._foreign[publisher] >= max(FLOOD, 2 * (self.accepted - self._since)):
            self._until = now  # a new window, lest each further message be reported
            self.flooded(self, publisher)
        return True

    def _has_left(self, now: float) -> bool:
        """Return whether the accepted publisher has been absent from the graph for ``ABSENT``."""
        if now >= self._next_look:
            self._next_look = now + _LOOK_EVERY
            self.look(now)
        return now - self._absent_since > ABSENT and self.replaceable(self._absent_since)

    def look(self, now: float) -> None:
        """Look whether the accepted publisher is in the graph, at a wall time in s."""
        there = self._first in self.publishers()
        if there or self._missed != self._first:
            self._missed, self._absent_since = self._first, math.inf
        if not there:
            self._absent_since = min(self._absent_since, now)

    def is_deserted(self, count: int) -> bool:
        """
        Return whether the accepted publisher has left and will be forgotten after ``ABSENT``.

        Parameters
        ----------
        count
            Of the publishers that are matched: the graph, which may know a little later, is
            asked when it has changed.

        """
        now = time.monotonic()
        if not self._first:
            return False
        if (count, self._first) != self._looked:
            self._looked, self._look_until = (count, self._first), now + _LAGS
        if now < self._look_until or self._absent_since < math.inf:
            self.look(now)
        if self._absent_since == math.inf or not self.replaceable(self._absent_since):
            return False
        if now - self._absent_since > ABSENT:
            self._forget()
        return bool(self._first)

    def _forget(self) -> None:
        """Let another publisher come, as the accepted one has left."""
        self._first = b''
        self.forgotten(self)


def live(take: Callable[..., Any], publishers: int) -> int:
    """Return how many publishers of an input are matched; 0 if the accepted one has left."""
    return 0 if isinstance(take, PublisherGuard) and take.is_deserted(publishers) else publishers
