"""The vehicle's numbers against those the thesis states, and its refusals."""

import dataclasses

from mambo_model import vehicle
from mambo_model.schema import build, ParameterError, walk
import pytest


def test_arm_and_yaw_ratio_are_the_unrounded_mixer_of_the_support_package():
    # six digits are published of each
    assert 1.0 / (4.0 * vehicle.Vehicle().arm) == pytest.approx(5.66592, rel=2e-6)
    assert 1.0 / (4.0 * vehicle.Vehicle().yaw_ratio) == pytest.approx(103.573624, rel=2e-6)


def test_inertia_grew_from_the_toolbox_to_the_identified_vehicle_as_measured():
    old, new = vehicle.preset('toolbox').inertia, vehicle.preset('identified').inertia
    growth = [100.0 * (b / a - 1.0) for a, b in zip(old, new)]
    assert growth == pytest.approx([18.4, 8.1, 50.0], abs=0.05)  # printed with one digit


def test_presets_differ_only_where_they_should():
    true = vehicle.preset('identified')
    assert true == vehicle.Vehicle()
    assert vehicle.preset('frictionless') == dataclasses.replace(true, drag_reading='none')
    toolbox = vehicle.preset('toolbox')
    assert (toolbox.mass, toolbox.thrust_map, toolbox.drag_reading) == (0.063, 'linear', 'none')
    assert (toolbox.arm, toolbox.gravity, toolbox.pwm_max) == (
        true.arm, true.gravity, true.pwm_max)


def test_motors_answer_at_once_unless_told_otherwise():
    assert {v.motor_time_constant for v in vehicle.PRESETS.values()} == {0.0}


def test_compiled_code_reads_the_same_numbers_under_the_same_names():
    params = vehicle.Vehicle(mass=0.07, drag_reading='force', thrust_map='linear')
    vv = params.values()
    assert vv._fields == tuple(name for name, _ in walk(vehicle.Vehicle))
    assert (vv.thrust_map, vv.drag_reading) == (vehicle.THRUST_LINEAR, vehicle.DRAG_FORCE)
    for name in set(vv._fields) - {'thrust_map', 'drag_reading'}:
        assert getattr(vv, name) == getattr(params, name)


@pytest.mark.parametrize(('values', 'message'), [
    ({'mass': -0.068}, r'Vehicle.mass = -0.068 kg is outside \[0.01, 1\]'),
    ({'mass': 68.0}, r'Vehicle.mass = 68.0 kg is outside \[0.01, 1\]'),
    ({'inertia': [0.69, 0.775, 1.5]}, r'Vehicle.inertia = .* kg m\^2 is outside \[1e-06, 0.01\]'),
    ({'inertia': [7e-5, 7e-5]}, r'Vehicle.inertia = .* must be 3 numbers'),
    ({'gravity': -9.81}, r'Vehicle.gravity = -9.81 m/s\^2 is outside \[9.7, 9.9\]'),
    ({'drag_reading': 'quadratic'}, r"Vehicle.drag_reading = 'quadratic' is not one of none, per"),
    ({'pwm_min': 400.0, 'pwm_max': 300.0}, r'Vehicle.pwm_min = 400 PWM must be below pwm_max'),
    ({'weight': 0.068}, r'weight: unknown parameter; known: arm, drag_coefficient, '),
])
def test_bad_vehicles_are_refused_with_the_reason(values, message):
    with pytest.raises(ParameterError, match=message):
        build(vehicle.Vehicle, values)


def test_unknown_preset_names_the_known_ones():
    with pytest.raises(ParameterError, match="'mambo' is unknown; known: identified, toolbox, "):
        vehicle.preset('mambo')
