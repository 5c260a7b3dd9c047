"""The command sweep: what is refused before a flight, what is kept, and what is printed."""

import contextlib
import math
import re
import signal

from mambo_flight.sweep import command, table
from mambo_flight.sweep.command import main, summary, sweep
from mambo_model.errors import InputError
from mambo_model.schema import ParameterError
import pyarrow.parquet as parquet
import pytest

TEXT = """
title: Two masses
design: grid
vary:
  duration: 2.5
  sim_node.simulator.vehicle.mass: [0.063, 0.068]
"""
ROW = dict.fromkeys(command.SHOWN, 0.5) | {
    'shutdown': False, 'failsafe': '', 'fallen': False, 'strayed': False}


@pytest.fixture
def file(tmp_path):
    path = tmp_path / 'sweep.yaml'
    path.write_text(TEXT)
    return path


@pytest.fixture
def flown(monkeypatch):
    """Return what `run` was asked for: rows are made up, nothing is flown or drawn."""
    asked = []

    def run(flights, journal, ideal, workers, dask):
        asked.append((len(flights.sweep.rows), ideal, workers, dask))
        for number in range(len(flights.sweep.rows)):
            if number not in journal.rows:
                journal.add(number, dict(ROW))
    monkeypatch.setattr(command, 'run', run)
    monkeypatch.setattr(command.plot, 'draw', lambda *_: None, raising=False)
    return asked


def test_a_sweep_is_a_table_and_no_journal_is_left(file, tmp_path, flown):
    data = sweep(file, tmp_path / 'a.parquet', True, 2)
    assert flown == [(2, True, 2, None)]
    assert data['flight'] == [0, 1]
    assert data['sim_node.simulator.vehicle.mass'] == [0.063, 0.068]
    assert parquet.read_table(tmp_path / 'a.parquet').num_rows == 2
    assert not (tmp_path / 'a.parquet.rows').exists()


def test_what_is_finished_is_kept_when_the_rest_fails(file, tmp_path, monkeypatch):
    def failing(flights, journal, *_):
        journal.add(0, dict(ROW))
        raise table.SweepEndedError('a worker died')
    monkeypatch.setattr(command, 'run', failing)
    with pytest.raises(table.SweepEndedError):
        sweep(file, tmp_path / 'a.parquet')
    assert (tmp_path / 'a.parquet.rows').read_bytes().count(b'\n') == 2
    assert not (tmp_path / 'a.parquet').exists()


@pytest.mark.parametrize('error', [KeyboardInterrupt, OSError])
def test_a_sweep_that_ends_while_it_draws_goes_on(file, tmp_path, flown, monkeypatch, error):
    out, ends = tmp_path / 'a.parquet', [error]

    def draw(path, *_):
        if ends:
            raise ends.pop()
        path.write_bytes(b'drawn')
    monkeypatch.setattr(command.plot, 'draw', draw)
    with pytest.raises(error):
        sweep(file, out)
    assert not out.exists() and (tmp_path / 'a.parquet.rows').exists()
    sweep(file, out)
    assert out.exists() and (tmp_path / 'a.png').read_bytes() == b'drawn'
    assert not (tmp_path / 'a.parquet.rows').exists()


def test_a_result_that_is_there_is_not_flown_again(file, tmp_path, flown):
    (tmp_path / 'a.parquet').write_text('precious')
    with pytest.raises(InputError, match=r'a.parquet exists'):
        sweep(file, tmp_path / 'a.parquet')
    assert not flown and (tmp_path / 'a.parquet').read_text() == 'precious'


def courses(tmp_path, rest):
    """Return a sweep file over a fast and a slow course, with more that varies."""
    for name, end in (('fast', 2.8), ('slow', 28.0)):
        (tmp_path / f'{name}.csv').write_text(
            f't,x,y,height\n0,0,0,1.5\n{end / 2},6,0,1.5\n{end},0,0,1.5\n')
    path = tmp_path / 'courses.yaml'
    path.write_text(f'vary:\n  trajectory: [slow.csv, fast.csv]\n{rest}')
    return path


