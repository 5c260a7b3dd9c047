"""One publisher is accepted; a flood of another is reported as soon as it is one."""

from mambo_ros.graph import publisher_guard
import pytest

FIRST, SECOND, THIRD = b'\1' * 16, b'\2' * 16, b'\3' * 16


@pytest.fixture
def wall(monkeypatch):
    wall = [100.0]
    monkeypatch.setattr(publisher_guard.time, 'monotonic', lambda: wall[0])
    return wall


@pytest.fixture
def guard(wall):
    """Return a guard that accepts the first, what it let through and what it reported."""
    used, reported = [], []
    made = publisher_guard.PublisherGuard('/imu', used.append, 1000)
    made.publishers = lambda: {FIRST, SECOND, THIRD}
    made.flooded = lambda guard, publisher: reported.append(publisher)
    made(b'first', FIRST)
    return made, used, reported


def test_only_messages_of_the_first_publisher_are_used(guard):
    made, used, _ = guard
    made(b'wrong', SECOND)
    made(b'next', FIRST)
    assert used == [b'first', b'next'] and made.accepted == 2 and made.first == FIRST
    assert made.refused == {publisher_guard.SECOND_PUBLISHER: 1}


def test_a_flood_is_reported_with_its_publisher(guard, wall):
    made, _, reported = guard
    for _ in range(publisher_guard.FLOOD - 1):
        made(b'', SECOND)
    made(b'', THIRD)
    assert reported == []
    made(b'', SECOND)
    assert reported == [SECOND]
    for _ in range(publisher_guard.FLOOD - 1):  # each message of what goes on is not another flood
        wall[0] += 1e-6
        made(b'', SECOND)
    assert reported == [SECOND]
    made(b'', SECOND)
    assert reported == [SECOND, SECOND]


def test_as_many_messages_as_the_first_sends_are_no_flood(guard):
    made, _, reported = guard
    for _ in range(4 * publisher_guard.FLOOD):
        made(b'', SECOND)
        made(b'', FIRST)
    assert reported == []


def test_many_messages_over_a_long_time_are_no_flood(guard, wall):
    made, _, reported = guard
    for _ in range(4 * publisher_guard.FLOOD):
        wall[0] += 1.1 / publisher_guard.FLOOD
        made(b'', SECOND)
    assert reported == []


def test_another_takes_over_from_one_that_left_unless_the_node_forbids_it(guard, wall):
    made, used, _ = guard
    began, allowed = wall[0], []
    made.publishers, made.replaceable = lambda: {SECOND}, lambda since: since in allowed
    for _ in range(20):
        wall[0] += 0.5 * publisher_guard.ABSENT
        made(b'stranger', SECOND)
    assert used == [b'first'] and made.refused[publisher_guard.SECOND_PUBLISHER] == 20
    assert made.latest == began
    allowed.append(began + 0.5 * publisher_guard.ABSENT)  # when it was missed
    made(b'heir', SECOND)
    assert used[-1] == b'heir' and made.first == SECOND


@pytest.mark.parametrize('waits', [False, True])
def test_what_one_sent_before_it_was_accepted_is_missing(guard, wall, waits):
    made, used, _ = guard
    told = []
    made.incomplete = lambda *what: told.append(what)
    made.publishers = lambda: {SECOND}
    made(b'too early', SECOND)
    assert not told
    wall[0] += publisher_guard.ABSENT + 0.01
    if waits:
        made.is_deserted(1)
    made(b'in time', SECOND)
    assert used == [b'first', b'in time'] and told == [(made, publisher_guard.REPLACED)]
    made(b'further', SECOND)
    assert len(told) == 1


def test_messages_of_the_own_process_need_no_guard(guard):
    made, used, _ = guard
    made.local(b'ours')
    assert used[-1] == b'ours'


def test_one_that_has_left_is_forgotten_before_anybody_else_sends(guard, wall):
    made, used, _ = guard
    assert not made.is_deserted(3)
    assert not made.is_deserted(2)  # the graph lags behind
    made.publishers = lambda: {SECOND}
    assert made.is_deserted(2) and made.first == FIRST
    wall[0] += publisher_guard.ABSENT + 0.01
    assert not made.is_deserted(2) and made.first == b''
    made(b'at once', SECOND)
    assert used == [b'first', b'at once'] and not made.refused


def test_one_that_is_back_or_that_nobody_replaces_is_not_forgotten(guard, wall):
    made, _, _ = guard
    made.publishers = lambda: set()
    assert made.is_deserted(0)
    made.publishers = lambda: {FIRST}
    wall[0] += publisher_guard.ABSENT + 0.01
    assert not made.is_deserted(1) and made.first == FIRST
    made.publishers = lambda: set()
    made.replaceable = lambda since: False
    for _ in range(3):
        assert not made.is_deserted(0) and made.first == FIRST
        wall[0] += publisher_guard.ABSENT


def test_messages_that_did_not_come_are_counted_by_their_numbers(guard):
    made, _, _ = guard
    told = []
    made.incomplete = lambda *what: told.append(what)
    for number in (7, 8, 9):
        made.follow(number)
    assert not made.refused and not told
    made.follow(13)
    assert made.refused == {publisher_guard.LOST: 3} and told == [(made, publisher_guard.LOST)]
    made.follow(15)
    assert made.refused == {publisher_guard.LOST: 4}


def test_another_publisher_misses_nothing(guard, wall):
    made, _, _ = guard
    made.follow(7)
    made.publishers = lambda: {SECOND}
    made.is_deserted(1)
    wall[0] += publisher_guard.ABSENT + 0.01
    made.is_deserted(1)
    made(b'next', SECOND)
    for number in (100, 101):
        made.follow(number)
    assert not made.refused


def test_a_middleware_that_does_not_count_misses_nothing(guard):
    made, _, _ = guard
    for _ in range(3):
        made.follow(2**64 - 1)
    assert not made.refused


def test_the_first_message_may_come_after_those_that_it_took(guard):
    made, _, _ = guard
    for number in (8, 7, 9):
        made.follow(number)
    assert not made.refused
    made.follow(11)
    assert made.refused == {publisher_guard.LOST: 1}


def test_a_publisher_of_another_process_does_not_come_first():
    used = []
    made = publisher_guard.PublisherGuard('/command', used.append, 1000)
    made.belongs = lambda gid: publisher_guard.same_process(gid, FIRST)
    made(b'wrong', SECOND)
    assert not made.first and made.refused == {publisher_guard.SECOND_PUBLISHER: 1}
    own = FIRST[:12] + b'next'
    made(b'right', own)
    made(b'wrong', SECOND)
    made(b'right', own)
    assert used == [b'right'] * 2 and made.first == own
    assert made.refused == {publisher_guard.SECOND_PUBLISHER: 2}


@pytest.mark.parametrize(('gid', 'other', 'same'), [
    (b'', FIRST, True), (FIRST, b'', True), (FIRST, FIRST[:12] + SECOND[:4], True),
    (FIRST, FIRST[:11] + SECOND[:5], False)])
def test_publishers_of_one_process_share_the_prefix_of_their_participant(gid, other, same):
    assert publisher_guard.same_process(gid, other) == same
