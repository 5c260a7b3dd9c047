"""
One MCAP file taken apart, whole or cut off.

The framing (one byte of opcode, eight of length) is walked here, so that a record that runs past
the end of the file is noticed instead of read short, and a second of 2000 messages costs
milliseconds; the records themselves are parsed by the ``mcap`` library.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
import dataclasses
from io import BytesIO
from pathlib import Path
import struct
import zlib

import lz4.frame
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Metadata, Schema
import zstandard

MAGIC = b'\x89MCAP0\r\n'
_FRAME = struct.Struct('<BQ')
_MESSAGE = struct.Struct('<HIQQ')


class BagError(ValueError):
    """A bag cannot be read; one line that says what, where and what to do."""


@dataclasses.dataclass
class Contents:
    """
    What a file holds.

    Attributes
    ----------
    schemas, channels
        By id, as the ``mcap`` library parses them.
    messages
        {channel id: list of (log time ns, publish time ns, data)} in the order of the file, of
        the wanted topics.
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
    messages: dict[int, list[tuple[int, int, bytes]]] = dataclasses.field(default_factory=dict)
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
        self._wanted: dict[int, list[tuple[int, int, bytes]]] = {}

    def inner(self, data: bytes) -> bool:
        """Take the records of a chunk; False if the last one is cut off."""
        for opcode, start, end in _records(data, 0):
            if end > len(data):
                return False
            if opcode == Opcode.MESSAGE:
                self.message(data, start, end)
            else:
                self.definition(opcode, data[start:end])
        return True

    def message(self, data: bytes, start: int, end: int) -> None:
        """Take a message record if its topic is wanted."""
        channel, _, log_time, publish_time = _MESSAGE.unpack_from(data, start)
        if channel not in self.contents.channels:
            raise ValueError(f'message of unknown channel {channel}')
        self.contents.count += 1
        if (messages := self._wanted.get(channel)) is not None:
            messages.append((log_time, publish_time, data[start + _MESSAGE.size:end]))

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

    def chunk(self, body: bytes, whole: bool) -> None:
        """Take a chunk record; of one cut off, the messages that are still whole."""
        chunk = Chunk.read(_stream(body))
        data = _unpack(chunk, whole)
        if whole and chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
            raise ValueError('checksum does not match')
        if not self.inner(data) and whole:
            raise ValueError('a record inside is cut off')

    def summary(self, data: bytes) -> None:
        """Take the definitions that a closed file repeats, in case their chunk is damaged."""
        for opcode, start, end in _records(data, len(MAGIC)):
            if end <= len(data) and opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                with suppress(Exception):  # of damaged bytes; reading in order says what is lost
                    self.definition(opcode, data[start:end])

    def record(self, opcode: int, body: bytes) -> None:
        """Take a record of the top level."""
        if opcode == Opcode.CHUNK:
            self.chunk(body, True)
        elif opcode == Opcode.MESSAGE:
            self.message(body, 0, len(body))
        elif opcode == Opcode.ATTACHMENT:
            self.contents.attachments.append(Attachment.read(_stream(body)))
        elif opcode == Opcode.METADATA:
            self.contents.metadata.append(Metadata.read(_stream(body)))
        else:
            self.definition(opcode, body)


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
    contents, closed, end = scanner.contents, False, len(MAGIC)
    scanner.summary(data)
    for opcode, start, end in _records(data, len(MAGIC)):
        whole = end <= len(data)
        try:
            if whole:
                scanner.record(opcode, data[start:end])
            elif opcode == Opcode.CHUNK:
                scanner.chunk(data[start:], False)
        except Exception as error:  # parsers of damaged bytes raise anything
            contents.lost.append(f'{_name(opcode)} at byte {start}: {error}')
        if not whole:
            contents.lost.append(f'cut off within a {_name(opcode)} at byte {start}')
        closed = closed or opcode == Opcode.FOOTER
        if closed or not whole:
            break
    if not closed and not contents.lost:
        contents.lost.append('the file was never closed')
    contents.complete = closed and not contents.lost and data[end:] == MAGIC
    return contents
