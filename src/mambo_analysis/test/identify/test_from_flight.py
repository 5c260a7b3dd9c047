"""Drag, motor map and lag of a flight that nobody knows more of than its recording."""

import json
from pathlib import Path

from flown import bag, MAP, TRUE
from mambo_analysis.identify import drag, from_flight, motor, thrust
from mambo_analysis.identify.regression import IdentifyError
from mambo_analysis.importers.any_table import import_table, shipped
from mambo_analysis.twin.recorded import GRAVITY
from mambo_model.vehicle.parameters import load, preset
import pytest

NANOBENCH = Path(__file__).parents[4] / '../shared/data/nanobench'
BAG = Path(__file__).parents[4] / 'bags/circle_short'


def numbers(command, path, folder, *options):
    """Return what a command writes: values, and the vehicle."""
    assert command.main([str(path), '--base', 'crazyflie', '-o', str(folder), *options]) == 0
    name = f'identify_{command.__name__.rpartition(".")[2]}'
    return json.loads((folder / f'{name}.json').read_text())['values'], load(
        folder / f'{name}.yaml')


@pytest.mark.long
def test_a_flight_without_scenario_gives_drag_map_and_lag(tmp_path):
    path, mass = bag(tmp_path, noise=0.05), ['--mass', '0.03']
    found, vehicle = numbers(drag, path, tmp_path / 'drag', *mass)
    assert found['drag x']['low'] < 0.4 < found['drag x']['high']
    assert found['drag y']['low'] < 0.35 < found['drag y']['high']
    assert vehicle.drag_reading == 'acceleration'
    assert vehicle.drag_coefficient == pytest.approx(0.375, abs=0.01)
    found, vehicle = numbers(drag, path, tmp_path / 'up', '--part', 'vertical')
    assert set(found) == {'drag z'} and found['drag z']['low'] < 0.25 < found['drag z']['high']
    assert vehicle.vertical_drag_coefficient == pytest.approx(0.25, abs=0.03)
    assert vehicle.drag_coefficient == pytest.approx(0.375, abs=0.01)  # of the same reading
    found, vehicle = numbers(thrust, path, tmp_path / 'thrust', *mass)
    assert found['b']['low'] < TRUE.exponent < found['b']['high'] and vehicle.mass == 0.03
    assert vehicle.thrust_map == 'power' and vehicle.power_b == found['b']['value']
    found, vehicle = numbers(motor, path, tmp_path / 'motor', *mass)
    assert found['time constant']['low'] < TRUE.lag < found['time constant']['high']
    assert vehicle.motor_time_constant == found['time constant']['value']


@pytest.mark.long
def test_the_mass_scales_the_motor_map_alone(tmp_path):
    path = bag(tmp_path)
    light, heavy = (numbers(thrust, path, tmp_path / mass, '--mass', mass)[1]
                    for mass in ('0.02', '0.04'))
    assert heavy.power_a == pytest.approx(2.0 * light.power_a)
    assert heavy.power_b == light.power_b


@pytest.mark.parametrize('command, arguments, said', [
    (drag, ['--shift', '1'], 'no scenario in the bag, and --shift, --start and --end need one'),
    (drag, ['--mass', '40'], 'mass'), (thrust, ['--namespace', 'x'], 'nothing in the namespace'),
    (motor, ['--base', 'none'], "vehicle 'none' is unknown")])
def test_wrong_use_is_one_line(tmp_path, capsys, command, arguments, said):
    path = bag(tmp_path, seconds=6.0)
    assert command.main([str(path), *arguments]) == 2
    error = capsys.readouterr().err.strip()
    assert said in error and '\n' not in error


@pytest.mark.long
def test_what_the_flight_does_not_show_is_refused_with_the_reason(tmp_path, capsys):
    path = bag(tmp_path, radius=0.02)
    assert drag.main([str(path)]) == 2
    error = capsys.readouterr().err.strip()
    assert 'does not show drag x: the velocity along x swings by' in error


def test_a_known_mass_belongs_to_flights_that_nobody_knows(tmp_path, capsys):
    assert drag.main([str(BAG), '--mass', '0.05']) == 2
    assert '--mass: the scenario of the flight says the mass' in capsys.readouterr().err
    bench = tmp_path / 'bench.csv'
    bench.write_text('pwm,thrust\n1,1\n')
    assert thrust.main([str(bench), '--mass', '0.05']) == 2
    assert 'is a bench, not the bag of a flight' in capsys.readouterr().err


@pytest.mark.long
def test_the_map_of_the_base_can_be_asked_for(tmp_path, capsys):
    path = bag(tmp_path)
    assert motor.main([str(path), '--base', 'crazyflie']) == 0
    assert 'the motor map is that of this flight' in capsys.readouterr().out
    # the table has 100 Hz, the command wants 4 s of it
    assert motor.main([str(path), '--base', 'crazyflie', '--map', 'base']) in (0, 2)
    assert 'that of this flight' not in capsys.readouterr().out
    assert motor.main([str(BAG), '--map', 'base']) == 0


