"""From a bag to numbers with intervals and a vehicle that flies."""

from dataclasses import replace
import json

from flown import answered, bag, flight, SPIN, steered, STRAIGHT, table_of, TRUE
from mambo_analysis.identify.base import choose
from mambo_analysis.identify.regression import IdentifyError, Value
from mambo_analysis.twin.force import fit_force
from mambo_analysis.twin.identify_flight import (
    _resting, battery_notes, command_notes, drag_parameters, hover_command, known_lag, Lag,
    lag_notes, main, moments_of, reading_notes, vehicle_parameters, voltage_notes)
from mambo_analysis.twin.moments import Moment
from mambo_analysis.twin.recorded import GRAVITY
from mambo_flight.scenario import scenario
from mambo_model.vehicle.parameters import load, preset
import numpy as np
import pytest


@pytest.mark.long
def test_a_flight_becomes_a_vehicle(tmp_path, capsys):
    path = bag(tmp_path, noise=0.05)
    assert main([str(path), '-o', str(tmp_path / 'out'), '--base', 'crazyflie',
                 '--mass', '0.03', '--json', str(tmp_path / 'flight.json')]) == 0
    found = json.loads((tmp_path / 'flight.json').read_text())
    value = found['values']['drag x']
    assert value['low'] < 0.4 < value['high'] and value['high'] - value['low'] < 0.02
    assert found['values']['gyro noise x']['unit'] == 'rad/s'
    vehicle = load(tmp_path / 'out' / 'identify_flight.yaml')
    assert vehicle.mass == 0.03 and vehicle.drag_reading == 'acceleration'
    assert vehicle.drag_coefficient == pytest.approx(0.375, abs=0.01)
    assert vehicle.vertical_drag_coefficient == pytest.approx(0.25, abs=0.02)
    assert vehicle.motor_time_constant == pytest.approx(0.05, abs=0.003)
    assert vehicle.power_b == pytest.approx(1.8, abs=0.02)
    hover = found['values']['hover command']['value']
    assert 4.0 * vehicle.power_a * hover ** vehicle.power_b == pytest.approx(0.03 * GRAVITY)
    out = capsys.readouterr().out
    assert 'per mass; thrust and tilt hold at 3.6' in out
    assert 'note: x, y and z, roll and pitch are of body FLU, the axes of imu/data_raw' in out
    assert 'accelerometer bias z, body FLU [m/s^2]' in found['facts']


def test_the_bias_of_the_gyro_is_that_of_the_recorded_topic():
    """Which is in body FLU, as the recording is read."""
    one = flight(0)
    rates = np.random.default_rng(0).normal([0.01, -0.02, 0.03], 1e-3, one.gyro.shape)
    found = _resting(one._replace(gyro=rates, rest=slice(0, 200)))
    for axis, mean in zip('xyz', rates[:200].mean(axis=0)):
        value = found[f'gyro bias {axis}, body FLU']
        assert value.value == pytest.approx(mean) and value.unit == 'rad/s'


def test_hover_command_at_the_voltage_of_the_flight():
    found = fit_force(flight())
    value = hover_command(found)
    share = (GRAVITY / 4.0 / TRUE.thrust) ** (1.0 / TRUE.exponent)
    truth = TRUE.command * share * TRUE.voltage / found.model.voltage
    assert value.low < truth < value.high and value.half < 0.001 * truth


@pytest.mark.parametrize('arguments, said', [
    (['--mass', 'nan'], 'mass'), (['--mass', '40'], 'mass'), (['--base', 'none'], 'none'),
    (['--namespace', '/other'], 'other')])
def test_wrong_input_is_one_line(tmp_path, capsys, arguments, said):
    path = bag(tmp_path, seconds=6.0)
    try:
        code = main([str(path), *arguments])
    except SystemExit as error:
        code = error.code
    assert code == 2
    error = capsys.readouterr().err.strip()
    assert said in error and '\n' not in error


