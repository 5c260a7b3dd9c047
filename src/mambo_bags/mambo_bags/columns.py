"""
CDR messages as numpy columns, and typed messages to CDR, without ROS.

A message whose strings and sequences have the same lengths throughout a topic has one fixed
layout (XCDR1, alignment counted from the end of the 4-byte header). :func:`layout` derives it
from the type's definition and the first message, then compares the lengths in every message. A
column is therefore either exact or refused.
"""

from __future__ import annotations

from collections.abc import Iterable
import dataclasses
from functools import cache
import os
import struct
from typing import Any

from mambo_model.errors import MamboError
import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.typesys import get_types_from_msg, get_typestore, Stores
from rosbags.typesys.store import Typestore

from . import message_definition

HEADER = b'\x00\x01\x00\x00'  # XCDR1, little endian
_SIZES = {
    'bool': ('?', 1), 'byte': ('u1', 1), 'char': ('u1', 1), 'octet': ('u1', 1),
    'int8': ('i1', 1), 'uint8': ('u1', 1), 'int16': ('<i2', 2), 'uint16': ('<u2', 2),
    'int32': ('<i4', 4), 'uint32': ('<u4', 4), 'int64': ('<i8', 8), 'uint64': ('<u8', 8),
    'float32': ('<f4', 4), 'float64': ('<f8', 8)}
_MAX_ITEMS = 256  # longer sequences of messages are not spread over columns


class NoLayout(MamboError):
    """The messages have no common layout; decode them one by one."""


@dataclasses.dataclass(frozen=True)
class Column:
    """Position and type of a field in every message of a topic."""

    offset: int
    dtype: str
    count: int | None  # None: a single value


class _Walk:
    """Walks through one message by its type definition and records the position of each field."""

    def __init__(self, store: Typestore, data: bytes) -> None:
        self.columns: dict[str, Column] = {}
        self.lengths: dict[int, int] = {}
        self._store, self._data, self._at = store, data, 4

    def _align(self, size: int) -> None:
        self._at += -(self._at - 4) % size

    def _length(self) -> int:
        self._align(4)
        if self._at + 4 > len(self._data):
            raise NoLayout
        value = struct.unpack_from('<I', self._data, self._at)[0]
        self.lengths[self._at] = value
        self._at += 4
        return value

    def _primitive(self, path: str, name: str, count: int | None) -> None:
        if name == 'string' and count is None:
            length = self._length()
            self.columns[path] = Column(self._at, f'S{length}', None)
            self._at += length
        elif name in _SIZES:
            dtype, size = _SIZES[name]
            if count != 0:
                self._align(size)
            self.columns[path] = Column(self._at, dtype, count)
            self._at += size * (1 if count is None else count)
        else:
            raise NoLayout

    def field(self, path: str, kind: tuple[Any, Any]) -> None:
        """Walk over one field of any type."""
        # without this limit an array of arrays would be walked to its last element
        if self._at > len(self._data):
            raise NoLayout
        node, detail = kind
        if node == Nodetype.BASE:
            self._primitive(path, detail[0], None)
        elif node == Nodetype.NAME:
            self.message(detail, f'{path}.')
        else:
            element, count = detail[0], detail[1]
            if node == Nodetype.SEQUENCE:
                count = self._length()
            if element[0] == Nodetype.BASE and element[1][0] != 'string':
                self._primitive(path, element[1][0], count)
            elif count <= _MAX_ITEMS:
                for item in range(count):
                    self.field(f'{path}[{item}]', element)
            else:
                raise NoLayout

    def message(self, type_name: str, prefix: str = '') -> None:
        """Walk over all fields of a message type."""
        fields = self._store.fielddefs[type_name][1]
        if not fields:
            raise NoLayout
        for name, kind in fields:
            self.field(prefix + name, kind)

    @property
    def end(self) -> int:
        """Return the length of the message."""
        return self._at

    def is_whole(self) -> bool:
        """
        Return whether the message ends where its type ends.

        Middlewares pad to four bytes. Fast CDR also reserves up to eight bytes for the alignment
        of each empty sequence; they are not needed and remain at the end of the message.
        """
        slack = 3 + 8 * sum(length == 0 for length in self.lengths.values())
        return self._at <= len(self._data) <= self._at + slack


