"""What a file says of itself: a chunk that is gone or there twice, lying counts, bombs."""

import struct
import time
import zlib

import lz4.frame
from mambo_analysis.compare import compare
from mambo_bags import mcap_reader, recover
from mambo_bags.reader import BagError, read_bag
from mambo_bags.writer import BagWriter
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Statistics
from mcap.writer import Writer
import pytest
import zstandard

CLOCK = 'rosgraph_msgs/msg/Clock'
SECONDS, RATE = 5, 10


@pytest.fixture
def file(tmp_path):
    with BagWriter(tmp_path / 'bag', {'note.txt': 'a note'}) as bag:
        bag.add_topic('/clock', CLOCK)
        for k in range(SECONDS * RATE):
            stamp = divmod(k * 10**9 // RATE, 10**9)
            bag.write('/clock', b'\0\1\0\0' + struct.pack('<iI', *stamp), k * 10**9 // RATE)
    return bag.file


def records(data):
    """Return the bytes of each record: [(opcode, record with its frame)]."""
    return [(opcode, data[start - 9:end])
            for opcode, start, end in mcap_reader._records(data, len(mcap_reader.MAGIC))]


def put(file, parts):
    file.write_bytes(mcap_reader.MAGIC + b''.join(data for _, data in parts) + (
        mcap_reader.MAGIC if parts[-1][0] == Opcode.FOOTER else b''))


def chunks(parts):
    return [i for i, (opcode, _) in enumerate(parts) if opcode == Opcode.CHUNK]


def group(parts, number):
    """Return the places of a chunk and of the message indexes behind it."""
    first = chunks(parts)[number]
    last = first + 1
    while parts[last][0] == Opcode.MESSAGE_INDEX:
        last += 1
    return first, last


def damaged(file, *expected, count=None):
    """Check that a file is refused by compare and told by recover, with these words."""
    with pytest.raises(BagError, match='recover') as refused:
        read_bag(file)
    assert '\n' not in str(refused.value)
    contents = mcap_reader.scan(file)
    for words in expected:
        assert any(words in line for line in contents.damage), contents.damage
    assert not contents.complete
    if count is not None:
        assert contents.count == count
        output = str(recover.recover(file, file.parent.parent / 'saved'))
        assert all(words in output for words in expected) and 'whole' not in output
        assert mcap_reader.scan(file.parent.parent / 'saved/saved_0.mcap').complete


def test_a_missing_chunk_is_told_with_its_time(file, capsys):
    parts = records(file.read_bytes())
    first, last = group(parts, 2)
    put(file, parts[:first] + parts[last:])
    damaged(file, 'the chunk of 2.000 to 2.900 s is missing',
            '40 messages, 50 were written (/clock 40 of 50)', count=40)
    assert compare.main([str(file)]) == 2
    output = capsys.readouterr().err
    assert output.count('\n') == 1 and 'damaged' in output and 'recover' in output


def test_a_chunk_that_is_there_twice_is_taken_once(file):
    parts = records(file.read_bytes())
    first, last = group(parts, 1)
    put(file, parts[:last] + parts[first:last] + parts[last:])
    damaged(file, 'taken once', '6 records of kind chunk, 5 were written', count=50)


def test_a_chunk_without_its_statistics_is_missed_by_its_index(file):
    parts = records(file.read_bytes())
    first, last = group(parts, 4)
    put(file, [part for part in parts[:first] + parts[last:] if part[0] != Opcode.STATISTICS])
    damaged(file, 'the chunk of 4.000 to 4.900 s is missing')


@pytest.mark.parametrize('field, expected', [
    ('message_count', '50 messages, 51 were written'),
    ('chunk_count', '5 records of kind chunk, 6 were written'),
    ('attachment_count', '1 records of kind attachment, 2 were written')])
def test_lying_statistics_are_told(file, field, expected):
    def change(record):
        output = Statistics.read(mcap_reader.stream(record[9:]))
        setattr(output, field, getattr(output, field) + 1)
        builder = RecordBuilder()
        output.write(builder)
        return builder.end()
    parts = records(file.read_bytes())
    put(file, [(opcode, change(data) if opcode == Opcode.STATISTICS else data)
               for opcode, data in parts])
    damaged(file, expected, 'the checksum of the summary does not match')


@pytest.mark.parametrize('offset', [6, 14], ids=['time', 'place'])
def test_a_message_index_that_is_not_that_of_its_messages_is_told(file, offset):
    data = bytearray(file.read_bytes())
    places = [start for opcode, start, _ in mcap_reader._records(data, len(mcap_reader.MAGIC))
              if opcode == Opcode.MESSAGE_INDEX]
    data[places[3] + offset] ^= 1
    file.write_bytes(data)
    damaged(file, 'does not match its messages', count=50)


@pytest.mark.parametrize('kind', [Opcode.ATTACHMENT, Opcode.SCHEMA, Opcode.STATISTICS,
                                  Opcode.CHUNK_INDEX, Opcode.FOOTER])
def test_no_byte_may_differ_where_a_checksum_is(file, kind):
    data = bytearray(file.read_bytes())
    start, end = [(start, end) for opcode, start, end in mcap_reader._records(data, 8)
                  if opcode == kind][0]
    data[(start + end) // 2] ^= 4
    file.write_bytes(data)
    assert not mcap_reader.scan(file).complete


def test_the_checksum_of_the_data_is_compared(tmp_path):
    file = tmp_path / 'theirs.mcap'
    with file.open('wb') as stream:
        writer = Writer(stream, use_chunking=False, enable_data_crcs=True)
        writer.start()
        channel = writer.register_channel('/a', 'cdr', 0)
        for k in range(10):
            writer.add_message(channel, k, b'payload', k)
        writer.finish()
    assert mcap_reader.scan(file).complete
    data = file.read_bytes()
    file.write_bytes(data.replace(b'payload', b'pAyload', 1))
    assert mcap_reader.scan(file).wrong == ['the checksum of the data does not match']


@pytest.mark.parametrize('length', [
    lambda size: 2**40, lambda size: size // 2, lambda size: 1200], ids=['all', 'half', 'some'])
def test_what_lies_whole_behind_a_broken_record_is_taken(file, length):
    data = bytearray(file.read_bytes())
    start = [start for opcode, start, _ in mcap_reader._records(data, 8)
             if opcode == Opcode.CHUNK][1]
    data[start - 8:start] = struct.pack('<Q', length(len(data)))
    file.write_bytes(data)
    damaged(file, 'at byte', count=50)


def test_zeros_are_no_records(file):
    data = file.read_bytes()
    parts = records(data)
    first, _ = group(parts, 3)
    put(file, [*parts[:first], (0, bytes(9_000_000)), *parts[first:]])
    damaged(file, 'bytes up to the next chunk were not read', count=50)


@pytest.mark.parametrize('closed', [True, False])
def test_a_chunk_whose_header_is_lost_costs_no_other(file, closed):
    data = file.read_bytes()
    starts = [start for opcode, start, _ in mcap_reader._records(data, 8)
              if opcode == Opcode.CHUNK]
    page = starts[1] - 9
    spoilt = bytearray(data if closed else data[:starts[4]])
    spoilt[page:page + 40] = bytes(40)
    file.write_bytes(spoilt)
    damaged(file, f'no record at byte {page}; ', count=40 if closed else 30)


def test_headers_of_chunks_without_end_are_read_in_bounded_time(file):
    one = struct.pack('<BQQQQI', Opcode.CHUNK, 39, 0, 1, 0, 0) + struct.pack('<I', 3) + (
        b'lz4' + bytes(8 + 9))  # an empty chunk, and what is no record
    file.write_bytes(mcap_reader.MAGIC + 200_000 * one)
    assert 10 < len(mcap_reader.scan(file).lost) < 1000


def bomb(file, compression, data, says):
    """Put a chunk in front of the others, which unpacks to other than it says."""
    body = struct.pack('<QQQI', 0, 0, says, 0) + struct.pack('<I', len(compression)) + (
        compression.encode()) + struct.pack('<Q', len(data)) + data
    parts = records(file.read_bytes())
    first = chunks(parts)[0]
    put(file, [*parts[:first], (6, struct.pack('<BQ', Opcode.CHUNK, len(body)) + body),
               *parts[first:]])


@pytest.mark.parametrize('compression, pack', [
    ('zstd', zstandard.compress), ('lz4', lz4.frame.compress)])
@pytest.mark.parametrize('says', [1000, 600_000_000, 2**63])
def test_a_chunk_unpacks_to_no_more_than_it_says_and_may(file, compression, pack, says):
    bomb(file, compression, pack(bytes(50_000_000)), says)
    damaged(file, 'it unpacks to more than the stated 1000 bytes' if says == 1000 else
            'MAMBO_MAX_UNPACKED_MB (now 512) raises the limit', count=50)


def test_zeros_in_a_chunk_are_no_records(file):
    bomb(file, 'zstd', zstandard.compress(bytes(256_000_000)), 256_000_000)
    began = time.process_time()
    damaged(file, 'a record inside is truncated or invalid', count=50)
    assert time.process_time() - began < 10.0


def test_the_limit_counts_all_chunks_and_can_be_raised(file, monkeypatch):
    full = zstandard.compress(bytes(4_000_000))
    for _ in range(3):
        bomb(file, 'zstd', full + bytes([_]), 4_000_000)
    monkeypatch.setenv('MAMBO_MAX_UNPACKED_MB', '9')
    assert sum('raises the limit' in line for line in mcap_reader.scan(file).lost) >= 1
    monkeypatch.setenv('MAMBO_MAX_UNPACKED_MB', '20')
    assert not any('raises the limit' in line for line in mcap_reader.scan(file).lost)
    monkeypatch.setenv('MAMBO_MAX_UNPACKED_MB', 'many')
    assert recover.main([str(file), str(file.parent.parent / 'saved')]) == 2


def test_records_of_a_kind_that_is_not_known_are_passed_over(file):
    parts = records(file.read_bytes())
    own = [(0x90, struct.pack('<BQ', 0x90, 4) + b'mine')]
    parts = [part for part in parts if part[0] not in (
        Opcode.CHUNK_INDEX, Opcode.ATTACHMENT_INDEX, Opcode.METADATA_INDEX, Opcode.FOOTER)]
    put(file, own + parts + [(Opcode.FOOTER, struct.pack('<BQQQI', Opcode.FOOTER, 20, 0, 0, 0))])
    assert mcap_reader.scan(file).complete


def test_a_text_of_aliases_in_a_channel_is_not_spread(tmp_path):
    lines = ['a: &a0 [x, x, x, x, x, x, x, x, x]']
    lines += [f'b{k}: &a{k + 1} [{", ".join([f"*a{k}"] * 9)}]' for k in range(12)]
    file = tmp_path / 'theirs.mcap'
    with file.open('wb') as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel(
            '/a', 'cdr', 0, {'offered_qos_profiles': '- ' + '\n  '.join(lines)})
        writer.add_message(channel, 0, b'', 0)
        writer.finish()
    recover.recover(file, tmp_path / 'saved')
    assert (tmp_path / 'saved/metadata.yaml').stat().st_size < 10_000


def test_checksums_are_those_of_the_format(file):
    data = file.read_bytes()
    (start, end), = [(start, end) for opcode, start, end in mcap_reader._records(data, 8)
                     if opcode == Opcode.FOOTER]
    begin, = struct.unpack_from('<Q', data, start)
    assert zlib.crc32(data[begin:end - 4]) == int.from_bytes(data[end - 4:end], 'little')


def test_messages_of_no_time_that_a_bag_can_tell_are_left_out(tmp_path):
    file = tmp_path / 'theirs.mcap'
    with file.open('wb') as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel('/a', 'cdr', 0)
        for log_time in (1, 2**63, 2, 2**64 - 1, 3):
            writer.add_message(channel, log_time, b'', log_time)
        writer.finish()
    contents = mcap_reader.scan(file)
    assert contents.count == 3 and contents.lost == ['2 messages of /a from after the year 2262']
    assert recover.recover(file, tmp_path / 'saved').end == 3


def test_an_attachment_that_differs_is_lost(file):
    data = file.read_bytes()
    file.write_bytes(data.replace(b'a note', b'a nose', 1))
    assert 'attachment at byte' in mcap_reader.scan(file).lost[0]
    assert mcap_reader.scan(file).attachments == []