@pytest.mark.long
def test_a_bag_without_rest_says_so(tmp_path, capsys):
    path = bag(tmp_path, lambda data: data.iloc[250:])
    assert main([str(path)]) == 0
    out = capsys.readouterr().out
    assert 'no second of rest' in out and 'gyro bias' not in out


@pytest.mark.long
def test_what_a_flight_does_not_show_stays_as_in_the_base(tmp_path, capsys):
    """A vehicle that hardly moves shows no drag: the file has none of its own."""
    path = bag(tmp_path, radius=0.02)
    assert main([str(path), '-o', str(tmp_path / 'out'), '--base', 'crazyflie']) == 0
    out = capsys.readouterr().out
    assert 'not shown by this flight: drag x: the velocity along x swings by' in out
    text = (tmp_path / 'out' / 'identify_flight.yaml').read_text()
    assert 'drag_coefficient' not in text and 'power_b' in text
    kept = load(tmp_path / 'out' / 'identify_flight.yaml').drag_coefficient
    assert kept == preset('crazyflie').drag_coefficient


def turned(folder):
    """Return the bag of a flight that its motors turn, and that gusts turn, too."""
    one = steered(0, seconds=24.0, shake=20.0, torque=SPIN._replace(damping=(0.0, 0.0, 0.0)))
    rng = np.random.default_rng(0)
    return table_of(one._replace(gyro=one.gyro + rng.normal(0.0, 0.002, one.gyro.shape),
                                 force=one.force + rng.normal(0.0, 0.05, one.force.shape)),
                    folder, mounting=STRAIGHT)


@pytest.mark.long
def test_a_flight_that_turns_shows_its_inertia(tmp_path, capsys):
    path, flie = turned(tmp_path), preset('crazyflie')
    assert main([str(path), '-o', str(tmp_path / 'out'), '--base', 'crazyflie',
                 '--motor-lag', str(TRUE.lag), '--json', str(tmp_path / 'flight.json')]) == 0
    found = json.loads((tmp_path / 'flight.json').read_text())
    moment = found['values']['inertia x']
    assert moment['unit'] == 'kg m^2'
    assert moment['low'] < flie.arm * flie.mass / SPIN.gain[0] < moment['high']
    assert found['facts']['R^2 of the gyro x'] > 0.7
    vehicle = load(tmp_path / 'out' / 'identify_flight.yaml')
    assert vehicle.inertia[0] == moment['value'] and vehicle.motor_time_constant == TRUE.lag
    out = capsys.readouterr().out
    assert 'inertia is for a motor lag of 0.05 s, as given' in out


@pytest.mark.long
def test_a_flight_that_its_motors_do_not_turn_keeps_the_inertia_of_the_base(tmp_path, capsys):
    path = bag(tmp_path, noise=0.05)
    assert main([str(path), '-o', str(tmp_path / 'out'), '--base', 'crazyflie']) == 0
    out = capsys.readouterr().out
    assert 'not shown by this flight: inertia x: the data do not depend on gain' in out
    assert 'inertia' not in (tmp_path / 'out' / 'identify_flight.yaml').read_text().replace(
        'inertia is for', '')
    assert load(tmp_path / 'out' / 'identify_flight.yaml').inertia == preset('crazyflie').inertia


def test_commands_in_another_unit_than_those_of_the_base_are_told():
    mambo = preset('identified')  # 10 to 500 PWM
    assert command_notes('flight', 270.0, mambo) == []
    assert command_notes('flight', 36000.0, preset('crazyflie')) == []
    for hover in (5.0, 36000.0):
        note, = command_notes('flight', hover, mambo)
        assert note.startswith(f'it hovers at a motor_pwm of {hover:.0f}, and its base takes 10')
    with pytest.raises(IdentifyError, match='flight: it hovers at a motor_pwm of 0.556: a veh'):
        command_notes('flight', 0.556, mambo)


@pytest.mark.parametrize('factor, told', [(0.4, True), (0.7, False), (1.5, False), (10.0, True)])
def test_a_mass_that_the_motors_do_not_lift_is_told(factor, told):
    base = preset('crazyflie')
    heavy = replace(base, mass=factor * base.mass)
    notes = command_notes('flight', 50000.0, heavy)
    assert bool(notes) == told
    assert all(note.endswith('check --mass and --base') for note in notes)


