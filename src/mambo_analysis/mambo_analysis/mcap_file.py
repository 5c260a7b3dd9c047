"""
One MCAP file taken apart, whole or cut off.

The framing (one byte of opcode, eight of length) is walked here, so that a record that runs past
the end of the file is noticed instead of read short; the records themselves are parsed by the
``mcap`` library. Messages, of which a second of flight has 2000, are not taken one by one: where
they stand is kept as arrays.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
import dataclasses
from io import BytesIO
from pathlib import Path
import struct
from typing import Any, NamedTuple
import zlib

import lz4.frame
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Metadata, Schema
import numpy as np
from numpy.typing import NDArray
import zstandard

MAGIC = b'\x89MCAP0\r\n'
_FRAME = struct.Struct('<BQ')
_HEAD = np.dtype([  # of a message, with its frame
    ('opcode', 'u1'), ('length', '<u8'), ('channel', '<u2'), ('sequence', '<u4'),
    ('log_time', '<u8'), ('publish_time', '<u8')])
_SHORTEST = _HEAD.itemsize - _FRAME.size


class BagError(ValueError):
    """A bag cannot be read; one line that says what, where and what to do."""


def windows(data: bytes, starts: NDArray[np.int64], size: int) -> NDArray[np.uint8]:
    """Return a copy of the ``size`` bytes behind each start, (n, size)."""
    every = np.ndarray((max(len(data) - size + 1, 0), size), np.uint8, data, strides=(1, 1))
    return every[starts]


class Heads(NamedTuple):
    """Where the records of n messages begin, and what they begin with, (n,) of ``_HEAD``."""

    starts: NDArray[np.int64]
    table: NDArray[Any]

    @classmethod
    def at(cls, data: bytes, starts: NDArray[np.int64]) -> Heads:
        """Return the heads that stand there."""
        return cls(starts, windows(data, starts, _HEAD.itemsize).view(_HEAD)[:, 0])


@dataclasses.dataclass(frozen=True)
class Batch:
    """
    Messages of one topic that stand together; it iterates over (log time, publish time, bytes).

    Attributes
    ----------
    log_time, publish_time : (n,) ns
    data
        (n, size) bytes where the messages have one size, else one after the other.

    """

    log_time: NDArray[np.int64]
    publish_time: NDArray[np.int64]
    data: NDArray[np.uint8] | list[bytes]

    @classmethod
    def of(cls, messages: list[tuple[int, int, bytes]]) -> Batch:
        """Return the batch of messages given one by one, as it iterates over them."""
        data = [payload for _, _, payload in messages]
        times = np.array([times for *times, _ in messages], np.int64).reshape(-1, 2)
        if len(set(map(len, data))) != 1:
            return cls(*times.T, data)
        return cls(*times.T, np.frombuffer(b''.join(data), np.uint8).reshape(len(data), -1))

    def __iter__(self) -> Iterator[tuple[int, int, bytes]]:
        times = self.log_time.tolist(), self.publish_time.tolist()
        return zip(*times, map(bytes, self.data), strict=True)


@dataclasses.dataclass
class Contents:
    """
    What a file holds.

    Attributes
    ----------
    schemas, channels
        By id, as the ``mcap`` library parses them.
    messages
        {channel id: batches in the order of the file}, of the wanted topics.
    count
        Messages of all topics.
    attachments, metadata
        In the order of the file.
    complete
        True if the file was closed and nothing of it was unreadable.
    lost
        What could not be read, one line each.

    """

    schemas: dict[int, Schema] = dataclasses.field(default_factory=dict)
    channels: dict[int, Channel] = dataclasses.field(default_factory=dict)
    messages: dict[int, list[Batch]] = dataclasses.field(default_factory=dict)
    count: int = 0
    attachments: list[Attachment] = dataclasses.field(default_factory=list)
    metadata: list[Metadata] = dataclasses.field(default_factory=list)
    complete: bool = False
    lost: list[str] = dataclasses.field(default_factory=list)


def read_file(path: Path) -> bytes:
    """Return a file's content; BagError if it cannot be read or is empty."""
    try:
        data = path.read_bytes()
    except OSError as error:
        raise BagError(f'{path}: cannot be read ({error.strerror})') from None
    if not data:
        raise BagError(f'{path}: the file is empty, nothing was recorded')
    return data


