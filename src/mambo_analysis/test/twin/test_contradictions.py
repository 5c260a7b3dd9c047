"""Each contradiction within a flight is told by its own line, and a sound flight by none."""

from pathlib import Path

from mambo_analysis.identify.regression import IdentifyError
from mambo_analysis.twin import contradictions as c
import numpy as np
import pytest

BAG, G, STEP = Path('flown'), 9.81, 0.01


def sensor(n=1000, seed=0):
    """Return three axes of noise, (n, 3)."""
    return np.random.default_rng(seed).normal(0.0, 0.1, (n, 3))


def motion(n=400, seed=0, noise=0.1):
    """Return specific force in the world and accelerations of one motion, (n, 3) m/s^2."""
    rng = np.random.default_rng(seed)
    change = rng.normal(0.0, 1.0, (n, 3))
    return change + [0.0, 0.0, G] + rng.normal(0.0, noise, (n, 3)), change


@pytest.mark.parametrize('axis', range(3))
def test_an_axis_that_repeats_a_number_is_named(axis):
    values = sensor()
    c.refuse_stuck(BAG, 'gyro', 'rad/s', values, STEP)
    values[300:300 + round(c.STUCK / STEP) + 1, axis] = 0.25
    with pytest.raises(IdentifyError, match=(
            f'flown: the gyro repeats 0.25 rad/s along {"xyz"[axis]} for 1.0 s')):
        c.refuse_stuck(BAG, 'gyro', 'rad/s', values, STEP)


def test_a_second_of_one_number_is_within_reach_of_a_coarse_sensor():
    values = sensor()
    values[300:300 + round(c.STUCK / STEP), 1] = 0.25
    c.refuse_stuck(BAG, 'gyro', 'rad/s', values, STEP)


def test_a_sensor_that_is_dead_to_the_end_is_named():
    values = sensor()
    values[200:, 2] = 0.0
    with pytest.raises(IdentifyError, match='repeats 0 m/s.2 along z for 8.0 s'):
        c.refuse_stuck(BAG, 'accelerometer', 'm/s^2', values, STEP)


@pytest.mark.parametrize('axes, wanted', [
    ((0, 4, 5), True), ((0, 1, 3, 4, 5), True),  # moves in a plane, hovers
    ((1,), False), ((0, 4), False), ((0, 1, 2), False), ((3, 4, 5), False),  # dead
    (range(6), False)])  # freezes
def test_axes_of_both_sensors_that_rest_together_show_that_there_is_no_noise(axes, wanted):
    values = np.hstack([sensor(), sensor(seed=1)])
    values[300:302 + round(c.STUCK / STEP), axes] = 0.25
    assert c.silent(values[:, :3], values[:, 3:], STEP) == wanted
    assert not c.silent(values[:50, :3], values[:50, 3:], STEP)


def test_a_motor_that_is_not_in_the_recording_is_named():
    command = 1e4 + 100.0 * np.abs(np.random.default_rng(0).normal(size=(100, 4)))
    c.refuse_still_motor(BAG, command)
    command[:, 2] = 0.0
    with pytest.raises(IdentifyError, match='motor 3 of motor_pwm has the command 0 throughout'):
        c.refuse_still_motor(BAG, command)
    c.refuse_still_motor(BAG, np.full((100, 4), 1e4))  # a hover of a model: all are constant


def test_a_motor_that_has_the_commands_of_another_is_named():
    command = 1e4 + 100.0 * np.random.default_rng(0).normal(size=(100, 4))
    c.refuse_doubled_motor(BAG, command)
    c.refuse_doubled_motor(BAG, command[:, [0, 1, 1, 0]])  # a model that pitches
    c.refuse_doubled_motor(BAG, command[:, [0, 0, 0, 0]])
    with pytest.raises(IdentifyError, match='motors 2 and 4 of motor_pwm have the same commands'):
        c.refuse_doubled_motor(BAG, command[:, [0, 1, 2, 1]])


@pytest.mark.parametrize('upward, hint', [
    (1.0, 'is it in g'), (0.85, 'is it in g'), (G * G, 'imported as g'),
    (-G, 'axes those of FRD'), (G + 2.5, 'check its unit'), (0.0, 'check its unit')])
def test_what_is_not_gravity_has_a_likely_cause(upward, hint):
    with pytest.raises(IdentifyError, match=hint):
        c.refuse_upward(BAG, upward, G)