@pytest.mark.parametrize('axis', range(3))
@pytest.mark.parametrize('gain, told', [
    ((0.95, 1.02), False), ((0.85, 0.94), False), ((0.7, 0.84), True), ((1.16, 1.2), True),
    ((0.0, np.inf), False)])
def test_positions_of_another_scale_are_told(axis, gain, told):
    gains = np.ones((3, 2))
    gains[axis] = gain
    notes = reading_notes(flight(0)._replace(gain=gains))
    assert [line for line in notes if 'of the world' in line] == [
        f'{flight(0).name}: along {"xyz"[axis]} of the world the tracked position accelerates '
        f'{gain[0]:.2f} to {gain[1]:.2f} times as much as accelerometer and attitude say: check '
        'the scales of both, as drag and thrust have their error'] * told


@pytest.mark.parametrize('angle, told', [(0.2, False), (0.35, True), (-0.35, True)])
def test_markers_turned_about_the_vertical_are_told(angle, told):
    notes = reading_notes(flight(0)._replace(askew=angle))
    assert [line for line in notes if 'about z' in line] == [
        f'{flight(0).name}: the axes of the tracked body are turned by {np.degrees(angle):.0f} '
        'deg about z against those of the gyro: check how its rigid body was made, as drag and '
        'inertia have its error'] * told


def test_a_thrust_without_the_lag_of_the_base_is_told():
    crazyflie, mambo = preset('crazyflie'), preset('identified')
    assert crazyflie.motor_time_constant > 0.05 and mambo.motor_time_constant == 0.0
    line, = lag_notes('late', 0.0004, crazyflie)
    assert 'late: the thrust follows its command at once, that of the base is 0.0647 s' in line
    assert not lag_notes('right', 0.021, crazyflie) and not lag_notes('model', 0.0, mambo)


def test_commands_that_are_stamped_late_against_the_gyro_are_told():
    one = answered()
    late = one._replace(command=np.roll(one.command, 5, axis=0))
    assert not any('stamps' in line for line in reading_notes(one))
    assert any('the stamps of motor_pwm are about 0.05 s late' in line
               for line in reading_notes(late))


def test_a_battery_that_never_changes_is_told():
    plain = flight(0)
    assert not any('battery' in line for line in reading_notes(plain))
    constant = plain._replace(voltage=np.full_like(plain.voltage, 4.2))
    assert 'the battery shows 4.2 V throughout: it was not measured' in ''.join(
        reading_notes(constant))
    absent = plain._replace(voltage=np.full_like(plain.voltage, np.nan))
    assert not any('battery' in line for line in reading_notes(absent))


def test_a_battery_of_unknown_voltage_is_told_unless_there_was_none():
    found, base = fit_force(flight(), blocks=0), choose('crazyflie', None)
    unknown = found._replace(model=found.model._replace(voltage=float('nan')))
    line, = voltage_notes(unknown, base, 'drag z')
    assert line.startswith('no battery voltage in the recording')
    assert line.endswith('drag z hold only if the battery did not sag; record the voltage, as '
                         'topic battery')
    assert not voltage_notes(found, base, 'drag z')
    assert not voltage_notes(unknown, base._replace(battery=False), 'drag z')


@pytest.mark.parametrize('volts, said', [
    (np.linspace(4.1, 3.4, 100), ''), (np.linspace(3.4, 3.42, 100), ''),
    (np.linspace(1.9, 1.7, 100), 'shows 1.8 V in the mean, less than one lithium cell'),
    (np.linspace(3.4, 3.7, 100), 'rises by 0.24 V in the air: it is that of another flight'),
    (np.full(3, np.nan), ''), (np.array([3.5, 3.4]), '')])
def test_a_battery_that_no_vehicle_flies_with_is_told(volts, said):
    notes = battery_notes('flight', volts)
    assert len(notes) == bool(said) and all(said in line for line in notes)


