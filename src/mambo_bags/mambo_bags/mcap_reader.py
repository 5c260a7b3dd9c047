"""
Read one MCAP file, intact, damaged or truncated.

The framing (one byte of opcode, eight of length) is parsed here, so that a record that extends
past the end of the file is detected; the records themselves are parsed by the ``mcap`` library.
A second of flight has 2000 messages, so they are not parsed one by one: their positions are kept
as arrays.

A chunk may unpack to at most its stated size, and a file to at most ``MAMBO_MAX_UNPACKED_MB``
(default 512) or 20 times its own size, whichever is more; otherwise a few kilobytes could fill
the memory.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
import dataclasses
import mmap
from pathlib import Path
import re
import struct
from typing import Any, NamedTuple
import zlib

import lz4.frame
from mambo_model import limits
from mambo_model.errors import InputError
from mambo_model.schema import ParameterError
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Footer, Metadata, Schema
import numpy as np
from numpy.typing import NDArray
import zstandard

from . import compression
from .mcap_check import Account, stream

MAGIC = b'\x89MCAP0\r\n'
LARGE = 1 << 30  # bytes of a file that is not held in memory as a whole
Content = bytes | mmap.mmap
_FRAME = struct.Struct('<BQ')
_HEAD = np.dtype([  # header of a message, with its frame
    ('opcode', 'u1'), ('length', '<u8'), ('channel', '<u2'), ('sequence', '<u4'),
    ('log_time', '<u8'), ('publish_time', '<u8')])
_SHORTEST = _HEAD.itemsize - _FRAME.size
_FOOTER = _FRAME.size + 20  # bytes
_BEFORE = _FRAME.size + 28  # bytes of a chunk before the name of its compression
_COMPRESSED = re.compile(rb'\x04\0\0\0zstd|\x03\0\0\0lz4')  # length and name, in a chunk
_PARTS = 100  # how often reading goes on behind damaged bytes, at most
_NONE = 0  # opcode reserved by the format; a run of zeros has it
Index = dict[int, tuple[int, NDArray[np.uint64]]]
"""{channel: (first byte of its message index, (n, 2) log times and offsets)}"""


class BagError(InputError):
    """A bag cannot be read; the message is one line that names what, where and what to do."""


def windows(data: Content, starts: NDArray[np.int64], size: int) -> NDArray[np.uint8]:
    """Return a copy of the ``size`` bytes from each start, (n, size)."""
    every = np.ndarray((max(len(data) - size + 1, 0), size), np.uint8, data, strides=(1, 1))
    return every[starts]


class Heads(NamedTuple):
    """Offsets of n message records, and their headers, (n,) of ``_HEAD``."""

    starts: NDArray[np.int64]
    table: NDArray[Any]

    @classmethod
    def at(cls, data: Content, starts: NDArray[np.int64]) -> Heads:
        """Return the message headers at the given offsets."""
        return cls(starts, windows(data, starts, _HEAD.itemsize).view(_HEAD)[:, 0])


@dataclasses.dataclass(frozen=True)
class Batch:
    """
    Consecutive messages of one topic; iterates over (log time, publish time, bytes).

    Attributes
    ----------
    log_time, publish_time : (n,) ns
    data
    (n, size) bytes if the messages have one size, else concatenated.

    """

    log_time: NDArray[np.int64]
    publish_time: NDArray[np.int64]
    data: NDArray[np.uint8] | list[bytes]

    @classmethod
    def of(cls, messages: list[tuple[int, int, bytes]]) -> Batch:
        """Return the batch of the given (log time, publish time, bytes) messages."""
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
    Content of a file.

    Attributes
    ----------
    schemas, channels
        By id, as the ``mcap`` library parses them.
    messages
        {channel id: batches in the order of the file}, of the wanted topics.
    count
        Messages of all topics.
    counts
        {channel id: messages}, of all topics.
    begin
        Earliest log time of its chunks, ns; None without chunks.
    attachments, metadata
        In the order of the file.
    complete
        True if the file was closed, all of it could be read and it agrees with its summary.
    lost
        What could not be read, one line each.
    wrong
        Other contradictions with the file's summary: missing or duplicate records.

    """

    schemas: dict[int, Schema] = dataclasses.field(default_factory=dict)
    channels: dict[int, Channel] = dataclasses.field(default_factory=dict)
    messages: dict[int, list[Batch]] = dataclasses.field(default_factory=dict)
    count: int = 0
    counts: dict[int, int] = dataclasses.field(default_factory=dict)
    begin: int | None = None
    attachments: list[Attachment] = dataclasses.field(default_factory=list)
    metadata: list[Metadata] = dataclasses.field(default_factory=list)
    complete: bool = False
    lost: list[str] = dataclasses.field(default_factory=list)
    wrong: list[str] = dataclasses.field(default_factory=list)

    @property
    def damage(self) -> list[str]:
        """Return all damage, one line each."""
        return [*self.lost, *self.wrong]


