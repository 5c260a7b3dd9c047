"""Doubts about a drone's own estimate and flow, of a motion whose truth is known."""

from mambo_analysis.importers.checks import motion_doubts
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

T = np.arange(0.0, 20.0, 0.02)
NAMES, RATES = ('x', 'y', 'z'), ('v_x', 'v_y', 'v_z')
POSITION = np.column_stack([np.sin(0.9 * T), np.cos(1.3 * T), 1.0 + 0.3 * np.sin(0.5 * T)])
VELOCITY = np.gradient(POSITION, 0.02, axis=0)
TURNING = 0.2 * np.column_stack([np.sin(3.0 * T), np.cos(4.0 * T), np.sin(T)])
FLOW = VELOCITY[:, :2] / POSITION[:, 2:] + np.column_stack([-TURNING[:, 1], TURNING[:, 0]])
NOISE = 0.02 * np.random.default_rng(0).standard_normal((len(T), 3))


def own(position=POSITION, velocity=VELOCITY):
    return motion_doubts.own_velocity(T, position, velocity + NOISE, NAMES, RATES)


def flow(seen, velocity=VELOCITY[:, :2], height=POSITION[:, 2]):
    return motion_doubts.flow(T, seen + NOISE[:, :2], velocity, height, TURNING, ('n_x', 'n_y'))


def test_nothing_is_said_about_a_sound_estimate():
    assert not own() and not flow(FLOW)
    assert not own(velocity=0.85 * VELOCITY)
    assert not motion_doubts.own_velocity(T[:2], POSITION[:2], VELOCITY[:2], NAMES, RATES)


@pytest.mark.parametrize('velocity, lines', [
    (VELOCITY[:, [1, 0, 2]], ['v_x shows the motion of y ', 'v_y shows the motion of x ']),
    (VELOCITY * [1.0, -1.0, 1.0], ['v_y shows the motion of -y ']),
    (VELOCITY * [1.0, 1.0, 1.4], ['v_z is 1.']),
    (VELOCITY * [0.7, 1.0, 1.0], ['v_x is 0.']),
    (VELOCITY[:, [1, 0, 2]] * [1.0, 1.0, 1.4], ['v_x shows the motion of y ',
                                                'v_y shows the motion of x ']),
    (0.001 * VELOCITY, ['the position moves ']),  # less than the noise
    (1000.0 * VELOCITY, ['the position moves ', 'v_x is ', 'v_y is ', 'v_z is '])])
def test_another_velocity_is_told(velocity, lines):
    found = own(velocity=velocity)
    assert [line[:len(begin)] for line, begin in zip(found, lines, strict=True)] == lines


def test_a_jump_of_the_estimate_is_no_motion():
    position = POSITION.copy()
    position[500:] += [300.0, -500.0, 0.0]
    assert not own(position)
    assert len(own(position, VELOCITY[:, [1, 0, 2]])) == 2


def test_a_small_motion_tells_no_scale():
    small = [1.0, 1.0, 0.1]  # 0.01 m in half a second
    assert not own(POSITION * small, VELOCITY * small * [1.0, 1.0, 1.4])


def test_what_lies_between_is_not_compared():
    t = np.arange(0.0, 60.0, 0.02)
    t = t[t % 2.0 < 0.9]
    fast = 0.3 * np.stack([np.sin((5.0 + k) * t) for k in range(3)], axis=1)
    velocity = 0.3 * np.stack([(5.0 + k) * np.cos((5.0 + k) * t) for k in range(3)], axis=1)
    found = motion_doubts.own_velocity(t, fast, 1.4 * velocity, NAMES, RATES)
    assert [line[:8] for line in found] == ['v_x is 1', 'v_y is 1', 'v_z is 1']


@pytest.mark.parametrize('seen, lines', [
    (FLOW[:, [1, 0]], ['n_x shows the motion along y ', 'n_y shows the motion along x ']),
    (FLOW * [-1.0, 1.0], ['n_x shows the motion along -x '])])
