"""The command ``mambo bound``: the flights that it selects and what it prints."""

import json
from pathlib import Path
import signal
import sys
from types import SimpleNamespace

from mambo_flight.accuracy import bound as command, from_bag
from mambo_flight.accuracy.error_statistics import Measured, MOTION, QUANTITIES, Row
from mambo_flight.accuracy.filter_error import LATENCIES, SCALES, SLOPES, with_unknowns
from mambo_model.errors import InputError
from mambo_model.schema import flatten
import numpy as np
import pytest

BAG = str(Path(__file__).parents[4] / 'bags/circle_short')


def test_unknowns_stay_in_their_ranges_and_are_those_of_the_seed():
    flight = command.flight_of('circle')
    seen, offsets = set(), []
    for seed in range(20):
        sim = with_unknowns(flight, seed, True).sim_node.simulator
        flow, believed = sim.optical_flow, flight.estimator_node.joint.optical_flow
        share = (flow.factor_offset + 1.5 * flow.factor_slope) / believed.scale
        assert SLOPES[0] <= flow.factor_slope <= SLOPES[1]
        assert SCALES[0] <= share <= SCALES[1] and LATENCIES[0] <= flow.latency <= LATENCIES[1]
        assert sim.seed == seed
        seen.add(flow.factor_slope)
        offsets.append(sim.sonar.offset)
    assert len(seen) == 20
    spread = flight.estimator_node.joint.sonar.offset_std
    assert 0.5 * spread < np.std(offsets) < 1.5 * spread
    assert flatten(with_unknowns(flight, 3, True)) == flatten(with_unknowns(flight, 3, True))
    plain = with_unknowns(flight, 3, False).sim_node.simulator.optical_flow
    assert plain == flight.sim_node.simulator.optical_flow
    assert with_unknowns(flight, 3, False, -0.07).sim_node.simulator.optical_flow.factor_slope == (
        -0.07)


@pytest.mark.long
def test_command_prints_a_table_or_json(capsys):
    assert command.main(['hover', '--seeds', '1', '--slope', '0.1']) == 0
    text = capsys.readouterr().out
    assert 'bound' in text and 'drift at the end [m]' in text and '1 flights' in text
    assert command.main(['hover', '--seeds', '1', '--beside', 'kalman', '--json']) == 0
    found = json.loads(capsys.readouterr().out)
    beside = found['beside']
    assert beside['estimator'] == 'kalman' and len(beside['quantities']) == MOTION
    assert 0.0 < beside['quantities'][0]['reached'] < 3.0
    assert found['flights'] == 1 and len(found['quantities']) == len(QUANTITIES)


@pytest.mark.parametrize(('arguments', 'message'), [
    (['circle', '--seeds', '0'], '--seeds: 0 must be within 1 to 10000'),
    (['circle', '--seeds', '10001'], '--seeds: 10001 must be within 1 to 10000'),
    (['circle', '--first', '-1'], '--first: -1 must be within 0 to 2147483647'),
    (['circle', '--seeds', '2', '--first', '2147483647'], '--first 2147483647: every seed'),
    (['circle', '--slope', '1e308'], '--slope: 1e308 must be within -100 to 100 1/m'),
    (['circle', '--slope', '99'], 'slope 99 1/m: '),
    (['nonesuch'], 'nonesuch'),
    ([BAG, '--vary'], f'{BAG}: a bag has been flown: leave out --vary'),
    ([BAG, '--seeds', '20', '--slope', '0'], f'{BAG}: a bag has been flown: leave out --seeds, -'),
    ([BAG, '--first', '0'], f'{BAG}: a bag has been flown: leave out --first'),
    pytest.param([BAG], f'{BAG}: the flight must last more than 10 s after take-off',
                 marks=pytest.mark.long)])
def test_wrong_input_is_one_line(arguments, message, capsys):
    with pytest.raises(SystemExit) as end:
        raise SystemExit(command.main(arguments))
    error = capsys.readouterr().err
    assert end.value.code == 2 and message in error and error.count('\n') == 1


@pytest.fixture
def no_flight(monkeypatch):
    """Return the flights that a command would fly, each with an error of 2 m."""
    flown = []

    def evaluated(flight, samples):
        flown.append(flight)
        return SimpleNamespace(start=0)

    def measured(error):
        return Measured(tuple(Row(1.0, 4.0, 2.0, 2) for _ in QUANTITIES), (1.0, 1.0, 1.0))
    seen = {**dict.fromkeys(from_bag.Samples._fields, np.zeros((3000, 3))), 't': np.arange(3000)}
    monkeypatch.setattr(command.closed_loop, 'fly', lambda flight: SimpleNamespace(**seen))
    monkeypatch.setattr(command, 'evaluate_recording', evaluated)
    monkeypatch.setattr(command, 'measured', measured)
    return flown


