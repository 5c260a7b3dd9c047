"""
Checks on what a node accepts: every message of an input passes through an :class:`InputGuard`.

A message is used when it comes from the first publisher of its topic, can be decoded, has a
stamp that is newer than the last one accepted and not ahead of the flight, and holds numbers
within limits. All others are refused and counted by reason, and have no effect on the node.

**Time.** A node that knows the time of the flight (the simulator, or a subscriber of ``/clock``)
passes it as ``now``. A stamp may be ahead of it by at most ``ahead``, because a message may
overtake the clock message that caused it. If that clock is an input of the same node, one message
of the accepted publisher that is further ahead, by ``LEAP`` at most, waits until the clock moves:
a message of the clock may be late, and in lockstep there is no other to wait for. If the input
itself is the clock of its node, it may run ahead of the last accepted message by ``LEAP``. A
longer leap is accepted when ``CONFIRMATIONS`` consecutive messages continue from it; those before
the last of them are kept until then and used with it.

**Publisher.** The first publisher of a usable message is accepted (``graph.publisher_guard``). One
that leaves before the flight leaves no stamp behind.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import chain
import math
import struct
from typing import Any

from .graph.publisher_guard import LARGEST, PublisherGuard
from .layout import LayoutError

LEAP = 1_000_000_000  # ns
LATEST = (2**31 - 86_401) * 1_000_000_000  # ns: a day before the last second that a stamp can hold
CONFIRMATIONS = 10  # messages after a leap before it is accepted
LARGEST_PWM = 65_535.0  # largest pwm_max that a vehicle may have

MALFORMED = 'malformed'
TOO_LARGE = 'too large'
NEGATIVE = 'stamp below 0'
BEHIND = 'stamp not after the last one'
AHEAD = 'stamp ahead of the flight'
NOT_FINITE = 'not finite'
OUT_OF_LIMITS = 'out of limits'

_FRAME = 12  # bytes of a message before the name of its frame: encapsulation and stamp
_UNREADABLE = (LayoutError, struct.error, IndexError)


def _framed(name: str) -> Iterator[bytes]:
    """Yield how a frame is written in the header of a message, in either order of bytes."""
    text = name.encode() + b'\0'
    for order in ('little', 'big'):
        yield len(text).to_bytes(4, order) + text
        if not name:
            yield bytes(4)


def finite(*parts: tuple[float, ...]) -> str:
    """Return the reason to refuse some tuples; empty if all their numbers are finite."""
    return '' if math.isfinite(sum(chain.from_iterable(parts))) else NOT_FINITE


def check_state(decoded: tuple) -> str:
    """Return the reason to refuse (stamp, state, ...); empty if all its numbers are finite."""
    return finite(*decoded[1])


def check_pwm(command: tuple) -> str:
    """Return the reason to refuse a motor command; empty if it is usable, as any shutdown."""
    _, (a, b, c, d), shutdown = command
    if shutdown or (0.0 <= a <= LARGEST_PWM and 0.0 <= b <= LARGEST_PWM
                    and 0.0 <= c <= LARGEST_PWM and 0.0 <= d <= LARGEST_PWM):
        return ''
    return finite(command[1]) or OUT_OF_LIMITS


class InputGuard(PublisherGuard):
    """
    Checks the messages of one input of a node; called with each message as it arrives.

    Parameters
    ----------
    topic : str
        Full name.
    decode
        Converts the bytes of a message to a tuple that begins with the stamp in ns.
    use
        Called with the elements of that tuple.
    now
        Time of the flight: a function that returns it in ns, or -1 while it is not known; or the
        guard of the clock; None: the input itself is the clock of its node.
    ahead : ns
        Largest amount by which a stamp may be ahead of ``now``.
    check
        Called with the tuple; returns the reason to refuse it, empty if it is usable.
    tolerant
        Whether a message that ``check`` refuses is counted but still used, for a node that can do
        without some of its numbers.
    timed
        Whether the stamp is checked here; False if the node itself sorts late, repeated and early
        samples.
    lost
        Called when a message of the first publisher is refused; None: no callback.
    frames
        Names of which the frame in the header must be one, the wanted one first, see
        ``wire.WireParams.frames``; empty: the frame is not looked at.

    Attributes
    ----------
    last : int
        Newest stamp accepted, ns; -1 before the first, and of inputs that are not ``timed``.

    Others as of :class:`mambo_ros.graph.publisher_guard.PublisherGuard`.

    """

    def __init__(
        self, topic: str, decode: Callable[[bytes], tuple], use: Callable[..., Any],
        now: Callable[[], int] | InputGuard | None = None, ahead: int = 0,
        check: Callable[[tuple], str] | None = None, tolerant: bool = False, timed: bool = True,
        lost: Callable[[], Any] | None = None, frames: tuple[str, ...] = (),
    ) -> None:
        super().__init__(topic, use, LARGEST)
        self._decode, self._check, self._tolerant = decode, check, tolerant
        self._now, self._newest = (
            (now.time, now.newest) if isinstance(now, InputGuard) else (now, now))
        # guard whose newest stamp limits this one, if any; read directly, without a call
        self._clock = self if now is None else now if isinstance(now, InputGuard) else None
        self._frames, self._framed = frames, tuple(chain.from_iterable(map(_framed, frames)))
        self._ahead, self._timed, self._lost = LEAP if now is None else ahead, timed, lost
        self._held: tuple[bytes, bytes] | None = None  # message and publisher, ahead of the clock
        self._waiting: list[InputGuard] = []  # inputs that hold a message, if this is the clock
        self._there, self._run = -1, 0  # stamp of the last leap, messages that continued from it
        self._leapt: list[tuple[bytes, bytes]] = []  # these messages, and their publisher

    def __call__(self, data: bytes, publisher: bytes = b'') -> None:
        """
        Check a message and use it if it is accepted.

        Parameters
        ----------
        data
            Its bytes.
        publisher
            GID of its publisher; empty: a node of this process.

        """
        if publisher != self._first and self._is_foreign(publisher):
            return
        try:
            value = self._decode(data) if len(data) <= LARGEST else None
        except _UNREADABLE:
            self._refuse(MALFORMED, publisher)
            return
        if value is None:
            self._refuse(TOO_LARGE, publisher)
            return
        if self._framed and not data.startswith(self._framed, _FRAME):
            self._refuse(f'frame is not {self._frames[0]}', publisher)
            return
        t = value[0]
        if self._timed:  # fast path: nearly every stamp is the next one and not ahead
            now = self._now() if self._clock is None else self._clock.last
            if self.last < t <= now + self._ahead:
                self._run = 0
                if self._leapt:
                    self._end_leap(False)
            elif wrong := self._mistimed(t):
                if wrong == AHEAD and publisher == self._first and self._awaits_clock(t):
                    self._hold(data, publisher)
                elif wrong == AHEAD and publisher == self._first and self._now is None:
                    if self._run == 1:
                        self._end_leap(False)
                    self._leapt.append((data, publisher))
                else:
                    self._refuse(wrong, publisher)
                return
            elif self._leapt:
                self._end_leap(True)
        elif t < 0 or t > LATEST:
            self._refuse(NEGATIVE if t < 0 else MALFORMED, publisher)
            return
        if self._check is not None and (wrong := self._check(value)):
            if not self._tolerant:
                self._refuse(wrong, publisher)
                return
            self.refused[wrong] += 1
        if self._timed:
            self.last = t
        self._first = publisher
        self.accepted += 1
        self.use(*value)
        if self._waiting:
            waiting, self._waiting = self._waiting, []
            for guard in waiting:
                guard.retry()

    @property
    def local(self) -> Callable[[bytes], None]:
        """What takes messages of the same process: this guard."""
        return self

    def time(self) -> int:
        """Return the newest stamp accepted, ns; -1 before the first."""
        return self.last

    def newest(self) -> int:
        """Return the newest stamp accepted after handling the messages that have arrived."""
        self.pull()
        return self.last

    def retry(self) -> None:
        """Check a message again that was ahead of the clock, which has moved."""
        held, self._held = self._held, None
        if held is not None:
            self(*held)

    def _forget(self) -> None:
        """Let another publisher come, with stamps from 0 if the flight has not begun."""
        if self._now is not None and self._now() < 0:
            self.last, self._held = -1, None
        super()._forget()

    def _awaits_clock(self, t: int) -> bool:
        """Return whether the message of the clock that belongs to a stamp may just be late."""
        return self._clock not in (None, self) and t <= self._clock.last + LEAP

    def _hold(self, data: bytes, publisher: bytes) -> None:
        """Keep a message until the clock moves, in place of the one kept before."""
        if self._held is not None:
            self._refuse(AHEAD, publisher)
        self._held = data, publisher
        if self not in self._clock._waiting:
            self._clock._waiting.append(self)

    def _end_leap(self, confirmed: bool) -> None:
        """Use the messages of a leap, or refuse them as nothing continued from it."""
        leapt, self._leapt = self._leapt, []
        for data, publisher in leapt:
            if confirmed:
                self.last = self._decode(data)[0] - 1
                self(data, publisher)
            else:
                self._refuse(AHEAD, publisher)

    def _refuse(self, reason: str, publisher: bytes) -> None:
        """Count a refused message; of a publisher that is not accepted nothing is lost."""
        self.refused[reason] += 1
        if self._lost is not None and publisher == self._first:
            self._lost()

    def _mistimed(self, t: int) -> str:
        """Return the reason to refuse a stamp that is not simply the next one; empty if none."""
        if t < 0:
            return NEGATIVE
        if t > LATEST:
            return MALFORMED
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
        """Return whether enough consecutive messages continued from a leap to accept it."""
        self._run = self._run + 1 if self._there < t <= self._there + LEAP else 1
        self._there = t
        return self._run >= CONFIRMATIONS
