import io
import struct
import tracemalloc

from mambo_bags import mcap_writer
from mambo_bags.mcap_writer import McapWriter
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
import numpy as np
import pytest
import zstandard

CHUNK = 4000


def theirs(stream):
    return Writer(stream, chunk_size=CHUNK, compression=CompressionType.ZSTD)


class Ours(McapWriter):
    """One message at a time, as the library writes them."""

    def add_message(self, channel, log_time, data, publish_time, sequence=0):
        self.add_records(np.array([channel]), np.array([log_time]), [
            mcap_writer.record(channel, sequence, log_time, publish_time, data)])


def ours(stream):
    return Ours(stream, CHUNK)


def flight(seed=0):
    """Return messages of three channels: (log times, channel numbers, payloads)."""
    rng = np.random.default_rng(seed)
    times = np.sort(rng.integers(0, 10**9, 400))
    channels = rng.integers(1, 4, 400)
    sizes = {1: 12, 2: 100, 3: 731}
    return times, channels, [rng.bytes(sizes[c]) for c in channels.tolist()]


def begin(writer):
    writer.start(profile='ros2', library='test')
    writer.add_metadata('about', {'b': '2', 'a': 'ä'})
    writer.add_attachment(0, 0, 'x.yaml', 'application/yaml', b'a: 1\n')
    schemas = [writer.register_schema(f'pkg/msg/{n}', 'ros2msg', n.encode()) for n in 'AB']
    for name, schema in (('/a', 0), ('/b', 1), ('/c', 1)):
        writer.register_channel(name, 'cdr', schemas[schema], {'key': 'value'})


def written(make, messages):
    stream = io.BytesIO()
    writer = make(stream)
    begin(writer)
    for number, (time, channel, data) in enumerate(zip(*messages)):
        if number == 200:
            writer.flush()
        writer.add_message(int(channel), int(time), data, int(time) + 5, number)
    writer.add_metadata('end', {})
    writer.finish()
    return stream.getvalue()


def test_the_file_is_that_of_the_library_byte_for_byte():
    data = written(ours, flight())
    assert data == written(theirs, flight())
    assert len(list(make_reader(io.BytesIO(data)).iter_messages())) == 400


def test_a_file_without_messages_is_that_of_the_library_too():
    empty = np.array([], int), np.array([], int), []
    assert written(ours, empty) == written(theirs, empty)


@pytest.mark.parametrize('seed', range(5))
def test_many_messages_at_once_are_those_one_by_one(seed):
    times, channels, payloads = flight(seed)
    one, many = io.BytesIO(), io.BytesIO()
    for stream in (one, many):
        writer = ours(stream)
        begin(writer)
        if stream is one:
            for time, channel, data in zip(times.tolist(), channels.tolist(), payloads):
                writer.add_message(channel, time, data, time, 7)
        else:
            pieces = [mcap_writer.records(
                channel, np.array([time]), 7, np.frombuffer(data, np.uint8)[None]).tobytes()
                for time, channel, data in zip(times.tolist(), channels.tolist(), payloads)]
            for part in (slice(0, 1), slice(1, 90), slice(90, 400)):
                writer.add_records(channels[part], times[part], pieces[part])
        writer.finish()
    assert many.getvalue() == one.getvalue()


def test_a_chunk_that_is_just_full_stays_open():
    count, size = 60, 50
    for limit in range(400, 400 + 31 + size):  # one of them is met exactly
        files = []
        for at_once in (False, True):
            stream = io.BytesIO()
            writer = Ours(stream, limit)
            writer.start('ros2', 'test')
            writer.register_channel('/a', 'cdr', 0, {})
            rows = np.arange(count * size).astype(np.uint8).reshape(count, size)
            times = np.arange(count)
            if at_once:
                part = mcap_writer.records(1, times, 0, rows)
                writer.add_records(np.ones(count, int), times, [r.tobytes() for r in part])
            else:
                for k in range(count):
                    writer.add_message(1, k, rows[k].tobytes(), k, k)
            writer.finish()
            files.append(stream.getvalue())
        assert files[0] == files[1], limit


def test_records_count_up_and_hold_the_payload():
    out = mcap_writer.records(3, np.array([10, 20]), 4, np.array([[1, 2], [3, 4]], np.uint8))
    assert out.shape == (2, 33)
    assert struct.unpack('<BQHIQQ2B', out[1].tobytes()) == (5, 24, 3, 5, 20, 20, 3, 4)


@pytest.mark.long
def test_an_hour_of_chunks_takes_little_memory(tmp_path):
    chunks, channels = 1000, np.arange(1, 16)
    with open(tmp_path / 'bag.mcap', 'wb') as stream:
        writer = ours(stream)
        begin(writer)
        tracemalloc.start()
        try:
            for time in range(chunks):
                writer.add_records(channels, np.full(15, time), [
                    mcap_writer.record(c, time, time, time, b'') for c in channels.tolist()])
                writer.flush()
            held = tracemalloc.get_traced_memory()[0]
        finally:
            tracemalloc.stop()
        writer.finish()
    # its record in the index of chunks has 10 bytes for each channel, and 78; grown by eighths
    assert held < 300 * chunks


def test_a_chunk_for_which_there_is_no_memory_is_a_memory_error(monkeypatch):
    def compress(data):
        raise zstandard.ZstdError('cannot compress: Allocation error : not enough memory')
    monkeypatch.setattr(mcap_writer.zstandard, 'compress', compress)
    with pytest.raises(MemoryError, match='not enough memory'):
        written(ours, flight())
