"""Motor maps against the published numbers; the mixer against geometry and the printed inverse."""

import math

from mambo_model.vehicle import motor_mixer as motors
from mambo_model.vehicle.parameters import preset, Vehicle
from mambo_model.vehicle.vehicle_options import FadeParams
import numpy as np
import pytest

POWER, LINEAR = preset('identified').values(), preset('toolbox').values()
POSITIONS = {0: (1, -1), 1: (1, 1), 2: (-1, 1), 3: (-1, -1)}  # motor: signs of x and y
CLOCKWISE = (0, 2)  # seen from above; the air turns the body the other way


def hover_pwm(vv):
    return motors.pwm_from_thrust(0.25 * vv.mass * vv.gravity, vv)


def test_hover_pwm_of_both_vehicles():
    assert hover_pwm(POWER) == pytest.approx(276.7, abs=0.05)  # printed with one digit
    assert hover_pwm(LINEAR) == pytest.approx(236.5, abs=0.05)
    assert hover_pwm(preset('toolbox').values()._replace(mass=0.068)) == pytest.approx(
        255.3, abs=0.05)


def test_maps_cross_where_they_should():
    x = (1.0 / (POWER.linear_gain * POWER.power_a)) ** (1.0 / (POWER.power_b - 1.0))
    assert x == pytest.approx(328.3, abs=0.05)
    for vv in (POWER, LINEAR):
        assert motors.thrust_from_pwm(x, vv) == pytest.approx(0.2145, abs=5e-5)
    assert motors.thrust_from_pwm(0.9 * x, POWER) < motors.thrust_from_pwm(0.9 * x, LINEAR)
    assert motors.thrust_from_pwm(1.1 * x, POWER) > motors.thrust_from_pwm(1.1 * x, LINEAR)


def test_total_thrust_at_the_limit():
    assert 4.0 * motors.thrust_from_pwm(500.0, POWER) == pytest.approx(1.592, abs=5e-4)
    assert 4.0 * motors.thrust_from_pwm(500.0, LINEAR) == pytest.approx(1.307, abs=5e-4)


def test_linear_command_that_lifts_the_vehicle_with_the_power_map():
    command = 4.0 * hover_pwm(POWER) / POWER.linear_gain
    assert command == pytest.approx(0.723, abs=5e-4)


@pytest.mark.parametrize('vv', [POWER, LINEAR])
@pytest.mark.parametrize('pwm', [1e-3, 10.0, 276.7, 500.0])
def test_maps_are_inverse_to_each_other(vv, pwm):
    # a power and a root of it, each within a few units in the last place
    assert motors.pwm_from_thrust(motors.thrust_from_pwm(pwm, vv), vv) == pytest.approx(
        pwm, rel=1e-14)


@pytest.mark.parametrize('vv', [POWER, LINEAR])
def test_a_motor_does_not_pull_down(vv):
    for value in (0.0, -0.0, -1e-9, -100.0):
        assert motors.thrust_from_pwm(value, vv) == 0.0
        assert motors.pwm_from_thrust(value, vv) == 0.0


@pytest.mark.parametrize('function', [
    motors.thrust_from_pwm, motors.pwm_from_thrust, motors.limit_pwm])
def test_nan_is_not_hidden(function):
    assert math.isnan(function(math.nan, POWER))
    assert math.isnan(function(math.nan, LINEAR))


def test_pwm_is_cut_to_its_limits():
    assert [motors.limit_pwm(x, POWER) for x in (-5.0, 9.9, 10.0, 276.7, 500.0, 501.0)] == [
        10.0, 10.0, 10.0, 276.7, 500.0, 500.0]


@pytest.mark.parametrize('motor', POSITIONS)
def test_each_motor_turns_the_body_as_its_place_says(motor):
    thrust = tuple(0.2 if i == motor else 0.0 for i in range(4))
    f, tau = motors.mix(thrust, POWER)
    # a force (0, 0, -T) at (x, y, 0), and the reaction of the air on the blades
    place = np.array([*POSITIONS[motor], 0]) * POWER.arm
    expected = np.cross(place, [0.0, 0.0, -0.2])
    expected[2] = (-1.0 if motor in CLOCKWISE else 1.0) * POWER.yaw_ratio * 0.2
    assert f == 0.2
    np.testing.assert_allclose(tau, expected, rtol=1e-15)


