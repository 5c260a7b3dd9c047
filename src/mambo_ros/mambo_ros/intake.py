"""
What a node accepts: every message of every input goes through one :class:`Intake`.

A message is used when it comes from the first publisher of its topic, can be decoded, has a
stamp that is newer than the last one accepted and not ahead of the flight, and holds numbers
within limits. Any other is refused and counted by its reason; nothing that is refused has an
effect on the node.

**Time.** A node that knows the time of the flight (the simulator, or who hears ``/clock``) gives
it as ``now``, and a stamp may be ahead of it by ``ahead`` at most: a message may overtake the
clock that caused it. Where an input is itself the clock of its node, it may run ahead of the last
message accepted by ``LEAP``. A longer gap is believed when ``BELIEVED`` messages in a row go on
from there.

**Publisher.** The middleware says who published a message, by the publisher's global identifier
(GID). The first publisher with a message that can be used is the one believed; those of any other
are refused. Another one takes over when the graph has not known the first for ``ABSENT``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from itertools import chain
import math
import struct
import time
from typing import Any

from .layout import LayoutError

LEAP = 1_000_000_000  # ns
BELIEVED = 10  # messages
ABSENT = 0.5  # s of wall time
_LOOK_EVERY = 0.1  # s of wall time between looks at the graph
LARGEST_PWM = 65_535.0  # of any vehicle; the limits of one are its motors' own
LARGEST = 65_536  # bytes; the largest message of the graph has 0.8 kB

STRANGER = 'from a second publisher'
MALFORMED = 'malformed'
TOO_LARGE = 'too large'
NEGATIVE = 'stamp below 0'
BEHIND = 'stamp not after the last one'
AHEAD = 'stamp ahead of the flight'
NOT_FINITE = 'not finite'
OUT_OF_LIMITS = 'out of limits'

_UNREADABLE = (LayoutError, struct.error, IndexError)


def _nobody() -> set[bytes]:
    """Return no publisher: of an input that no other process can reach."""
    return set()


def _nothing() -> None:
    """Do nothing."""


def finite(*parts: tuple[float, ...]) -> str:
    """Return why the numbers of some tuples cannot be used, empty if they can: all are finite."""
    return '' if math.isfinite(sum(chain.from_iterable(parts))) else NOT_FINITE


def check_pwm(command: tuple) -> str:
    """Return why a decoded motor command cannot be used, empty if it can, as any shutdown."""
    _, (a, b, c, d), shutdown = command
    if shutdown or (0.0 <= a <= LARGEST_PWM and 0.0 <= b <= LARGEST_PWM
                    and 0.0 <= c <= LARGEST_PWM and 0.0 <= d <= LARGEST_PWM):
        return ''
    return finite(command[1]) or OUT_OF_LIMITS


class Intake:
    """
    Guard of one input of a node; called with each message as it arrives.

    Parameters
    ----------
    topic : str
        Full name.
    decode
        From the bytes of a message to a tuple that begins with the stamp in ns.
    use
        Gets that tuple as arguments.
    now
        Time of the flight: what returns it in ns, -1 while it is not known, or the intake of the
        clock; None: the input itself is the clock of its node.
    ahead : ns
        By which a stamp may be ahead of ``now``.
    check
        Gets the tuple; returns why its numbers cannot be used, empty if they can.
    tolerant
        Whether a message that ``check`` refuses is counted and used all the same, by a node that
        knows how to do without some of its numbers.
    timed
        Whether the stamp is bounded here; False for inputs whose node itself puts late, repeated
        and early samples in order.
    lost
        Called for a message of the first publisher that is refused, None: nobody needs to know.

    Attributes
    ----------
    last : int
        Newest stamp accepted, ns; -1 before the first, and of inputs that are not ``timed``.
    refused : collections.Counter
        Messages refused, by reason.
    publishers
        Returns the GIDs of the topic's publishers in the graph; set by the node.
    pull
        Takes what has arrived but waits for its turn; set by the loop.

    """

    def __init__(
        self, topic: str, decode: Callable[[bytes], tuple], use: Callable[..., Any],
        now: Callable[[], int] | Intake | None = None, ahead: int = 0,
        check: Callable[[tuple], str] | None = None, tolerant: bool = False, timed: bool = True,
        lost: Callable[[], Any] | None = None,
    ) -> None:
        self.topic, self.last = topic, -1
        self.refused: Counter[str] = Counter()
        self.publishers: Callable[[], set[bytes]] = _nobody
        self.pull: Callable[[], Any] = _nothing
        self._decode, self._use, self._check, self._tolerant = decode, use, check, tolerant
        self._now, self._newest = (
            (now.time, now.newest) if isinstance(now, Intake) else (now, now))
        # whose newest stamp bounds this input's, if there is one: it is read without a call
        self._clock = self if now is None else now if isinstance(now, Intake) else None
        self._ahead, self._timed, self._lost = LEAP if now is None else ahead, timed, lost
        self._first = b''  # GID of the publisher believed, empty before there is one
        self._next_look = 0.0  # s of wall time, at the graph
        self._absent_since = math.inf  # s of wall time, of the publisher believed
        self._there, self._run = -1, 0  # stamp of the last leap, messages that went on from it

    def __call__(self, data: bytes, publisher: bytes = b'') -> None:
        """
        Take a message.

        Parameters
        ----------
        data
            Its bytes.
        publisher
            GID of who published it; empty: a node of this process.

        """
        if publisher != self._first and self._first and not self._has_left():
            self.refused[STRANGER] += 1
            return
        try:
            value = self._decode(data) if len(data) <= LARGEST else None
        except _UNREADABLE:
            self._refuse(MALFORMED)
            return
        if value is None:
            self._refuse(TOO_LARGE)
            return
        t = value[0]
        if self._timed:  # nearly every stamp is the next one and not ahead: no call to find out
            now = self._now() if self._clock is None else self._clock.last
            if self.last < t <= now + self._ahead:
                self._run = 0
            elif wrong := self._mistimed(t):
                self._refuse(wrong)
                return
        elif t < 0:
            self._refuse(NEGATIVE)
            return
        if self._check is not None and (wrong := self._check(value)):
            if not self._tolerant:
                self._refuse(wrong)
                return
            self.refused[wrong] += 1
        if self._timed:
            self.last = t
        self._first = publisher
        self._use(*value)

    def time(self) -> int:
        """Return the newest stamp accepted, ns; -1 before the first."""
        return self.last

    def newest(self) -> int:
        """Return the same after a look at what has arrived."""
        self.pull()
        return self.last

    def _refuse(self, reason: str) -> None:
        """Count a message of the first publisher that is not used."""
        self.refused[reason] += 1
        if self._lost is not None:
            self._lost()

    def _mistimed(self, t: int) -> str:
        """Return what is wrong with a stamp that is not next in time, empty if nothing."""
        if t < 0:
            return NEGATIVE
        if t <= self.last:
            return BEHIND
        if self._now is None:
            if 0 <= self.last and not self._goes_on(t):
                return AHEAD
            self._run = 0
        elif 0 <= self._now() < t - self._ahead and 0 <= self._newest() < t - self._ahead:
            return AHEAD
        return ''

    def _goes_on(self, t: int) -> bool:
        """Return whether enough messages in a row went on from a leap to believe it."""
        self._run = self._run + 1 if self._there < t <= self._there + LEAP else 1
        self._there = t
        return self._run >= BELIEVED

    def _has_left(self) -> bool:
        """Return whether the graph has not known the publisher believed for a while."""
        now = time.monotonic()
        if now >= self._next_look:
            self._next_look = now + _LOOK_EVERY
            if self._first in self.publishers():
                self._absent_since = math.inf
            else:
                self._absent_since = min(self._absent_since, now)
        return now - self._absent_since > ABSENT
