"""The joint filter against the bound, and its honesty: a fast subset of what the command does."""

import json
import math

from mambo_flight.judge import judge as command
from mambo_flight.judge.flights import judge as judged
from mambo_flight.judge.flights import LATENCIES, SCALES, SLOPES, with_unknowns
from mambo_model.schema import flatten
import numpy as np
import pytest

SEEDS = range(101, 107)


@pytest.fixture(scope='module', params=['circle', 'circle_rising', 'vertical_circle_large'])
def report(request):
    flight = command.flight_of(request.param)
    return command.summary([
        command.measured(judged(with_unknowns(flight, seed, True))) for seed in SEEDS])


def line(report, name):
    return next(one for one in report.lines if one.name == name)


def test_errors_are_near_the_bound(report):
    # over six flights a ratio of deviations scatters by a quarter
    assert line(report, 'drift at the end').ratio < 2.0
    assert line(report, 'horizontal velocity').ratio < 1.5
    assert line(report, 'vertical velocity').ratio < 2.0
    assert line(report, 'tilt').ratio < 1.5
    assert line(report, 'drift at the end').reached < 0.16  # a tenth of 1.6 m


@pytest.mark.parametrize('name', [q.name for q in command.QUANTITIES])
def test_no_error_is_larger_than_it_is_stated(report, name):
    one = line(report, name)
    # thirty of these at once, and a slope that is drawn evenly: beyond 95 % by a quarter
    assert one.nees < 1.25 * one.high
    assert 0.0 < one.bound < math.inf


def test_innovations_are_as_large_as_expected(report):
    assert report.nis['flow'] == pytest.approx(1.0, abs=0.1)
    assert report.nis['sonar'] == pytest.approx(1.0, abs=0.1)


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
    assert found['flights'] == 1 and len(found['quantities']) == len(command.QUANTITIES)


@pytest.mark.parametrize(('arguments', 'message'), [
    (['circle', '--seeds', '0'], '--seeds 0: must be 1 or more'),
    (['nonesuch'], 'nonesuch')])
def test_wrong_input_is_one_line(arguments, message, capsys):
    assert command.main(arguments) == 2
    error = capsys.readouterr().err
    assert message in error and error.count('\n') == 1
