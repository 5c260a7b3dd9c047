"""Motion on the paths of the thesis: velocity, tilt and rates belong together."""

from hypothesis import given, settings, strategies as st
from mambo_model.motion.trajectory import Trajectory
from mambo_thesis.drift.paths import (
    DRAG_RATE, EXPERIMENTS, LEVEL, one_turn, PATHS, perfect, turn_of)
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

def test_the_motion_of_a_path_is_consistent():
    dt = 1e-4
    t = np.arange(0.0, 3.0, dt)
    track = perfect(PATHS['(5.4)'], t, 1.3, 0.8, drag_rate=DRAG_RATE)
    np.testing.assert_allclose(np.gradient(track.position, dt, axis=0)[1:-1],
                               track.velocity[1:-1], atol=1e-6)  # second order of the difference
    turned = Rotation.from_matrix(track.R)
    rates = (turned[:-1].inv() * turned[1:]).as_rotvec() / dt
    # what the heading of the least rotation adds is about b3
    np.testing.assert_allclose(rates[:, :2], track.omega[:-1, :2], atol=0.02)
    a = np.gradient(track.velocity, dt, axis=0)
    force = a - [0, 0, 9.81] + DRAG_RATE * track.velocity * [1, 1, 0]
    assert np.abs(np.cross(force, track.R[:, :, 2]))[1:-1].max() < 1e-3


def test_a_path_is_that_of_the_trajectory_at_any_speed_and_size():
    path, t = PATHS['(5.4)'], np.linspace(0.0, 7.0, 30)
    track = perfect(path, t, 1.7, 0.6)
    angle = 1.7 * path.rate * t[:, None] + np.array(path.phase)
    np.testing.assert_allclose(
        track.position, path.offset + 0.6 * np.array(path.amplitude) * np.sin(angle), atol=1e-12)


def test_a_path_by_hand_is_level_and_does_not_turn():
    track = perfect(PATHS[LEVEL], np.linspace(0.0, 6.0, 20), level=True)
    assert (track.R == np.eye(3)).all() and not track.omega.any()
    np.testing.assert_array_equal(track.nu, track.velocity)
    np.testing.assert_array_equal(track.depth, track.height)


@pytest.mark.parametrize('name', list(PATHS))
def test_the_thrust_axis_is_along_g_less_the_acceleration(name):
    """(3.14): without drag b3 is along g e3 - a, with it g e3 - a - D v."""
    turn = one_turn(name, steps=200)
    if name == LEVEL:
        return
    T = turn.t[1] * 200
    closed = np.vstack([turn.velocity[-1:], turn.velocity, turn.velocity[:1]])
    a = (closed[2:] - closed[:-2]) / (2.0 * T / 200)
    wanted = [0.0, 0.0, 9.81] - a
    wanted /= np.linalg.norm(wanted, axis=1)[:, None]
    # second order of the difference: a of 1 rad/s, 200 steps a turn: (2 pi / 200)^2 / 6
    np.testing.assert_allclose(turn.R[:, :, 2], wanted, atol=2e-4)
    np.testing.assert_allclose(np.linalg.det(turn.R), 1.0, atol=1e-12)


def test_drag_leans_the_vehicle_into_its_motion():
    t = np.array([0.0])
    without, with_drag = (perfect(PATHS['(5.3)'], t, drag_rate=rate) for rate in (0.0, 0.54))
    v = without.velocity[0, :2]
    lean = with_drag.R[0, :2, 2] - without.R[0, :2, 2]
    assert lean @ v < 0.0  # b3 points down: thrust, -b3, forward
    assert abs(lean[0] * v[1] - lean[1] * v[0]) < 0.02  # along it


def test_depth_is_height_over_the_cosine_of_the_tilt():
    turn = one_turn('C.4', steps=50)
    euler = Rotation.from_matrix(turn.R).as_euler('ZYX')
    np.testing.assert_allclose(
        turn.depth, turn.height / (np.cos(euler[:, 1]) * np.cos(euler[:, 2])), rtol=1e-9)


def test_one_turn_ends_where_it_began_and_leaves_the_end_out():
    turn = one_turn('(5.4)', speed=2.0, steps=100)
    step = turn.t[1] - turn.t[0]
    assert len(turn.t) == 100 and turn.t[-1] + step == pytest.approx(2.0 * np.pi / 2.0)
    end = perfect(PATHS['(5.4)'], np.array([turn.t[-1] + step]), 2.0)
    np.testing.assert_allclose(end.position[0], turn.position[0], atol=1e-9)
    assert turn.part(turn.t > 1.0).position.shape == (int((turn.t > 1.0).sum()), 3)


@given(speed=st.floats(0.2, 3.0), size=st.floats(0.1, 1.2), name=st.sampled_from(list(PATHS)))
@settings(max_examples=40, deadline=None)
def test_velocity_and_attitude_belong_to_the_path_at_any_speed_and_size(speed, size, name):
    dt = 1e-4
    t = np.arange(0.0, 0.01, dt)
    track = perfect(PATHS[name], t, speed, size, level=name == LEVEL)
    moved = np.gradient(track.position, dt, axis=0)[1:-1]
    np.testing.assert_allclose(moved, track.velocity[1:-1], atol=1e-5)
    np.testing.assert_allclose(track.R @ np.swapaxes(track.R, 1, 2), np.tile(
        np.eye(3), (len(t), 1, 1)), atol=1e-12)
    np.testing.assert_allclose(  # a rotation keeps the length of the velocity
        np.linalg.norm(track.nu, axis=1), np.linalg.norm(track.velocity, axis=1))


@given(speed=st.floats(0.2, 2.0))
@settings(deadline=None)
def test_a_turn_is_closed_and_as_long_as_the_speed_says(speed):
    turn = one_turn('C.4', speed, steps=64)
    step = turn.t[1] - turn.t[0]
    assert 64 * step == pytest.approx(2.0 * np.pi / speed)
    np.testing.assert_allclose(turn.velocity.mean(axis=0), 0.0, atol=1e-9)


def test_experiments_are_on_known_paths_and_only_the_hand_is_level():
    assert {path for _, _, path in EXPERIMENTS.values()} <= set(PATHS)
    assert [name for name, (_, _, path) in EXPERIMENTS.items() if path == LEVEL] == [
        'drift_hand_loop']


@pytest.mark.parametrize('speed', [0.5, 1.0, 3.0])
def test_a_turn_of_any_path_is_one_period_of_it(speed):
    path = Trajectory('sine in y', (0.0, 0.0, -1.2), (0.0, 0.7, 0.0), rate=2.0)
    turn = turn_of(path, speed, steps=400)
    period = np.pi / speed
    np.testing.assert_allclose(turn.t, np.arange(400) * period / 400, atol=1e-12)
    phase = 2.0 * speed * turn.t
    np.testing.assert_allclose(turn.position[:, 1], 0.7 * np.sin(phase), atol=1e-12)
    np.testing.assert_allclose(
        turn.velocity[:, 1], 0.7 * 2.0 * speed * np.cos(phase), atol=1e-9)
    np.testing.assert_allclose(turn.height, 1.2, atol=1e-12)
    assert np.abs(turn.omega).max() > 0.0  # the vehicle leans into its accelerations
    level = turn_of(path, speed, steps=40, level=True)
    np.testing.assert_allclose(level.R, np.broadcast_to(np.eye(3), (40, 3, 3)), atol=1e-12)
    assert not level.omega.any()