def test_another_flow_is_told(seen, lines):
    found = flow(seen)
    assert [line[:len(begin)] for line, begin in zip(found, lines, strict=True)] == lines


SLOW = 0.02 * VELOCITY[:, :2]  # of a vehicle whose flow is most of all its turning


@pytest.mark.parametrize('velocity, height', [
    (SLOW, POSITION[:, 2]), (VELOCITY[:, :2], 1.65 + 1.35 * np.sin(0.8 * T))],
    ids=['turning', 'height'])
def test_turning_and_height_belong_to_the_flow(velocity, height):
    seen = velocity / height[:, None] + np.column_stack([-TURNING[:, 1], TURNING[:, 0]])
    assert not flow(seen, velocity, height)
    assert len(flow(seen[:, ::-1], velocity, height)) == 2


def test_a_flow_near_the_floor_says_nothing():
    low = np.full(len(T), 0.1)
    assert not motion_doubts.flow(T, -FLOW, VELOCITY[:, :2], low, TURNING, ('n_x', 'n_y'))


@pytest.mark.parametrize(('factor', 'told'), [(1.0, False), (1.15, False), (2.0, True)])
def test_another_scale_is_told_at_constant_speed(factor, told):
    velocity = np.tile([0.3, 0.0, 0.0], (len(T), 1))
    found = own(position=factor * velocity * T[:, None], velocity=velocity)
    assert len(found) == told
    if told:
        ratio = float(found[0].split()[3])
        assert found[0].startswith('the velocity is ') and ratio == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize('rate', [20.0, 10.0, 8.0])
def test_another_velocity_is_told_at_low_rates_too(rate):
    """Steps of 10 Hz are 0.1 s, some a rounding error longer."""
    t = np.arange(0.0, 40.0, 1.0 / rate)
    position = np.column_stack([np.sin(0.9 * t), np.cos(1.3 * t), 1.0 + 0.3 * np.sin(0.5 * t)])
    velocity = np.gradient(position, 1.0 / rate, axis=0)
    line, = motion_doubts.own_velocity(t, position, velocity * [0.7, 1.0, 1.0], NAMES, RATES)
    assert line.startswith('v_x is 0.')
    assert not motion_doubts.own_velocity(t, position, velocity, NAMES, RATES)


@pytest.mark.parametrize('seconds', [3.0, 5.0, 9.0])
@pytest.mark.parametrize('axis', [0, 1, 2])
def test_a_sign_is_told_in_a_short_flight_if_the_motion_shows_it(seconds, axis):
    """Flights of a minidrone last 3.5 to 13 s."""
    rng = np.random.default_rng(axis)
    t = np.arange(0.0, seconds, 0.005)
    slow = gaussian_filter1d(rng.standard_normal((len(t) + 400, 3)), 60.0, axis=0)[200:-200]
    position = 0.3 * np.cumsum(slow / slow.std(axis=0), axis=0) * 0.005
    velocity = np.gradient(position, 0.005, axis=0)
    assert not motion_doubts.own_velocity(t, position, velocity, NAMES, RATES)
    position[:, axis] *= -1.0
    line, = motion_doubts.own_velocity(t, position, velocity, NAMES, RATES)
    assert line.startswith(f'{RATES[axis]} shows the motion of -{NAMES[axis]} ')


def test_a_short_flight_whose_velocity_is_noise_says_nothing():
    """Of 500 flights of 3 s in which position and velocity have nothing to do with each other."""
    t, told = np.arange(0.0, 3.0, 0.05), 0
    rng = np.random.default_rng(5)
    for _ in range(500):
        position, velocity = gaussian_filter1d(
            rng.standard_normal((2, len(t) + 80, 3)), 8.0, axis=1)[:, 40:-40]
        told += any('shows the motion' in line for line in motion_doubts.own_velocity(
            t, position, velocity, NAMES, RATES))
    assert told <= 55  # three axes against three, each beyond 2.5 sigma on either side: 11 %
