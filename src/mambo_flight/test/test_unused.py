"""Parameters that would change nothing are refused, wherever they are given."""

from mambo_flight import scenario_file, unused
from mambo_flight.fly import main
from mambo_flight.sweep import design
from mambo_model.schema import ParameterError
import pytest

NOISE = 'estimator_node.kalman.sonar.noise'
GAIN = 'controller_node.cascaded.k_p'


def test_only_the_estimators_that_are_flown_count():
    unused.refuse({NOISE: 'here', 'controller_node.indi.k_x': 'there'},
                  estimators=['joint', 'kalman'], controllers=['cascaded', 'indi'])
    unused.refuse({
        'estimator_node.joint.sonar.noise': '', 'estimator_node.synchronise': '',
        'controller_node.mine.k_p': '', 'controller_node.cascaded.k_p': 'the backup'},
        estimators=['joint'], controllers=['mine.py'])
    unused.refuse({'controller_node.toolbox.k_p': ''},
                  estimators=['ground_truth'], controllers=['toolbox'])
    with pytest.raises(ParameterError) as error:
        unused.refuse({NOISE: 'line 3'}, estimators=['toolbox', 'joint'], controllers=['indi'])
    assert str(error.value) == (
        f'line 3: {NOISE}: has no effect, as the estimator is joint or toolbox: choose '
        'estimator: kalman, or leave it out')


@pytest.mark.parametrize('flown', ['indi', 'toolbox'])
def test_of_a_controller_too(flown):
    with pytest.raises(ParameterError) as error:
        unused.refuse({GAIN: 'line 3'}, estimators=['joint'], controllers=[flown])
    assert str(error.value) == (
        f'line 3: {GAIN}: has no effect, as the controller is {flown}: choose '
        'controller: cascaded, or leave it out')


def test_a_scenario_file_is_refused_if_none_of_its_flights_has_the_estimator(tmp_path):
    path = tmp_path / 'a.yaml'
    text = f'title: a\nparameters:\n  {NOISE}: 0.1\n'
    path.write_text(f'{text}flights:\n  one: {{}}\n  two: {{estimator: kalman}}\n')
    assert scenario_file.read(path).flights['two'].estimator_node.kalman.sonar.noise == 0.1
    path.write_text(text)
    with pytest.raises(ParameterError, match=f'{path}:3: {NOISE}: has no effect'):
        scenario_file.read(path)


def test_a_sweep_is_refused_unless_it_flies_the_estimator(tmp_path):
    path = tmp_path / 'sweep.yaml'
    text = f'title: a\nvary:\n  {NOISE}: [0.1, 0.2]\n'
    path.write_text(text)
    with pytest.raises(ParameterError, match=f'{path}:3: {NOISE}: has no effect'):
        design.read(path)
    path.write_text(f'{text}  estimator: [joint, kalman]\n')
    assert len(design.read(path).rows) == 4
    path.write_text(f'scenario: fig_5_10\n{text}')
    assert len(design.read(path).rows) == 2


def test_a_sweep_of_another_controllers_gains_is_refused(tmp_path):
    path = tmp_path / 'sweep.yaml'
    text = 'title: a\nvary:\n  controller_node.flatness_drag.k_x: [2.0, 3.0]\n'
    path.write_text(text)
    with pytest.raises(ParameterError, match='k_x: has no effect, as the controller is cascaded'):
        design.read(path)
    path.write_text(f'{text}  controller: [cascaded, flatness_drag]\n')
    assert len(design.read(path).rows) == 4


def test_two_keys_for_one_seed_are_refused(tmp_path):
    path = tmp_path / 'sweep.yaml'
    path.write_text('title: a\nvary:\n  sim_node.simulator.seed: [1, 2]\n  seed: [3, 4]\n')
    with pytest.raises(ParameterError, match='yaml:3: sim_node.simulator.seed: the key seed sets'):
        design.read(path)


def test_an_option_is_refused(tmp_path, capsys):
    given = ['--trajectory', 'circle', '--set', f'{NOISE}=0.1', '-o', str(tmp_path / 'bag')]
    assert main(given) == 2 and f'--set: {NOISE}: has no effect' in capsys.readouterr().err
