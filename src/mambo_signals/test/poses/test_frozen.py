"""Poses that a tracker repeats while the body is lost are found; those of a body at rest stay."""

from mambo_signals.poses import frozen, outliers
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic import FLIP, loop, rocking

T = np.arange(0.0, 15.0, 0.01)
RNG = np.random.default_rng(3)
NOISE = 1e-4 * RNG.standard_normal((len(T), 3))


def seen():
    """Return positions and attitudes of a flight, with the noise of a motion capture."""
    return (loop(T)[0] + NOISE,
            (rocking(T) * Rotation.from_rotvec(3.0 * NOISE[::-1])).as_quat())


def freeze(position, attitude, first, last):
    """Repeat the pose ``first`` to ``last``, as a tracker does that has lost the body."""
    position[first:last + 1], attitude[first:last + 1] = position[first], attitude[first]


def rows(*runs):
    return {k for first, last in runs for k in range(first + 1, last + 1)}


@pytest.mark.parametrize('runs', [
    [(400, 402)], [(500, 560)], [(300, 309), (900, 1100)], [(700, 710), (713, 730)],
    [(1300, 1499)], [(450, 470), (1350, 1499)]])
def test_frozen_poses_are_found_and_only_those(runs):
    """The first of each run is the last pose that was seen."""
    position, attitude = seen()
    for first, last in runs:
        freeze(position, attitude, first, last)
    found = frozen.frozen(T, position, attitude)
    assert set(np.flatnonzero(found)) == rows(*runs)
    kept = ~found
    assert not outliers.impossible(T[kept], position[kept], attitude[kept]).any()


def test_a_frozen_pose_from_the_start_is_found():
    position, attitude = seen()
    freeze(position, attitude, 0, 79)
    assert set(np.flatnonzero(frozen.frozen(T, position, attitude))) == set(range(1, 80))


def test_a_pose_that_stands_for_a_lost_body_is_not_kept_once():
    position, attitude = seen()
    position[600:640], attitude[600:640] = 0.0, (0.0, 0.0, 0.0, 1.0)
    assert set(np.flatnonzero(frozen.frozen(T, position, attitude))) == set(range(600, 640))


def test_a_frozen_run_before_lost_frames_is_found():
    position, attitude = seen()
    freeze(position, attitude, 500, 540)
    kept = np.r_[0:541, 600:len(T)]
    found = frozen.frozen(T[kept], position[kept], attitude[kept])
    assert set(np.flatnonzero(found)) == rows((500, 540))


def test_only_the_attitude_leaps():
    """A body that turns on the spot is lost and found with another heading."""
    position = np.zeros((len(T), 3))
    attitude = Rotation.from_euler('z', T[:, None]).as_quat()
    freeze(position, attitude, 500, 540)
    assert set(np.flatnonzero(frozen.frozen(T, position, attitude))) == rows((500, 540))


def test_a_sound_capture_is_whole():
    assert not frozen.frozen(T, *seen()).any()


def rest(position, attitude):
    """Put the vehicle to rest, without noise, for 3 s at both ends; a smooth climb between."""
    up = np.interp(T, [3.0, 12.0], [0.0, 1.0])
    up = up ** 2 * (3.0 - 2.0 * up)
    position[:] = np.column_stack([0.4 * up, 0.1 * up, up])
    attitude[:] = Rotation.from_euler('z', up[:, None]).as_quat()


def test_a_simulated_rest_is_kept():
    """Without noise a vehicle at rest repeats its pose; its take-off is no leap."""
    position, attitude = seen()
    rest(position, attitude)
    assert not frozen.frozen(T, position, attitude).any()
    freeze(position, attitude, 700, 720)
    assert set(np.flatnonzero(frozen.frozen(T, position, attitude))) == rows((700, 720))


def test_a_simulated_landing_that_stops_on_the_floor_is_no_lost_body():
    position, attitude = np.zeros((len(T), 3)), seen()[1]
    position[:, 2] = np.interp(T, [1.0, 4.0, 9.0, 11.5], [0.0, 1.0, 1.0, 0.0])
    position[:, 0] = np.interp(T, [2.0, 11.5], [0.0, 2.0])
    freeze(position, attitude, 1150, len(T) - 1)
    assert not frozen.frozen(T, position, attitude).any()
    position[1150:] = position[1000]  # half a metre higher, the last pose that was seen
    position[1000:1150], attitude[1000:] = position[1000], attitude[1000]
    assert set(np.flatnonzero(frozen.frozen(T, position, attitude))) == rows((1000, len(T) - 1))


@pytest.mark.parametrize('digits', [2, 3])
def test_rounded_poses_are_kept(digits):
    """A table in cm or mm repeats its poses wherever the body moves slowly, or rests."""
    position, attitude = seen()
    rest(position, attitude)
    position += NOISE * 10.0 ** (4 - digits) / 10.0
    position, attitude = position.round(digits), attitude.round(digits)
    attitude /= np.linalg.norm(attitude, axis=1, keepdims=True)
    assert (np.diff(position, axis=0) == 0.0).all(axis=1).any()
    assert not frozen.frozen(T, position, attitude).any()


def test_a_flip_of_the_markers_at_rest_is_left_to_the_outliers():
    position, attitude = seen()
    rest(position, attitude)
    attitude[100:130] = (Rotation.from_quat(attitude[100]) * FLIP).as_quat()
    assert not frozen.frozen(T, position, attitude).any()
    assert set(np.flatnonzero(outliers.impossible(T, position, attitude))) == set(range(100, 130))


def test_a_capture_with_every_pose_several_times_is_kept():
    """Of a stream at a third of the rate of the export."""
    held = np.arange(len(T)) // 3 * 3
    position, attitude = seen()
    assert not frozen.frozen(T, position[held], attitude[held]).any()


@pytest.mark.parametrize('count', [0, 1, 2, 3, 4])
def test_a_few_poses_are_kept(count):
    position, attitude = seen()
    assert not frozen.frozen(T[:count], position[:count], attitude[:count]).any()


def test_the_line_counts_them():
    assert frozen.describe('optitrack/pose', 1).startswith('optitrack/pose: 1 frozen pose left')
    assert '2 frozen poses left out' in frozen.describe('optitrack/pose', 2)
