"""Flights from a script."""

from pathlib import Path

import mambo
from mambo_flight import closed_loop, fly as command
from mambo_flight.scenario import to_yaml
import numpy as np
import pytest


@pytest.fixture(scope='module')
def flight():
    return mambo.fly(trajectory='hover', duration=2.0, seed=3, landing=False)


def test_a_flight_is_that_of_the_closed_loop(flight):
    again = closed_loop.fly(flight.scenario)
    np.testing.assert_array_equal(flight.recording.truth, again.truth)
    assert flight.scenario.seed == 3 and flight.t[-1] == 2.0


def test_the_table_holds_the_columns_of_the_recording(flight):
    table = flight.to_pandas()
    assert table.index.name == 't' and len(table) == 401
    np.testing.assert_array_equal(table['truth']['z'], flight.recording.truth[:, 2])
    np.testing.assert_array_equal(
        table['estimate'][list('pqr')], flight.recording.estimate[:, 10:])
    np.testing.assert_array_equal(table['pwm']['4'], flight.recording.pwm[:, 3])
    assert table['command']['phase'].max() == 1


def test_metrics_are_those_of_the_arrays(flight):
    r = flight.recording
    wrong = np.linalg.norm(r.estimate[:, :3] - r.truth[:, :3], axis=1)
    assert flight.metrics['estimation_final'] == pytest.approx(wrong[-1], rel=1e-12)
    assert repr(flight).startswith('<Flight hover_kalman: 2 s, tracking RMS 0.')


def test_a_saved_bag_is_that_of_the_command(tmp_path, capsys):
    file = tmp_path / 'flight.yaml'
    flight = mambo.fly('fig_5_11', parameters={'sim_node.duration': 2.0})
    file.write_text(to_yaml(flight.scenario))
    flight.save(tmp_path / 'ours')
    assert command.main([str(file), '--output', str(tmp_path / 'theirs')]) == 0, capsys
    ours, theirs = (next((tmp_path / name).glob('*.mcap')).read_bytes()
                    for name in ('ours', 'theirs'))
    assert ours == theirs


def test_parameters_are_applied_last(flight):
    other = mambo.fly(flight.scenario, parameters={'sim_node.simulator.vehicle.mass': 0.07})
    assert other.scenario.sim_node.simulator.vehicle.mass == 0.07
    assert not np.array_equal(other.recording.truth, flight.recording.truth)


@pytest.mark.parametrize('arguments, what', [
    ({'trajectory': 'circel'}, "'circel'"), ({'scenario': 'fig_9_99'}, 'fig_9_99'),
    ({'duration': -1.0}, 'duration'), ({'duration': float('nan')}, 'duration'),
    ({'parameters': {'sim_node.mass': 1.0}}, 'sim_node.mass'), ({'seed': -1}, 'seed'),
    ({'scenario': mambo.Scenario(), 'seed': 3}, 'seed')])
def test_wrong_input_is_one_line(arguments, what):
    with pytest.raises(mambo.InputError) as error:
        mambo.fly(**arguments)
    assert what in str(error.value) and '\n' not in str(error.value)


def test_a_bag_that_exists_is_not_overwritten(flight, tmp_path):
    flight.save(tmp_path / 'bag')
    with pytest.raises(mambo.InputError, match='exists'):
        flight.save(tmp_path / 'bag')


def test_the_figure_shows_the_flight(flight, tmp_path):
    flight.plot().savefig(tmp_path / 'flight.png')
    assert (tmp_path / 'flight.png').stat().st_size > 20_000


def test_a_controller_that_fails_in_flight_is_told_with_its_line(flight, tmp_path):
    pd = Path(__file__).parents[3] / 'examples/pd_controller.py'
    text = pd.read_text().replace('@jit\n', '').replace(
        'from mambo_model.compiled import jit\n', '')
    end = 'return Memory(memory.steps + 1)'
    assert end in text
    mine = tmp_path / 'mine.py'
    mine.write_text(text.replace(end, (
        f"if memory.steps > 400:\n        raise RuntimeError('lost')\n    {end}")))
    failed = mambo.fly(controller=str(mine), estimator='ground_truth', duration=6.0)
    assert 'mine.py:' in failed.fault and failed.fault.endswith('RuntimeError: lost')
    assert failed.fault in repr(failed) and not flight.fault
