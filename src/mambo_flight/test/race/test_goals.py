"""Goals of a race: which course counts, which controller reaches what."""

from mambo_flight.race import goals
from mambo_flight.race.result import Result
import pytest


def result(rms, course='circle', condition='twenty_percent', state='true', entrant='indi',
           survived=1.0, flights=4):
    return Result(entrant, course, condition, state, flights, survived, rms, rms, rms, rms, 0.0,
                  400.0)


FOUND = [
    result(0.010), result(0.014, 'lemniscate'), result(0.137, 'step', survived=0.5),
    result(0.041, state='aided'), result(0.009, 'circle_fast', 'known'),
    result(0.260, 'circle_fast', 'known', entrant='cascaded'),
    result(0.580, entrant='cascaded', survived=0.995, flights=200)]


def test_the_worst_course_without_a_jump_counts():
    assert goals.worst(FOUND, 'indi', 'true') == 0.014
    assert goals.worst(FOUND, 'indi', 'aided') == 0.041
    assert goals.worst(FOUND, 'cascaded', 'aided') is None


def test_the_fast_circle_is_compared_with_the_cascade():
    assert goals.reduction(FOUND, 'indi') == pytest.approx(1.0 - 9.0 / 260.0)
    assert goals.reduction(FOUND, 'cascaded') == 0.0
    assert goals.reduction(FOUND[:5], 'indi') is None
    assert goals.reduction(FOUND, 'geometric') is None


def test_survivors_are_counted_over_all_flights_with_wrong_beliefs():
    assert goals.alive(FOUND, 'indi') == pytest.approx(14 / 16)  # 2 of 16 lost, the step counts
    assert goals.alive(FOUND, 'geometric') is None


def test_the_table_says_what_is_reached():
    text = goals.lines(FOUND)
    assert '| `indi` | 14 mm, reached | 41 mm, missed | 96.5 %, reached | 87.5 %, missed |' in text
    assert '| `cascaded` | 580 mm, missed |  | 0.0 %, missed | 99.5 %, reached |' in text


def test_a_goal_counts_only_flights_of_its_state_and_condition():
    others = [result(9.0, condition='known'), result(9.0, entrant='geometric')]
    assert goals.worst([*FOUND, *others], 'indi', 'true') == goals.worst(FOUND, 'indi', 'true')
    assert goals.worst([result(9.0, condition='known')], 'indi', 'true') is None


def test_without_flights_nothing_is_reached_or_missed():
    assert 'reached' not in goals.lines([]) and 'missed' not in goals.lines([])