def test_seeds_are_consecutive_from_the_first(no_flight, capsys):
    assert command.main(['circle', '--seeds', '3', '--first', '41']) == 0
    assert [flight.seed for flight in no_flight] == [41, 42, 43]
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == 'circle' and lines[-1].startswith('3 flights; mean NIS: ')


def test_an_interrupt_says_how_many_were_flown(no_flight, monkeypatch):
    fly, flown = command.closed_loop.fly, []

    def third(flight):
        flown.append(flight)
        if len(flown) == 3:
            raise KeyboardInterrupt(signal.SIGTERM)
        return fly(flight)
    monkeypatch.setattr(command.closed_loop, 'fly', third)
    with pytest.raises(KeyboardInterrupt) as end:
        command.main(['circle', '--seeds', '4'])
    assert end.value.args == (signal.SIGTERM, '2 of 4 flights were done, none is kept')


def test_options_choose_what_is_drawn(no_flight, capsys):
    assert command.main(['circle', '--seeds', '1']) == 0
    assert command.main(['circle', '--seeds', '1', '--slope', '0.1']) == 0
    assert command.main(['circle', '--seeds', '1', '--vary']) == 0
    plain, sloped, varied = (one.sim_node.simulator.optical_flow for one in no_flight)
    assert plain == command.flight_of('circle').sim_node.simulator.optical_flow
    assert sloped.factor_slope == 0.1 and sloped.latency == plain.latency
    assert varied.factor_slope not in (plain.factor_slope, 0.1)
    assert varied.latency != plain.latency


def test_another_estimator_is_compared_on_the_same_flights(no_flight, monkeypatch, capsys):
    squares = iter([9.0, 16.0])

    def beside(flight, samples, start, own, name):
        assert (flight, start, name) == (no_flight[-1], 0, 'toolbox')
        one = next(squares)
        return Measured(tuple(Row(1.0, one, np.nan, 2) for _ in range(MOTION)), (np.nan,) * 3)
    monkeypatch.setattr(command, 'measured_beside', beside)
    assert command.main(['circle', '--seeds', '2', '--beside', 'toolbox']) == 0
    lines = capsys.readouterr().out.splitlines()
    at = lines.index('toolbox on the same samples')
    assert lines[at + 1].split()[-2:] == ['3.536', '3.54'] and len(lines) == at + 1 + MOTION


def test_without_the_bindings_nothing_is_flown(no_flight, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, 'cffirmware', None)
    assert command.main(['circle', '--beside', 'crazyflie']) == 2
    assert 'bound: no module cffirmware' in capsys.readouterr().err and not no_flight


def test_json_goes_to_a_file_beside_the_table(no_flight, tmp_path, capsys):
    path = tmp_path / 'bound.json'
    assert command.main(['circle', '--seeds', '2', '--json', str(path)]) == 0
    found = json.loads(path.read_text())
    assert found['flights'] == 2 and found['nis'] == {'sonar': 1, 'flow': 1, 'barometer': 1}
    assert [one['name'] for one in found['quantities']] == [q.name for q in QUANTITIES]
    assert 'drift at the end [m]' in capsys.readouterr().out


def test_a_trajectory_is_flown_without_landing_on_the_joint_filter():
    flight = command.flight_of('z_sine')
    assert flight.estimator_node.estimator == 'joint'
    assert flight.sim_node.duration == command.DURATION
    assert flight.reference_node.plan.landing_time == 0.0


def test_a_scenario_keeps_its_flight_and_changes_the_estimator(tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text('title: mine\nduration: 30\nestimator: kalman\nseed: 5\n')
    flight = command.flight_of(str(path))
    assert (flight.sim_node.duration, flight.seed) == (30.0, 5)
    assert flight.estimator_node.estimator == 'joint'


def test_a_flight_that_is_too_short_to_settle_is_refused(tmp_path):
    path = tmp_path / 'short.yaml'
    path.write_text('title: short\nduration: 20\n')
    message = r'short\.yaml: sim_node\.duration must be more than 20 s$'
    with pytest.raises(InputError, match=message):
        command.flight_of(str(path))
