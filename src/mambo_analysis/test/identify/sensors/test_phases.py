"""At rest and in the air: both from thresholds on what the sensors say."""

from dataclasses import replace

from mambo_analysis.identify.recording import Recording, Stream
from mambo_analysis.identify.sensors.phases import airborne, heights, stretch_at_rest
import numpy as np
import pytest

STEP = 0.005


def inertial(seconds, moving, axis=0, gyro_size=1.0, accel_size=10.0):
    """Return a recording that shakes on one axis while ``moving`` (t) says so."""
    t = np.arange(round(seconds / STEP)) * STEP
    shake = np.where(moving(t), np.sin(2.0 * np.pi * 10.0 * t), 0.0)
    gyro, accel = np.zeros((len(t), 3)), np.zeros((len(t), 3))
    gyro[:, axis], accel[:, axis] = gyro_size * shake, accel_size * shake
    accel[:, 2] -= 9.81
    return Recording('r', Stream(t, gyro), Stream(t, accel))


def test_the_longest_rest_is_taken_and_not_the_first():
    rest = stretch_at_rest(inertial(20.0, lambda t: (t >= 4.0) & (t < 7.0) | (t >= 15.0)))
    assert (rest.start * STEP, rest.stop * STEP) == (7.0, 15.0)


@pytest.mark.parametrize('axis', range(3))
@pytest.mark.parametrize(('gyro', 'accel'), [(0.02, 0.0), (0.0, 0.4)])
def test_either_sensor_on_any_axis_ends_a_rest(axis, gyro, accel):
    # a sine of twice the limit has 1.4 times the limit as its standard deviation
    rest = stretch_at_rest(inertial(10.0, lambda t: t >= 5.0, axis, gyro, accel))
    assert (rest.start, rest.stop * STEP) == (0, 5.0)
    weak = stretch_at_rest(inertial(10.0, lambda t: t >= 5.0, axis, gyro / 2.0, accel / 2.0))
    assert weak.stop * STEP == 10.0


def test_a_constant_bias_is_no_motion():
    still = inertial(4.0, lambda t: t < 0.0)
    biased = Recording('r', Stream(still.gyro.t, still.gyro.values + 0.5),
                       Stream(still.accel.t, still.accel.values - 0.5))
    assert stretch_at_rest(biased) == slice(0, 800)


@pytest.mark.parametrize('force', [0.0, 1.0, 7.7, 11.9, 98.1])
def test_what_shows_no_gravity_is_not_at_rest(force):
    still = inertial(4.0, lambda t: t < 0.0)
    other = Stream(still.accel.t, still.accel.values / 9.81 * force)
    assert stretch_at_rest(Recording('r', still.gyro, other)) is None
    known = Stream(still.accel.t, still.accel.values / 9.81 * 9.29)  # a Rolling Spider's bench
    assert stretch_at_rest(Recording('r', still.gyro, known)) == slice(0, 800)


def test_a_rest_below_two_seconds_is_none():
    assert stretch_at_rest(inertial(10.0, lambda t: t >= 1.5)) is None
    assert stretch_at_rest(inertial(10.0, lambda t: t >= 2.5)) is not None
    assert stretch_at_rest(inertial(10.0, lambda t: t >= 0.0)) is None


def test_what_has_no_inertial_sensor_or_no_length_has_no_rest():
    whole = inertial(4.0, lambda t: t < 0.0)
    assert stretch_at_rest(Recording('r', gyro=whole.gyro)) is None
    assert stretch_at_rest(Recording('r', accel=whole.accel)) is None
    short = Stream(whole.gyro.t[:2], whole.gyro.values[:2])
    assert stretch_at_rest(Recording('r', short, short)) is None
    few = Stream(whole.gyro.t[:50], whole.gyro.values[:50])  # less than half a second
    assert stretch_at_rest(Recording('r', few, few)) is None


def test_a_height_is_that_of_its_neighbours_whatever_one_sample_says():
    t = np.arange(40) * 0.04
    values = 1.0 + 0.1 * t
    values[[7, 20]] = 3.0, np.nan
    at = np.array([7, 20]) * 0.04
    # the median of nine of a ramp is its middle, the stray moves it by a sample at most
    np.testing.assert_allclose(heights(Stream(t, values), at), 1.0 + 0.1 * at, atol=0.1 * 0.041)
    assert np.isnan(heights(Stream(t, np.full(40, np.nan)), at)).all()


def flying(pwm, height):
    t = np.arange(100) * 0.04
    sonar = Stream(t, np.full(100, height))
    return Recording('r', sonar=sonar, pwm=Stream(t, np.tile(pwm, (100, 1))))


@pytest.mark.parametrize(('pwm', 'height', 'flies'), [
    ((250.0, 250.0, 250.0, 250.0), 1.0, True), ((250.0, -250.0, 250.0, -250.0), 1.0, True),
    ((150.0, 240.0, 150.0, 240.0), 1.0, True), ((180.0,) * 4, 1.0, False),
    ((350.0,) * 4, 1.0, False), ((250.0,) * 4, 0.5, False), ((0.0,) * 4, 1.0, False)])
def test_a_vehicle_flies_by_the_mean_of_its_motors_and_the_sonar(pwm, height, flies):
    at = np.array([0.5, 1.0, 2.0])
    assert airborne(flying(pwm, height), at).tolist() == [flies] * 3


def test_without_motors_or_sonar_nothing_flies():
    whole, at = flying((250.0,) * 4, 1.0), np.array([1.0, 2.0])
    assert not airborne(Recording('r', sonar=whole.sonar), at).any()
    assert not airborne(Recording('r', pwm=whole.pwm), at).any()
    empty = Stream(np.array([]), np.zeros((0, 4)))
    assert not airborne(Recording('r', sonar=whole.sonar, pwm=empty), at).any()


@pytest.mark.parametrize('unit', [0.001, 150.0])
def test_commands_in_another_unit_are_judged_by_those_in_flight(unit):
    """Motors idle on the floor, the vehicle rises, flies and lands."""
    t = np.arange(400) * 0.04
    command, height = np.full(400, 250.0), np.full(400, 1.0)
    command[:50], command[50:100], command[350:], height[:100], height[350:] = 0, 60, 100, 0.1, 0.1
    recording = Recording('r', sonar=Stream(t, height), pwm=Stream(
        t, np.tile(unit * command[:, None], 4)))
    assert airborne(recording, t).tolist() == [100 <= k < 350 for k in range(400)]
    on_floor = replace(recording, sonar=Stream(t, 0.0 * t + 0.1))
    assert not airborne(on_floor, t).any()
