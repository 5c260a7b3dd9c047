"""The smoothed flight of a bag: its truth, its table and its odometry."""

from pathlib import Path
from types import SimpleNamespace

from mambo_bags.reader import BagError
from mambo_estimation.joint.joint_parameters import JointParams
from mambo_flight.smooth import recorded
from mambo_ros import topics
import numpy as np
import pytest
from smoothed_flight import made_up, moving_in, N, steps


class Bag(dict):
    path = Path('flight')


def bag_with_truth():
    """Return a bag whose truth flies north at 2 m/s, 1 m high, from 10 ms to 40 ms."""
    stamp = np.arange(10, 41, 10) * 1_000_000
    position = np.stack([2e-9 * stamp, np.zeros(4), np.ones(4)], axis=1)
    return Bag({topics.GROUND_TRUTH.name: SimpleNamespace(stamp=stamp, position=position)})


@pytest.fixture
def smoothed(monkeypatch):
    """Return the answer for a bag whose steps and smoothed states are known."""
    def answer(bag, made):
        monkeypatch.setattr(recorded.offline_replay, 'steps', lambda bag: steps())
        monkeypatch.setattr(recorded, 'smooth', lambda found, params: made)
        return recorded.smoothed(bag, JointParams())
    return answer


def test_truth_is_interpolated_in_ned_and_unknown_outside_of_its_times():
    t = np.array([5, 10, 15, 40, 45]) * 1_000_000
    truth = recorded._truth(bag_with_truth(), t)
    np.testing.assert_allclose(truth[1:4], [[0.02, 0, -1], [0.03, 0, -1], [0.08, 0, -1]])
    assert np.isnan(truth[[0, 4]]).all()


def test_a_bag_without_truth_has_none():
    assert recorded._truth(Bag(), np.arange(3)) is None


def test_every_step_becomes_a_message_of_odometry(smoothed):
    answer = smoothed(Bag(), made_up())
    assert answer.table.shape[0] == N and answer.table.dtype == np.uint8
    assert not (answer.table[0] == answer.table[1]).all()  # the stamps differ


def test_the_path_is_compared_only_where_there_is_a_truth(smoothed):
    assert 'path error' not in smoothed(Bag(), made_up()).text
    assert 'path error' in smoothed(bag_with_truth(), made_up()).text


def test_the_numbers_are_those_of_the_smoother(smoothed):
    made = made_up()
    assert smoothed(Bag(), made).numbers is made


@pytest.mark.parametrize('steps', [0, 1])
def test_a_vehicle_that_never_moves_cannot_be_smoothed(smoothed, steps):
    with pytest.raises(BagError, match='^flight: the vehicle never moves, nothing to smooth$'):
        smoothed(Bag(), moving_in(made_up(), np.arange(N) >= N - steps))


def test_the_last_two_steps_are_enough(smoothed):
    moving = np.arange(N) >= N - 2
    assert smoothed(Bag(), moving_in(made_up(), moving)).numbers.moving is moving
