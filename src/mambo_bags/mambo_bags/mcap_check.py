"""
What a closed MCAP file says of itself, against what is in it.

A file whose every record can be read may still lack a chunk or hold one twice: its statistics,
indexes and checksums tell. All of them are optional in the format; what a file does not say is
not missed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
import dataclasses
from io import BytesIO
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
_SPAN = struct.Struct('<QQ')  # what a chunk begins with: first and last log time
_CRC = 4  # bytes of a checksum, the last of a footer
MAX_SHOWN = 3  # lines of one kind, and topics in a line


def stream(data: bytes) -> ReadDataStream:
    """Return what the records of the ``mcap`` library are parsed from."""
    return ReadDataStream(BytesIO(data))


class Record(NamedTuple):
    """Where a record stands: opcode, first byte of its frame and length with its frame."""

    opcode: int
    offset: int
    length: int


@dataclasses.dataclass
class Account:
    """
    What a file holds and what it tells, gathered while it is read.

    Attributes
    ----------
    found
        Chunks, attachments and metadata records.
    spans
        {chunk: first and last log time in ns, as it says}.
    indexes
        {first byte of a chunk: {channel: first byte of the message index behind it}}.
    counts
        {channel: messages}.
    told
        Index records of the summary, {what each points to: it}.
    statistics
        The file's own, if it has them.
    wrong
        What does not agree, one line each.

    """

    found: list[Record] = dataclasses.field(default_factory=list)
    spans: dict[Record, tuple[int, int]] = dataclasses.field(default_factory=dict)
    indexes: dict[int, dict[int, int]] = dataclasses.field(default_factory=dict)
    counts: dict[int, int] = dataclasses.field(default_factory=dict)
    told: dict[Record, Any] = dataclasses.field(default_factory=dict)
    statistics: Statistics | None = None
    wrong: list[str] = dataclasses.field(default_factory=list)

    def take(self, opcode: int, data: bytes, start: int, end: int) -> None:
        """Take a record of the top level whose content stands from start to end."""
        if opcode in _NAMES:
            self.found.append(Record(opcode, start - _FRAME.size, end - start + _FRAME.size))
            if opcode == Opcode.CHUNK and end - start >= _SPAN.size:
                self.spans[self.found[-1]] = _SPAN.unpack_from(data, start)
        elif opcode in _TOLD:
            target, kind, offset, length = _TOLD[opcode]
            index = kind.read(stream(data[start:end]))
            self.told[Record(target, getattr(index, offset), getattr(index, length))] = index
        elif opcode == Opcode.STATISTICS:
            self.statistics = Statistics.read(stream(data[start:end]))
        elif opcode == Opcode.DATA_END:
            told = DataEnd.read(stream(data[start:end])).data_section_crc
            if told and zlib.crc32(memoryview(data)[:start - _FRAME.size]) != told:
                self.wrong.append('the checksum of the data does not match')
        elif opcode == Opcode.FOOTER:
            self._footer(data, start, end)

    def _footer(self, data: bytes, start: int, end: int) -> None:
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
        Compare the message indexes behind a chunk with its messages.

        Parameters
        ----------
        where
            First byte of the chunk.
        entries
            {channel: (first byte of its index, (n, 2) log times and offsets)}.
        starts, table : (n,)
            Where the messages begin in the chunk, and their heads.

        """
        if not entries:
            return
        self.indexes[where] = {channel: at for channel, (at, _) in entries.items()}
        told = np.concatenate([pairs for _, pairs in entries.values()])
        channels = np.repeat(
            np.array(list(entries), np.int64), [len(pairs) for _, pairs in entries.values()])
        order, here = np.argsort(told[:, 1], kind='stable'), np.argsort(starts)
        if not (len(told) == len(starts) and (told[order, 1] == starts[here]).all()
                and (told[order, 0] == table['log_time'][here]).all()
                and (channels[order] == table['channel'][here]).all()):
            self.wrong.append(f'the message index of the chunk at byte {where} is not that of '
                              'its messages')

    def contradictions(self, topics: dict[int, str]) -> Iterator[str]:
        """Yield what a closed file says that is not so; ``topics``: {channel: name}."""
        yield from self.wrong[:MAX_SHOWN]
        if len(self.wrong) > MAX_SHOWN:
            yield f'and {len(self.wrong) - MAX_SHOWN} more of that kind'
        if self.statistics is not None:
            yield from self._statistics(self.statistics, topics)
        for kind, name in _NAMES.items():
            told = {place: index for place, index in self.told.items() if place.opcode == kind}
            found = {place for place in self.found if place.opcode == kind}
            if not told or told.keys() == found:
                continue
            yield from self._missing(told, found) if kind == Opcode.CHUNK else ()
            yield (f'{len(told.keys() - found)} of {len(told)} entries of its {name} index point '
                   f'elsewhere, {len(found - told.keys())} of {len(found)} have none')
        yield from self._index_places()

    def _statistics(self, told: Statistics, topics: dict[int, str]) -> Iterator[str]:
        count = sum(self.counts.values())
        wrong = [
            f'{topics.get(channel, channel)} {self.counts.get(channel, 0)} of {number}'
            for channel, number in told.channel_message_counts.items()
            if self.counts.get(channel, 0) != number]
        if count != told.message_count or wrong:
            what = ', '.join(wrong[:MAX_SHOWN]) + ', ...' * (len(wrong) > MAX_SHOWN)
            yield (f'{count} messages, {told.message_count} were written'
                   + f' ({what})' * bool(wrong))
        for kind, number in ((Opcode.CHUNK, told.chunk_count),
                             (Opcode.ATTACHMENT, told.attachment_count),
                             (Opcode.METADATA, told.metadata_count)):
            here = sum(place.opcode == kind for place in self.found)
            if here != number:
                yield f'{here} records of kind {_NAMES[kind]}, {number} were written'

    def _missing(self, told: dict[Record, ChunkIndex], found: set[Record]) -> Iterator[str]:
        """Yield the time of chunks that are gone; what stood behind them has moved."""
        left = Counter((place.length, self.spans.get(place)) for place in found)
        gone = []
        for place, index in told.items():
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
        """Yield how many chunks have message indexes elsewhere than the chunk index says."""
        wrong = sum(
            place in self.told and bool(self.told[place].message_index_offsets)
            and self.told[place].message_index_offsets != self.indexes.get(place.offset, {})
            for place in self.found if place.opcode == Opcode.CHUNK)
        if wrong:
            yield f'the message indexes of {wrong} chunks are not where the chunk index says'
