"""Bags of equal messages have equal digests; any other bag has another."""

from mambo_bags.cli.digest import digest, main
from mambo_bags.reader import read_bag
from mambo_bags.recover import recover
import pytest
from synthetic import make_flight


@pytest.fixture(scope='module')
def flight(tmp_path_factory):
    return make_flight(tmp_path_factory.mktemp('bags') / 'flight', 2.0)


def test_a_copy_in_other_chunks_has_the_same(tmp_path, flight, capsys):
    recover(flight, tmp_path / 'copy')
    assert main([str(flight), str(tmp_path / 'copy')]) == 0
    first, second = capsys.readouterr().out.splitlines()
    assert first.split()[0] == second.split()[0] == digest(read_bag(flight))
    assert len(first.split()[0]) == 64 and second.endswith('copy')


@pytest.mark.parametrize('change', ['data', 'time', 'topic'])
def test_a_changed_message_shows(flight, change):
    bag = read_bag(flight)
    messages = bag['motor_pwm']
    if change == 'data':
        messages.raw[3] = messages.raw[3][:-1] + bytes([messages.raw[3][-1] ^ 1])
    elif change == 'time':
        messages.log_time[3] += 1
    else:
        del bag.topics[messages.topic]
    assert digest(bag) != digest(read_bag(flight))


def test_other_messages_are_told_and_no_success(tmp_path, flight, capsys):
    other = make_flight(tmp_path / 'other', 1.0)
    assert main([str(path) for path in (flight, flight, other)]) == 1
    out, err = capsys.readouterr()
    assert out.count('\n') == 3
    assert err == f'digest: {other} holds other messages than {flight}\n'


def test_a_bag_that_is_missing_is_one_line(tmp_path, capsys):
    assert main([str(tmp_path / 'none')]) == 2
    assert capsys.readouterr().err.count('\n') == 1
