"""The command ``mambo bound``: the flights that it selects and what it prints."""

import json

from mambo_flight.accuracy import bound as command
from mambo_flight.accuracy.error_statistics import Measured, QUANTITIES, Row
from mambo_flight.accuracy.filter_error import LATENCIES, SCALES, SLOPES, with_unknowns
from mambo_model.errors import InputError
from mambo_model.schema import flatten
import numpy as np
import pytest


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


def test_command_prints_a_table_or_json(capsys):
    assert command.main(['hover', '--seeds', '1', '--slope', '0.1']) == 0
    text = capsys.readouterr().out
    assert 'bound' in text and 'drift at the end [m]' in text and '1 flights' in text
    assert command.main(['hover', '--seeds', '1', '--beside', 'kalman', '--json']) == 0
    found = json.loads(capsys.readouterr().out)
    assert found['beside']['estimator'] == 'kalman' and 0.0 < found['beside']['drift'] < 3.0
    assert found['flights'] == 1 and len(found['quantities']) == len(QUANTITIES)


@pytest.mark.parametrize(('arguments', 'message'), [
    (['circle', '--seeds', '0'], '--seeds 0: must be 1 or more'),
    (['nonesuch'], 'nonesuch')])
def test_wrong_input_is_one_line(arguments, message, capsys):
    assert command.main(arguments) == 2
    error = capsys.readouterr().err
    assert message in error and error.count('\n') == 1


@pytest.fixture
def no_flight(monkeypatch):
    """Return the flights that a command would fly, each with an error of 2 m."""
    flown = []

    def measured(flight):
        flown.append(flight)
        return Measured(tuple(Row(1.0, 4.0, 2.0, 2) for _ in QUANTITIES), (1.0, 1.0, 1.0))
    monkeypatch.setattr(command, 'evaluate', lambda flight: flight)
    monkeypatch.setattr(command, 'measured', measured)
    return flown


def test_seeds_are_consecutive_from_the_first(no_flight, capsys):
    assert command.main(['circle', '--seeds', '3', '--first', '41']) == 0
    assert [flight.seed for flight in no_flight] == [41, 42, 43]
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == 'circle' and lines[-1].startswith('3 flights; mean NIS: ')


def test_options_choose_what_is_drawn(no_flight, capsys):
    assert command.main(['circle', '--seeds', '1']) == 0
    assert command.main(['circle', '--seeds', '1', '--slope', '0.1']) == 0
    assert command.main(['circle', '--seeds', '1', '--vary']) == 0
    plain, sloped, varied = (one.sim_node.simulator.optical_flow for one in no_flight)
    assert plain == command.flight_of('circle').sim_node.simulator.optical_flow
    assert sloped.factor_slope == 0.1 and sloped.latency == plain.latency
    assert varied.factor_slope not in (plain.factor_slope, 0.1)
    assert varied.latency != plain.latency


def test_the_drift_of_another_estimator_is_a_root_mean_square(no_flight, monkeypatch, capsys):
    squares = iter([9.0, 16.0])
    monkeypatch.setattr(command, 'drift_beside', lambda flight, name: next(squares))
    assert command.main(['circle', '--seeds', '2', '--beside', 'toolbox']) == 0
    assert capsys.readouterr().out.endswith(
        '\ndrift of toolbox on the same samples: 3.536 m\n')


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
