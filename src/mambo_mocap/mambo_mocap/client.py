"""
What a NatNet client makes of packets, and which it sends; without sockets.

The client connects, asks for the definitions, keeps the connection alive and asks the server for
its time. Frames may come late, twice, in a wrong order or not at all; packets of others, and those
that cannot be read, are counted and dropped.
"""

from __future__ import annotations

from collections import Counter
import math
from typing import NamedTuple

from .axes import attitude_from_stream, from_stream
from .clock_match import ClockMatch, STEP
from .natnet import frame as frames, handshake, wire
from .natnet.model import bodies, decode_model
from .natnet.wire import Quat, Vec3

NAME = 'Mambo'
ECHO = 50_000_000  # ns between questions for the server's time
KEEP_ALIVE = 1_000_000_000  # ns
RETRY = 1_000_000_000  # ns between tries to connect or to get the definitions
RESTART = 1000  # frames, a step back by which the server has begun anew
ANEW = 500_000_000  # ns of late frames in their order, without a newer one, by which it has too
UNIT = 0.02  # of a quaternion, largest deviation of its length from 1
FARTHEST = 1e4  # m
OLDEST = 60_000_000_000  # ns from the exposure of a frame to its arrival
_NONE = 2**31  # no number of a frame
AHEAD = 2 * STEP  # ns from the arrival to the exposure: the clocks' match may be off by a step


class Seen(NamedTuple):
    """A rigid body in a frame."""

    identifier: int
    name: str   # empty while the definitions are not here
    stamp: int  # ns, exposure on this host's clock or the server's timestamp
    rho: Vec3   # (3,) m, NED
    q: Quat     # (4,) w x y z, FRD to NED
    latency: float  # s, exposure to arrival


class Delays(NamedTuple):
    """Where the time of the newest frame went, s; 0 where the version does not tell."""

    camera: float    # exposure to the server
    software: float  # in the server
    network: float   # server to this host
    total: float     # exposure to this host


