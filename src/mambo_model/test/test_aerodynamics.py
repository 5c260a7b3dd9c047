"""The readings of the drag law against their published time constants and terminal speeds."""

import math

from mambo_model.aerodynamics import lumped_drag
from mambo_model.vehicle.parameters import DRAG_READINGS, Vehicle
import numpy as np
import pytest

# 1/s at hover, m/s at a tilt of 20 degrees in level flight
PUBLISHED = {
    'none': (0.0, math.inf), 'per_rotor_thrust': (0.540, 6.6), 'total_thrust': (2.158, 1.65),
    'force': (3.235, 1.1), 'acceleration': (0.220, 16.0)}


def values(reading):
    return Vehicle(drag_reading=reading).values()


@pytest.mark.parametrize('reading', DRAG_READINGS)
def test_deceleration_at_hover(reading):
    vv = values(reading)
    F_D = lumped_drag((1.0, 0.0, 0.0), vv.mass * vv.gravity, vv)
    assert -F_D[0] / vv.mass == pytest.approx(PUBLISHED[reading][0], abs=5e-4)


@pytest.mark.parametrize('reading', DRAG_READINGS[1:])
def test_terminal_speed_of_a_tilt_of_20_degrees(reading):
    vv, tilt = values(reading), math.radians(20.0)
    weight = vv.mass * vv.gravity  # the published speeds take the thrust of hover
    per_speed = -lumped_drag((1.0, 0.0, 0.0), weight, vv)[0]
    # along body x: weight sin(tilt) = drag on the component speed cos(tilt)
    speed = weight * math.tan(tilt) / per_speed
    assert speed == pytest.approx(PUBLISHED[reading][1], rel=0.02)  # printed with 2 digits


@pytest.mark.parametrize('reading', DRAG_READINGS)
def test_drag_opposes_the_horizontal_body_velocity_only(reading):
    vv = values(reading)
    F_D = lumped_drag((0.5, -2.0, 3.0), 0.7, vv)
    assert F_D[2] == 0.0
    np.testing.assert_allclose(F_D[1], -4.0 * F_D[0], rtol=1e-15)
    assert F_D[0] <= 0.0 <= F_D[1]
    assert (F_D[0] < 0.0) == (reading != 'none')


def test_only_two_readings_scale_with_thrust():
    nu = (1.0, 1.0, 1.0)
    ratio = {
        reading: lumped_drag(nu, 1.4, vv)[0] / lumped_drag(nu, 0.7, vv)[0]
        for reading, vv in ((name, values(name)) for name in DRAG_READINGS[1:])}
    assert ratio == {
        'per_rotor_thrust': 2.0, 'total_thrust': 2.0, 'force': 1.0, 'acceleration': 1.0}


def test_thrust_of_one_rotor_equals_a_quarter_of_the_coefficient_with_total_thrust():
    quarter = Vehicle(drag_reading='total_thrust', drag_coefficient=0.055).values()
    one = values('per_rotor_thrust')
    assert lumped_drag((0.3, -0.8, 0.1), 0.7, one) == pytest.approx(
        lumped_drag((0.3, -0.8, 0.1), 0.7, quarter), rel=1e-15)


@pytest.mark.parametrize('reading', DRAG_READINGS)
def test_vertical_drag_opposes_climb_and_descent_and_leaves_the_rest_to_the_bit(reading):
    nu, f, vv = (0.5, -2.0, 3.0), 0.7, values(reading)
    with_k_z = Vehicle(drag_reading=reading, vertical_drag_coefficient=0.11).values()
    F_D = lumped_drag(nu, f, with_k_z)
    assert F_D[:2] == lumped_drag(nu, f, vv)[:2]
    # half of k_c = 0.22: half the force at the same speed
    assert F_D[2] == pytest.approx(0.5 * lumped_drag((3.0, 0.0, 0.0), f, vv)[0], rel=1e-15)
    assert lumped_drag((0.0, 0.0, -3.0), f, with_k_z)[2] == -F_D[2]