@pytest.mark.parametrize(('axis', 'raised'), [(0, {0, 3}), (1, {0, 1}), (2, {1, 3})])
def test_each_torque_raises_the_motors_it_should(axis, raised):
    tau = tuple(1e-3 if i == axis else 0.0 for i in range(3))
    thrust = motors.allocate(0.6, tau, POWER)
    assert {i for i in range(4) if thrust[i] > 0.15} == raised


def mixer(vv):
    """Return (3.2) as a matrix."""
    l, d = vv.arm, vv.yaw_ratio
    return np.array([[1, 1, 1, 1], [l, -l, -l, l], [l, l, -l, -l], [-d, d, -d, d]])


@pytest.mark.parametrize('seed', range(5))
def test_allocation_inverts_the_mixer(seed):
    f, *tau = np.random.default_rng(seed).normal(size=4).tolist()
    # torques in units that make thrusts of size 1; the yaw entries are 1/(4 d) = 104
    tau = (tau[0] * POWER.arm, tau[1] * POWER.arm, tau[2] * POWER.yaw_ratio)
    thrust = motors.allocate(f, tau, POWER)
    np.testing.assert_allclose(
        thrust, np.linalg.solve(mixer(POWER), [f, *tau]), rtol=0.0, atol=1e-12)
    again = motors.mix(thrust, POWER)
    np.testing.assert_allclose([again[0], *again[1]], [f, *tau], rtol=0.0, atol=1e-14)


@pytest.mark.parametrize('seed', range(5))
def test_allocation_is_the_printed_inverse_with_its_columns_and_sign_put_right(seed):
    a, b = 5.66592, 103.573624  # support package, unrounded
    vv = Vehicle(arm=0.25 / a, yaw_ratio=0.25 / b).values()
    printed = np.array([
        [0.25, b, -a, -a], [0.25, -b, -a, a], [0.25, b, a, a], [0.25, -b, a, -a]])
    f, t1, t2, t3 = np.random.default_rng(seed).normal(size=4).tolist()
    np.testing.assert_allclose(
        motors.allocate(f, (t1, t2, t3), vv), -printed @ [-f, t3, t2, t1], rtol=0.0, atol=1e-12)


FADE = FadeParams(enabled=True).values()


def test_thrust_fades_exponentially_above_350_and_comes_back_below():
    lost = 0.0
    for k in range(1, 401):
        lost = motors.faded(lost, 351.0, 0.005, FADE)
        assert lost == pytest.approx(0.07 * (1.0 - math.exp(-0.005 * k / 2.0)), rel=1e-11)
    for command in (350.0, 0.0, -1.0, math.nan):
        assert motors.faded(lost, command, 2.0, FADE) == pytest.approx(lost / math.e, rel=1e-14)


def test_fading_bends_the_map_that_a_thrust_test_finds():
    # commands of 0.1 ... 1.2 N through the linear map, the thrust read when it has faded: known
    # to turn the exponent from 1.47 to 1.44 and the factor from 4.29e-5 to 4.9e-5
    force = np.arange(1, 13) * 0.1
    pwm = 1530.72681 * force / 4.0
    thrust = [
        (1.0 - motors.faded(0.0, x, 60.0, FADE)) * motors.thrust_from_pwm(x, POWER)
        for x in pwm.tolist()]
    b, log_a = np.polyfit(np.log(pwm), np.log(thrust), 1)
    assert b == pytest.approx(1.44, abs=0.005)
    assert math.exp(log_a) == pytest.approx(4.9e-5, rel=0.02)
    low = pwm < 350.0
    b, _ = np.polyfit(np.log(pwm[low]), np.log(np.array(thrust)[low]), 1)
    assert b == pytest.approx(1.47, abs=1e-12)
