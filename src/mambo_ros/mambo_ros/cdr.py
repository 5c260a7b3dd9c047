"""
CDR bytes of any message (XCDR1, little endian): read and replace its stamp, serialise it.

The middleware's own serialiser leaves the alignment bytes uninitialised, so equal messages may
have different bytes. Byte-identical flights need this serialiser, which writes zeros there.
"""

from __future__ import annotations

import re
import struct
from typing import Any

FORMATS = {
    'boolean': ('?', 1), 'octet': ('c', 1), 'uint8': ('B', 1), 'int8': ('b', 1),
    'uint16': ('H', 2), 'int16': ('h', 2), 'uint32': ('I', 4), 'int32': ('i', 4),
    'uint64': ('Q', 8), 'int64': ('q', 8), 'float': ('f', 4), 'double': ('d', 8)}
ENCAPSULATION = b'\x00\x01\x00\x00'  # XCDR1, little endian
WORD = 4  # bytes; a sent message is padded to a multiple of this
SECOND = 1_000_000_000  # ns
# byte order, selected by the last bit of the encapsulation
_STAMP = struct.Struct('>iI'), struct.Struct('<iI')


def stamp_ns(data: bytes, offset: int = 0) -> int:
    """
    Return the stamp in nanoseconds of any serialised message that begins with one.

    These are all messages with a header, ``rosgraph_msgs/Clock`` and ``builtin_interfaces/Time``.
    ``offset`` is the number of bytes before the stamp (4 for the count of a sequence).
    """
    seconds, nanoseconds = _STAMP[data[1] & 1].unpack_from(data, 4 + offset)
    return seconds * SECOND + nanoseconds


def restamped(data: bytes, stamp: int) -> bytes:
    """Return a copy of a serialised message whose leading stamp is replaced by ``stamp`` in ns."""
    order = '<' if data[1] & 1 else '>'
    return data[:4] + struct.pack(f'{order}iI', *divmod(stamp, SECOND)) + data[12:]


class _Writer:
    """Serialiser of any message, with zeros as alignment bytes."""

    def __init__(self) -> None:
        self.data = bytearray(ENCAPSULATION)

    def align(self, width: int) -> None:
        """Pad with zeros to a multiple of ``width`` bytes."""
        self.data.extend(b'\0' * (-(len(self.data) - 4) % width))

    def primitive(self, kind: str, values: Any) -> None:
        """Write numbers of one primitive type."""
        code, width = FORMATS[kind]
        self.align(width)
        self.data += struct.pack(f'<{len(values)}{code}', *values)

    def one(self, kind: str, value: Any) -> None:
        """Write a value of any type."""
        if kind in FORMATS:
            self.primitive(kind, (value,))
        elif kind == 'string':
            data = value.encode() + b'\0'
            self.primitive('uint32', (len(data),))
            self.data += data
        else:
            self.message(value)

    def message(self, message: Any) -> None:
        """Write the fields of a message."""
        for name, kind in message.get_fields_and_field_types().items():
            value = getattr(message, name)
            many = re.fullmatch(r'sequence<(.+?)(?:, \d+)?>|(.+)\[\d+\]', kind)
            if not many:
                self.one(kind, value)
                continue
            if many[1]:
                self.primitive('uint32', (len(value),))
            for element in value:
                self.one(many[1] or many[2], element)


def serialize(message: Any) -> bytes:
    """
    Return the CDR bytes of any message, with zeros as alignment bytes. Slow.

    Frequent messages of fixed layout go through :class:`mambo_ros.layout.Layout`.
    """
    writer = _Writer()
    writer.message(message)
    writer.align(WORD)
    return bytes(writer.data)