@pytest.mark.parametrize(('pace', 'told'), [(0.01, False), (0.05, False), (0.5, True)])
def test_a_battery_with_few_readings_is_told(pace, told):
    volts = np.linspace(3.8, 3.6, 200)
    lines = battery_notes('flight', volts, pace)
    assert [f'a new reading every {pace:g} s' in line for line in lines] == [True] * told


@pytest.mark.parametrize(('bias', 'told'), [(0.5, False), (1.99, True), (-1.2, True)])
def test_an_accelerometer_of_another_scale_is_told(bias, told):
    notes = reading_notes(flight(0)._replace(bias=bias))
    assert any(f'is {bias:+.2g} m/s^2 off along z' in line for line in notes) == told


def test_the_lag_of_the_inertia_is_given_or_of_the_base_or_of_the_flight():
    found, flie, mambo = fit_force(flight()), choose('crazyflie', None), choose('identified', None)
    assert known_lag(0.03, flie, found) == Lag(0.03, 'as given', given=True)
    of_base = flie.vehicle.motor_time_constant
    assert known_lag(None, flie, found) == Lag(of_base, 'of the base')
    assert known_lag(None, choose(None, scenario()), found) == Lag(0.0, 'of the base')
    own, one = known_lag(None, mambo, found), found.values['motor lag']
    assert own.shown and own.value == found.model.lag and own.ends == (one.low, one.high)
    unseen = found._replace(hidden=['motor lag: the interval is wider'])
    assert not known_lag(None, mambo, unseen).shown
    assert known_lag(None, flie, unseen).shown and known_lag(0.03, mambo, unseen).shown


def test_a_flight_that_does_not_show_the_lag_has_no_inertia_without_one():
    one = flight()
    found = fit_force(one, blocks=0)._replace(hidden=['motor lag: the interval is wider'])
    lag = known_lag(None, choose('identified', None), found)
    moments, (note,) = moments_of(one, found, preset('identified'), lag)
    assert moments == {} and 'inertia: it holds for a motor lag' in note
    assert 'give --motor-lag' in note


@pytest.mark.parametrize(('lag', 'shown', 'written'), [
    (Lag(0.03, 'as given', given=True), True, 0.03),
    (Lag(0.03, 'as given', given=True), False, 0.03),
    (Lag(0.06, 'of the base'), True, 0.06), (Lag(0.06, 'of the base'), False, None)])
def test_a_vehicle_file_has_the_lag_that_its_inertia_is_for(lag, shown, written):
    """Without inertia it has the lag of the flight, if that shows it (None here)."""
    found, flie = fit_force(flight(), blocks=0), preset('crazyflie')
    moment = Moment(Value(2e-5, 1.8e-5, 2.2e-5, 'kg m^2') if shown else None, 0.8, '')
    out = vehicle_parameters(found, flie, 0.027, 4e4, 'here', {'x': moment}, lag)
    assert ('inertia' in out) == shown
    assert out['motor_time_constant'][0] == (written or found.model.lag)
    assert ('the inertia holds for it' in out['motor_time_constant'][1]) == shown
    hidden = found._replace(hidden=['motor lag: the interval is wider'])
    out = vehicle_parameters(hidden, flie, 0.027, 4e4, 'here', {'x': moment}, lag)
    assert out.get('motor_time_constant', (None,))[0] == written


def test_a_drag_that_is_not_above_zero_is_none_of_the_vehicle():
    found = fit_force(flight())
    given = drag_parameters(found, 'here')
    assert given['drag_coefficient'][0] == pytest.approx(0.375, abs=0.01)
    assert given['vertical_drag_coefficient'][0] == pytest.approx(0.25, abs=0.03)
    unsure = {name: value._replace(low=-1.0) for name, value in found.values.items()}
    assert drag_parameters(found._replace(values=unsure), 'here') == {}
    level = found.values | {'drag z': unsure['drag z']}
    assert drag_parameters(found._replace(values=level), 'here')[
        'vertical_drag_coefficient'] == (0.0, 'not shown by the flight')