def test_a_course_that_cannot_be_flown_is_told_once_before_the_flights(
        tmp_path, flown, capsys, monkeypatch):
    file = courses(tmp_path, '  seed: {range: [1, 50]}\n')
    checks = []
    describe = command.course_warnings.describe
    monkeypatch.setattr(command.course_warnings, 'describe', lambda *pair: (
        checks.append(pair), describe(*pair))[1])
    with pytest.warns(UserWarning, match='cannot fly') as found:
        sweep(file, tmp_path / 'a.parquet')
    line, = [str(one.message) for one in found]
    assert line.startswith('flight 50: the vehicle cannot fly fast.csv: ')
    assert line.endswith(' slows it') and '\n' not in line
    assert len(checks) == 2  # of 100 flights
    monkeypatch.setitem(ROW, 'fault', '')
    assert main([str(file), '-o', str(tmp_path / 'b.parquet')]) == 0
    assert capsys.readouterr().out.startswith(f'warning: {line}\n')


def test_a_vehicle_that_cannot_fly_a_course_is_found_among_the_first(tmp_path, flown):
    mass = '  sim_node.simulator.vehicle.mass: [0.068]\n  reference_node.vehicle.mass: '
    file = courses(tmp_path, f'{mass}[0.068, 0.17]\n')
    lines = []
    sweep(file, tmp_path / 'a.parquet', warn=lines.append)
    first, second = lines[0].splitlines()
    assert first.startswith('flight 1: the vehicle cannot fly slow.csv: ')
    assert second.startswith('flight 2: the vehicle cannot fly fast.csv: ')


def test_as_many_different_flights_of_a_course_are_checked_as_take_no_time(
        tmp_path, flown, monkeypatch):
    file = courses(tmp_path, '  reference_node.vehicle.mass: {range: [0.06, 0.068, 40]}\n')
    checks = []
    monkeypatch.setattr(command.course_warnings, 'describe', lambda *pair: (
        checks.append(pair), [])[1])
    sweep(file, tmp_path / 'a.parquet', warn=pytest.fail)
    assert len(checks) == 2 * command.MOST_CHECKED == 40


def test_a_flight_that_contradicts_itself_is_refused_before_any_is_flown(file, tmp_path, flown):
    file.write_text(TEXT.replace('duration: 2.5', 'duration: [2.5, 0.0]'))
    with pytest.raises(ParameterError, match='sweep.yaml:5: .*duration = 0.0 s is outside'):
        sweep(file, tmp_path / 'a.parquet')
    assert not flown


@pytest.mark.parametrize(('arguments', 'wanted'), [
    ([], 'give --output RESULT.parquet'),
    (['-o', 'a.parquet', '--workers', '0'],
     '--workers: 0 must be within 1 to 1024; sweep --help says more')])
def test_wrong_options_are_one_line(file, capsys, flown, arguments, wanted):
    with pytest.raises(SystemExit) as end:
        raise SystemExit(main([str(file), *arguments]))
    error = capsys.readouterr().err
    assert end.value.code == 2 and error == f'sweep: {wanted}\n' and not flown


def test_ctrl_c_says_that_the_same_command_goes_on(file, tmp_path, monkeypatch):
    def stopped(*_):
        raise KeyboardInterrupt
    monkeypatch.setattr(command, 'run', stopped)
    with pytest.raises(KeyboardInterrupt) as end:  # of which `mambo` makes a line and exit code
        main([str(file), '-o', str(tmp_path / 'a.parquet')])
    assert end.value.args == (signal.SIGINT, table.KEPT)


def test_a_summary_has_percentiles_of_what_is_finite_and_counts_shutdowns():
    values = [float(k) for k in range(101)] + [math.nan, math.inf]
    data = {name: list(values) for name in command.SHOWN}
    data['pwm_max'] = [math.nan] * 103
    data |= {'flight': list(range(103)), 'shutdown': [True] * 3 + [False] * 100,
             'failsafe': ['crash'] * 5 + [''] * 98, 'fallen': [True] * 2 + [False] * 101,
             'strayed': [True] * 3 + [False] * 100}
    lines = summary(data).splitlines()
    row = next(line for line in lines if line.startswith('tracking_rms'))
    assert row.split()[1:] == ['5', '50', '95', '100', '101', 'of', '103']
    assert lines[0].split()[-2:] == ['of', 'flights']
    assert not any(line.startswith('pwm_max') for line in lines)  # nothing to tell
    assert lines[-5:] == ['1 of 103 flights never took off: no errors',
                          '3 of 103 flights were shut down',
                          '2 of 103 flights ended while the failsafe held or landed them',
                          '2 of 103 flights lay on the floor below their reference, fell '
                          'after their landing, or hit the floor',
                          '3 of 103 flights were more than 5 m beside their reference, or far '
                          'from its height, for 2 s']


