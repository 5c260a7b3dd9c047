"""The experiments that tell mechanisms apart, and what was flown of them."""

import json
import math
from types import SimpleNamespace

from drift_flights import flown
from mambo_flight import scenario_file
from mambo_thesis.drift import experiments, report
from mambo_thesis.drift.mechanisms import flow
from mambo_thesis.drift.paths import EXPERIMENTS, LEVEL, PATHS
import numpy as np
import pytest

@pytest.mark.parametrize('name', EXPERIMENTS)
def test_every_experiment_has_a_scenario_with_all_mechanisms(name):
    speed, size, path = EXPERIMENTS[name]
    for key, truth in experiments.TRUTHS.items():
        flight = scenario_file.load(f'{name}/{key}', {})[1]
        plan, sensor = flight.reference_node.plan, flight.sim_node.simulator.optical_flow
        assert (plan.scale_rate, plan.scale_amplitude) == (speed, size)
        assert flight.sim_node.simulator.hand.enabled == (path == LEVEL)
        assert sensor.leakage == truth.sensor.get('leakage', 0.0)
        assert sensor.nonlinearity == truth.sensor.get('cubic', 0.0)


def test_the_drift_of_a_flight_is_that_of_the_table():
    f = flown('C.4', {'slope': 0.07 / 1.025, 'scale': 1.025}, 0, drag=0.0, noise=0.0)
    assert experiments.drift(f, f.flow, 1.0) == pytest.approx(0.233, abs=0.002)


@pytest.mark.long
@pytest.mark.parametrize('name', EXPERIMENTS)
def test_an_equation_predicts_the_drift_along_the_motion_flown(name):
    for key, found in experiments.experiment(name).items():
        # noise of a turn: 0.015 rad/s at 1.5 m, 32 Hz, 4 turns of at most 12.6 s: 7 mm; 3 sigma
        assert found.measured[0] == pytest.approx(found.predicted, abs=0.022), key


@pytest.mark.slow
@pytest.mark.parametrize('key', experiments.TRUTHS)
@pytest.mark.long
def test_the_flown_experiments_name_what_was_wrong(key):
    found = experiments.identify(key, 'all five, every sample')
    assert found.included > 0.99
    assert experiments.TRUTHS[key].letter in found.model
    assert found.value == pytest.approx(experiments.TRUTHS[key].value, rel=0.01)  # D: 0.5 %


def line(t, x):
    """Return a track that moves along x alone."""
    position = np.column_stack([x, np.zeros(len(t)), np.full(len(t), -1.5)])
    return SimpleNamespace(t=t, position=position)


def test_movement_in_a_turn_is_over_whole_turns():
    t = np.arange(0.0, 20.0, 0.01)
    path = 0.1 * t + np.sin(t)  # 0.1 m/s along, and a turn of 2 pi
    assert experiments.per_turn(line(t, path), path, 1.0) == pytest.approx(0.2 * math.pi, abs=1e-4)
    assert experiments.per_turn(line(t, path), 0.1 * t, 2.0) == pytest.approx(0.1 * math.pi)


def test_an_integral_is_by_trapezoids_from_the_first_instant():
    t = np.array([1.0, 2.0, 4.0])
    np.testing.assert_allclose(experiments.integral(t, np.array([0.0, 2.0, 6.0])), [0.0, 1.0, 9.0])


@pytest.mark.parametrize(('speed', 'size'), [(1.0, 1.0), (2.0, 1.0), (1.0, 0.5)])
def test_a_loop_that_is_flown_exactly_encloses_the_area_of_the_path(speed, size):
    f = flown('C.4', {}, 0, speed, size)
    assert experiments.loop(f, speed, size) == pytest.approx(1.0, abs=0.01)


def test_only_the_flow_of_c2_is_that_of_an_estimator():
    f = flown('C.4', {'scale': 1.06}, 0, noise=0.0)
    assert experiments.flow_of_estimator('a', f.track, f.flow) is f.flow
    unturned = experiments.flow_of_estimator('c2', f.track, f.flow)
    wrong = flow(f.track, f.track.height, {'scale': 1.06, 'frame': 1.0})
    np.testing.assert_allclose(unturned, wrong, atol=1e-9)


def test_the_command_takes_a_folder_and_a_document(tmp_path):
    options = experiments.parser().parse_args(['-o', str(tmp_path), '--write', 'drift.md'])
    assert (options.output, str(options.write)) == (tmp_path, 'drift.md')
    assert str(experiments.parser().parse_args([]).output) == 'drift'


