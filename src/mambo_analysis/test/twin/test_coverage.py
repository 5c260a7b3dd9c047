"""Intervals of ``identify flight`` hold in flights of a known vehicle; the command goes on."""

import json
import math

from mambo_analysis.twin import coverage
from mambo_analysis.twin.coverage import main, stored, table, trial, Trial, truth_of
from mambo_analysis.twin.identify_flight import hover_command
from mambo_model.vehicle.parameters import preset
import pytest

FLIE = preset('crazyflie')


@pytest.fixture(scope='module')
def flown():
    return [trial(seed) for seed in (1, 2, 3)]


@pytest.mark.long
def test_intervals_hold_in_simulated_flights(flown):
    """Of 24 intervals of 95 % one may miss; 5 have a chance of 0.6 %."""
    rows = [row for one in flown for row in one.values.values()]
    assert len(rows) >= 24 and all(low < value < high for value, low, high, _ in rows)
    assert sum(low <= true <= high for _, low, high, true in rows) >= len(rows) - 4


@pytest.mark.long
def test_every_kind_of_parameter_is_shown(flown):
    shown = {name for one in flown for name in one.values}
    assert shown >= {'drag x', 'drag y', 'drag z', 'exponent', 'thrust', 'hover command',
                     'inertia x', 'inertia y'}
    assert 'inertia z' not in shown  # nothing turns it about z


@pytest.mark.long
def test_intervals_are_narrow_enough_to_tell_something(flown):
    widest = {'drag x': 0.1, 'drag y': 0.1, 'exponent': 0.1, 'thrust': 0.005,
              'hover command': 0.005, 'inertia x': 0.15, 'inertia y': 0.15}
    for one in flown:
        for name, share in widest.items():
            value, low, high, true = one.values[name]
            assert 0.5 * (high - low) < share * true, name
            assert abs(value - true) < 2.0 * share * true, name


@pytest.mark.long
def test_the_truth_of_the_hover_is_where_the_thrust_is_the_weight(flown):
    true = flown[0].values['hover command'][3]
    assert 4.0 * FLIE.power_a * true ** FLIE.power_b == pytest.approx(
        FLIE.mass * coverage.GRAVITY)


def test_the_true_thrust_belongs_to_the_mean_command():
    class Model:
        command = 30000.0

    class Found:
        model = Model
    truth = truth_of(FLIE, Found)
    assert truth['thrust'] == FLIE.power_a * 30000.0 ** FLIE.power_b / FLIE.mass
    assert (truth['drag x'], truth['drag z']) == coverage.DRAG
    assert truth['inertia y'] == FLIE.inertia[1] and callable(hover_command)


def test_the_table_counts_what_holds():
    trials = [Trial(1, {'a': (1.0, 0.9, 1.1, 1.05), 'b': (2.0, 1.9, 2.1, 3.0)}),
              Trial(2, {'a': (1.0, 0.9, 1.1, 1.2)})]
    head, a, b, every = (line.split() for line in table(trials).splitlines())
    assert head[:3] == ['parameter', 'held', '%']
    assert a == ['a', '1', 'of', '2', '50.0', '-0.125',
                 f'{math.sqrt((0.05 ** 2 + 0.2 ** 2) / 2.0):.3g}', '0.1']
    assert b[:5] == ['b', '0', 'of', '1', '0.0'] and every == ['all', '1', 'of', '3', '33.3']
    assert table([]).split()[0] == 'parameter'


def fake(monkeypatch, seeds):
    def fly(seed, path, seconds):
        seeds.append(seed)
        if seed == 4:
            raise coverage.IdentifyError('nothing shown')
        return Trial(seed, {'a': (1.0, 0.9, 1.1, 1.05)})
    monkeypatch.setattr(coverage, 'trial', fly)


def test_a_command_that_was_ended_goes_on(tmp_path, monkeypatch, capsys):
    file, seeds = tmp_path / 'held.json', []
    fake(monkeypatch, seeds)
    assert main(['--seeds', '2', '-o', str(file)]) == 0
    assert '2 of 2' in capsys.readouterr().out
    assert main(['--seeds', '4', '-o', str(file)]) == 0
    assert seeds == [1, 2, 3, 4]
    out = capsys.readouterr().out
    assert '3 of 3' in out and 'seed 4: nothing shown' in out
    assert [one.seed for one in stored(file, {'trajectory': coverage.PATH, 'seconds': 40.0})] == [
        1, 2, 3]
    assert main(['--seeds', '1', '--first', '2', '-o', str(file)]) == 0
    assert '1 of 1' in capsys.readouterr().out and seeds == [1, 2, 3, 4]