@pytest.mark.parametrize('bias', [0.0, 0.4, -1.9])
def test_the_bias_of_a_sensor_is_no_contradiction(bias):
    c.refuse_upward(BAG, G + bias, G)


def test_a_mounting_is_no_other_frame():
    c.refuse_steep(BAG, np.array([0.2, -0.2, 0.0]))
    with pytest.raises(IdentifyError, match='turned by 20 deg in roll and pitch'):
        c.refuse_steep(BAG, np.array([np.radians(20.0), 0.0, 0.0]))


def test_one_motion_is_no_contradiction():
    c.refuse_other_motion(BAG, *motion())
    c.refuse_other_motion(BAG, *motion(noise=0.9))  # a rough one


def test_what_hardly_moves_shows_nothing():
    force, change = motion()
    c.refuse_other_motion(BAG, 0.2 * force, -0.2 * change)


@pytest.mark.parametrize('axis', range(3))
@pytest.mark.parametrize('factor, message', [
    (-1.0, 'check axes and signs'), (0.0, 'check axes and signs'), (0.5, 'check the units'),
    (0.01, 'check the units'), (2.0, 'check the units'), (G, 'check the units')])
def test_another_sign_or_unit_of_the_position_is_told(axis, factor, message):
    force, change = motion()
    change[:, axis] *= factor
    with pytest.raises(IdentifyError, match=f'along {"xyz"[axis]} of the world.*{message}'):
        c.refuse_other_motion(BAG, force, change)


@pytest.mark.parametrize('axis', range(3))
@pytest.mark.parametrize('n, noise', [(400, 0.1), (67, 0.2), (32, 0.3)])
@pytest.mark.parametrize('scale', [1.0, 0.8, 0.85, 1.25])
def test_the_scale_of_one_axis_of_the_positions_shows(axis, n, noise, scale):
    """As in the flights of NanoBench: half a minute, and 0.1 to 0.2 of the motion is noise."""
    force, change = motion(n, noise=noise)
    change[:, axis] *= scale
    found = c.gains(force, change)
    wanted = np.ones(3)
    wanted[axis] = scale
    assert ((found[:, 0] < wanted) & (wanted < found[:, 1])).all()
    assert (np.diff(found) < 1.7 * noise).all()
    told = [not (low <= most and high >= least)
            for (low, high), (least, most) in zip(found, c.SCALE)]
    assert not any(np.delete(told, axis))
    if scale == 1.0:
        assert not told[axis]
    elif noise <= 0.1 and not (axis == 2 and scale == 0.85):
        assert told[axis]


def test_without_motion_or_with_another_one_the_scale_does_not_show():
    force, change = motion()
    for other in (0.0 * change, -change):
        assert c.gains(force, other).tolist() == [[0.0, np.inf]] * 3


def test_swapped_axes_are_told():
    force, change = motion()
    with pytest.raises(IdentifyError, match='along x of the world'):
        c.refuse_other_motion(BAG, force[:, [1, 0, 2]], change)


def dragged(matrix, n=800, noise=0.05):
    """Return specific forces of drag, and velocities of a body, (n, 2)."""
    rng = np.random.default_rng(3)
    velocity = rng.normal(0.0, 1.0, (n, 2))
    return -velocity @ np.array(matrix).T + rng.normal(0.0, noise, (n, 2)), velocity


@pytest.mark.parametrize('matrix', [
    [[0.4, 0.0], [0.0, 0.4]], [[0.4, 0.1], [-0.1, 0.4]], [[0.05, 0.08], [0.08, 0.05]],
    [[0.0, 0.0], [0.0, 0.0]]])
def test_drag_along_the_velocity_is_that_of_a_drone(matrix):
    c.refuse_swapped('a, b', *dragged(matrix))


@pytest.mark.parametrize('matrix', [
    [[0.0, 0.4], [-0.4, 0.0]], [[0.0, 0.4], [0.4, 0.0]], [[0.2, 0.3], [-0.3, 0.2]]])
def test_drag_across_the_velocity_is_another_frame(matrix):
    with pytest.raises(IdentifyError, match=r'^a, b: .* drag of 0\.\d+ 1/s across the velocity'):
        c.refuse_swapped('a, b', *dragged(matrix))


def test_one_gust_across_is_no_other_frame():
    """An eighth of the flight may show anything: each is left out once."""
    force, velocity = dragged([[0.4, 0.0], [0.0, 0.4]])
    force[:100] += 8.0 * velocity[:100, ::-1]
    c.refuse_swapped('a', force, velocity)
