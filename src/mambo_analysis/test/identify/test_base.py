"""Which vehicle an identified one starts from, and what counts as the scenario of a flight."""

from pathlib import Path

from flown import bag
from mambo_analysis.identify import base, drag, inertia, motor, result, thrust
from mambo_analysis.identify.base import based, choose, flown, of_bag
from mambo_analysis.identify.regression import IdentifyError, Value
from mambo_analysis.importers.common import estimator_parameters
from mambo_analysis.twin import identify_flight
from mambo_bags import reader
from mambo_bags.reader import Bag
from mambo_flight.scenario import override, Scenario, to_yaml as as_yaml
from mambo_model.schema import flatten, ParameterError
from mambo_model.vehicle.parameters import load, preset
import numpy as np
import pytest

PLACE = 'sim_node.simulator.vehicle'


def attached(text):
    out = Bag(Path('a'))
    out.attachments['scenario.yaml'] = text
    return out


def of_vehicle(name, **changes):
    """Return a scenario with a known vehicle, and changes of it."""
    values = flatten(preset(name)) | changes
    return override(Scenario(), {f'{PLACE}.{key}': value for key, value in values.items()})


def test_parameters_of_the_estimator_alone_are_no_flight():
    assert flown(Bag(Path('a'))) is None
    assert flown(attached(estimator_parameters('crazyflie', {})['scenario.yaml'])) is None
    node = '/mambo/sim_node:\n  ros__parameters:\n    duration: 7.0\n'
    assert flown(attached(node)).sim_node.duration == 7.0
    with pytest.raises(ParameterError, match='a: scenario.yaml'):
        flown(attached('- 1\n'))


def test_the_vehicle_of_the_scenario_is_the_base():
    found = choose(None, of_vehicle('crazyflie'))
    assert found.vehicle == preset('crazyflie') and found.name == 'crazyflie' and not found.kept
    assert found.notes == ('the base is the vehicle of the scenario: crazyflie',)
    found = choose(None, of_vehicle('crazyflie', mass=0.031))
    assert found.vehicle.mass == 0.031 and found.name == 'crazyflie'
    assert found.kept == {'mass': (0.031, 'as the scenario of the flight')}
    assert found.notes[0].endswith('crazyflie, with another mass') and found.simulated


@pytest.mark.parametrize('given', [None, 'crazyflie'])
def test_only_a_simulation_without_battery_cannot_sag(given):
    sound = choose(given, of_vehicle('identified'))
    assert not sound.unless_sagged('no voltage', 'a and b', 'record it')
    told = ['no voltage: a and b hold only if the battery did not sag; record it']
    for flight in (of_vehicle('identified', **{'battery.enabled': True}), None):
        assert choose(given, flight).unless_sagged('no voltage', 'a and b', 'record it') == told


def test_a_base_that_contradicts_the_scenario_is_noted():
    found = choose('identified', of_vehicle('crazyflie'))
    assert found.vehicle == preset('identified') and found.name == 'identified'
    assert found.notes[0].startswith(
        '--base: identified is not the vehicle of the scenario: they differ in mass, inertia')
    assert not choose('crazyflie', of_vehicle('crazyflie')).notes


def test_without_a_scenario_the_default_is_named_and_a_given_base_is_not():
    assert choose(None, None).notes == (
        'no --base and no scenario in the bag: all else is as of identified, a Mambo',)
    found = choose('crazyflie', None)
    assert found == (preset('crazyflie'), 'crazyflie', {}, (), False, True, False)


def test_a_report_gets_the_base_and_the_file_what_is_kept_of_it():
    report = result.Report('t', {'k': Value(1.0, 1.0, 1.0, '1')}, {}, ['first'],
                           {'motor_time_constant': (0.05, 'x')}, lambda figure: None)
    found = based(report, choose(None, of_vehicle('crazyflie', mass=0.031)))
    assert found.base == 'crazyflie' and found.notes[0] == 'first' and len(found.notes) == 2
    assert found.vehicle == {'mass': (0.031, 'as the scenario of the flight'),
                             'motor_time_constant': (0.05, 'x')}
    assert not based(report._replace(vehicle={}), choose('crazyflie', None)).vehicle


