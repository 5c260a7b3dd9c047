"""The command fly: which flight is meant, what it says, and what it refuses before it flies."""

import math
import re
import signal
import time
from types import SimpleNamespace

from mambo_flight import fly
from mambo_flight.scenario import scenario
from mambo_model.motion import trajectory
from numba.core import event
import numpy as np
import pytest

SCENARIO = """
title: A short flight
duration: 3
landing: false
seed: 2
"""

METRICS = {'tracking_rms': 0.0123, 'tracking_max': 0.1, 'estimation_rms': 0.2, 'shutdown': False,
           'shutdown_reason': '', 'failsafe': ''}
CRASHED = METRICS | {'shutdown': True, 'shutdown_time': 2.5, 'shutdown_reason': 'crash'}


def recording(seconds, inner=True, phase=trajectory.GROUND):
    """Return what a flight on the floor records; its reference flies 1.5 m high from half on."""
    reference = np.zeros((3, 13))
    reference[1:, 2] = -1.5 * trajectory.in_flight(phase)
    return SimpleNamespace(inner=inner, located=None,
                           t=np.array([0, 500_000_000, 1_000_000_000]) * seconds,
                           truth=np.zeros((3, 13)), reference=reference, pwm=np.zeros((3, 4)),
                           phase=np.array([trajectory.GROUND, phase, phase]))


@pytest.fixture
def flown(monkeypatch):
    """Return the flights that would be flown; nothing is, and no bag is written."""
    flights = []

    def record(flight, inner):
        flights.append(flight)
        return recording(flight.sim_node.duration, inner), ''
    monkeypatch.setattr(fly.supervised, 'fly', record)
    monkeypatch.setattr(fly.monte_carlo, 'measure', lambda flight, recording: METRICS)
    monkeypatch.setattr(fly.recording_to_bag, 'write', lambda path, *_: path.mkdir())
    return flights


@pytest.fixture
def file(tmp_path):
    path = tmp_path / 'short.yaml'
    path.write_text(SCENARIO)
    return str(path)


def test_a_file_is_flown_as_it_says(file, tmp_path, capsys, flown):
    assert fly.main([file, '-o', str(tmp_path / 'bag')]) == 0
    flight, = flown
    assert (flight.sim_node.duration, flight.sim_node.simulator.seed) == (3.0, 2)
    output = capsys.readouterr().out.splitlines()
    assert output[-2].startswith(f'{file}: 3.00 s flown in ') or ': 3.00 s flown in ' in output[-2]
    assert output[-3].endswith('tracking error in flight 0.0123 m RMS, 0.1 m at most; '
                               'estimation error 0.2 m RMS')
    assert output[-2].endswith(' times real time') and output[-1] == f'bag: {tmp_path / "bag"}'


def test_a_flight_that_the_failsafe_ended_has_its_bag_and_has_failed(
        file, tmp_path, monkeypatch, capsys, flown):
    monkeypatch.setattr(fly.monte_carlo, 'measure', lambda flight, recording: CRASHED)
    assert fly.main([file, '-o', str(tmp_path / 'bag')]) == 1
    out, error = capsys.readouterr()
    assert 'estimation error 0.2 m RMS; motors stopped (crash)' in out
    assert error.count('\n') == 1
    assert error.endswith(': motors stopped at 2.500 s: crash\n')
    assert (tmp_path / 'bag').exists()
    carried = ['--set', 'sim_node.simulator.hand.enabled=true', '-o', str(tmp_path / 'carried')]
    assert fly.main([file, *carried]) == 0
    out = capsys.readouterr().out
    assert ': carried by hand; estimation error 0.2 m RMS' in out and 'tracking' not in out


@pytest.mark.parametrize(('phase', 'code', 'reason'), [
    (trajectory.GROUND, 0, ''),
    (trajectory.TRACK, 1, ': the vehicle never took off: on the floor from 1.50 to 3.00 s, up to '
                          '1.50 m below its reference\n')])
