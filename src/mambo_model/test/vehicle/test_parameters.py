"""The vehicles' numbers against those that are published, and the refusals."""

import dataclasses
import math
from pathlib import Path

from mambo_model.schema import build, flatten, ParameterError, walk
from mambo_model.vehicle import parameters
from mambo_model.vehicle.motor_mixer import thrust_from_pwm
from mambo_model.vehicle.vehicle_options import DragParams
import numpy as np
import pytest
from scipy.io import loadmat

BENCH = (Path(__file__).resolve().parents[5] / 'shared' / 'data' / 'rolling_spider_bench'
         / 'thrustdata.mat')
OPTIONS = ('drag', 'rotor', 'ground_effect', 'fade', 'battery')


def test_arm_and_yaw_ratio_are_the_unrounded_mixer_of_the_support_package():
    # six digits are published of each
    assert 1.0 / (4.0 * parameters.Vehicle().arm) == pytest.approx(5.66592, rel=2e-6)
    assert 1.0 / (4.0 * parameters.Vehicle().yaw_ratio) == pytest.approx(103.573624, rel=2e-6)


def test_rotors_are_those_whose_toolbox_gives_the_same_mixer_and_motor_map():
    # toolbox of the Rolling Spider: C_t 0.0107, C_q = C_t sqrt(C_t/2), arm 62.4 mm, 1.184 kg/m^3
    mambo, C_t, command_to_speed = parameters.Vehicle(), 0.0107, 13840.8
    assert math.sqrt(C_t / 2.0) * mambo.rotor.radius == pytest.approx(mambo.yaw_ratio, rel=1e-5)
    assert 0.0624 / math.sqrt(2.0) == pytest.approx(mambo.arm, rel=1e-5)
    # a blade pair of 1.5 g / 4 as a slender rod
    assert 0.0015 / 4.0 * 0.066**2 / 12.0 == pytest.approx(mambo.rotor.inertia, rel=0.002)
    k = C_t * mambo.air_density * math.pi * mambo.rotor.radius**4
    assert 1.0 / (k * command_to_speed) == pytest.approx(mambo.linear_gain, rel=1e-4)
    assert k == pytest.approx(mambo.rotor.speed_coefficient, rel=0.01)  # the bench says 0.5 % more


def test_inertia_grew_from_the_toolbox_to_the_identified_vehicle_as_measured():
    old, new = parameters.preset('toolbox').inertia, parameters.preset('identified').inertia
    growth = [100.0 * (b / a - 1.0) for a, b in zip(old, new)]
    assert growth == pytest.approx([18.4, 8.1, 50.0], abs=0.05)  # printed with one digit


def test_presets_differ_only_where_they_should():
    true = parameters.preset('identified')
    assert true == parameters.Vehicle()
    assert parameters.preset('frictionless') == dataclasses.replace(true, drag_reading='none')
    assert parameters.preset('toolbox') == dataclasses.replace(
        true, mass=0.063, inertia=(0.5829e-4, 0.7169e-4, 1.0e-4), thrust_map='linear',
        drag_reading='none')
    spider = parameters.preset('rolling_spider')
    assert (spider.rotor, spider.drag, spider.arm, spider.pwm_max) == (
        true.rotor, true.drag, true.arm, true.pwm_max)


def test_the_vehicles_of_the_thesis_and_its_relatives_are_known():
    assert tuple(parameters.PRESETS) == (
        'crazyflie', 'frictionless', 'identified', 'identified_markers', 'rolling_spider',
        'toolbox')
    assert len(parameters.PRESETS) == 6 and 'toolbox' in parameters.PRESETS
    assert parameters.PRESETS['toolbox'] is parameters.preset('toolbox')


@pytest.mark.parametrize('name', parameters.PRESETS)
def test_no_vehicle_has_an_option_switched_on(name):
    assert parameters.preset(name).options() is None


def test_motors_answer_at_once_unless_measured():
    lags = {name: v.motor_time_constant for name, v in parameters.PRESETS.items()}
    assert lags.pop('crazyflie') == pytest.approx(1.0 / 15.4666, rel=1e-3)
    assert set(lags.values()) == {0.0}


def test_the_file_of_the_identified_vehicle_tells_every_value_and_its_source():
    content = parameters.vehicle_file.read(
        parameters.FOLDER / 'identified.yaml', parameters.Vehicle)
    assert content.values == flatten(parameters.Vehicle())
    assert content.base is None and not content.markers


def test_markers_add_mass_and_inertia_as_points_do():
    bare, marked = parameters.preset('identified'), parameters.preset('identified_markers')
    content = parameters.vehicle_file.read(
        parameters.FOLDER / 'identified_markers.yaml', parameters.Vehicle)
    masses = np.array([m for m, _ in content.markers])
    places = np.array([r for _, r in content.markers])
    assert len(masses) == 5
    centre = masses @ places / marked.mass
    J = np.diag(bare.inertia)
    J += bare.mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    for m, r in zip(masses, places - centre):
        J += m * (r @ r * np.eye(3) - np.outer(r, r))
    assert marked.mass == pytest.approx(0.068 + 5 * 0.05e-3, rel=1e-15)
    np.testing.assert_allclose(marked.inertia, np.diag(J), rtol=1e-12)
    assert dataclasses.replace(marked, mass=bare.mass, inertia=bare.inertia) == bare
    # no two distances are alike, or a tracker could mix them up: 6 mm apart at least
    pairs = [np.linalg.norm(a - b) for i, a in enumerate(places) for b in places[:i]]
    assert np.diff(sorted(pairs)).min() > 6e-3


