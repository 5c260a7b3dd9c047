"""Saving what a killed recorder left, without touching it."""

import re

from mambo_bags import recover
from mambo_bags.reader import BagError, read_bag
from mambo_bags.recover import main
import pytest
from rosbags.highlevel import AnyReader
from synthetic import make_flight


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


def test_the_report_says_what_was_saved_and_lost(tmp_path, flight, capsys):
    cut(flight, tmp_path / 'broken.mcap', 0.5)
    assert main([str(tmp_path / 'broken.mcap'), str(tmp_path / 'saved')]) == 0
    out = capsys.readouterr().out
    assert 'saved ' in out and 'lost: broken.mcap: cut off within a' in out


def test_careless_use_ends_in_one_line(tmp_path, flight, capsys):
    cut(flight, tmp_path / 'stub.mcap', 0.001)
    for source, target, text in (
            (tmp_path / 'none', tmp_path / 'a', 'there is no such bag'),
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
