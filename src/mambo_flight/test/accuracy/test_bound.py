"""The command ``mambo bound``: the flights that it selects and what it prints."""

import json

from mambo_flight.accuracy import bound as command
from mambo_flight.accuracy.error_statistics import QUANTITIES
from mambo_flight.accuracy.filter_error import LATENCIES, SCALES, SLOPES, with_unknowns
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