def test_a_flight_that_stays_on_the_floor_has_no_errors_and_failed_if_it_was_to_fly(
        file, tmp_path, monkeypatch, capsys, flown, phase, code, reason):
    monkeypatch.setattr(fly.monte_carlo, 'measure', lambda flight, recording: METRICS | {
        'tracking_rms': math.nan, 'estimation_rms': math.nan, 'shutdown': False})
    monkeypatch.setattr(
        fly.supervised, 'fly', lambda flight, inner: (recording(3.0, phase=phase), ''))
    assert fly.main([file, '-o', str(tmp_path / 'bag')]) == code
    out, err = capsys.readouterr()
    assert out.splitlines()[-3].endswith(': no errors in flight, as it never took off')
    assert err.endswith(reason) and bool(err) == bool(reason)
    carried = ['--set', 'sim_node.simulator.hand.enabled=true', '-o', str(tmp_path / 'carried')]
    assert fly.main([file, *carried]) == 0


def test_a_recorded_flight_is_flown_again_with_its_commands(tmp_path, flown, file, monkeypatch,
                                                            capsys):
    bags = []
    monkeypatch.setattr(fly.commanded, 'scenario_of', lambda bag: bags.append(bag) or scenario())
    monkeypatch.setattr(fly.commanded, 'alone', lambda bag: [f'{bag} is of a hall'])
    monkeypatch.setattr(fly.commanded, 'beyond', lambda bag, flight: [f'{bag} ends early'])
    out = ['-o', str(tmp_path / 'bag')]
    assert fly.main(['--again', 'bags/mine', '--set', 'sim_node.duration=7', *out]) == 0
    assert str(bags[0]) == 'bags/mine' and flown[0].sim_node.duration == 7.0
    assert 'bags/mine is of a hall\nbags/mine ends early\n' in capsys.readouterr().out
    for more in ([file], ['--seed', '2']):
        assert fly.main(['--again', 'bags/mine', *more, '-o', str(tmp_path / 'b')]) == 2
        assert 'leave out SCENARIO' in capsys.readouterr().err


def test_what_is_typed_counts_before_the_file(file, tmp_path, flown):
    assert fly.main([file, '--seed', '9', '--controller', 'toolbox',
                     '-o', str(tmp_path / 'bag')]) == 0
    flight, = flown
    assert flight.sim_node.simulator.seed == 9
    assert flight.controller_node.controller == 'toolbox'
    assert flight.sim_node.duration == 3.0


def test_a_trajectory_alone_is_a_flight(tmp_path, capsys, flown):
    assert fly.main(['--trajectory', 'circle', '-o', str(tmp_path / 'bag')]) == 0
    flight, = flown
    assert flight.reference_node.plan.trajectory == 'circle'
    assert capsys.readouterr().out.splitlines()[-2].startswith('circle: ')


def test_nothing_at_all_says_what_to_give(tmp_path, capsys, flown):
    assert fly.main(['-o', str(tmp_path / 'bag')]) == 2
    assert capsys.readouterr().err == (
        'fly: give a SCENARIO or one of --trajectory, --controller, --estimator\n')
    assert not flown


def test_a_flight_of_no_time_is_refused(tmp_path, capsys, flown):
    path = tmp_path / 'none.yaml'
    path.write_text(SCENARIO.replace('duration: 3', 'duration: 0'))
    assert fly.main([str(path), '-o', str(tmp_path / 'bag')]) == 2
    assert 'duration = 0.0 s is outside' in capsys.readouterr().err
    assert not flown


def test_a_name_that_no_bag_can_have_is_refused_before_the_flight(tmp_path, capsys, flown):
    assert fly.main(['--trajectory', 'circle', '-o', f'{tmp_path}/fl\udcfcg']) == 2
    assert capsys.readouterr().err == (f'fly: {tmp_path}/fl\\xfcg cannot be the name of a bag: '
                                       'it is not UTF-8: give another name\n')
    assert not flown


