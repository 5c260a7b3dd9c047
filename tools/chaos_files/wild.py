"""Messages and requests that nobody should send, made from the structure of their type."""

from __future__ import annotations

import array
from collections.abc import Iterator
from importlib import import_module
import math
import random
import re
import struct
from typing import Any

from builtin_interfaces.msg import Duration, Time
import numpy as np
from rclpy.serialization import serialize_message

MEGABYTES = 5
TEXTS = ('', ' ', '/', 'map', 'odom', '\x1b[2J\x1b]0;x\x07', 'a\nb\r\nc: d', '%s%n{0}', '~',
         '\N{GRINNING FACE}', '../../etc', 'x' * 300, 'x' * 70_000, '\t', '\x7f', "'; --")
FLOATS = (math.nan, math.inf, -math.inf, 1e30, -1e30, 5e-324, -1.0, -0.0, 0.0, 1e-9, 3.0)
_BITS = {'int8': 8, 'int16': 16, 'int32': 32, 'int64': 64,
         'uint8': 8, 'uint16': 16, 'uint32': 32, 'uint64': 64, 'octet': 8}
_MANY = re.compile(r'sequence<(.+?)(?:, \d+)?>|(.+)\[(\d+)\]')
_STAMPS = (Time, Duration)
_TIMES = ('builtin_interfaces/Time', 'builtin_interfaces/Duration')
_WORDS = 40  # 32-bit words at the beginning of a message, of which one becomes a wrong length


def found(kind: str) -> type:
    """Return the class of a ``package/Name`` or ``package/msg/Name``."""
    package, *middle, name = kind.split('/')
    return getattr(import_module(f'{package}.{middle[0] if middle else "msg"}'), name)


def number(rng: random.Random, kind: str) -> Any:
    """Return an extreme value of a primitive type."""
    if kind in ('float', 'double'):
        value = rng.choice((*FLOATS, rng.uniform(-100.0, 100.0)))
        return float(np.float32(value)) if kind == 'float' else value
    if kind == 'boolean':
        return rng.random() < 0.5
    bits, signed = _BITS[kind], kind.startswith('int')
    low, high = (-(1 << bits - 1), (1 << bits - 1) - 1) if signed else (0, (1 << bits) - 1)
    value = rng.choice((low, high, 0, 1, min(high, 99), rng.randint(low, high)))
    return bytes([value]) if kind == 'octet' else value


def one(rng: random.Random, kind: str, depth: int = 0) -> Any:
    """Return a wild value of any type of field."""
    if kind == 'string':
        return rng.choice(TEXTS)
    if kind == 'boolean' or kind in _BITS or kind in ('float', 'double'):
        return number(rng, kind)
    message = found(kind)()
    for name, field in leaves(message):
        setattr(message, name, value(rng, field, depth + 1))
    return message


def value(rng: random.Random, kind: str, depth: int = 0) -> Any:
    """Return a wild value of a field, which may be an array or a sequence."""
    many = _MANY.fullmatch(kind)
    if not many:
        return one(rng, kind, depth)
    kind = many[1] or many[2]
    most = 3 if depth > 1 else 2000 if kind in ('float', 'double', *_BITS) else 20
    count = int(many[3]) if many[3] else rng.choice((0, 1, 2, most))
    return [one(rng, kind, depth) for _ in range(count)]


def leaves(message: Any) -> Iterator[tuple[str, str]]:
    """Yield name and type of the fields of a message."""
    yield from message.get_fields_and_field_types().items()


def parts(message: Any) -> Iterator[Any]:
    """Yield a message and all single messages in it."""
    yield message
    for name, _ in leaves(message):
        inner = getattr(message, name)
        if hasattr(inner, 'get_fields_and_field_types'):
            yield from parts(inner)
        elif isinstance(inner, list):
            for each in inner[:3]:
                if hasattr(each, 'get_fields_and_field_types'):
                    yield from parts(each)


def spoil(rng: random.Random, message: Any) -> None:
    """Give some fields of a message, at any depth, wild values."""
    fields = [(part, name, kind) for part in parts(message) for name, kind in leaves(part)
              if kind not in _TIMES and not isinstance(part, _STAMPS)]
    for part, name, kind in rng.sample(fields, min(len(fields), rng.randint(1, 3))):
        setattr(part, name, value(rng, kind))


def stamp(message: Any, seconds: int, nanoseconds: int) -> bool:
    """Set every stamp of a message; return whether it has any."""
    stamps = [part for part in parts(message) if isinstance(part, _STAMPS)]
    for part in stamps:
        part.sec = max(min(seconds, 2**31 - 1), -2**31)
        part.nanosec = nanoseconds
    return bool(stamps)


def enlarged(rng: random.Random, message: Any) -> bytes:
    """Return the bytes of a message with megabytes in a text or sequence, or behind it."""
    size = MEGABYTES << 20
    fields = [(part, name, kind) for part in parts(message) for name, kind in leaves(part)
              if kind == 'string' or (_MANY.fullmatch(kind) or [''] * 2)[1]]
    if not fields:
        return serialize_message(message) + bytes(size)
    part, name, kind = rng.choice(fields)
    inner = '' if kind == 'string' else _MANY.fullmatch(kind)[1]
    if not inner:
        content: Any = 'x' * size
    elif inner in _BITS and inner != 'octet':
        content = array.array('B', bytes(size)) if inner == 'uint8' else [0] * (size // 8)
    elif inner in ('float', 'double'):
        content = [math.nan] * (size // 8)
    else:
        each = one(rng, inner, 9)
        content = [each] * (size // len(serialize_message(each)) + 1)
    setattr(part, name, content)
    return serialize_message(message)


def garbage(rng: random.Random, data: bytes) -> bytes:
    """Return raw bytes in place of a message: random, cut, or with a wrong length in it."""
    kind = rng.randrange(6)
    if kind == 0:
        return rng.randbytes(rng.choice((0, 1, 3, 4, 8, 100, len(data), 60_000)))
    if kind == 1:
        return data[:rng.randrange(len(data) + 1)]
    if kind == 2:  # a length or a number
        place = 4 + 4 * rng.randrange(min(_WORDS, max(len(data) // 4 - 1, 1)))
        word = struct.pack('<I', rng.choice((0xFFFFFFFF, 0x7FFFFFFF, 0xFFFFFFF0, 1 << 20)))
        return data[:place] + word + data[place + 4:]
    if kind == 3:  # another encapsulation: order of bytes, parameter lists, XCDR2, unknown
        return bytes((rng.choice((0, 7, 255)), rng.choice((0, 2, 3, 6, 9, 255)))) + data[2:]
    if kind == 4:
        return data[:4] + b'\xff' * max(len(data) - 4, 0)
    return data + rng.randbytes(rng.choice((1, 4, 1000)))