def layout(
    store: Typestore, type_name: str, table: NDArray[np.uint8],
) -> dict[str, Column]:
    """
    Find the common layout of a topic's messages.

    Parameters
    ----------
    store
        Types of the bag.
    type_name
        Type of the messages.
    table : (n, size)
        CDR messages of one length, at least one.

    Returns
    -------
    Column of each field by dotted path.

    Raises
    ------
    NoLayout
        If any message differs in header or in the length of a string or sequence.

    """
    first = table[0].tobytes()
    walk = _Walk(store, first)
    if first[:2] != HEADER[:2]:
        raise NoLayout
    walk.message(type_name)
    if not walk.is_whole():
        raise NoLayout
    same = (table[:, :2] == table[0, :2]).all()
    for offset in walk.lengths:
        same = same and bool((table[:, offset:offset + 4] == table[0, offset:offset + 4]).all())
    if not same:
        raise NoLayout
    return walk.columns


def trimmed(store: Typestore, type_name: str, data: bytes) -> bytes:
    """Return a message without the padding that a middleware appended."""
    walk = _Walk(store, data)
    try:
        walk.message(type_name)
    except NoLayout:
        return data
    return data[:walk.end] if walk.is_whole() else data


def take(table: NDArray[np.uint8], column: Column) -> NDArray[Any]:
    """Return a column of values, (n,) or (n, count); texts as str."""
    dtype = np.dtype(column.dtype)
    width = dtype.itemsize * (1 if column.count is None else column.count)
    if width == 0:
        shape = (len(table),) if column.count is None else (len(table), 0)
        return np.full(shape, '', 'U1') if dtype.kind == 'S' else np.empty(shape, dtype)
    values = np.ascontiguousarray(table[:, column.offset:column.offset + width]).view(dtype)
    if dtype.kind == 'S':
        values = np.char.decode(values, 'utf-8', 'replace')
    return values[:, 0] if column.count is None else values


def load_types(type_names: Iterable[str]) -> Typestore:
    """
    Return the installed definitions of message types, to serialise and to build them.

    They are the same object for the same types, as parsing them takes longer than most of what
    they serialise: register no further types there.

    Raises
    ------
    mambo_bags.message_definition.DefinitionError
        If a type is not installed.

    """
    return _loaded(tuple(sorted(set(type_names))), os.environ.get('AMENT_PREFIX_PATH', ''))


@cache
def _loaded(type_names: tuple[str, ...], prefixes: str) -> Typestore:
    """Return the definitions of types as they are in some ament prefixes."""
    store = get_typestore(Stores.EMPTY)
    for name in type_names:
        store.register(get_types_from_msg(message_definition.full_text(name), name))
    return store


def zero(store: Typestore, type_name: str, **fields: Any) -> Any:
    """Return a message whose fields are 0, empty or false, except the given ones."""
    values: dict[str, Any] = {}
    for name, kind in store.fielddefs[type_name][1]:
        values[name] = fields.pop(name) if name in fields else _zero_field(store, kind)
    if fields:
        raise TypeError(f"{type_name} has no field {', '.join(fields)}")
    return store.types[type_name](**values)


def _zero_field(store: Typestore, kind: tuple[Any, Any]) -> Any:
    node, detail = kind
    if node == Nodetype.NAME:
        return zero(store, detail)
    if node == Nodetype.BASE:
        if detail[0] in ('string', 'wstring'):
            return ''
        return {'?': False, 'f': 0.0}.get(_SIZES[detail[0]][0].lstrip('<')[0], 0)
    element, count = detail[0], detail[1] if node == Nodetype.ARRAY else 0
    if element[0] == Nodetype.BASE and element[1][0] in _SIZES:
        return np.zeros(count, _SIZES[element[1][0]][0])
    return [_zero_field(store, element) for _ in range(count)]
