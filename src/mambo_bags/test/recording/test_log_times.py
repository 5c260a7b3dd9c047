"""Which stamps a recording believes, and what it holds back before there is any."""

import time

from mambo_bags.recording import log_times
from mambo_bags.recording.log_times import AGREEING, EarlyMessages, LogTimes, SECOND, WINDOW
import pytest

STEP = 5_000_000  # ns
FAR = 1_790_000_000 * SECOND


@pytest.fixture
def times():
    """Return the times of a flight that has come from 100 to 110 s."""
    out = LogTimes()
    for k in range(2001):
        assert out.update(100 * SECOND + k * STEP)
    return out


@pytest.mark.parametrize('stamp', [
    90 * SECOND, 100 * SECOND, 110 * SECOND, 110 * SECOND + 1, 110 * SECOND + WINDOW])
def test_a_stamp_of_the_flight_is_kept(times, stamp):
    assert times.of(stamp) == (stamp, True)


@pytest.mark.parametrize('stamp', [
    None, -1, -2**31 * SECOND, 0, 90 * SECOND - 1, 110 * SECOND + WINDOW + 1, FAR])
def test_any_other_gives_way_to_the_clock(times, stamp):
    assert times.of(stamp) == (110 * SECOND, False)


def test_a_clock_far_away_is_not_believed_beside_the_true_one(times):
    for k in range(1, 200):
        assert not times.update(FAR + k * STEP)
        assert times.update(110 * SECOND + k * STEP)
        assert times.now == 110 * SECOND + k * STEP
    assert not times.update(None) and not times.update(-1)


@pytest.mark.parametrize('leap', [FAR, 3 * SECOND], ids=['ahead', 'back'])
def test_a_clock_that_really_leaps_is_followed(times, leap):
    assert not any(times.update(leap + k * STEP) for k in range(AGREEING - 1))
    assert times.now == 110 * SECOND
    assert times.update(leap + AGREEING * STEP) and times.now == leap + AGREEING * STEP
    assert times.of(leap) == (leap, True)


def test_leaps_to_everywhere_agree_on_nothing(times):
    assert not any(times.update(FAR + k * 20 * SECOND) for k in range(100))


def test_without_a_clock_the_machine_s_own_counts_until_there_is_one():
    times = LogTimes()
    times.use_wall_clock()
    now = time.time_ns()
    assert times.of(now) == (now, True)
    assert times.of(0)[0] >= now and not times.of(0)[1]
    assert times.update(SECOND) and times.now == SECOND
    assert times.of(2 * SECOND) == (2 * SECOND, True)


def test_stamps_that_certainly_count_are_those_of_the_window():
    times = LogTimes()
    assert times.low > times.high  # none before the first /clock
    for now in (100 * SECOND, 101 * SECOND):
        assert times.update(now)
        for stamp in (times.low, times.high):
            assert times.of(stamp) == (stamp, True)
        for stamp in (times.low - 1, times.high + 1):
            assert times.of(stamp) == (now, False)


def test_messages_are_released_in_order_and_those_of_a_topic_forgotten():
    held, heard = EarlyMessages(), []
    for topic, data in (('/a', b'1'), ('/b', b'2'), ('/a', b'3')):
        assert not held.hold(topic, heard.append, data)
    assert len(held) == 3 and held.forget('/b') == 1 and held.forget('/c') == 0
    held.release()
    assert heard == [b'1', b'3'] and not held


def test_what_is_forgotten_takes_no_room(monkeypatch):
    monkeypatch.setattr(log_times, 'LARGEST_EARLY', 10)
    held = EarlyMessages()
    assert not held.hold('/a', print, bytes(8))
    held.forget('/a')
    assert not held.hold('/b', print, bytes(8))
    assert held.hold('/b', print, bytes(8))