@pytest.mark.parametrize(('words', 'kept'), [
    ([], 'none is kept'), (['-o'], 'and the same command goes on')])
def test_an_interrupt_says_how_many_were_flown(tmp_path, monkeypatch, words, kept):
    fake(monkeypatch, [])
    assert not words or main(['--seeds', '1', '-o', str(tmp_path / 'held.json')]) == 0
    quick = coverage.trial

    def third(seed, *about):
        if seed == 3:
            raise KeyboardInterrupt
        return quick(seed, *about)
    monkeypatch.setattr(coverage, 'trial', third)
    with pytest.raises(KeyboardInterrupt, match=f'2 of 5 flights were done, {kept}'):
        main(['--seeds', '5', *words, *([str(tmp_path / 'held.json')] if words else [])])


@pytest.mark.parametrize('text', [
    '', '[]', '{"flights": {}}', '{"flights": {}, "trials": [{"seed": "x", "values": {}}]}',
    '{"flights": {}, "trials": [{"seed": 1, "values": {"a": [1, 2]}}]}', '\x00'])
def test_a_file_that_is_none_of_its_own_is_kept_and_named(tmp_path, monkeypatch, capsys, text):
    file = tmp_path / 'other.json'
    file.write_text(text)
    fake(monkeypatch, [])
    assert main(['--seeds', '1', '-o', str(file)]) == 2
    error = capsys.readouterr().err.strip()
    assert 'no file of mambo identify coverage' in error and '\n' not in error
    assert file.read_text() == text


def test_a_file_of_other_flights_is_kept(tmp_path, monkeypatch, capsys):
    file = tmp_path / 'held.json'
    fake(monkeypatch, [])
    assert main(['--seeds', '1', '-o', str(file)]) == 0
    kept = json.loads(file.read_text())
    assert main(['--seeds', '1', '--duration', '20', '-o', str(file)]) == 2
    assert 'holds other flights' in capsys.readouterr().err
    assert json.loads(file.read_text()) == kept


@pytest.mark.parametrize('arguments', [
    ['--seeds', '0'], ['--duration', '5'], ['--trajectory', 'spiral'], ['--first', '-1']])
def test_wrong_use_is_one_line(capsys, arguments):
    with pytest.raises(SystemExit) as error:
        main(arguments)
    assert error.value.code == 2 and '\n' not in capsys.readouterr().err.strip()


def test_the_flights_have_the_parameters_that_are_asked_for():
    one = coverage.flight_of(7, 'circle', 25.0)
    simulator = one.sim_node.simulator
    assert (simulator.seed, one.optitrack_node.seed, one.sim_node.duration) == (7, 7, 25.0)
    assert simulator.noise and one.reference_node.plan.trajectory == 'circle'
    vehicle = simulator.vehicle
    assert vehicle.drag_reading == 'acceleration' and vehicle.gravity == coverage.GRAVITY
    assert (vehicle.drag_coefficient, vehicle.vertical_drag_coefficient) == coverage.DRAG
    assert (vehicle.mass, vehicle.inertia) == (FLIE.mass, FLIE.inertia)
    assert vehicle.motor_time_constant == FLIE.motor_time_constant > 0.0
    assert simulator.imu.accel_vibration == coverage.VIBRATION['accel_vibration']
    assert simulator.imu.accel_bias[0] > 0.0  # biases are those of the simulator


@pytest.mark.long
def test_a_flight_too_short_to_show_anything_is_said(monkeypatch, capsys):
    def short(path, namespace=None):
        raise coverage.IdentifyError(f'{path.name}: 3.0 s in the air')
    monkeypatch.setattr(coverage, 'read_flight', short)
    assert main(['--seeds', '1', '--duration', '10']) == 0
    assert 'seed 1: seed_1: 3.0 s in the air' in capsys.readouterr().out


@pytest.mark.long
def test_a_flight_that_stays_on_its_path_is_the_same_every_time(flown):
    again = trial(2)
    assert again == flown[1]
