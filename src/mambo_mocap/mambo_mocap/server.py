"""
What a NatNet server answers and to whom it sends frames; without sockets.

Commands come from anyone and are not trusted: what cannot be read is counted and gets no answer,
a request that is not known gets the answer that says so, and the number of clients is bounded.
"""

from __future__ import annotations

from collections import Counter, OrderedDict
import struct
from typing import NamedTuple

from mambo_model.schema import ParameterError

from .hall import fullest, model
from .natnet import frame as frames, handshake, wire
from .natnet.model import encode_model
from .parameters import NatNetServerNodeParams, VERSIONS

FREQUENCY = 10_000_000  # ticks/s, that of Windows' performance counter
NAME, APPLICATION = 'Mambo', (0, 1, 0, 0)
MOST_CLIENTS = 32
SILENT = 30_000_000_000  # ns without a sign of life of a client that sends such
LONGEST = 1024  # bytes of a command
Address = tuple[str, int]
Packet = tuple[bytes, Address]


def ticks(ns: int) -> int:
    """Return ns as ticks of the server's clock."""
    return ns * FREQUENCY // 1_000_000_000


class Client(NamedTuple):
    """A client of a unicast server."""

    seen: int              # ns, last sign of life
    lively: bool           # it sends signs of life
    version: wire.Version  # of the frames that it gets


class Server:
    """
    Answers commands and addresses frames.

    Parameters
    ----------
    params
        Of the node. ParameterError if their bodies do not fit into a UDP packet.

    Attributes
    ----------
    clients : dict
        By address, those of a unicast server; the one that was silent for longest first.
    refused : Counter
        Commands without use, by reason.

    """

    def __init__(self, params: NatNetServerNodeParams) -> None:
        self._params, self.version = params, params.protocol
        self._model = model(params)
        self.clients: OrderedDict[Address, Client] = OrderedDict()
        self.refused: Counter[str] = Counter()
        self._multicast = params.transmission == 'multicast'
        self._check_size()

    def _check_size(self) -> None:
        """Raise ParameterError if the definitions or a frame may be longer than a packet."""
        spoken = {self.version}
        if not self._multicast:  # a client may ask for another version
            spoken |= {wire.OLDEST, *(tuple(map(int, one.split('.'))) for one in VERSIONS)}
        frame = fullest(self._params)
        try:
            for version in spoken:
                encode_model(self._model, version)
                frames.encode_frame(frame, version)
        except wire.PacketError as error:
            raise ParameterError(
                f'{len(self._params.topics)} bodies of these names may not fit into one packet: '
                f'{error}: give fewer bodies or shorter names') from None

    @property
    def info(self) -> handshake.ServerInfo:
        """Return the reply to a client that connects."""
        return handshake.ServerInfo(
            handshake.Sender(NAME, APPLICATION, (*self.version, 0, 0)), FREQUENCY,
            self._params.data_port, self._multicast, self._params.group)

    def answer(self, data: bytes, sender: Address, now: int) -> bytes | None:
        """
        Return the reply to a command, None if it gets none.

        Parameters
        ----------
        data
            The packet. Its announced size is not looked at, as clients announce any.
        sender
            Address and port it came from.
        now : ns
            When it came, of the system's clock.

        """
        if len(data) > LONGEST:
            self.refused['too long'] += 1
            return None
        try:
            number = wire.kind(data)
        except wire.PacketError:
            self.refused['malformed'] += 1
            return None
        if number == wire.DISCONNECT:
            self.clients.pop(sender, None)
            return None
        if number in (wire.CONNECT, wire.KEEP_ALIVE):
            self._welcome(sender, now, number == wire.KEEP_ALIVE)
        if number in (wire.CONNECT, wire.DISCOVERY):
            return handshake.encode_server_info(self.info)
        if number == wire.KEEP_ALIVE:
            return None
        if number == wire.REQUEST_MODEL:
            return encode_model(self._model, self._version_of(sender))
        if number == wire.ECHO_REQUEST:
            return self._echo(data, now)
        if number == wire.REQUEST:
            return self._request(data, sender, now)
        self.refused['unknown'] += 1
        return wire.message(wire.UNRECOGNISED, b'')

    def _echo(self, data: bytes, now: int) -> bytes | None:
        try:
            return handshake.encode_echo_response(handshake.decode_echo_request(data), ticks(now))
        except wire.PacketError:
            self.refused['malformed'] += 1
            return None

    def _request(self, data: bytes, sender: Address, now: int) -> bytes:
        """Answer a command in words; an empty one connects, as motioncapture sends it."""
        words = data[wire.HEADER.size:].split(b'\0')[0].decode('ascii', 'replace').split(',')
        if words == ['']:
            self._welcome(sender, now, False)
        elif words[0].lower() == 'framerate':
            return wire.message(wire.RESPONSE, struct.pack('<f', self._params.rate))
        elif words[0].lower() == 'unitstomillimeters':
            return wire.message(wire.RESPONSE, struct.pack('<f', 1000.0))
        elif words[0].lower() == 'bitstream' and sender in self.clients:
            return self._bitstream(words[1:], sender)
        self.refused['unknown'] += words != ['']
        return wire.message(wire.UNRECOGNISED, b'')

    def _bitstream(self, words: list[str], sender: Address) -> bytes:
        """Set the version of the frames of a unicast client."""
        try:
            major, minor = words[0].split('.')[:2]
            version = int(major), int(minor)
            wire.check(version)
        except (IndexError, ValueError):
            self.refused['unknown'] += 1
            return wire.message(wire.UNRECOGNISED, b'')
        self.clients[sender] = self.clients[sender]._replace(version=version)
        return wire.message(wire.RESPONSE, wire.INT.pack(0))

    def _version_of(self, sender: Address) -> wire.Version:
        client = self.clients.get(sender)
        return client.version if client else self.version

    def _welcome(self, sender: Address, now: int, lively: bool) -> None:
        """Remember a client; of too many the one that was silent for longest leaves."""
        if self._multicast:
            return
        before = self.clients.get(sender)
        self.clients[sender] = Client(
            now, lively or bool(before and before.lively), self._version_of(sender))
        self.clients.move_to_end(sender)
        while len(self.clients) > MOST_CLIENTS:
            self.clients.popitem(last=False)

    def packets(self, frame: frames.Frame, now: int) -> list[Packet]:
        """Return the packets of a frame: one for the group, or one for each client."""
        if self._multicast:
            return [(frames.encode_frame(frame, self.version),
                     (self._params.group, self._params.data_port))]
        for address in [address for address, client in self.clients.items()
                        if client.lively and now - client.seen > SILENT]:
            del self.clients[address]
        written: dict[wire.Version, bytes] = {}
        out = []
        for (host, port), client in self.clients.items():
            if client.version not in written:
                written[client.version] = frames.encode_frame(frame, client.version)
            port = self._params.data_port if self._params.unicast_to == 'data_port' else port
            out.append((written[client.version], (host, port)))
        # several clients of a host that listen at one port get one packet
        return list({address: (data, address) for data, address in out}.values())
