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
from .clock_match import ClockMatch
from .natnet import frame as frames, handshake, wire
from .natnet.model import bodies, decode_model
from .natnet.wire import Quat, Vec3

NAME = 'Mambo'
ECHO = 50_000_000  # ns between questions for the server's time
KEEP_ALIVE = 1_000_000_000  # ns
RETRY = 1_000_000_000  # ns between tries to connect or to get the definitions
RESTART = 1000  # frames, a step back by which the server has begun anew
UNIT = 0.02  # of a quaternion, largest deviation of its length from 1
FARTHEST = 1e4  # m
OLDEST = 60_000_000_000  # ns between exposure and arrival of a frame, either way


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
        self.delays = Delays(0.0, 0.0, 0.0, 0.0)
        self.problem = ''
        self._last = -1   # number of the newest frame
        self._heard = self._framed = 0  # ns, when the newest packet and frame came
        self._known = False  # the definitions are here
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
                self.names, self._known = bodies(decode_model(data, self.version)), True
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
            self.info, self._known, self._last = info, False, -1
            self.match = ClockMatch()
        self._heard = arrived

    def _ns(self, ticks: int) -> int:
        """Return a time of the server's clock in ns."""
        return ticks * 1_000_000_000 // (self.info.frequency if self.info else 1)

    def _frame(self, frame: frames.Frame, arrived: int) -> list[Seen]:
        self._heard = self._framed = arrived
        times = frame.times
        if not (math.isfinite(times.timestamp) and 0.0 <= times.timestamp < 1e9):
            raise wire.PacketError(f'frame {frame.number} has no time')
        if frame.flags & frames.MODELS_CHANGED:
            self._known = False
        timestamp = round(times.timestamp * 1e9)
        ticking = self.version >= (3, 0)
        exposure = self._ns(times.exposure) if ticking else timestamp
        sent = self._ns(times.transmitted) if ticking else timestamp
        self.match.add_arrival(sent, arrived)
        if -RESTART < frame.number - self._last <= 0:
            self.counts['late frames'] += 1
            return []
        if 1 < frame.number - self._last < RESTART and self._last >= 0:
            self.counts['missing frames'] += frame.number - self._last - 1
        self._last = frame.number
        waited = 0 if self.match.answered else self._least_delay
        here = (self.match.local(exposure) or arrived) - waited
        if abs(arrived - here) > OLDEST:
            raise wire.PacketError(f'frame {frame.number} was exposed '
                                   f'{(arrived - here) * 1e-9:.3g} s before it arrived')
        self.counts['frames'] += 1
        received = self._ns(times.received) if ticking else exposure
        self.delays = Delays(
            (received - exposure) * 1e-9, (sent - received) * 1e-9,
            (arrived - here - (sent - exposure)) * 1e-9, (arrived - here) * 1e-9)
        stamp = timestamp if self._server_time else here
        return [self._seen(body, stamp) for body in frame.bodies if self._usable(body)]

    def _usable(self, body: frames.RigidBody) -> bool:
        """Return whether a body has a pose; count it if not."""
        if not body.tracked:
            self.counts['bodies not tracked'] += 1
            return False
        length = math.hypot(*body.attitude)
        if abs(length - 1.0) < UNIT and all(abs(x) < FARTHEST for x in body.position):
            return True
        self.counts['bodies without a pose'] += 1
        return False

    def _seen(self, body: frames.RigidBody, stamp: int) -> Seen:
        length = math.hypot(*body.attitude)
        x, y, z, w = (one / length for one in body.attitude)
        return Seen(
            body.identifier, self.names.get(body.identifier, ''), stamp,
            from_stream(body.position, self._up), attitude_from_stream((x, y, z, w), self._up),
            self.delays.total)