def test_a_summary_tells_flights_without_estimate_from_those_that_never_took_off():
    data = {name: [0.5, 0.6, math.nan] for name in command.SHOWN}
    data['estimation_rms'] = [0.1, math.nan, math.nan]
    data |= {'flight': [0, 1, 2], 'shutdown': [False] * 3, 'failsafe': [''] * 3,
             'fallen': [False] * 3, 'strayed': [False] * 3}
    lines = summary(data).splitlines()
    assert '1 of 3 flights never took off: no errors' in lines
    assert '1 of 3 flights have no estimation error: their estimate was not finite' in lines


def test_a_summary_counts_flights_that_repeat_another_one():
    data = {name: [0.5, math.nan, 0.5, float('nan'), 0.5] for name in command.SHOWN}
    data |= {'flight': list(range(5)), 'shutdown': [False] * 5, 'failsafe': [''] * 5,
             'fallen': [False] * 5, 'strayed': [False] * 5, 'seed': [1, 2, 1, 2, 3]}
    assert '2 of 5 flights repeat another one, with all its values' in summary(data).splitlines()
    data['estimation_rms'] = [0.1, math.nan, 0.2, float('nan'), 0.3]  # two never took off
    assert not re.search('repeat|no effect', summary(data | {'seed': [1, 2, 3, 4, 5]}))


def test_a_summary_counts_flights_that_a_varied_value_has_no_effect_on():
    data = {name: [0.5, 0.6, 0.5, math.nan, math.nan] for name in command.SHOWN}
    data |= {'flight': list(range(5)), 'shutdown': [False] * 5, 'failsafe': [''] * 5,
             'fallen': [False] * 5, 'strayed': [False] * 5, 'gust_time': [1.0, 1.0, 2.0, 3.0, 4.0]}
    assert summary(data).splitlines()[-1] == (
        '1 of 5 flights have the numbers of one with other parameters: what varies between these '
        'has no effect')


def test_a_summary_of_carried_vehicles_says_that_values_have_no_effect_and_not_that_none_rose():
    data = {name: [math.nan] * 2 for name in command.SHOWN} | {'estimation_rms': [0.2, 0.2]}
    data |= {'flight': [0, 1], 'shutdown': [False] * 2, 'failsafe': [''] * 2,
             'fallen': [False] * 2, 'strayed': [False] * 2, 'gust_time': [1.0, 2.0]}
    text = summary(data)
    assert '1 of 2 flights have the numbers of one with other parameters' in text
    assert 'took off' not in text


def test_one_flight_of_a_sweep_is_flown_as_it_stands_in_the_table(
        file, tmp_path, monkeypatch, capsys):
    flown = []
    monkeypatch.setattr(command.fly, 'write_flight', lambda *given: flown.append(given))
    assert main([str(file), '--flight', '1', '-o', str(tmp_path / 'bag')]) == 0
    (name, flight, out), = flown
    assert name == 'flight 1' and out == tmp_path / 'bag'
    assert flight.sim_node.simulator.vehicle.mass == 0.068 and flight.sim_node.duration == 2.5
    (tmp_path / 'there').mkdir()
    for words, told in (
            (['--flight', '2'], 'the last flight of'), (['--flight', '-1'], '--flight'),
            (['--flight', '0', '--ideal'], 'leave out --ideal'),
            (['--flight', '0', '--workers', '2'], '--dask and --workers'),
            (['--measure', '--flight', '0'], 'only measures: leave out --flight, --output')):
        with pytest.raises(SystemExit) if '-1' in words else contextlib.nullcontext():
            assert main([str(file), *words, '-o', str(tmp_path / 'other')]) == 2
        assert told in capsys.readouterr().err
    for name in ('there', 'fl\udcfcg'):
        assert main([str(file), '--flight', '0', '-o', str(tmp_path / name)]) == 2
    assert len(flown) == 1


@pytest.mark.long
def test_a_map_lies_beside_the_result_and_is_told(file, tmp_path, flown, monkeypatch, capsys):
    monkeypatch.setitem(ROW, 'fault', '')
    file.write_text(TEXT + '  sim_node.simulator.vehicle.drag_coefficient: [0.2, 0.3]\n')
    assert main([str(file), '-o', str(tmp_path / 'a.parquet')]) == 0
    assert (tmp_path / 'a_map.png').is_file()
    assert f'heat map: {tmp_path / "a_map.png"}; ' in capsys.readouterr().out
