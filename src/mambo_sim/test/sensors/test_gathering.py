"""Samples of several drones: one step at a time, whatever the order in which they come."""

from mambo_model.motion.rigid_body import State
from mambo_sim.sensors import gathering
from mambo_sim.sensors.gathering import Gathering

ZERO = (0.0, 0.0, 0.0)


def state(x):
    return State((x, 0.0, 0.0), ZERO, (1.0, 0.0, 0.0, 0.0), ZERO)


A, B = state(1.0), state(2.0)


def test_a_step_is_complete_with_the_last_drone():
    both = Gathering(2)
    assert both.put(1, 0, B) == []
    assert both.put(0, 0, A) == [(0, [A, B])]


def test_a_drone_may_be_ahead():
    both = Gathering(2)
    assert [both.put(0, t, A) for t in (0, 5, 10)] == [[], [], []]
    assert both.put(1, 0, B) == [(0, [A, B])]
    assert both.put(1, 5, B) == [(5, [A, B])]


def test_a_step_with_a_missing_sample_comes_before_the_next_complete_one():
    both = Gathering(2)
    both.put(0, 0, A)
    both.put(0, 5, A)
    assert both.put(1, 5, B) == [(0, [A, None]), (5, [A, B])]
    assert both.put(1, 0, B) == []  # too late


def test_a_drone_that_is_gone_does_not_stop_the_others_for_ever(monkeypatch):
    monkeypatch.setattr(gathering, 'MOST', 3)
    both = Gathering(2)
    assert [both.put(0, t, A) for t in range(3)] == [[]] * 3
    assert both.put(0, 3, A) == [(0, [A, None])]
    assert both.put(0, 4, A) == [(1, [A, None])]