class Client:
    """
    Follows one server.

    Parameters
    ----------
    up : str
        Axis of the stream that is up, 'y' or 'z'.
    server_time : bool
        Whether stamps are the server's timestamps.
    patience : ns
        Time without a frame, or without any packet, after which it connects again.
    least_delay : ns
        Of a frame on its way, for a server that answers no echo.

    Attributes
    ----------
    counts : Counter
        Of packets by what became of them.
    match : ClockMatch
        The server's clock and this host's.
    info : ServerInfo or None
        The server's reply; None while not connected.
    names : dict
        Names of the rigid bodies by identifier.
    defined : tuple or None
        Identifier and name of each definition, which may repeat; None while they are not here.
    servers : int
        How often a server was met or began anew: its timestamps may be those of another clock.
    unusable : dict
        Why bodies of the newest frame have no pose, by identifier.
    delays : Delays
        Of the newest frame.
    problem : str
        Why the newest packet that was refused is of no use.

    """

    def __init__(self, up: str = 'y', server_time: bool = False, patience: int = 2_000_000_000,
                 least_delay: int = 0) -> None:
        self._up, self._server_time, self._patience = up, server_time, patience
        self._least_delay = least_delay
        self.counts: Counter[str] = Counter()
        self.match = ClockMatch()
        self.info: handshake.ServerInfo | None = None
        self.names: dict[int, str] = {}
        self.defined: tuple[tuple[int, str], ...] | None = None
        self.servers = 0
        self.unusable: dict[int, str] = {}
        self.delays = Delays(0.0, 0.0, 0.0, 0.0)
        self.problem = ''
        self._last = -1   # number of the newest frame
        self._sent = (0, 0)  # ns, its timestamp and when it was sent, both of the server
        self._heard = self._framed = 0  # ns, when the newest packet and frame came
        self._late = (_NONE, 0)  # number of the newest of a run of late frames, when that began
        self._known = False  # the definitions are those of the newest frame
        self._changing = False  # the newest frame said that they have changed
        self._connection = handshake.encode_connect(handshake.Sender(
            NAME, (0, 1, 0, 0), (*wire.NEWEST, 0, 0)))
        self._next = dict.fromkeys(('connect', 'model', 'keep alive', 'echo'), 0)

    @property
    def version(self) -> wire.Version:
        """Return the version of the server."""
        return (0, 0) if self.info is None else self.info.sender.version

    def due(self, now: int) -> list[bytes]:
        """Return the packets to send to the command port at a time of this host, ns."""
        out = []
        # if this host's clock was set back, patience begins now
        self._heard, self._framed = min(self._heard, now), min(self._framed, now)
        if self.info is not None and now - self._heard > self._patience:
            self.info, self._known = None, False
            self.counts['lost connection'] += 1
        if self.info is None:
            if self._is_due('connect', now, RETRY):
                out.append(self._connection)
            return out
        if now - self._framed > self._patience and self._is_due('connect', now, RETRY):
            out.append(self._connection)
        if not self._known and self._is_due('model', now, RETRY):
            out.append(wire.message(wire.REQUEST_MODEL, b''))
        if self._is_due('keep alive', now, KEEP_ALIVE):
            out.append(wire.message(wire.KEEP_ALIVE, b''))
        if self.version >= (3, 0) and self._is_due('echo', now, ECHO):
            out.append(handshake.encode_echo_request(now))
        return out

    def _is_due(self, what: str, now: int, every: int) -> bool:
        if self._next[what] <= now or self._next[what] > now + every:  # or the clock was set
            self._next[what] = now + every
            return True
        return False

    def take(self, data: bytes, arrived: int) -> list[Seen]:
        """
        Take a packet of the server; return the bodies that it shows.

        Parameters
        ----------
        data
            The packet.
        arrived : ns
            When it came, of this host's clock.

        """
        try:
            kind = wire.kind(data)
            if kind == wire.SERVER_INFO:
                self._meet(handshake.decode_server_info(data), arrived)
            elif self.info is None:
                self.counts['before the connection'] += 1
            elif kind == wire.FRAME:
                return self._frame(frames.decode_frame(data, self.version), arrived)
            elif kind == wire.MODEL:
                self.defined = bodies(decode_model(data, self.version))
                self.names, self._known = dict(self.defined), True
            elif kind == wire.ECHO_RESPONSE:
                sent, ticks = handshake.decode_echo_response(data)
                if self.version < (3, 0) or not 0 <= arrived - sent <= self._patience:
                    raise wire.PacketError('an echo that was not asked for')
                self.match.add_echo(sent, self._ns(ticks), arrived)
                self._heard = arrived
            elif kind not in (wire.RESPONSE, wire.TEXT, wire.UNRECOGNISED):
                self.counts['unknown'] += 1
        except wire.PacketError as error:
            self.counts['malformed'] += 1
            self.problem = str(error)
        return []

    def _meet(self, info: handshake.ServerInfo, arrived: int) -> None:
        """Take the server's reply."""
        wire.check(info.sender.version)
        if info != self.info:
            self.info = info
            self._begin_anew()
        self._heard = arrived

    def _begin_anew(self) -> None:
        """Forget numbers, clock and definitions of a server that is gone."""
        self._last, self._sent = -1, (0, 0)
        self._late, self._changing = (_NONE, 0), False
        self.match = ClockMatch()
        self.servers += 1
        self._forget()

    def _forget(self) -> None:
        """Forget the definitions: an identifier may be that of another body from now on."""
        self.names, self.defined, self._known = {}, None, False

    def _is_late(self, number: int, sent: tuple[int, int], arrived: int) -> bool:
        """
        Return whether a frame was overtaken; see whether the server has begun anew.

        sent: as ``_sent``. In a later frame of the same server neither is earlier.
        """
        step = number - self._last
        if step <= -RESTART:
            self._begin_anew()
        elif step <= 0:
            before, since = self._late
            if not before < number:
                since = arrived
            self._late = (number, since)
            if abs(arrived - since) < ANEW:
                self.counts['late frames'] += 1
                return True
            self._begin_anew()
        elif sent[0] < self._sent[0] or sent[1] < self._sent[1]:
            self._begin_anew()
        elif step > 1 and self._last >= 0:
            self._known = False  # one that is missing may have said that they have changed
            self.counts['missing frames'] += step - 1 if step < RESTART else 0
        self._last, self._sent, self._late = number, sent, (_NONE, 0)
        return False

    def _ns(self, ticks: int) -> int:
        """Return a time of the server's clock in ns."""
        return ticks * 1_000_000_000 // (self.info.frequency if self.info else 1)

    def _frame(self, frame: frames.Frame, arrived: int) -> list[Seen]:
        self._heard = self._framed = arrived
        times = frame.times
        if not (math.isfinite(times.timestamp) and 0.0 <= times.timestamp < 1e9):
            raise wire.PacketError(f'frame {frame.number} has no time')
        timestamp = round(times.timestamp * 1e9)
        ticking = self.version >= (3, 0)
        exposure = self._ns(times.exposure) if ticking else timestamp
        sent = self._ns(times.transmitted) if ticking else timestamp
        late = self._is_late(frame.number, (timestamp, sent), arrived)
        changed = bool(frame.flags & frames.MODELS_CHANGED)
        if changed and not self._changing:
            self._forget()
        self._changing, self._known = changed, self._known and not changed
        self.match.add_arrival(sent, arrived)
        if late:
            return []
        waited = 0 if self.match.answered else self._least_delay
        here = (self.match.local(exposure) or arrived) - waited
        if not -AHEAD <= arrived - here <= OLDEST:
            raise wire.PacketError(
                f'frame {frame.number} was exposed {abs(arrived - here) * 1e-9:.3g} s '
                f'{"before" if here < arrived else "after"} it arrived')
        self.counts['frames'] += 1
        received = self._ns(times.received) if ticking else exposure
        self.delays = Delays(
            (received - exposure) * 1e-9, (sent - received) * 1e-9,
            (arrived - here - (sent - exposure)) * 1e-9, (arrived - here) * 1e-9)
        stamp = timestamp if self._server_time else here
        found = Counter(body.identifier for body in frame.bodies)
        reasons = [(body, self._unusable(body, found[body.identifier])) for body in frame.bodies]
        self.unusable = {body.identifier: reason for body, reason in reasons if reason}
        return [self._seen(body, stamp) for body, reason in reasons if not reason]

    def _unusable(self, body: frames.RigidBody, count: int) -> str:
        """Return why a body, one of a number with its identifier, has no pose; count it."""
        reason = ''
        length = math.hypot(*body.attitude)
        if count > 1:
            reason = 'bodies that share their identifier'
        elif not body.tracked:
            reason = 'bodies not tracked'
        elif not (abs(length - 1.0) < UNIT and all(abs(x) < FARTHEST for x in body.position)):
            reason = 'bodies without a pose'
        if reason:
            self.counts[reason] += 1
        return reason.removeprefix('bodies ')

    def _seen(self, body: frames.RigidBody, stamp: int) -> Seen:
        length = math.hypot(*body.attitude)
        x, y, z, w = (one / length for one in body.attitude)
        return Seen(
            body.identifier, self.names.get(body.identifier, ''), stamp,
            from_stream(body.position, self._up), attitude_from_stream((x, y, z, w), self._up),
            self.delays.total)