def test_a_fault_of_a_component_of_yours_is_told_after_the_bag(file, tmp_path, capsys, flown,
                                                              monkeypatch):
    monkeypatch.setattr(fly.supervised, 'fly', lambda flight, inner: (
        recording(3.0), 'your controller: division by zero at 1.005 s'))
    assert fly.main([file, '-o', str(tmp_path / 'bag')]) == 1
    error = capsys.readouterr().err
    assert error.endswith('your controller: division by zero at 1.005 s\n')
    assert error.count('\n') == 1 and (tmp_path / 'bag').exists()


def test_a_fault_that_ends_in_a_fall_is_told_with_it(file, tmp_path, capsys, flown, monkeypatch):
    monkeypatch.setattr(fly.supervised, 'fly', lambda flight, inner: (
        recording(3.0), 'your estimator: boom'))
    monkeypatch.setattr(fly.monte_carlo, 'measure', lambda flight, recording: CRASHED | {
        'estimation_rms': math.nan})
    assert fly.main([file, '-o', str(tmp_path / 'bag')]) == 1
    out, error = capsys.readouterr()
    assert error.endswith('your estimator: boom; motors stopped at 2.500 s: crash\n')
    assert 'm at most; no estimation error, as the estimate was not finite' in out


@pytest.mark.parametrize('arguments, message', [
    (['fig_99'], 'fig_99'), (['fig_5_10', '--seed', '-1'], 'seed')])
def test_careless_arguments_get_one_line(tmp_path, capsys, arguments, message):
    with pytest.raises(SystemExit) as end:
        raise SystemExit(fly.main([*arguments, '--out', str(tmp_path / 'bag')]))
    error = capsys.readouterr().err
    assert end.value.code == 2 and error.count('\n') == 1 and message in error
    assert not (tmp_path / 'bag').exists()


@pytest.mark.parametrize('arguments, drones', [
    (['--drones', '3'], '3 drones'), ([], '1 drone')])
def test_a_flight_that_takes_too_much_memory_is_refused_before_it(
        tmp_path, capsys, monkeypatch, arguments, drones):
    flight = ['--trajectory', 'hover', '--duration', '30', '-o', str(tmp_path / 'bag')]
    monkeypatch.setenv('MAMBO_MAX_FLIGHT_MB', '10')
    assert fly.main([*flight, *arguments]) == 2
    assert re.search(rf'hover: \d+ MB of memory for the flight of {drones} over 30 s: .* with '
                     r'./run, .*MAMBO_MAX_FLIGHT_MB \(now 10\)', capsys.readouterr().err)
    assert not (tmp_path / 'bag').exists()


def test_an_existing_bag_is_not_touched(tmp_path, capsys, flown):
    bag = tmp_path / 'bag'
    bag.mkdir()
    (bag / 'metadata.yaml').write_text('precious')
    before = sorted((path.name, path.read_bytes()) for path in bag.iterdir())
    code = fly.main(['fig_5_10', '--out', str(bag)])
    assert code == 2 and 'exists' in capsys.readouterr().err
    assert sorted((path.name, path.read_bytes()) for path in bag.iterdir()) == before


def test_a_flight_with_ill_sensors_is_left_to_the_graph(tmp_path, capsys):
    file = tmp_path / 'ill.yaml'
    file.write_text(SCENARIO + 'parameters:\n  sim_node.simulator.faults.sonar.kind: late\n')
    code = fly.main([str(file), '--out', str(tmp_path / 'bag')])
    error = capsys.readouterr().err
    assert code == 2 and error.count('\n') == 1 and 'faults' in error
    assert not (tmp_path / 'bag').exists()


def test_the_time_of_the_compiler_is_not_that_of_the_flight(file, tmp_path, capsys, flown,
                                                            monkeypatch):
    def compiles(*_, **__):
        with event.trigger_event('numba:compile'):
            time.sleep(1.2)
        return recording(3.0), ''
    monkeypatch.setattr(fly.supervised, 'fly', compiles)
    assert fly.main([file, '-o', str(tmp_path / 'bag')]) == 0
    out, err = capsys.readouterr()
    assert re.search(r'^compiled in 1\.\d s, once for these components and options$', out, re.M)
    assert float(re.search(r'flown in ([\d.]+) s', out)[1]) < 0.6 and err == ''