@pytest.mark.parametrize(('markers', 'message'), [
    ([(0.002, (0.05, 0.05, 0.0)), (0.002, (-0.05, -0.05, 0.0))], 'product of inertia'),
    ([(0.002, (0.05, 0.0, 0.0))], 'centre of mass by 1.4 mm, more than 1 mm')])
def test_markers_that_the_model_cannot_hold_are_refused(markers, message):
    with pytest.raises(ParameterError, match=message):
        parameters.with_markers(parameters.Vehicle(), markers)


@pytest.mark.skipif(not BENCH.exists(), reason='the bench is not beside the repo (../shared/data)')
def test_rolling_spider_is_that_of_its_bench():
    command, _, hertz, thrust = loadmat(BENCH)['thrust_recdata']['data'][0, 0][:12].T
    spider = parameters.preset('rolling_spider')
    assert command @ thrust / (thrust @ thrust) == pytest.approx(spider.linear_gain, abs=0.05)
    squared = (2.0 * math.pi * hertz) ** 2
    assert squared @ thrust / (squared @ squared) == pytest.approx(
        spider.rotor.speed_coefficient, abs=0.005e-8)
    predicted = [thrust_from_pwm(x, spider.values()) for x in command.tolist()]
    np.testing.assert_allclose(predicted, thrust, atol=0.014)  # N: 0.3 at full command


def test_crazyflie_is_that_of_its_identification():
    # J. Foerster 2015: thrust and speed of a rotor by 16-bit command
    flie = parameters.preset('crazyflie')
    vv, hover = flie.values(), flie.mass * flie.gravity / 4.0
    u = np.linspace(20000.0, 60000.0, 41)
    thrust = 2.130295e-11 * u**2 + 1.032633e-6 * u + 5.484560e-4
    np.testing.assert_allclose([thrust_from_pwm(x, vv) for x in u.tolist()], thrust, rtol=0.032)
    command = np.interp(hover, thrust, u)
    speed = 0.04076521 * command + 380.8359
    assert thrust_from_pwm(float(command), vv) == pytest.approx(hover, rel=0.015)
    assert hover / speed**2 == pytest.approx(flie.rotor.speed_coefficient, rel=0.005)
    assert hover * flie.linear_gain == pytest.approx(command, rel=0.015)


def test_compiled_code_reads_the_same_numbers_under_the_same_names():
    params = parameters.Vehicle(mass=0.07, drag_reading='force', thrust_map='linear')
    vv = params.values()
    leaves = {name for name, _ in walk(parameters.Vehicle) if '.' not in name}
    assert set(vv._fields) == leaves - {'air_density'}
    assert (vv.thrust_map, vv.drag_reading) == (parameters.THRUST_LINEAR, parameters.DRAG_FORCE)
    for name in set(vv._fields) - {'thrust_map', 'drag_reading'}:
        assert getattr(vv, name) == getattr(params, name)


def test_compiled_code_reads_the_options_under_the_same_names():
    params = parameters.Vehicle(air_density=1, drag=DragParams(induced=True, profile='linear'))
    options = params.options()
    assert options._fields == ('air_density', 'rotor', 'drag', 'ground_effect', 'fade', 'battery')
    assert type(options.air_density) is float
    for group in OPTIONS:
        names = tuple(f.name for f in dataclasses.fields(getattr(params, group)))
        assert set(getattr(options, group)._fields) == set(names)
        for name in set(names) - {'profile'}:
            assert getattr(getattr(options, group), name) == getattr(getattr(params, group), name)


@pytest.mark.parametrize('switch', [
    'drag.blade_flapping', 'drag.induced', 'drag.translational', 'drag.parasitic', 'rotor.torques',
    'ground_effect.enabled', 'fade.enabled', 'battery.enabled', 'drag.profile'])
def test_every_switch_turns_the_options_on(switch):
    on = {switch: 'linear' if switch == 'drag.profile' else True, 'motor_time_constant': 0.05}
    assert build(parameters.Vehicle, on).options() is not None
    assert build(parameters.Vehicle, {'motor_time_constant': 0.05}).options() is None


@pytest.mark.parametrize(('values', 'message'), [
    ({'mass': -0.068}, r'mass = -0.068 kg is outside \[0.01, 1\]'),
    ({'mass': 68.0}, r'mass = 68.0 kg is outside \[0.01, 1\]'),
    ({'inertia': [0.69, 0.775, 1.5]}, r'inertia = .* kg m\^2 is outside \[1e-06, 0.01\]'),
    ({'inertia': [7e-5, 7e-5]}, r'inertia = .* must be 3 numbers'),
    ({'gravity': -9.81}, r'gravity = -9.81 m/s\^2 is outside \[9.7, 9.9\]'),
    ({'drag_reading': 'quadratic'}, r"drag_reading = 'quadratic' is not one of none, per"),
    ({'pwm_min': 400.0, 'pwm_max': 300.0}, r'pwm_min = 400 PWM must be below pwm_max'),
    ({'rotor.torques': True}, r'rotor.torques = True needs a motor_time_constant above 0 s'),
    ({'weight': 0.068}, r'weight: unknown parameter; known: air_density, arm, '),
    ({'drag.induced': 1.0}, r'drag.induced = 1.0 must be true or false'),
    ({'fade.loss': 1.0}, r'fade.loss = 1.0 is outside \[0, 0.9\]'),
])
def test_bad_vehicles_are_refused_with_the_reason(values, message):
    with pytest.raises(ParameterError, match=message):
        build(parameters.Vehicle, values)


def test_unknown_preset_names_the_known_ones():
    with pytest.raises(ParameterError, match="'mambo' is unknown; known: crazyflie, frictionless"):
        parameters.preset('mambo')