@pytest.mark.long
@pytest.mark.skipif(not NANOBENCH.is_dir(), reason='no recordings beside the checkout')
def test_a_real_flight_imported_through_its_mapping_gives_the_numbers(tmp_path):
    """Drags as published for this drone, 0.38 and 0.40 1/s; a lag near the bench's 0.065 s."""
    path = tmp_path / 'flight'
    import_table(NANOBENCH / 'B8_star_medium_rep1.csv', path, shipped()['nanobench'])
    found, _ = numbers(drag, path, tmp_path / 'drag')
    assert found['drag x']['value'] == pytest.approx(0.38, abs=0.03)
    assert found['drag y']['value'] == pytest.approx(0.40, abs=0.03)
    found, _ = numbers(motor, path, tmp_path / 'motor')
    bench = preset('crazyflie').motor_time_constant
    assert found['time constant']['low'] < bench < found['time constant']['high']
    found, vehicle = numbers(thrust, path, tmp_path / 'thrust')
    assert 1.4 < found['b']['value'] < 2.2 and vehicle.mass == preset('crazyflie').mass


def test_a_value_is_that_of_the_fit_or_the_reason_why_there_is_none(tmp_path):
    flight = from_flight.read(bag(tmp_path), 'crazyflie', 0.03, None)
    assert flight.value('drag x') == flight.found.values['drag x'] and flight.name == 'bag'
    hidden = flight._replace(found=flight.found._replace(
        hidden=['drag x: the velocity along x swings by 0.1 m/s']))
    with pytest.raises(IdentifyError, match='^bag does not show drag x: the velocity'):
        hidden.value('drag x')
    assert hidden.value('drag y') == flight.found.values['drag y']
    with pytest.raises(IdentifyError, match='does not show drag x'):
        from_flight.drag_report(hidden, 'horizontal')
    facts = flight.facts()
    assert facts['mass [kg], not identified'] == 0.03
    assert facts['mean command'] == flight.found.model.command
    assert facts['mean voltage [V]'] == pytest.approx(3.6, abs=0.1)


@pytest.mark.long
def test_a_flight_without_battery_says_so(tmp_path):
    flight = from_flight.read(bag(tmp_path, text=MAP.partition('  battery')[0]), 'crazyflie',
                              None, None)
    assert flight.facts()['mean voltage [V]'] == 'not recorded'
    assert flight.vehicle.mass == preset('crazyflie').mass


def test_a_battery_without_voltage_is_told_beside_what_it_falsifies(tmp_path):
    flight = from_flight.read(bag(tmp_path), 'crazyflie', None, None)
    reports = {'a, b and the hover command': from_flight.thrust_report,
               'lag and exponent': from_flight.motor_report,
               'drag z': lambda one: from_flight.drag_report(one, 'vertical'),
               '': lambda one: from_flight.drag_report(one, 'horizontal')}
    silent = flight.found._replace(model=flight.found.model._replace(voltage=float('nan')))
    unknown = flight._replace(found=silent)
    supplied = unknown._replace(base=unknown.base._replace(battery=False))
    for values, report in reports.items():
        notes = ' '.join(report(unknown).notes)
        assert (f'{values} hold only if the battery did not sag; record the voltage' in notes
                ) == bool(values)
        for one in (flight, supplied):
            assert 'did not sag' not in ' '.join(report(one).notes)


def test_a_drag_that_drives_is_refused(tmp_path):
    flight = from_flight.read(bag(tmp_path), 'crazyflie', None, None)
    turned = {name: value._replace(value=-value.value) for name, value in
              flight.found.values.items()}
    with pytest.raises(IdentifyError, match='drives the vehicle: check axes and signs'):
        from_flight.drag_report(
            flight._replace(found=flight.found._replace(values=turned)), 'horizontal')


def test_the_law_goes_through_the_thrust_at_the_mean_command(tmp_path):
    flight = from_flight.read(bag(tmp_path), 'crazyflie', 0.03, None)
    found, model = from_flight.thrust_report(flight), flight.found.model
    a, b = found.vehicle['power_a'][0], found.vehicle['power_b'][0]
    thrust_there = found.values['thrust at the mean command'].value
    assert a * model.command ** b == pytest.approx(thrust_there)
    hover = found.facts['hover command']
    assert 4.0 * a * hover ** b == pytest.approx(0.03 * GRAVITY)
    assert found.vehicle['linear_gain'][0] == pytest.approx(hover / (0.03 * GRAVITY / 4.0))