@pytest.mark.long
def test_so_it_is_for_several_drones(tmp_path, capsys, monkeypatch):
    fly_together, took = fly.supervised.together.fly, []

    def compiles(*arguments, **options):
        with event.trigger_event('numba:compile'):
            time.sleep(1.2)
        began = time.monotonic()
        result = fly_together(*arguments, **options)
        took.append(time.monotonic() - began)
        return result
    monkeypatch.setattr(fly.supervised.together, 'fly', compiles)
    arguments = ['--trajectory', 'hover', '--drones', '2', '--duration', '1', '--no-landing']
    assert fly.main([*arguments, '-o', str(tmp_path / 'bags')]) == 0
    out = capsys.readouterr().out
    assert re.search(r'^compiled in [\d.]+ s, once for these components and options$', out, re.M)
    assert float(re.search(r'flown in ([\d.]+) s', out)[1]) < took[0] + 0.6


def test_an_interruption_says_how_many_bags_of_a_hall_are_written(tmp_path, monkeypatch):
    written = []

    def write(path, *_):
        written.append(path)
        if len(written) == 3:
            raise KeyboardInterrupt(signal.SIGTERM)
    flights = SimpleNamespace(recordings=[recording(1.0)] * 4)
    monkeypatch.setattr(fly.supervised.together, 'fly', lambda *_: flights)
    monkeypatch.setattr(fly.monte_carlo, 'measure', lambda flight, recording: METRICS | {
        'shutdown': False})
    monkeypatch.setattr(fly.recording_to_bag, 'write', write)
    with pytest.raises(KeyboardInterrupt) as end:
        fly.main(['--trajectory', 'hover', '--drones', '4', '-o', str(tmp_path / 'out')])
    assert end.value.args == (
        signal.SIGTERM, f'2 of 4 bags are written to {tmp_path / "out"}')


def test_a_terminal_is_told_once_that_a_flight_waits_for_the_compiler(monkeypatch, capsys):
    monkeypatch.setattr(fly.sys.stderr, 'isatty', lambda: True)
    with event.install_listener('numba:compile', fly._Announced()):
        for _ in range(2):
            with event.trigger_event('numba:compile'):
                pass
    line, = capsys.readouterr().err.splitlines()
    assert line.startswith('compiling, about a minute')


def test_a_landing_that_does_not_end_and_a_fall_after_one_are_told(monkeypatch, tmp_path, capsys):
    made = recording(1.0, phase=trajectory.TRACK)
    made.truth[1:, 2], made.pwm[:] = -1.5, 270.0
    monkeypatch.setattr(fly.supervised, 'fly', lambda *_, **given: (made, ''))
    monkeypatch.setattr(fly.recording_to_bag, 'write', lambda *_: None)
    monkeypatch.setattr(fly.monte_carlo, 'measure', lambda flight, recording: METRICS | {
        'shutdown': False})
    flight = ['--trajectory', 'hover', '--duration', '12', '-o', str(tmp_path / 'bag'),
              '--set', 'reference_node.plan.landing_time=11']
    assert fly.main(flight) == 0
    assert ('hover: the flight was over in the air, 1.50 m high: no landing ended within its '
            'duration\n') in (out := capsys.readouterr().out) and 'pwm_max' not in out
    assert fly.main([*flight, '--set', 'sim_node.simulator.vehicle.pwm_max=265']) == 0
    assert ('hover: 100.0 % of the steps had a motor command above pwm_max of the vehicle: '
            'limited to 265\n') in capsys.readouterr().out
    made.phase[2], made.truth[2, 2], made.pwm[2] = trajectory.LANDED, -0.9, 0.0
    assert fly.main(flight) == 1
    assert 'with the vehicle 0.90 m above the floor: it fell from there' in capsys.readouterr().err
