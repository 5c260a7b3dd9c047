"""The limits of a path: each of them is found, and named with its value."""

from mambo_control.commanded.command_params import CommandParams
from mambo_control.commanded.envelope import beyond
from mambo_control.commanded.maneuvers import at_rest, move, Segment
from mambo_model.motion.trajectory import LANDING, TAKEOFF, TRACK
from mambo_model.vehicle.parameters import Vehicle
import numpy as np
import pytest

P, V = CommandParams(), Vehicle()


def path(start, end, duration, phase=TRACK):
    start, end = (np.array([*point, 0.0, 0.0][:4], float) for point in (start, end))
    return [move(at_rest(start), at_rest(end), duration, phase)], end


@pytest.mark.parametrize(('start', 'end', 'duration', 'words'), [
    ((0, 0, -1), (1, 0, -1), 4.0, ''),
    ((0, 0, -1), (5.1, 0, -1), 30.0, 'x = 5.1 m, limit 5 m'),
    ((0, 0, -1), (-5.1, 0, -1), 30.0, 'x = -5.1 m'),
    ((0, 0, -1), (0, 5.1, -1), 30.0, 'y = -5.1 m'),
    ((0, 0, -1), (0, 0, -3.1), 30.0, '3.1 m high'),
    ((0, 0, -1), (0, 0, -3.0004), 30.0, '3.0004 m high, ceiling 3 m'),
    ((0, 0, -1), (-5.00002, 0, -1), 30.0, 'x = -5.00002 m, limit 5 m'),
    ((0, 0, -1), (0, 0, -0.2), 30.0, 'comes down to 0.2 m, lowest flight 0.5 m'),
    ((0, 0, -1), (4.9, 0, -1), 5.5, 'speed 2'),
    ((0, 0, -1), (1, 0, -1), 1.5, 'acceleration 4'),
    ((0, 0, -1), (0.02, 0, -1), 0.1, 'the path needs'),
    ((0, 0, -1), (np.nan, 0, -1), 4.0, 'leaves the volume'),
    ((0, 0, -1), (1, 0, -1), 121.0, 'takes 121 s, limit 120 s')])
def test_a_limit_that_is_exceeded_is_named(start, end, duration, words):
    found = beyond(*path(start, end, duration), 1.0, P, V)
    assert words in found and bool(found) == bool(words)


@pytest.mark.parametrize(('phase', 'accepted'), [(TRACK, False), (TAKEOFF, True), (LANDING, True)])
def test_only_takeoff_and_landing_come_below_the_lowest_flight(phase, accepted):
    assert (beyond(*path((0, 0, -1), (0, 0, 0), 6.0, phase), 1.0, P, V) == '') == accepted


def test_a_path_may_begin_low_but_not_sink_further():
    assert beyond(*path((0, 0, -0.1), (1, 0, -1), 6.0), 0.1, P, V) == ''
    assert 'comes down' in beyond(*path((0, 0, -0.1), (1, 0, -0.05), 6.0), 0.1, P, V)


def test_a_hover_that_is_asked_for_is_not_below_the_lowest_flight():
    low = path((0, 0, -0.01), (2, 0, -0.01), 6.0)
    assert beyond(*low, 0.01, P, V) == '' and 'comes down' in beyond(*low, 0.01, P, V, True)
    assert beyond(*path((0, 0, -0.01), (1, 0, -1), 6.0), 0.01, P, V, True) == ''


def test_a_fast_turn_and_a_weak_vehicle_are_named():
    turn = np.array([0.0, 0.0, -1.0, 3.0])
    still = at_rest(np.array([0.0, 0.0, -1.0, 0.0]))
    assert 'turns at 2.46 rad/s, limit 2 rad/s' in beyond(
        [move(still, at_rest(turn), 3.0)], turn, 1.0, P, V)
    assert 'the path needs' in beyond(
        *path((0, 0, -1), (1, 0, -1), 4.0), 1.0, P, Vehicle(mass=0.2))


def test_a_path_without_parts_is_the_point_where_it_stays():
    assert beyond([], np.array([0.0, 0.0, -1.0, 0.0]), 1.0, P, V) == ''
    assert 'volume' in beyond([], np.array([9.0, 0.0, -1.0, 0.0]), 1.0, P, V)
    assert beyond([Segment(2.0, np.array([[0.0], [0.0], [-1.0], [0.0]]), TRACK)],
                  np.array([0.0, 0.0, -1.0, 0.0]), 1.0, P, V) == ''
