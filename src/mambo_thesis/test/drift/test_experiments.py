"""The experiments that tell mechanisms apart, and what was flown of them."""

import math
from types import SimpleNamespace

from drift_flights import flown
from mambo_flight import scenario_file
from mambo_thesis.drift import experiments
from mambo_thesis.drift.mechanisms import flow
from mambo_thesis.drift.paths import EXPERIMENTS, LEVEL
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


@pytest.mark.parametrize('name', EXPERIMENTS)
def test_an_equation_says_the_drift_along_the_motion_that_was_flown(name):
    for key, found in experiments.experiment(name).items():
        # noise of a turn: 0.015 rad/s at 1.5 m, 32 Hz, 4 turns of at most 12.6 s: 7 mm; 3 sigma
        assert found.measured[0] == pytest.approx(found.predicted, abs=0.022), key


@pytest.mark.slow
@pytest.mark.parametrize('key', experiments.TRUTHS)
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
    assert experiments.judged('a', f.track, f.flow) is f.flow
    unturned = experiments.judged('c2', f.track, f.flow)
    wrong = flow(f.track, f.track.height, {'scale': 1.06, 'frame': 1.0})
    np.testing.assert_allclose(unturned, wrong, atol=1e-9)


def test_the_command_takes_a_folder_and_a_document(tmp_path):
    options = experiments.parser().parse_args(['-o', str(tmp_path), '--write', 'drift.md'])
    assert (options.output, str(options.write)) == (tmp_path, 'drift.md')
    assert str(experiments.parser().parse_args([]).output) == 'drift'
