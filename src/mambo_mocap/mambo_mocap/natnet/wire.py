"""
Bytes of NatNet packets: a bounded reader, and what all messages share.

Every packet is little endian and begins with its message number and the number of bytes that
follow, both 16 bits. Layouts of the versions are those of the PacketClient sample of OptiTrack's
NatNet SDK, held against packets of Motive in the tests.
"""

from __future__ import annotations

import struct

from mambo_model.errors import InputError

Vec3 = tuple[float, float, float]
Quat = tuple[float, float, float, float]
Version = tuple[int, int]
"""Major and minor number of the protocol."""

OLDEST, NEWEST = (2, 5), (4, 2)
"""Versions that these modules read and write."""
SIZED = (4, 1)
"""First version whose sections and descriptions tell their size in bytes."""

LARGEST = 65_507  # bytes that a UDP packet holds

CONNECT, SERVER_INFO, REQUEST, RESPONSE, REQUEST_MODEL, MODEL, REQUEST_FRAME, FRAME = range(8)
TEXT, DISCONNECT, KEEP_ALIVE = 8, 9, 10
ECHO_REQUEST, ECHO_RESPONSE, DISCOVERY = 12, 13, 14
UNRECOGNISED = 100

HEADER = struct.Struct('<HH')
INT, VECTOR = struct.Struct('<i'), struct.Struct('<3f')


class PacketError(InputError):
    """A packet is cut off, too long, of a wrong kind, or contradicts itself."""


def message(number: int, payload: bytes) -> bytes:
    """
    Return a packet: header and payload.

    Raises
    ------
    PacketError
        If the payload does not fit into a UDP packet.

    """
    if HEADER.size + len(payload) > LARGEST:
        raise PacketError(f'a message of {len(payload)} bytes does not fit into a UDP packet')
    return HEADER.pack(number, len(payload)) + payload


def kind(data: bytes) -> int:
    """Return the message number of a packet; PacketError if it has no header."""
    if len(data) < HEADER.size:
        raise PacketError(f'a packet of {len(data)} bytes has no header')
    return HEADER.unpack_from(data)[0]


def payload(data: bytes, number: int) -> Reader:
    """
    Return a reader of the payload of a packet.

    Raises
    ------
    PacketError
        If the packet is no such message, or its size is not what its header says.

    """
    found = kind(data)
    if found != number:
        raise PacketError(f'message {found} instead of {number}')
    size = HEADER.unpack_from(data)[1]
    if size != len(data) - HEADER.size:
        raise PacketError(
            f'the header announces {size} bytes, {len(data) - HEADER.size} have arrived')
    return Reader(data, HEADER.size)


def check(version: Version) -> None:
    """Raise PacketError if a version of the protocol is not known."""
    if not OLDEST <= version <= NEWEST:
        raise PacketError(
            f'NatNet {version[0]}.{version[1]} is unknown: set the server to a version from '
            f'{OLDEST[0]}.{OLDEST[1]} to {NEWEST[0]}.{NEWEST[1]}')


class Reader:
    """
    Reads values one after the other and never beyond the end.

    Parameters
    ----------
    data
        The packet.
    at
        Index of the first byte.
    end
        Index behind the last one; default: the end of the data.

    """

    def __init__(self, data: bytes, at: int = 0, end: int | None = None) -> None:
        self.data, self.at, self.end = data, at, len(data) if end is None else end

    def _pass(self, size: int, what: str) -> int:
        """Move on by some bytes; return where they began."""
        begin = self.at
        if size > self.end - begin:
            raise PacketError(f'{what} is cut off: {size} bytes wanted, {self.end - begin} left')
        self.at = begin + size
        return begin

    def take(self, layout: struct.Struct, what: str) -> tuple:
        """Return the values of a layout."""
        return layout.unpack_from(self.data, self._pass(layout.size, what))

    def many(self, layout: struct.Struct, count: int, what: str) -> list[tuple]:
        """Return the values of a layout that is repeated."""
        begin = self._pass(layout.size * count, what)
        return list(layout.iter_unpack(self.data[begin:self.at]))

    def count(self, least: int, what: str) -> int:
        """Return a number of elements, each of which takes at least ``least`` bytes."""
        n = self.take(INT, f'the number of {what}')[0]
        if not 0 <= n * least <= self.end - self.at:
            raise PacketError(f'{n} {what} do not fit into {self.end - self.at} bytes')
        return n

    def raw(self, size: int, what: str) -> bytes:
        """Return some bytes."""
        if size < 0:
            raise PacketError(f'{what} has {size} bytes')
        begin = self._pass(size, what)
        return self.data[begin:self.at]

    def string(self, what: str) -> str:
        """Return a text that ends with a zero byte; bytes that are no UTF-8 become surrogates."""
        stop = self.data.find(b'\0', self.at, self.end)
        if stop < 0:
            raise PacketError(f'{what} does not end')
        begin, self.at = self.at, stop + 1
        return self.data[begin:stop].decode('utf-8', 'surrogateescape')

    def section(self, sized: bool, what: str) -> Reader:
        """Return a reader of the section that begins here; of a sized one up to its own end."""
        if not sized:
            return self
        size = self.take(INT, f'the size of {what}')[0]
        if size < 0:
            raise PacketError(f'{what} has {size} bytes')
        begin = self._pass(size, what)
        return Reader(self.data, begin, self.at)

    def close(self, what: str) -> None:
        """Raise PacketError if bytes are left."""
        if self.at != self.end:
            raise PacketError(f'{what} has {self.end - self.at} bytes too many')


def text(value: str) -> bytes:
    """Return a text with its zero byte; what is behind a zero byte in it is left out."""
    return value.split('\0')[0].encode('utf-8', 'surrogateescape') + b'\0'


def section(body: bytes, sized: bool) -> bytes:
    """Return a section, with its size before it where the version has that."""
    return (INT.pack(len(body)) if sized else b'') + body
