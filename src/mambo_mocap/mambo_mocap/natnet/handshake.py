"""Messages by which a client and a server find each other and compare their clocks."""

from __future__ import annotations

from ipaddress import IPv4Address
import struct
from typing import NamedTuple

from .wire import (
    CONNECT, ECHO_REQUEST, ECHO_RESPONSE, message, PacketError, payload, Reader, SERVER_INFO,
    Version)

NAME = 256  # bytes of the field of an application's name
Numbers = tuple[int, int, int, int]

_SENDER = struct.Struct(f'<{NAME}s4B4B')
_SERVER = struct.Struct('<QH?4s')
_ONE, _TWO = struct.Struct('<Q'), struct.Struct('<2Q')


class Sender(NamedTuple):
    """Who sends: application, its version and that of the protocol."""

    name: str
    application: Numbers
    protocol: Numbers

    @property
    def version(self) -> Version:
        """Return major and minor number of the protocol."""
        return self.protocol[:2]


class ServerInfo(NamedTuple):
    """A server's reply to a client that connects."""

    sender: Sender
    frequency: int = 0       # ticks/s of its clock, since 3.0
    data_port: int = 1511    # since 3.0
    multicast: bool = True   # since 3.0
    group: str = '239.255.42.99'  # since 3.0


def _read_sender(reader: Reader, what: str) -> Sender:
    name, *numbers = reader.take(_SENDER, what)
    return Sender(name.split(b'\0')[0].decode('utf-8', 'surrogateescape'),
                  tuple(numbers[:4]), tuple(numbers[4:]))


def _write_sender(sender: Sender) -> bytes:
    """Return the fields of a sender; a name that is too long is cut."""
    name = sender.name.split('\0')[0].encode('utf-8', 'surrogateescape')[:NAME - 1]
    return _SENDER.pack(name, *sender.application, *sender.protocol)


def encode_connect(sender: Sender, number: int = CONNECT) -> bytes:
    """Return the packet by which a client connects, or with ``DISCOVERY`` looks for servers."""
    return message(number, _write_sender(sender))


def decode_connect(data: bytes, number: int = CONNECT) -> Sender:
    """
    Return who connects.

    Raises
    ------
    PacketError
        If the packet is none of Motive's clients; those of others often send the header alone.

    """
    reader = payload(data, number)
    sender = _read_sender(reader, 'the client')
    reader.close('the message')
    return sender


def encode_server_info(info: ServerInfo) -> bytes:
    """Return the packet of a server's reply, in the layout of its version."""
    out = _write_sender(info.sender)
    if info.sender.version >= (3, 0):
        out += _SERVER.pack(
            info.frequency, info.data_port, info.multicast, IPv4Address(info.group).packed)
    return message(SERVER_INFO, out)


def decode_server_info(data: bytes) -> ServerInfo:
    """Return a server's reply; PacketError if the packet is none."""
    reader = payload(data, SERVER_INFO)
    sender = _read_sender(reader, "the server's reply")
    if sender.version < (3, 0):
        reader.close("the server's reply")
        return ServerInfo(sender)
    frequency, port, multicast, group = reader.take(_SERVER, "the server's reply")
    if not frequency or not port:
        raise PacketError('the server names no data port or no frequency of its clock')
    if multicast and not IPv4Address(group).is_multicast:
        raise PacketError(f'the group {IPv4Address(group)} of the server is no multicast address')
    return ServerInfo(sender, frequency, port, multicast, str(IPv4Address(group)))


def encode_echo_request(sent: int) -> bytes:
    """Return the question for the server's time; ``sent`` comes back with the answer."""
    return message(ECHO_REQUEST, _ONE.pack(sent))


def decode_echo_request(data: bytes) -> int:
    """Return the number that the answer is to repeat."""
    return payload(data, ECHO_REQUEST).take(_ONE, 'the echo request')[0]


def encode_echo_response(sent: int, ticks: int) -> bytes:
    """Return the answer: the client's number, and the server's clock in ticks."""
    return message(ECHO_RESPONSE, _TWO.pack(sent, ticks))


def decode_echo_response(data: bytes) -> tuple[int, int]:
    """Return the client's number and the server's clock in ticks."""
    return payload(data, ECHO_RESPONSE).take(_TWO, 'the echo response')
