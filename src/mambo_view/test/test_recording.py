"""A bag gives the state of a drone at any time."""

from pathlib import Path

from mambo_bags.reader import BagError, read_bag
from mambo_view.drone_state import ESTIMATE, MEASURED, REFERENCE, TRUTH
from mambo_view.recording import Recording
import numpy as np
import pytest

BAG = Path(__file__).parents[3] / 'bags/circle_short'


@pytest.fixture(scope='module')
def flight():
    return Recording(BAG)


@pytest.fixture(scope='module')
def bag():
    return read_bag(BAG)


@pytest.mark.parametrize(('role', 'topic'), [
    (TRUTH, 'ground_truth/odom'), (ESTIMATE, 'estimate/odom'), (REFERENCE, 'reference'),
    (MEASURED, 'optitrack/pose')])
def test_a_pose_is_the_last_one_not_after_the_time(flight, bag, role, topic):
    t, positions = bag[topic].t, bag[topic].position
    for when in (3.0, 4.0025, 7.9):
        index = np.flatnonzero(t <= when)[-1]
        assert flight.state(when).position(role) == tuple(positions[index])
    x, y, z, w = bag[topic].orientation[np.flatnonzero(t <= 5.0)[-1]]
    assert flight.state(5.0).poses[role].attitude == (w, x, y, z)


def test_motors_and_health_are_those_of_the_time(flight, bag):
    t, pwm = bag['motor_pwm'].t, bag['motor_pwm'].pwm
    assert flight.state(5.0).pwm == tuple(pwm[np.flatnonzero(t <= 5.0)[-1]])
    assert not flight.state(-1.0).health
    assert flight.state(8.0).health['sim_node'] == (0, 'flying')


def test_outside_of_the_flight_nothing_is_shown(flight):
    assert flight.start == 0.0 and flight.end == pytest.approx(8.0)
    assert not flight.state(flight.start - 1.0).poses
    assert not flight.state(flight.end + 1.0).poses  # half a second without a pose


def test_a_bag_that_cannot_be_shown_is_one_line(tmp_path, monkeypatch):
    with pytest.raises(BagError):
        Recording(tmp_path / 'none')
    monkeypatch.setattr('mambo_view.recording.POSES', {TRUTH: ('nobody',)})
    with pytest.raises(BagError, match='circle_short: no pose to show; it has .*/mambo/reference'):
        Recording(BAG)
