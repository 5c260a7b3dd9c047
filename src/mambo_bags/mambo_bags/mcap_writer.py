"""
Write MCAP files many messages at a time, byte for byte as the writer of the package mcap.

That writer assembles each message field by field, which costs ten microseconds; writing a whole
flight at once costs a tenth of that. Chunks are compressed with zstd and have message indexes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
import struct
from typing import Any, BinaryIO
import zlib

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment, AttachmentIndex, Channel, Chunk, ChunkIndex, DataEnd, Footer, Header, Metadata,
    MetadataIndex, Schema, Statistics, SummaryOffset)
import numpy as np
from numpy.typing import NDArray
import zstandard

MAGIC = struct.pack('<8B', 137, 77, 67, 65, 80, 48, 13, 10)
_HEADER = struct.Struct('<BQHIQQ')  # opcode, length, channel, sequence, log and publish time
_FIELDS = np.dtype([
    ('opcode', 'u1'), ('length', '<u8'), ('channel', '<u2'), ('sequence', '<u4'),
    ('log_time', '<u8'), ('publish_time', '<u8')])


def record(channel: int, sequence: int, log_time: int, publish_time: int, data: bytes) -> bytes:
    """Return one message record; times in ns."""
    return _HEADER.pack(
        Opcode.MESSAGE, 22 + len(data), channel, sequence, log_time, publish_time) + data


def records(
    channel: int, log_times: NDArray[np.int64], first: int, rows: NDArray[np.uint8],
) -> NDArray[np.uint8]:
    """
    Return message records of one channel, (n, 31 + size).

    Parameters
    ----------
    channel
        Its number.
    log_times : (n,) ns
        Publish times too.
    first
        Sequence number of the first one.
    rows : (n, size)
        Serialised messages.

    """
    count, size = rows.shape
    out = np.empty((count, _FIELDS.itemsize + size), dtype=np.uint8)
    head = np.empty(count, dtype=_FIELDS)
    head['opcode'], head['length'], head['channel'] = Opcode.MESSAGE, 22 + size, channel
    head['sequence'] = first + np.arange(count)
    head['log_time'] = head['publish_time'] = log_times
    out[:, :_FIELDS.itemsize] = head.view(np.uint8).reshape(count, -1)
    out[:, _FIELDS.itemsize:] = rows
    return out


class McapWriter:
    """
    Writes one file; the methods are those of ``mcap.writer.Writer``, but for :meth:`add_records`.

    Parameters
    ----------
    stream
        Binary stream to write to.
    chunk_size : byte
        Size at which a chunk is closed.

    """

    def __init__(self, stream: BinaryIO, chunk_size: int) -> None:
        self._stream, self._chunk_size = stream, chunk_size
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._chunks = bytearray()  # their index, as it will be written: a flight may take a day
        self._statistics = Statistics(
            attachment_count=0, channel_count=0, channel_message_counts={}, chunk_count=0,
            message_count=0, metadata_count=0, message_start_time=0, message_end_time=0,
            schema_count=0)
        self._begin_chunk()

    def _begin_chunk(self) -> None:
        self._chunk: list[bytes] = []
        self._length = 0
        self._index: dict[int, bytearray] = {}
        self._span: tuple[int, int] | None = None

    def _put(self, record: Any) -> int:
        """Write a record; return its length."""
        data = _bytes(record)
        self._stream.write(data)
        return len(data)

    def start(self, profile: str, library: str) -> None:
        """Write the header of the file."""
        self._stream.write(MAGIC)
        self._put(Header(profile, library))

    def add_attachment(
        self, create_time: int, log_time: int, name: str, media_type: str, data: bytes,
    ) -> None:
        """Write an attachment record."""
        offset = self._stream.tell()
        length = self._put(Attachment(
            create_time=create_time, log_time=log_time, name=name, media_type=media_type,
            data=data))
        self._attachments.append(AttachmentIndex(
            offset=offset, length=length, create_time=create_time, log_time=log_time,
            data_size=len(data), name=name, media_type=media_type))
        self._statistics.attachment_count += 1

    def add_metadata(self, name: str, data: Mapping[str, str]) -> None:
        """Write a metadata record of texts by key."""
        offset = self._stream.tell()
        length = self._put(Metadata(name=name, metadata=dict(data)))
        self._metadata.append(MetadataIndex(offset=offset, length=length, name=name))
        self._statistics.metadata_count += 1

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        """Write a schema; return its number."""
        schema = Schema(id=len(self._schemas) + 1, data=data, encoding=encoding, name=name)
        self._schemas.append(schema)
        self._statistics.schema_count += 1
        self._into_chunk(_bytes(schema))
        return schema.id

    def register_channel(
        self, topic: str, message_encoding: str, schema_id: int, metadata: Mapping[str, str],
    ) -> int:
        """Write a channel; return its number."""
        channel = Channel(
            id=len(self._channels) + 1, topic=topic, message_encoding=message_encoding,
            schema_id=schema_id, metadata=dict(metadata))
        self._channels.append(channel)
        self._statistics.channel_count += 1
        self._into_chunk(_bytes(channel))
        return channel.id

    def _into_chunk(self, data: bytes) -> None:
        self._chunk.append(data)
        self._length += len(data)
        if self._length > self._chunk_size:
            self._finish_chunk()

    def _count(self, channel: int, count: int, first: int, last: int) -> None:
        """Count messages of a channel between two times."""
        s = self._statistics
        low, high = self._span or (first, last)
        self._span = (min(low, first), max(high, last))
        s.message_start_time = min(s.message_start_time, first) if s.message_count else first
        s.message_end_time = max(s.message_end_time, last)
        s.message_count += count
        s.channel_message_counts[channel] = s.channel_message_counts.get(channel, 0) + count

    def add_records(
        self, channels: NDArray[np.int64], log_times: NDArray[np.int64],
        pieces: Sequence[bytes],
    ) -> None:
        """
        Add messages, sorted by time, to the open chunk.

        Parameters
        ----------
        channels : (n,)
            Number of the channel of each message.
        log_times : (n,) ns
        pieces
            The record of each message, from :func:`record` or :func:`records`.

        """
        ends = np.cumsum(np.fromiter(map(len, pieces), dtype=np.int64, count=len(pieces)))
        begin = 0
        while begin < len(pieces):
            base = self._length - (ends[begin - 1] if begin else 0)
            end = 1 + int(np.searchsorted(ends, self._chunk_size - base, side='right'))
            end = min(max(end, begin + 1), len(pieces))
            self._add_part(channels[begin:end], log_times[begin:end], np.concatenate(
                ([self._length], base + ends[begin:end - 1])))
            self._chunk.extend(pieces[begin:end - 1])
            self._length = int(base + (ends[end - 2] if end > 1 else 0))
            self._into_chunk(pieces[end - 1])
            begin = end

    def _add_part(self, channels: NDArray, log_times: NDArray, offsets: NDArray) -> None:
        found, first = np.unique(channels, return_index=True)
        for channel in found[np.argsort(first)].tolist():
            mine = channels == channel
            entries = np.stack(
                (log_times[mine].astype('<u8'), offsets[mine].astype('<u8')), axis=1)
            self._index.setdefault(channel, bytearray()).extend(entries.tobytes())
            times = log_times[mine]
            self._count(channel, len(times), int(times.min()), int(times.max()))

    def _finish_chunk(self) -> None:
        """Write the open chunk and its indexes, if it has messages."""
        if self._span is None:
            return
        data = b''.join(self._chunk)
        try:
            compressed = zstandard.compress(data)
        except zstandard.ZstdError as error:  # its only reason here
            raise MemoryError(str(error)) from None
        first, last = self._span
        offset = self._stream.tell()
        length = self._put(Chunk(
            compression='zstd', data=compressed, message_start_time=first, message_end_time=last,
            uncompressed_crc=zlib.crc32(data), uncompressed_size=len(data)))
        places, at = {}, self._stream.tell()
        begin = at
        for channel, entries in self._index.items():
            places[channel] = at
            record = struct.pack(
                '<BQHI', Opcode.MESSAGE_INDEX, 6 + len(entries), channel, len(entries)) + entries
            self._stream.write(record)
            at += len(record)
        self._chunks += _bytes(ChunkIndex(
            message_start_time=first, message_end_time=last, chunk_start_offset=offset,
            chunk_length=length, message_index_offsets=places, message_index_length=at - begin,
            compression='zstd', compressed_size=len(compressed), uncompressed_size=len(data)))
        self._statistics.chunk_count += 1
        self._begin_chunk()

    def flush(self) -> None:
        """Write all data, including the open chunk, to disk."""
        self._finish_chunk()
        self._stream.flush()

    def finish(self) -> None:
        """Write the summary and the end of the file; the stream stays open."""
        self._finish_chunk()
        self._put(DataEnd(0))
        start, summary, offsets = self._stream.tell(), [], []
        at = start
        for opcode, data in (
                (Opcode.SCHEMA, _joined(self._schemas)),
                (Opcode.CHANNEL, _joined(self._channels)),
                (Opcode.STATISTICS, _bytes(self._statistics)),
                (Opcode.CHUNK_INDEX, bytes(self._chunks)),
                (Opcode.ATTACHMENT_INDEX, _joined(self._attachments)),
                (Opcode.METADATA_INDEX, _joined(self._metadata))):
            summary.append(data)
            offsets.append(SummaryOffset(
                group_opcode=opcode, group_start=at, group_length=len(data)))
            at += len(data)
        data = b''.join([*summary, _joined(offsets)])
        checked = data + struct.pack('<BQQQ', Opcode.FOOTER, 20, start, at)
        self._stream.write(data)
        self._put(Footer(
            summary_start=start, summary_offset_start=at, summary_crc=zlib.crc32(checked)))
        self._stream.write(MAGIC)


def _bytes(record: Any) -> bytes:
    """Return the bytes of a record."""
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


def _joined(records: Iterable[Any]) -> bytes:
    """Return the bytes of records, one after the other."""
    return b''.join(map(_bytes, records))
