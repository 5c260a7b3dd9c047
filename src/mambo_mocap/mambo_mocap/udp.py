"""UDP sockets that tell when a packet arrived, by the clock of the kernel."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
import socket
import struct
import time

from mambo_model.errors import JobError

from .natnet.wire import LARGEST

AT_ONCE = 100
"""Most packets taken from a socket before others have their turn."""
BUFFER = 1 << 21  # bytes for packets that wait, as far as the system allows
_STAMP = 35  # SO_TIMESTAMPNS of Linux: a struct timespec comes with each packet
_TIMESPEC = struct.Struct('@ll')
Address = tuple[str, int]


def open_socket(address: str, port: int, group: str = '') -> socket.socket:
    """
    Return a socket that does not block.

    Parameters
    ----------
    address
        Of the interface.
    port
        To be bound to; 0: any.
    group
        Multicast group to receive from; empty: none.

    Raises
    ------
    JobError
        If the address is not of this machine, or the port is in use.

    """
    out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        out.setblocking(False)
        out.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
        out.setsockopt(socket.SOL_SOCKET, _STAMP, 1)
        here = socket.inet_aton(address)
        out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, here)
        out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, 1)
        out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_LOOP, 1)
        if group:
            out.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            out.bind((group, port))
            out.setsockopt(
                socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, socket.inet_aton(group) + here)
        else:
            out.bind((address, port))
    except OSError as error:
        out.close()
        raise JobError(
            f'{group or address}:{port} cannot be used: {error.strerror}: choose another port, or '
            f'an address of this machine') from None
    return out


def receive(source: socket.socket) -> Iterator[tuple[bytes, Address, int]]:
    """Yield the packets that wait: bytes, sender, and arrival in ns of the system's clock."""
    for _ in range(AT_ONCE):
        try:
            data, notes, _, sender = source.recvmsg(LARGEST + 1, 64)
        except BlockingIOError:
            return
        except OSError:  # an earlier packet was sent to a port that nobody listens at
            continue
        arrived = time.time_ns()
        for level, kind, note in notes:
            if (level, kind) == (socket.SOL_SOCKET, _STAMP) and len(note) >= _TIMESPEC.size:
                seconds, rest = _TIMESPEC.unpack_from(note)
                arrived = seconds * 1_000_000_000 + rest
        yield data, sender, arrived


def send(target: socket.socket, data: bytes, address: Address) -> bool:
    """Send a packet; return whether the system took it."""
    with suppress(OSError):
        return target.sendto(data, address) == len(data)
    return False
