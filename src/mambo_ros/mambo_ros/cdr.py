"""
CDR bytes of any message, XCDR1 little endian: its stamp read and replaced, and a serialiser.

The middleware's own serialiser leaves whatever was in memory in the alignment bytes, so that
equal messages need not have equal bytes; a flight that is to be identical needs these.
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
WORD = 4  # bytes; what is sent is a whole number of them
SECOND = 1_000_000_000  # ns
_STAMP = struct.Struct('>iI'), struct.Struct('<iI')  # by the last bit of the encapsulation


def stamp_ns(data: bytes, offset: int = 0) -> int:
    """
    Return the stamp in nanoseconds of any serialised message that begins with one.

    That is every message with a header, ``rosgraph_msgs/Clock`` and ``builtin_interfaces/Time``;
    ``offset`` bytes further in where something stands before it (4 for the count of a sequence).
    """
    seconds, nanoseconds = _STAMP[data[1] & 1].unpack_from(data, 4 + offset)
    return seconds * SECOND + nanoseconds


def restamped(data: bytes, stamp: int) -> bytes:
    """Return a serialised message that begins with a stamp, with another one in ns."""
    order = '<' if data[1] & 1 else '>'
    return data[:4] + struct.pack(f'{order}iI', *divmod(stamp, SECOND)) + data[12:]


class _Writer:
    """CDR bytes of any message, alignment bytes zero."""

    def __init__(self) -> None:
        self.data = bytearray(ENCAPSULATION)

    def align(self, width: int) -> None:
        """Fill up with zeros to a multiple of so many bytes."""
        self.data.extend(b'\0' * (-(len(self.data) - 4) % width))

    def primitive(self, kind: str, values: Any) -> None:
        """Write numbers of a kind."""
        code, width = FORMATS[kind]
        self.align(width)
        self.data += struct.pack(f'<{len(values)}{code}', *values)

    def one(self, kind: str, value: Any) -> None:
        """Write a value of any kind."""
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
    Return the bytes of any message, slowly, with zeros between the fields.

    Frequent messages of fixed layout go through :class:`mambo_ros.layout.Layout`.
    """
    writer = _Writer()
    writer.message(message)
    writer.align(WORD)
    return bytes(writer.data)