@pytest.fixture
def attach(monkeypatch):
    """Return what makes every bag that is read hold a text as its scenario."""
    whole = reader.read_bag

    def attach(text):
        def attached_to(*arguments):
            found = whole(*arguments)
            found.attachments['scenario.yaml'] = text
            return found
        for module in (result, motor, base):
            monkeypatch.setattr(module, 'read_bag', attached_to)
    return attach


@pytest.mark.long
def test_commands_take_the_vehicle_of_the_bag(tmp_path, attach, capsys, monkeypatch):
    path = bag(tmp_path, noise=0.05)
    attach(as_yaml(of_vehicle('crazyflie', mass=0.031)))
    assert thrust.main([str(path), '-o', str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert 'no scenario' not in said and 'scenario: crazyflie, with another mass' in said
    vehicle = load(tmp_path / 'identify_thrust.yaml')
    assert vehicle.mass == 0.031 and vehicle.arm == preset('crazyflie').arm
    assert identify_flight.main([str(path), '-o', str(tmp_path)]) == 0
    assert load(tmp_path / 'identify_flight.yaml').mass == 0.031
    assert 'scenario: crazyflie, with another mass' in capsys.readouterr().out
    assert motor.main([str(path), '--map', 'flight', '-o', str(tmp_path)]) == 0
    assert load(tmp_path / 'identify_motor.yaml').mass == 0.031
    assert 'no scenario' not in capsys.readouterr().out
    fitted = []

    def fit(t, pwm, acceleration, vehicle):
        fitted.append(vehicle)
        raise IdentifyError('enough')
    monkeypatch.setattr(motor, 'fit_motor', fit)
    assert motor.main([str(path)]) == 2  # with the map of the base
    assert fitted == [of_vehicle('crazyflie', mass=0.031).sim_node.simulator.vehicle]
    assert thrust.main([str(path), '--base', 'identified']) == 0
    assert '--base: identified is not the vehicle of the scenario' in capsys.readouterr().out
    with pytest.raises(ParameterError, match='unknown'):
        of_bag('nobody', path, None)


def test_a_scenario_that_cannot_be_read_needs_a_base(tmp_path, attach):
    path = bag(tmp_path, seconds=6.0)
    attach('- 1\n')
    with pytest.raises(ParameterError, match='scenario.yaml.*; give --base'):
        of_bag(None, path, None)
    assert of_bag('crazyflie', path, None).notes[0].startswith('not compared with --base: ')


def test_the_other_moments_of_a_pendulum_are_those_of_the_base(tmp_path, attach, monkeypatch):
    path = bag(tmp_path, seconds=6.0)
    attach(as_yaml(of_vehicle('crazyflie')))
    swing = np.arange(4000) * 0.005
    noise = np.random.default_rng(0).normal(0.0, 0.002, 4000)
    swing = swing, 0.1 * np.exp(-0.02 * swing) * np.cos(7.0 * swing) + noise
    monkeypatch.setattr(inertia, '_data', lambda options: swing)
    assert inertia.main([str(path), '--mass', '0.028', '--separation', '0.1', '--length', '0.5',
                         '-o', str(tmp_path)]) == 0
    found = load(tmp_path / 'identify_inertia.yaml')
    assert found.inertia[:2] == preset('crazyflie').inertia[:2] and found.mass == 0.028


@pytest.mark.long
def test_a_bag_with_parameters_of_an_estimator_is_a_flight_that_nobody_knows(
        tmp_path, attach, capsys):
    path = bag(tmp_path, noise=0.05)
    attach(estimator_parameters('crazyflie', {})['scenario.yaml'])
    options = [str(path), '--base', 'crazyflie', '--mass', '0.03']
    assert drag.main(options) == 0
    assert 'no scenario in the bag' in capsys.readouterr().out
    assert motor.main(options) == 0
    assert 'the motor map is that of this flight' in capsys.readouterr().out