@pytest.fixture
def formulas(monkeypatch):
    """Let flights be made of formulas, on the path of the experiment with the error of the key."""
    calls = []

    def fly(name, seed=1):
        calls.append((name, seed))
        experiment, _, key = name.partition('/')
        speed, size, path = EXPERIMENTS[experiment]
        truth = experiments.TRUTHS[key]
        drag = experiments.table.ROWS[truth.row].drag_rate
        f = flown(path, truth.sensor, seed, speed, size, drag)
        return f._replace(flow=experiments.flow_of_estimator(key, f.track, f.flow))
    monkeypatch.setattr(experiments, 'fly', fly)
    return calls


@pytest.mark.parametrize('name', EXPERIMENTS)
def test_on_perfect_paths_predicted_and_measured_drift_are_those_of_the_table(formulas, name):
    speed, size, _ = EXPERIMENTS[name]
    tilt = size * speed**2 / 9.81  # rad, largest
    for key, found in experiments.experiment(name).items():
        assert found.loop == pytest.approx(1.0, abs=0.02), key
        # the flow equivalent to the velocity of C2 is exact to second order in the tilt
        rest = tilt**2 * abs(found.perfect) if key == 'c2' else 0.0
        assert found.predicted == pytest.approx(found.perfect, abs=0.01 + rest), key
        # noise of a turn: 0.015 rad/s at 1.5 m, 32 Hz, 12.6 s: 13 mm over one turn at least
        assert found.measured == pytest.approx([found.predicted] * 3, abs=0.04), key
        assert found.vehicle == pytest.approx([0.0] * 3, abs=1e-3), key
    assert {seed for _, seed in formulas} == set(experiments.SEEDS)


def test_the_mechanism_is_identified_from_the_flights_of_the_data_set(formulas):
    found = experiments.identify('f', '`drift_w_1`, every sample')
    assert formulas == [('drift_w_1/f', 1)]
    assert (found.truth, found.model, found.data_set) == (
        'f', ('F',), '`drift_w_1`, every sample')
    assert found.value == pytest.approx(0.1, abs=4.0 * found.sigma)


def test_the_command_writes_tables_data_and_a_figure(monkeypatch, tmp_path, capsys):
    drift = report.Flown(0.9, 0.25, 0.2, [0.1, 0.3, 0.26], [0.01, -0.01, 0.03])
    monkeypatch.setattr(experiments.table, 'table', lambda: {
        'A': np.zeros((len(PATHS), 2))})
    monkeypatch.setattr(experiments, 'experiment', lambda name: {'a': drift, 'd2': drift})
    monkeypatch.setattr(experiments, 'identify', lambda key, data_set: report.Identification(
        key, data_set, ('A',), 0.9, 0.95, 0.07, 0.01))
    document = tmp_path / 'drift.md'
    heads = [table.splitlines()[0] for table in (
        report.perfect_table({}), report.sources_table(), report.observed_table({}),
        report.flown_table({}), report.identification_table([], {}))]
    monkeypatch.setattr(experiments.observations, 'observed_by_mechanism', lambda: {
        'A': {o.name: True for o in experiments.observations.OBSERVATIONS}})
    document.write_text('# Title\n\n' + '\n\ntext\n\n'.join(heads) + '\n')
    assert experiments.main(['-o', str(tmp_path / 'out'), '--write', str(document)]) == 0
    assert sorted(path.name for path in (tmp_path / 'out').iterdir()) == [
        'drift.json', 'drift.md', 'drift.png']
    found = json.loads((tmp_path / 'out' / 'drift.json').read_text())
    assert found['flown']['drift_w_1']['a']['perfect'] == 0.25
    assert len(found['identified']) == len(experiments.TRUTHS) * len(experiments.DATA_SETS)
    text = document.read_text()
    assert text.startswith('# Title\n\n') and text.count('\ntext\n') == 4
    assert '| `drift_w_2` | D2 | +0.250 | 0.90 |' in text and '| C2 | all five, every' in text
    assert capsys.readouterr().out.endswith(f'figure: {tmp_path / "out" / "drift.png"}\n')


def test_a_document_without_the_tables_is_one_line_before_anything_is_flown(
        monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(experiments, 'experiment', lambda name: pytest.fail('flown'))
    (tmp_path / 'drift.md').write_text('nothing here\n')
    assert experiments.main(
        ['-o', str(tmp_path / 'out'), '--write', str(tmp_path / 'drift.md')]) == 2
    error = capsys.readouterr().err
    assert 'drift.md: no table begins with' in error and error.count('\n') == 1


def test_a_document_that_is_no_file_is_noticed_before_anything_is_flown(monkeypatch, capsys):
    monkeypatch.setattr(experiments, 'experiment', lambda name: pytest.fail('flown'))
    assert experiments.main(['--write', '/dev/null']) == 2
    assert '/dev/null: not a regular file' in capsys.readouterr().err
