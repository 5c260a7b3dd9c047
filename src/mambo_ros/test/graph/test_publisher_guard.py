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


def test_messages_of_the_own_process_need_no_guard(guard):
    made, used, _ = guard
    made.local(b'ours')
    assert used[-1] == b'ours'