def _stream(data: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(data))


def _records(data: bytes, start: int) -> Iterator[tuple[int, int, int]]:
    """Yield (opcode, start, end) of each record; an end past the data is a record cut off."""
    position, size = start, len(data)
    while position + _FRAME.size <= size:
        opcode, length = _FRAME.unpack_from(data, position)
        position += _FRAME.size
        yield opcode, position, position + length
        position += length


def _unpack(chunk: Chunk, whole: bool) -> bytes:
    """Return a chunk's records; of a chunk cut off, what its compression gives back."""
    if chunk.compression == 'zstd':
        if not whole:
            return zstandard.ZstdDecompressor().decompressobj().decompress(chunk.data)
        return zstandard.decompress(chunk.data, chunk.uncompressed_size)
    if chunk.compression == 'lz4':
        return lz4.frame.decompress(chunk.data)
    if chunk.compression:
        raise ValueError(f'compression {chunk.compression!r} is not known')
    return chunk.data


class _Scanner:
    """Reads one file into :class:`Contents`."""

    def __init__(self, is_wanted: Callable[[str], bool]) -> None:
        self.contents = Contents()
        self._is_wanted = is_wanted
        self._wanted: dict[int, list[Batch]] = {}

    def inner(self, data: bytes, index: list[NDArray[np.uint64]]) -> bool:
        """Take the records of a chunk; False if the last one is cut off."""
        heads, whole = _indexed(data, index), True
        if heads is None:
            found = []
            for opcode, start, end in _records(data, 0):
                whole = end <= len(data) and (
                    opcode != Opcode.MESSAGE or end - start >= _SHORTEST)
                if not whole:
                    break
                if opcode == Opcode.MESSAGE:
                    found.append(start - _FRAME.size)
                else:
                    self.definition(opcode, data[start:end])
            heads = Heads.at(data, np.array(found, np.int64))
        self.messages(data, heads)
        return whole

    def messages(self, data: bytes, heads: Heads) -> None:
        """Take the messages with these heads, of the wanted topics."""
        order = np.argsort(heads.table['channel'], kind='stable')
        channels, log_times, publish_times, lengths = (
            heads.table[name][order].astype(np.int64)
            for name in ('channel', 'log_time', 'publish_time', 'length'))
        starts, unknown = heads.starts[order], []
        firsts = np.flatnonzero(np.diff(channels, prepend=-1)).tolist()
        for first, last in zip(firsts, [*firsts[1:], len(order)]):
            channel = int(channels[first])
            if channel not in self.contents.channels:
                unknown.append(channel)
                continue
            self.contents.count += last - first
            if (batches := self._wanted.get(channel)) is not None:
                part = slice(first, last)
                batches.append(Batch(
                    log_times[part], publish_times[part],
                    _cut(data, starts[part] + _HEAD.itemsize, lengths[part] - _SHORTEST)))
        if unknown:
            raise ValueError(f'message of unknown channel {unknown[0]}')

    def definition(self, opcode: int, body: bytes) -> None:
        """Take a schema or channel record."""
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(_stream(body))
            self.contents.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(_stream(body))
            if channel.id not in self.contents.channels:
                self.contents.channels[channel.id] = channel
                messages = self.contents.messages.setdefault(channel.id, [])
                if self._is_wanted(channel.topic):
                    self._wanted[channel.id] = messages

    def chunk(self, body: bytes, whole: bool, index: list[NDArray[np.uint64]]) -> None:
        """Take a chunk record; of one cut off, the messages that are still whole."""
        chunk = Chunk.read(_stream(body))
        data = _unpack(chunk, whole)
        if whole and chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
            raise ValueError('checksum does not match')
        if not self.inner(data, index) and whole:
            raise ValueError('a record inside is cut off')

    def summary(self, data: bytes) -> None:
        """Take the definitions that a closed file repeats, in case their chunk is damaged."""
        for opcode, start, end in _records(data, len(MAGIC)):
            if end <= len(data) and opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                with suppress(Exception):  # of damaged bytes; reading in order says what is lost
                    self.definition(opcode, data[start:end])

    def record(self, opcode: int, body: bytes) -> None:
        """Take a record of the top level."""
        if opcode == Opcode.ATTACHMENT:
            self.contents.attachments.append(Attachment.read(_stream(body)))
        elif opcode == Opcode.METADATA:
            self.contents.metadata.append(Metadata.read(_stream(body)))
        else:
            self.definition(opcode, body)


