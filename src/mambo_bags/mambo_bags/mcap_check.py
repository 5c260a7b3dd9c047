"""
Check the statistics, indexes and checksums of a closed MCAP file against its content.

A file whose every record is readable may still lack a chunk or contain one twice, which its
statistics, indexes and checksums show. The format makes them optional; a file without them is not
reported.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
import dataclasses
from io import BytesIO
from mmap import mmap
import struct
from typing import Any, NamedTuple
import zlib

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex, ChunkIndex, DataEnd, Footer, MetadataIndex, Statistics)
import numpy as np
from numpy.typing import NDArray

_TOLD = {
    Opcode.CHUNK_INDEX: (Opcode.CHUNK, ChunkIndex, 'chunk_start_offset', 'chunk_length'),
    Opcode.ATTACHMENT_INDEX: (Opcode.ATTACHMENT, AttachmentIndex, 'offset', 'length'),
    Opcode.METADATA_INDEX: (Opcode.METADATA, MetadataIndex, 'offset', 'length')}
_NAMES = {Opcode.CHUNK: 'chunk', Opcode.ATTACHMENT: 'attachment', Opcode.METADATA: 'metadata'}
_FRAME = struct.Struct('<BQ')
_SPAN = struct.Struct('<QQ')  # the first fields of a chunk: first and last log time
_CRC = 4  # bytes of a checksum, the last ones of a footer
MAX_SHOWN = 3  # most lines of one kind, and most topics in a line


def stream(data: bytes) -> ReadDataStream:
    """Return the stream from which the ``mcap`` library parses records."""
    return ReadDataStream(BytesIO(data))


class Record(NamedTuple):
    """Position of a record: opcode, first byte of its frame and length including the frame."""

    opcode: int
    offset: int
    length: int


@dataclasses.dataclass
class Account:
    """
    What a file contains and what its summary states, collected while reading.

    Attributes
    ----------
    found
        Chunks, attachments and metadata records.
    spans
        {chunk: first and last log time in ns, as stated}.
    indexes
        {first byte of a chunk: {channel: first byte of the message index after it}}.
    counts
        {channel: messages}.
    stated
        Index records of the summary, {position: index record}.
    statistics
        Statistics record of the file, if it has one.
    wrong
        Contradictions, one line each.

    """

    found: list[Record] = dataclasses.field(default_factory=list)
    spans: dict[Record, tuple[int, int]] = dataclasses.field(default_factory=dict)
    indexes: dict[int, dict[int, int]] = dataclasses.field(default_factory=dict)
    counts: dict[int, int] = dataclasses.field(default_factory=dict)
    stated: dict[Record, Any] = dataclasses.field(default_factory=dict)
    statistics: Statistics | None = None
    wrong: list[str] = dataclasses.field(default_factory=list)

    def take(self, opcode: int, data: bytes | mmap, start: int, end: int) -> None:
        """Add a top-level record whose content extends from start to end."""
        if opcode in _NAMES:
            self.found.append(Record(opcode, start - _FRAME.size, end - start + _FRAME.size))
            if opcode == Opcode.CHUNK and end - start >= _SPAN.size:
                self.spans[self.found[-1]] = _SPAN.unpack_from(data, start)
        elif opcode in _TOLD:
            target, kind, offset, length = _TOLD[opcode]
            index = kind.read(stream(data[start:end]))
            self.stated[Record(target, getattr(index, offset), getattr(index, length))] = index
        elif opcode == Opcode.STATISTICS:
            self.statistics = Statistics.read(stream(data[start:end]))
        elif opcode == Opcode.DATA_END:
            stated = DataEnd.read(stream(data[start:end])).data_section_crc
            if stated and zlib.crc32(memoryview(data)[:start - _FRAME.size]) != stated:
                self.wrong.append('the checksum of the data does not match')
        elif opcode == Opcode.FOOTER:
            self._footer(data, start, end)

    def _footer(self, data: bytes | mmap, start: int, end: int) -> None:
        footer = Footer.read(stream(data[start:end]))
        summary = memoryview(data)[footer.summary_start:end - _CRC]
        if footer.summary_start > start or (
                footer.summary_crc and zlib.crc32(summary) != footer.summary_crc):
            self.wrong.append('the checksum of the summary does not match')

    def index(
        self, where: int, entries: dict[int, tuple[int, NDArray[np.uint64]]],
        starts: NDArray[np.int64], table: NDArray[Any],
    ) -> None:
        """
        Compare the message indexes after a chunk with its messages.

        Parameters
        ----------
        where
            First byte of the chunk.
        entries
            {channel: (first byte of its index, (n, 2) log times and offsets)}.
        starts, table : (n,)
            Offsets of the messages in the chunk, and their headers.

        """
        if not entries:
            return
        self.indexes[where] = {channel: at for channel, (at, _) in entries.items()}
        stated = np.concatenate([pairs for _, pairs in entries.values()])
        channels = np.repeat(
            np.array(list(entries), np.int64), [len(pairs) for _, pairs in entries.values()])
        order, here = np.argsort(stated[:, 1], kind='stable'), np.argsort(starts)
        if not (len(stated) == len(starts) and (stated[order, 1] == starts[here]).all()
                and (stated[order, 0] == table['log_time'][here]).all()
                and (channels[order] == table['channel'][here]).all()):
            self.wrong.append(f'the message index of the chunk at byte {where} does not match '
                              'its messages')

    def contradictions(self, topics: dict[int, str]) -> Iterator[str]:
        """Yield the false statements of a closed file; ``topics``: {channel: name}."""
        yield from self.wrong[:MAX_SHOWN]
        if len(self.wrong) > MAX_SHOWN:
            yield f'and {len(self.wrong) - MAX_SHOWN} more of this kind'
        if self.statistics is not None:
            yield from self._statistics(self.statistics, topics)
        for kind, name in _NAMES.items():
            stated = {place: index for place, index in self.stated.items() if place.opcode == kind}
            found = {place for place in self.found if place.opcode == kind}
            if not stated or stated.keys() == found:
                continue
            yield from self._missing(stated, found) if kind == Opcode.CHUNK else ()
            yield (f'{len(stated.keys() - found)} of {len(stated)} entries of its {name} index '
                   f'point elsewhere, {len(found - stated.keys())} of {len(found)} have none')
        yield from self._index_places()

    def _statistics(self, stated: Statistics, topics: dict[int, str]) -> Iterator[str]:
        count = sum(self.counts.values())
        wrong = [
            f'{topics.get(channel, channel)} {self.counts.get(channel, 0)} of {number}'
            for channel, number in stated.channel_message_counts.items()
            if self.counts.get(channel, 0) != number]
        if count != stated.message_count or wrong:
            what = ', '.join(wrong[:MAX_SHOWN]) + ', ...' * (len(wrong) > MAX_SHOWN)
            yield (f'{count} messages, {stated.message_count} were written'
                   + f' ({what})' * bool(wrong))
        for kind, number in ((Opcode.CHUNK, stated.chunk_count),
                             (Opcode.ATTACHMENT, stated.attachment_count),
                             (Opcode.METADATA, stated.metadata_count)):
            here = sum(place.opcode == kind for place in self.found)
            if here != number:
                yield f'{here} records of kind {_NAMES[kind]}, {number} were written'

    def _missing(self, stated: dict[Record, ChunkIndex], found: set[Record]) -> Iterator[str]:
        """Yield the times of missing chunks; records after them have moved."""
        left = Counter((place.length, self.spans.get(place)) for place in found)
        gone = []
        for place, index in stated.items():
            mark = place.length, (index.message_start_time, index.message_end_time)
            if left[mark]:
                left[mark] -= 1
            else:
                gone.append(index)
        for index in gone[:MAX_SHOWN]:
            first, last = (t * 1e-9 for t in (index.message_start_time, index.message_end_time))
            yield f'the chunk of {first:.3f} to {last:.3f} s is missing'
        if len(gone) > MAX_SHOWN:
            yield f'and {len(gone) - MAX_SHOWN} more chunks'

    def _index_places(self) -> Iterator[str]:
        """Yield the number of chunks whose message indexes are not where the chunk index says."""
        wrong = sum(
            place in self.stated and bool(self.stated[place].message_index_offsets)
            and self.stated[place].message_index_offsets != self.indexes.get(place.offset, {})
            for place in self.found if place.opcode == Opcode.CHUNK)
        if wrong:
            yield f'the message indexes of {wrong} chunks are not where the chunk index says'