def check_regular(path: Path) -> None:
    """Raise BagError if a path to be read is a pipe, a device or a file of the kernel."""
    try:
        limits.check_regular(path)
    except ParameterError as error:
        raise BagError(str(error)) from None


def read_file(path: Path) -> bytes:
    """Return a file's content; BagError if it cannot be read, is empty or not a regular file."""
    check_regular(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise BagError(f'{path}: cannot be read ({error.strerror})') from None
    except MemoryError:
        raise BagError(f'{path}: larger than the memory of this machine') from None
    if not data:
        raise BagError(f'{path}: the file is empty, nothing was recorded')
    return data


def _map(path: Path) -> Content:
    """Return a file's content, that of a large one as a map of it; errors as of read_file."""
    with suppress(OSError):
        if path.is_file() and path.stat().st_size > LARGE:
            with path.open('rb') as file:
                return mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
    return read_file(path)


def _records(data: Content, start: int) -> Iterator[tuple[int, int, int]]:
    """Yield (opcode, start, end) of each record; an end past the data means a truncated record."""
    position, size = start, len(data)
    while position + _FRAME.size <= size:
        opcode, length = _FRAME.unpack_from(data, position)
        position += _FRAME.size
        yield opcode, position, position + length
        position += length


def _next_chunk(data: Content, begin: int) -> int | None:
    """Return the offset of the next compressed chunk, by the name of its compression."""
    for found in _COMPRESSED.finditer(data, begin + _BEFORE):
        at = found.start() - _BEFORE
        opcode, length = _FRAME.unpack_from(data, at)
        first, last = struct.unpack_from('<QQ', data, at + _FRAME.size)
        if opcode == Opcode.CHUNK and first <= last and at + _FRAME.size + length <= len(data):
            return at
    return None


def _unpack(chunk: Chunk, most: int) -> bytes:
    """
    Return the uncompressed records of a chunk, at most its stated size.

    For a truncated chunk this is the part that can be decompressed. ValueError if it states more
    than ``most`` bytes.
    """
    size = chunk.uncompressed_size
    if size > most:
        raise ValueError(
            f'its stated size is {size / 1e6:.0f} MB, more than may be unpacked of this '
            f'file; {limits.raised_by(limits.UNPACKED_MB)}')
    if chunk.compression == 'zstd':
        return zstandard.ZstdDecompressor().stream_reader(chunk.data).read(size + 1)
    if chunk.compression == 'lz4':
        return lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
    if chunk.compression:
        raise ValueError(f'compression {chunk.compression[:20]!r} is not known')
    return chunk.data


class _Scanner:
    """Reads one file into :class:`Contents`."""

    def __init__(self, data: Content, is_wanted: Callable[[str], bool]) -> None:
        self.contents = Contents()
        self.account = Account()
        self._data, self._is_wanted = data, is_wanted
        self._wanted: dict[int, list[Batch]] = {}
        self._left = limits.unpacked(len(data))
        self._bodies: dict[int, list[tuple[int, int]]] = {}  # chunks by checksum
        self._loose: list[int] = []  # starts of messages outside of chunks

    def walk(self) -> None:
        """Scan the whole file."""
        closed, end, position = False, len(MAGIC), len(MAGIC)
        self._repeated_definitions(len(MAGIC))
        for _ in range(_PARTS):
            closed, end, position = self._stretch(position)
            if position is None:
                break
        self._passed_over(closed)
        try:
            self.messages(self._data, Heads.at(self._data, np.array(self._loose, np.int64)))
        except ValueError as error:
            self.contents.lost.append(str(error))
        if closed:
            self._after(end)
            self.contents.wrong += self.account.contradictions(
                {number: channel.topic for number, channel in self.contents.channels.items()})
        elif not self.contents.lost:
            self.contents.lost.append('the file was never closed')
        self.contents.counts = self.account.counts
        self.contents.begin = min(
            (first for first, _ in self.account.spans.values()), default=None)
        self.contents.complete = closed and not self.contents.damage

    def _stretch(self, position: int) -> tuple[bool, int, int | None]:
        """
        Take the records from a byte on, up to the footer or to what is no whole record.

        Returns
        -------
        Whether the footer came, the end of the last record, and where the next chunk is that can
        be read; None: nowhere.

        """
        end = position
        for opcode, start, end in _records(self._data, position):
            at, size = start - _FRAME.size, len(self._data)
            if opcode == _NONE or end > size:
                following = _next_chunk(self._data, start)
                if opcode == _NONE:
                    wrong = f'no record at byte {at}'
                else:
                    wrong = f'cut off within a {_name(opcode)} at byte {start}'
                    self._take(opcode, start, end, following)  # what is whole of it
                self.contents.lost.append(wrong if following is None else (
                    f'{wrong}; {following - at} bytes up to the next chunk were not read'))
                return False, end, following
            self._take(opcode, start, end)
            if opcode == Opcode.FOOTER:
                return True, end, None
        return False, end, None

    def _after(self, end: int) -> None:
        """Check what follows the footer, which ends at byte ``end``: the magic bytes alone."""
        more = end + len(MAGIC)
        if self._data[end:more] != MAGIC:
            self.contents.wrong.append('the magic bytes at the end of the file are missing')
        elif self._data[more:more + len(MAGIC)] == MAGIC:
            self.contents.lost.append(
                f'the file ends at byte {more}, where another MCAP file follows (two files '
                f'concatenated): cut it out with tail -c +{more + 1} and read it by itself')
        elif len(self._data) > more:
            self.contents.wrong.append(
                f'{len(self._data) - more} bytes follow the end of the file at byte {more}')

    def _take(self, opcode: int, start: int, end: int, following: int | None = None) -> None:
        """
        Add a top-level record; an unreadable one is listed as lost.

        One that is cut off has bytes up to the chunk at ``following``, or to the end of the file.
        """
        data, whole = self._data, end <= len(self._data)
        try:
            if whole:
                self.account.take(opcode, data, start, end)
            if opcode == Opcode.CHUNK:
                self.chunk(start, end, following)
            elif whole and opcode == Opcode.MESSAGE:
                if end - start < _SHORTEST:
                    raise ValueError('shorter than the header of a message')
                self._loose.append(start - _FRAME.size)
            elif whole:
                self.record(opcode, data[start:end])
        except Exception as error:  # parsers may raise any error on damaged bytes
            self.contents.lost.append(
                f'{_name(opcode)} at byte {start}: {str(error) or "not readable"}')

    def _summary(self) -> int | None:
        """Return the offset of the summary, from the footer at the end of the file."""
        at = len(self._data) - len(MAGIC) - _FOOTER
        if at < len(MAGIC) or self._data[-len(MAGIC):] != MAGIC or _FRAME.unpack_from(
                self._data, at) != (Opcode.FOOTER, 20):
            return None
        begin = Footer.read(stream(self._data[at + _FRAME.size:])).summary_start
        return begin if len(MAGIC) < begin < at else None

    def _repeated_definitions(self, begin: int) -> None:
        """Add the definitions that a closed file repeats, in case their chunk is damaged."""
        for place in dict.fromkeys((self._summary() or begin, begin)):
            for opcode, start, end in _records(self._data, place):
                if opcode == _NONE or end > len(self._data):
                    break
                if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    with suppress(Exception):  # damaged; reading in order reports what
                        self.definition(opcode, self._data[start:end])

    def _passed_over(self, closed: bool) -> None:
        """Use the chunk index to add the chunks after a record with a wrong length."""
        begin = None if closed else self._summary()
        for opcode, start, end in _records(self._data, begin) if begin else ():
            if opcode == Opcode.CHUNK_INDEX and end <= len(self._data):
                with suppress(Exception):  # damaged; reading in order reports what
                    self.account.take(opcode, self._data, start, end)
        found = set(self.account.found)
        for place in sorted(self.account.stated.keys() - found):
            end = place.offset + place.length
            if place.opcode == Opcode.CHUNK and end <= len(self._data) and _FRAME.unpack_from(
                    self._data, place.offset) == (Opcode.CHUNK, place.length - _FRAME.size):
                self._take(Opcode.CHUNK, place.offset + _FRAME.size, end)

    def inner(self, data: bytes, index: Index, where: int) -> bool:
        """Add the records of the chunk at ``where``; False if the last one is truncated."""
        heads, whole = _indexed(data, index), True
        if heads is None:
            found = []
            for opcode, start, end in _records(data, 0):
                whole = end <= len(data) and opcode != _NONE and (
                    opcode != Opcode.MESSAGE or end - start >= _SHORTEST)
                if not whole:
                    break
                if opcode == Opcode.MESSAGE:
                    found.append(start - _FRAME.size)
                else:
                    self.definition(opcode, data[start:end])
            heads = Heads.at(data, np.array(found, np.int64))
        self.account.index(where, index, *heads)
        self.messages(data, heads)
        return whole

    def messages(self, data: Content, heads: Heads) -> None:
        """Add the messages with these headers, of the wanted topics."""
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
            part = slice(first, last)
            late = (log_times[part] < 0) | (publish_times[part] < 0)  # stamps of 2^63 ns and more
            if late.any():
                topic = self.contents.channels[channel].topic
                self.contents.lost.append(
                    f'{int(late.sum())} messages of {topic} from after the year 2262')
                part = first + np.flatnonzero(~late)
            self.contents.count += last - first - int(late.sum())
            self.account.counts[channel] = self.account.counts.get(channel, 0) + last - first
            if (batches := self._wanted.get(channel)) is not None and not late.all():
                batches.append(self._batch(
                    log_times[part], publish_times[part],
                    _cut(data, starts[part] + _HEAD.itemsize, lengths[part] - _SHORTEST)))
        if unknown:
            raise ValueError(f'message of unknown channel {unknown[0]}')

    def _batch(self, log_times: NDArray[np.int64], publish_times: NDArray[np.int64],
               data: NDArray[np.uint8] | list[bytes]) -> Batch:
        """Return messages as they were sent; rosbag2 may have compressed each by itself."""
        if bytes(data[0][:len(compression.ZSTD)]) != compression.ZSTD:
            return Batch(log_times, publish_times, data)
        plain = []
        for message in map(bytes, data):
            plain.append(compression.message(message, self._left))
            self._left -= len(plain[-1])
        return Batch.of(list(zip(log_times.tolist(), publish_times.tolist(), plain)))

    def definition(self, opcode: int, body: bytes) -> None:
        """Add a schema or channel record."""
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(stream(body))
            self.contents.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(stream(body))
            if channel.id not in self.contents.channels:
                self.contents.channels[channel.id] = channel
                messages = self.contents.messages.setdefault(channel.id, [])
                if self._is_wanted(channel.topic):
                    self._wanted[channel.id] = messages

    def chunk(self, start: int, end: int, following: int | None = None) -> None:
        """Add a chunk record; of a truncated or damaged one, the messages that are intact."""
        where = start - _FRAME.size
        body = self._data[start:end if following is None else following]
        whole = end <= len(self._data)
        same = self._bodies.setdefault(zlib.crc32(body), [])
        for first, last in same:
            if self._data[first:last] == body:
                self.contents.wrong.append(
                    f'the chunk at byte {where} is a duplicate of that at byte '
                    f'{first - _FRAME.size}: '
                    'taken once')
                return
        same.append((start, end))
        chunk = Chunk.read(stream(body))
        data = _unpack(chunk, self._left)
        self._left -= len(data)
        if whole and len(data) != chunk.uncompressed_size:
            raise ValueError(
                f'it unpacks to {"more" if len(data) > chunk.uncompressed_size else "fewer"} than '
                f'the stated {chunk.uncompressed_size} bytes')
        if whole and chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
            raise ValueError('checksum does not match')
        if not self.inner(data, _index(self._data, end), where) and whole:
            raise ValueError('a record inside is truncated or invalid')

    def record(self, opcode: int, body: bytes) -> None:
        """Add a top-level record."""
        if opcode == Opcode.ATTACHMENT:
            stated = int.from_bytes(body[-4:], 'little')
            if stated and zlib.crc32(body[:-4]) != stated:
                raise ValueError('checksum does not match')
            self.contents.attachments.append(Attachment.read(stream(body)))
        elif opcode == Opcode.METADATA:
            self.contents.metadata.append(Metadata.read(stream(body)))
        else:
            self.definition(opcode, body)


def _cut(
    data: Content, starts: NDArray[np.int64], sizes: NDArray[np.int64],
) -> NDArray[np.uint8] | list[bytes]:
    """Return the bytes of the given messages, in the form of :class:`Batch`."""
    if (sizes == sizes[0]).all():
        return windows(data, starts, int(sizes[0]))
    return [data[start:start + size] for start, size in zip(starts.tolist(), sizes.tolist())]


def _indexed(data: bytes, index: Index) -> Heads | None:
    """
    Return the message headers of a chunk, using the index that follows it in the file.

    None if the chunk contains other records or the index is wrong: records must begin at the
    first byte and at the end of the previous record, and nowhere else.
    """
    starts = np.sort(np.concatenate(
        [np.empty(0, np.uint64), *(pairs[:, 1] for _, pairs in index.values())]))
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


def _index(data: Content, behind: int) -> Index:
    """Return the message indexes that follow a chunk."""
    out: Index = {}
    for opcode, start, end in _records(data, behind):
        if opcode != Opcode.MESSAGE_INDEX or end > len(data) or end - start < 6:
            break
        channel = int.from_bytes(data[start:start + 2], 'little')
        pairs = np.frombuffer(data[start + 6:end][:(end - start - 6) // 16 * 16], '<u8')
        out[channel] = start - _FRAME.size, pairs.reshape(-1, 2)
    return out


def _name(opcode: int) -> str:
    try:
        return Opcode(opcode).name.lower()
    except ValueError:
        return f'record of unknown kind 0x{opcode:02x}'


def scan(path: Path, is_wanted: Callable[[str], bool] = lambda topic: True) -> Contents:
    """
    Read everything readable of an MCAP file.

    Parameters
    ----------
    path
        File.
    is_wanted
        Called with a topic's name; returns whether its messages are kept. Default: all.

    Raises
    ------
    BagError
        If the file cannot be opened or is not an MCAP file. Damage inside does not raise: it is
        listed in ``damage``, and everything around it is kept.

    """
    data = _map(path)
    if data[:len(MAGIC)] != MAGIC:
        raise BagError(f'{path}: not an MCAP file; give a rosbag2 directory or an .mcap file')
    scanner = _Scanner(data, is_wanted)
    scanner.walk()
    return scanner.contents
