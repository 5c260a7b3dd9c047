"""Whether a velocity is in the axes of the body or of the poses shows in the motion alone."""

from pathlib import Path

from mambo_analysis.importers.checks.world_twist import axes_of
from mambo_bags.reader import read_bag
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

CIRCLE = Path(__file__).parents[5] / 'bags/circle_short'


def flown(yaw=90.0, noise=0.0, seconds=6.0):
    """Return times, positions, orientations, and the velocity in the world, of a vehicle."""
    t = np.arange(0.0, seconds, 0.01)
    rng = np.random.default_rng(1)
    position = np.stack([np.cos(t), 0.5 * np.sin(2.0 * t), 1.0 + 0.1 * t], axis=1)
    velocity = np.stack([-np.sin(t), np.cos(2.0 * t), np.full_like(t, 0.1)], axis=1)
    turn = Rotation.from_euler('z', np.full((len(t), 1), yaw), degrees=True)
    return (t, position + noise * rng.normal(size=position.shape), turn.as_quat(), velocity,
            turn.inv().apply(velocity))


@pytest.mark.parametrize('noise', [0.0, 0.01])
@pytest.mark.parametrize('yaw', [90.0, -45.0, 180.0])
def test_the_motion_tells_the_axes(yaw, noise):
    *motion, world, body = flown(yaw, noise)
    assert axes_of(*motion, world) == 'world'
    assert axes_of(*motion, body) == 'body'


def test_nothing_tells_a_vehicle_that_does_not_turn_or_whose_velocity_is_another():
    *motion, world, body = flown(yaw=0.0)
    assert axes_of(*motion, body) == ''
    *motion, world, body = flown()
    assert axes_of(*motion, 3.0 * world) == axes_of(*motion, np.zeros_like(world)) == ''
    *motion, world, body = flown(yaw=180.0)  # 1.6 times as fast, and the other way
    assert axes_of(*motion, 1.6 * world) == ''
    assert axes_of(*flown(seconds=1.0)[:-1]) == ''
    assert axes_of(*(x[:1] for x in flown()[:-1])) == ''
    assert axes_of(*(x[:0] for x in flown()[:-1])) == ''


def test_damaged_and_repeated_rows_are_left_out():
    t, position, orientation, world, _ = flown()
    t[5], position[7, 1], orientation[9], world[11] = t[4], np.nan, 0.0, np.inf
    assert axes_of(t, position, orientation, world) == 'world'


def test_orientations_that_are_no_rotations_are_left_out():
    t, position, orientation, _, body = flown()
    orientation[np.arange(len(t)) % 3 > 0] = [0.0, 0.0, -2.0, 2.0]  # the other way, if it were one
    assert axes_of(t, position, orientation, body) == 'body'


def test_rows_in_any_order_and_at_any_rate_are_taken_by_their_times():
    t, position, orientation, _, body = flown()
    rows = np.concatenate([np.arange(0, 300), np.arange(300, 600, 5)])  # then a fifth of the rate
    np.random.default_rng(1).shuffle(rows)
    assert axes_of(*(x[rows] for x in (t, position, orientation, body))) == 'body'


@pytest.mark.parametrize('topic', ['ground_truth/odom', 'estimate/odom'])
def test_our_own_odometry_is_in_the_axes_of_the_body_or_does_not_tell(topic):
    odometry = read_bag(CIRCLE)[topic]
    turn = Rotation.from_euler('z', 90.0, degrees=True)  # of the world, by which nothing changes
    assert axes_of(odometry.t, turn.apply(odometry.position),
                   (turn * Rotation.from_quat(odometry.orientation)).as_quat(),
                   odometry.velocity) == 'body'
