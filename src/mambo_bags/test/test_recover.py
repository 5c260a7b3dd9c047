"""Saving what a killed recorder left, without touching it."""

import re

from mambo_bags import mcap_reader, recover
from mambo_bags.reader import BagError, read_bag
from mambo_bags.recover import main
from mambo_bags.writer import BagWriter
import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from synthetic import make_flight, Maker


@pytest.fixture(scope='module')
def flight(tmp_path_factory):
    return make_flight(tmp_path_factory.mktemp('bags') / 'flight', 5.0)


def cut(flight, target, share):
    """Copy a bag's file, cut at a share of its size; return the path and the bytes."""
    content = (flight / 'flight_0.mcap').read_bytes()
    content = content[:round(share * len(content))]
    target.write_bytes(content)
    return content


@pytest.mark.parametrize('share', [0.3, 0.5, 0.7, 0.9, 0.999])
def test_everything_before_the_cut_is_saved_in_whole_seconds(tmp_path, flight, share):
    broken = tmp_path / 'broken.mcap'
    content = cut(flight, broken, share)
    result = recover.recover(broken, tmp_path / 'saved')
    assert broken.read_bytes() == content  # only read
    saved, whole = read_bag(tmp_path / 'saved'), read_bag(flight)
    assert saved.topics == whole.topics
    assert saved.attachments == whole.attachments
    seconds = len(set(saved['reference'].log_time // 10**9)) - 1  # the last may be a part
    assert seconds >= int(5 * share) - 1 and result.lost
    for topic in whole.topics:
        kept = len(saved[topic])
        assert saved[topic].raw == whole[topic].raw[:kept]
        assert kept >= (whole[topic].log_time < seconds * 10**9).sum()
        assert result.counts[topic] == kept
    with AnyReader([tmp_path / 'saved']) as reader:
        assert reader.message_count == sum(result.counts.values())


def test_a_whole_bag_is_copied_and_said_to_be_whole(tmp_path, flight, capsys):
    assert main([str(flight), str(tmp_path / 'copy')]) == 0
    assert 'nothing was lost' in capsys.readouterr().out
    whole, copy = read_bag(flight), read_bag(tmp_path / 'copy')
    assert all(copy[t].raw == whole[t].raw for t in whole.topics)
    assert copy.custom_data == {'recovered_from': 'flight'}
    content = (tmp_path / 'copy' / 'copy_0.mcap').read_bytes()
    assert content.count(b'serialized_metadata') == 1 and b'flight_0.mcap' not in content
    with AnyReader([flight]) as a, AnyReader([tmp_path / 'copy']) as b:
        assert [(c.topic, c.digest, c.ext) for c in a.connections] == [
            (c.topic, c.digest, c.ext) for c in b.connections]


def test_one_damaged_chunk_costs_that_chunk(tmp_path, flight):
    content = bytearray((flight / 'flight_0.mcap').read_bytes())
    chunk = [match.start() for match in re.finditer(b'zstd', content)][2]
    content[chunk + 500] ^= 255
    (tmp_path / 'bad.mcap').write_bytes(content)
    result = recover.recover(tmp_path / 'bad.mcap', tmp_path / 'saved')
    seconds = set((read_bag(tmp_path / 'saved')['reference'].log_time // 10**9).tolist())
    assert len(seconds) == 4 and len(result.lost) == 1 and 'chunk' in result.lost[0]


def test_a_damaged_first_chunk_does_not_take_the_definitions_with_it(tmp_path, flight):
    content = bytearray((flight / 'flight_0.mcap').read_bytes())
    content[content.index(b'zstd') + 500] ^= 255
    (tmp_path / 'bad.mcap').write_bytes(content)
    recover.recover(tmp_path / 'bad.mcap', tmp_path / 'saved')
    seconds = set((read_bag(tmp_path / 'saved')['reference'].log_time // 10**9).tolist())
    assert seconds == {1, 2, 3, 4}


def odd_bag(path):
    """Write messages that were published in another order than they were received."""
    rng = np.random.default_rng(0)
    maker = Maker(path, ['estimate/odom', 'reference'], attachments={'scenario.yaml': 'a: 1'},
                  metadata={'note': {'by': 'hand'}})
    for k in range(40):
        topic = 'reference' if k % 3 else 'estimate/odom'
        maker.writer.write(f'/mambo/{topic}', maker.message(topic, k), 10**9 + k * 10**7,
                           5 * 10**8 + int(rng.integers(0, 10**9)))
    maker.writer.close({'flown_by': 'nobody'})
    return path


def test_publish_times_are_those_of_the_source_and_not_log_times(tmp_path):
    source = odd_bag(tmp_path / 'odd')
    result = recover.recover(source, tmp_path / 'saved')
    whole, saved = (mcap_reader.scan(path / f'{path.name}_0.mcap')
                    for path in (source, tmp_path / 'saved'))
    before, after = recover.in_order(whole), recover.in_order(saved)
    assert len(before) == 40 and after == before  # topic, log time, publish time, bytes
    assert [m[1] for m in after] == sorted(m[1] for m in after)
    assert [m[2] for m in after] != sorted(m[2] for m in after)
    assert (result.start, result.end) == (10**9, 10**9 + 39 * 10**7)
    assert str(result).startswith('saved 40 messages over 0.390 s\n')
    assert result.counts == {'/mambo/estimate/odom': 14, '/mambo/reference': 26}


def test_attachments_and_metadata_come_along_and_the_writers_own_record_is_new(tmp_path):
    recover.recover(odd_bag(tmp_path / 'odd'), tmp_path / 'saved')
    saved = read_bag(tmp_path / 'saved')
    assert saved.attachments == {'scenario.yaml': 'a: 1'}
    assert saved.custom_data == {'recovered_from': 'odd'}
    contents = mcap_reader.scan(tmp_path / 'saved' / 'saved_0.mcap')
    assert [record.name for record in contents.metadata].count('rosbag2') == 1
    assert {record.name: record.metadata for record in contents.metadata}['note'] == {
        'by': 'hand'}


def test_quality_of_service_that_cannot_be_read_is_left_out():
    assert recover._profiles('- {depth: 3}') == [{'depth': 3}]
    assert recover._profiles('') == recover._profiles('a: [') == recover._profiles('a: 1') == []


def test_one_topic_of_two_types_is_refused(tmp_path):
    folder = tmp_path / 'two'
    folder.mkdir()
    for number, kind in enumerate(('std_msgs/msg/Header', 'geometry_msgs/msg/Point')):
        with BagWriter(tmp_path / f'part_{number}') as writer:
            writer.add_topic('/x', kind)
            writer.write('/x', b'\x00\x01\x00\x00' + bytes(24), 10**9)
        (tmp_path / f'part_{number}' / f'part_{number}_0.mcap').rename(
            folder / f'two_{number}.mcap')
    with pytest.raises(BagError, match='/x has two types in one bag; recover file by file'):
        recover.recover(folder, tmp_path / 'saved')


def test_the_report_says_what_was_saved_and_lost(tmp_path, flight, capsys):
    cut(flight, tmp_path / 'broken.mcap', 0.5)
    assert main([str(tmp_path / 'broken.mcap'), str(tmp_path / 'saved')]) == 0
    out = capsys.readouterr().out
    assert 'saved ' in out and 'lost: broken.mcap: cut off within a' in out


def test_a_second_file_behind_the_first_is_named_and_not_the_magic_bytes(
        tmp_path, flight, capsys):
    content = (flight / 'flight_0.mcap').read_bytes()
    for number, more, text in (
            (1, content, f'lost: x.mcap: the file ends at byte {len(content)}, where another'),
            (2, b'stray', f'damaged: x.mcap: 5 bytes follow the end of the file at byte '
                          f'{len(content)}')):
        (tmp_path / 'x.mcap').write_bytes(content + more)
        assert main([str(tmp_path / 'x.mcap'), str(tmp_path / f'saved_{number}')]) == 0
        out = capsys.readouterr().out
        assert text in out and 'magic' not in out
    joined = tmp_path / 'joined.mcap'
    joined.write_bytes(2 * content)
    second = tmp_path / 'second.mcap'
    second.write_bytes(joined.read_bytes()[len(content):])  # as tail -c +BYTE
    assert main([str(second), str(tmp_path / 'intact')]) == 0
    assert 'the source is intact' in capsys.readouterr().out


def test_careless_use_ends_in_one_line(tmp_path, flight, capsys):
    cut(flight, tmp_path / 'stub.mcap', 0.001)
    for source, target, text in (
            (tmp_path / 'none', tmp_path / 'a', 'no such bag'),
            (tmp_path / 'stub.mcap', tmp_path / 'b', 'no message can be read'),
            (flight, flight, 'exists: give another name')):
        assert main([str(source), str(target)]) == 2
        error = capsys.readouterr().err
        assert error.startswith('recover: ') and text in error and error.count('\n') == 1
    assert not (tmp_path / 'a').exists() and not (tmp_path / 'b').exists()
    with pytest.raises(SystemExit) as usage:
        main([])
    assert usage.value.code == 2


def test_nothing_is_written_when_nothing_can_be_read(tmp_path):
    (tmp_path / 'x.mcap').write_bytes(b'\x89MCAP0\r\n')
    with pytest.raises(BagError, match='nothing to recover'):
        recover.recover(tmp_path / 'x.mcap', tmp_path / 'out')
    assert not (tmp_path / 'out').exists()
