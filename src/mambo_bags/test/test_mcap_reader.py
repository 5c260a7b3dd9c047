"""Where the messages of a file are: an index is believed only where it is true."""

import os

from mambo_bags import mcap_reader
from mambo_bags.mcap_reader import BagError
from mambo_bags.writer import BagWriter
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.writer import CompressionType, IndexType, Writer
import pytest

CLOCK = 'rosgraph_msgs/msg/Clock'


@pytest.fixture
def file(tmp_path):
    with BagWriter(tmp_path / 'bag') as bag:
        for name in ('/a', '/b'):
            bag.add_topic(name, CLOCK)
        for k in range(40):
            for name in ('/a', '/b', '/b'):
                bag.write(name, b'\0\1\0\0' + bytes([k] * (8 + 4 * (name == '/a' and k == 20))),
                          k * 100_000_000)
    return bag.file


def taken(contents):
    """Return {topic: [(log time, publish time, bytes)]}."""
    return {contents.channels[number].topic: [message for batch in batches for message in batch]
            for number, batches in contents.messages.items()}


def by_the_library(file):
    out = {}
    with file.open('rb') as stream:
        for _, channel, message in make_reader(stream).iter_messages(log_time_order=False):
            out.setdefault(channel.topic, []).append(
                (message.log_time, message.publish_time, message.data))
    return out


def indices(data):
    """Return the start of each offset that a message index tells."""
    return [at for opcode, start, end in mcap_reader._records(data, len(mcap_reader.MAGIC))
            if opcode == Opcode.MESSAGE_INDEX for at in range(start + 14, end, 16)]


def walked(monkeypatch):
    """Return a list of the chunks whose records are walked one after the other from now on."""
    out, walk = [], mcap_reader._records
    monkeypatch.setattr(mcap_reader, '_records', lambda data, start: (
        out.append(len(data)) if start == 0 else None, walk(data, start))[1])
    return out


def test_messages_are_those_that_the_library_reads(file):
    contents = mcap_reader.scan(file)
    assert taken(contents) == by_the_library(file)
    assert contents.complete and contents.count == 120


@pytest.mark.parametrize('change', [
    lambda data: data, lambda data: data[:-9], lambda data: data[:len(data) // 2],
    lambda data: data[:900] + bytes(9) + data[909:], lambda data: bytes(len(data))])
def test_a_large_file_is_read_through_a_map_and_all_the_same(file, change, monkeypatch):
    def read():
        try:
            contents = mcap_reader.scan(file)
        except BagError as error:
            return str(error)
        return taken(contents), contents.damage, contents.complete

    file.write_bytes(change(file.read_bytes()))
    whole = read()
    monkeypatch.setattr(mcap_reader, 'LARGE', 0)
    monkeypatch.setattr(mcap_reader, 'read_file', None)
    assert read() == whole


def test_a_true_index_saves_the_walk_but_through_definitions(file, monkeypatch):
    chunks = walked(monkeypatch)
    mcap_reader.scan(file)
    assert len(chunks) == 1  # the first, which holds schemas and channels


@pytest.mark.parametrize('damage', [
    lambda data, at: int.from_bytes(data[at:at + 8], 'little') + 1,
    lambda data, at: 0, lambda data, at: 2**64 - 1, lambda data, at: 2**62,
    lambda data, at: len(data)], ids=['beside', 'first', 'largest', 'large', 'behind'])
def test_an_index_that_lies_changes_nothing(file, damage, monkeypatch):
    data, wanted = bytearray(file.read_bytes()), by_the_library(file)
    places = indices(data)
    for at in places[len(places) // 2 + 1], places[-1]:
        data[at:at + 8] = damage(data, at).to_bytes(8, 'little')
    file.write_bytes(data)
    chunks = walked(monkeypatch)
    assert taken(mcap_reader.scan(file)) == wanted
    assert len(chunks) == 3


@pytest.mark.parametrize('options', [
    {'use_chunking': False}, {'index_types': IndexType.NONE}, {'index_types': IndexType.CHUNK},
    {'compression': CompressionType.NONE}, {'compression': CompressionType.LZ4}], ids=str)
def test_files_of_another_writer_are_read_alike(tmp_path, options):
    file = tmp_path / 'theirs.mcap'
    with file.open('wb') as stream:
        writer = Writer(stream, chunk_size=400, **options)
        writer.start()
        channels = [
            writer.register_channel(name, 'cdr', writer.register_schema(CLOCK, 'ros2msg', b''))
            for name in ('/a', '/b')]
        for k in range(50):
            writer.add_message(channels[k % 2], k, bytes(k % 7), k, k)
        writer.finish()
    contents = mcap_reader.scan(file)
    assert taken(contents) == by_the_library(file)
    assert contents.complete and contents.count == 50


@pytest.mark.parametrize('chunked', [True, False])
def test_messages_of_a_channel_that_is_not_defined_are_told_and_the_others_kept(
        tmp_path, chunked):
    file = tmp_path / 'theirs.mcap'
    with file.open('wb') as stream:
        writer = Writer(stream, use_chunking=chunked)
        writer.start()
        channel = writer.register_channel('/a', 'cdr', 0)
        for k in range(10):
            writer.add_message(channel + 6 * (k % 2), k, b'', k)
        writer.finish()
    contents = mcap_reader.scan(file)
    assert len(taken(contents)['/a']) == contents.count == 5 and not contents.complete
    assert 'message of unknown channel 7' in contents.lost[0]


@pytest.mark.parametrize('path', ['/dev/zero', '/proc/kmsg', 'pipe'])
def test_what_may_never_end_is_not_read(tmp_path, path):
    os.mkfifo(tmp_path / 'pipe')
    with pytest.raises(BagError, match='not a regular file'):
        mcap_reader.read_file(tmp_path / path)