def _cut(
    data: bytes, starts: NDArray[np.int64], sizes: NDArray[np.int64],
) -> NDArray[np.uint8] | list[bytes]:
    """Return the bytes that stand there, as :class:`Batch` has them."""
    if (sizes == sizes[0]).all():
        return windows(data, starts, int(sizes[0]))
    return [data[start:start + size] for start, size in zip(starts.tolist(), sizes.tolist())]


def _indexed(data: bytes, index: list[NDArray[np.uint64]]) -> Heads | None:
    """
    Return the heads of the messages of a chunk, by the index that follows it in the file.

    None if it holds anything else, or the index is not true: a record begins at the first byte
    and where another ends, and nowhere else.
    """
    starts = np.sort(np.concatenate(index)) if index else np.empty(0, np.uint64)
    if not len(starts) or starts[0] != 0 or int(starts[-1]) + _HEAD.itemsize > len(data):
        return None
    starts = starts.astype(np.int64)
    heads = Heads.at(data, starts)
    lengths = heads.table['length']
    if not ((heads.table['opcode'] == Opcode.MESSAGE) & (lengths >= _SHORTEST)
            & (lengths <= len(data))).all():
        return None
    ends = starts + _FRAME.size + lengths.astype(np.int64)
    return heads if np.array_equal(ends, np.append(starts[1:], len(data))) else None


def _index(data: bytes, records: list[tuple[int, int, int]]) -> list[NDArray[np.uint64]]:
    """Return the offsets in each message index that the records begin with."""
    out = []
    for opcode, start, end in records:
        if opcode != Opcode.MESSAGE_INDEX or end > len(data):
            break
        out.append(np.frombuffer(data[start + 6:end][:(end - start - 6) // 16 * 16], '<u8')[1::2])
    return out


def _name(opcode: int) -> str:
    try:
        return Opcode(opcode).name.lower()
    except ValueError:
        return f'unknown record 0x{opcode:02x}'


def scan(path: Path, is_wanted: Callable[[str], bool] = lambda topic: True) -> Contents:
    """
    Read everything readable of an MCAP file.

    Parameters
    ----------
    path
        File.
    is_wanted
        Says by its name whether a topic's messages are kept; default: all.

    Raises
    ------
    BagError
        If the file cannot be opened or is no MCAP file. Damage inside does not raise: it is
        listed in ``lost``, and what surrounds it is kept.

    """
    data = read_file(path)
    if not data.startswith(MAGIC):
        raise BagError(f'{path}: not an MCAP file; give a rosbag2 directory or an .mcap file')
    scanner = _Scanner(is_wanted)
    contents, closed, end, loose = scanner.contents, False, len(MAGIC), []
    scanner.summary(data)
    records = list(_records(data, len(MAGIC)))
    for number, (opcode, start, end) in enumerate(records):
        whole = end <= len(data)
        try:
            if opcode == Opcode.CHUNK:
                scanner.chunk(data[start:end], whole, _index(data, records[number + 1:]))
            elif whole and opcode == Opcode.MESSAGE:
                if end - start < _SHORTEST:
                    raise ValueError('shorter than the head of a message')
                loose.append(start - _FRAME.size)
            elif whole:
                scanner.record(opcode, data[start:end])
        except Exception as error:  # parsers of damaged bytes raise anything
            contents.lost.append(f'{_name(opcode)} at byte {start}: {error}')
        if not whole:
            contents.lost.append(f'cut off within a {_name(opcode)} at byte {start}')
        closed = closed or opcode == Opcode.FOOTER
        if closed or not whole:
            break
    try:
        scanner.messages(data, Heads.at(data, np.array(loose, np.int64)))
    except ValueError as error:
        contents.lost.append(str(error))
    if not closed and not contents.lost:
        contents.lost.append('the file was never closed')
    contents.complete = closed and not contents.lost and data[end:] == MAGIC
    return contents
