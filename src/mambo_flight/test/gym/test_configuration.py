"""What an environment is made of, and the one line with which anything else is refused."""

from pathlib import Path

from mambo_flight.gym.configuration import configure
from mambo_flight.scenario import scenario
from mambo_model.errors import InputError
import numpy as np
import pytest

MASS, GUST = 'sim_node.simulator.vehicle.mass', 'sim_node.simulator.wind.gust'
GAIN, SCALE = 'controller_node.cascaded.k_p', 'estimator_node.joint.optical_flow.scale'
PLAN = 'reference_node.plan.'


@pytest.mark.parametrize(('arguments', 'said'), [
    ({'task': 'race'}, 'task = .* hover, track'),
    ({'observation': 'all'}, 'observation = .* truth, estimate'),
    ({'action': 'torque'}, 'action = .* pwm, attitude_thrust, setpoint'),
    ({'epsiode': 3.0}, 'epsiode: unknown parameter; did you mean episode'),
    ({'episode': 0.0}, 'episode = 0.0 s is outside'),
    ({'repeat': 2.5}, 'repeat = 2.5 must be a whole number'),
    ({'trajectory': 'cricle'}, 'cricle'),
    ({'scenario': 'fig_9_99'}, 'fig_9_99'),
    ({'scenario': scenario(), 'trajectory': 'circle'}, 'trajectory: a Scenario has its own'),
    ({'scenario': scenario(carried=True)}, 'carried by hand'),
    ({'parameters': {'sim_node.mass': 1.0}}, 'sim_node.mass'),
    ({'randomise': {'mass': (0.06, 0.07)}}, 'randomise: mass: unknown parameter'),
    ({'randomise': {MASS: 0.06}}, r'must be \(low, high\)'),
    ({'randomise': {MASS: (0.07, 0.06)}}, r'must be \(low, high\)'),
    ({'randomise': {MASS: (0.06, 600.0)}}, 'mass = 600.0 kg is outside'),
    ({'randomise': {GUST: (0.0, 1.0)}}, 'gust = 0.0 must be 3 numbers'),
    ({'randomise': {'sim_node.simulator.noise': (0.0, 1.0)}}, 'not a real number'),
    ({'trajectory': ''}, 'trajectory'),
    ({'scenario': 'several_formation'}, 'several_formation: world.drones = 4: only one drone'),
    ({'parameters': {'controller_node.controller': 'cascaded',
                     'controller_node.changes': '- {time: 1, set: {cascaded.k_p: 2.6}}'}},
     'nothing changes within an episode'),
    ({'parameters': {'reference_node.commands.enabled': True}}, 'commanded flight has no plan'),
    ({'parameters': 5}, r"parameters = 5 must be {'node.parameter': value}"),
    ({'parameters': [1]}, r"parameters = \[1\] must be {'node.parameter': value}"),
    ({'parameters': {5: 1}}, 'parameters: the name 5 must be text'),
    ({'randomise': 5}, r"randomise = 5 must be {'node.parameter': \(low, high\)}"),
    ({'randomise': {5: 1}}, 'randomise: the name 5 must be text'),
    ({'repeat': True}, 'repeat = True must be a whole number'),
    ({'episode': np.True_}, 'episode = True must be a number')])
def test_what_cannot_be_flown_is_refused_in_one_line(arguments, said):
    with pytest.raises(InputError, match=said) as error:
        configure(**{'task': 'hover', **arguments})
    assert '\n' not in str(error.value)


@pytest.mark.parametrize(('arguments', 'said'), [
    ({'parameters': {'sim_node.duration': 30.0}},
     '^parameters: sim_node.duration: has no effect, .*: set handover and episode$'),
    ({'randomise': {'sim_node.duration': (20.0, 30.0)}},
     '^randomise: sim_node.duration: has no effect, .*: set handover and episode$'),
    ({'parameters': {f'{PLAN}landing_time': 9.0}}, f'^parameters: {PLAN}landing_time: has no ef'),
    ({'parameters': {'sim_node.simulator.seed': 3}}, r'has no effect, .* reset\(\): leave it out'),
    ({'parameters': {SCALE: 1.1}},
     f"^parameters: {SCALE}: has no effect, as the observation is 'truth': choose obs"),
    ({'randomise': {SCALE: (1.0, 1.1)}}, f'^randomise: {SCALE}: has no effect'),
    ({'parameters': {'estimator_node.estimator': 'kalman'}}, 'estimator: has no effect'),
    ({'parameters': {GAIN: 3.0}, 'randomise': {GAIN: (2.0, 4.0)}},
     f'^parameters: {GAIN}: has no effect, as randomise draws it$'),
    ({'parameters': {SCALE: 1.1, 'estimator_node.estimator': 'kalman'},
      'observation': 'estimate'},
     f'^parameters: {SCALE}: has no effect, as the estimator is kalman: choose estimator: joint'),
    ({'randomise': {'estimator_node.kalman.optical_flow.constant': (1.0, 1.1)},
      'observation': 'estimate'}, '^randomise: .* as the estimator is joint'),
    ({'parameters': {GAIN: 3.0}, 'scenario': scenario(controller='flatness_drag')},
     f'^parameters: {GAIN}: has no effect, as the controller is flatness_drag'),
    ({'randomise': {'controller_node.flatness_drag.k_x': (3.0, 4.0)}},
     '^randomise: .* as the controller is cascaded'),
    ({'parameters': {'optitrack_node.optitrack.latency': 0.04}},
     '^parameters: optitrack_node.optitrack.latency: .* no motion capture: leave it out'),
    ({'parameters': {'estimator_node.joint.pose.enabled': True}, 'observation': 'estimate'},
     '^scenario: an episode has no motion capture: set estimator_node.joint.pose.enabled: false'),
    ({'parameters': {'estimator_node.estimator': 'ground_truth'}, 'observation': 'estimate'},
     "= 'ground_truth': choose observation='truth' instead$")])
def test_a_parameter_without_effect_is_refused(arguments, said):
    with pytest.raises(InputError, match=said) as error:
        configure('hover', **arguments)
    assert '\n' not in str(error.value)


def test_parameters_of_what_is_flown_are_taken():
    drag = scenario(controller='flatness_drag')
    made = configure('hover', 'estimate', parameters={SCALE: 1.1})
    assert made.scenario.estimator_node.joint.optical_flow.scale == 1.1
    made = configure('hover', action='attitude_thrust', scenario=drag, parameters={GAIN: 3.0})
    assert made.scenario.controller_node.cascaded.k_p == 3.0  # of the inner loop


def test_a_commanded_flight_is_refused(tmp_path):
    file = tmp_path / 'up.yaml'
    file.write_text('title: up\nduration: 9.0\ncommands: [{time: 1.0, takeoff: {height: 1.0}}]\n')
    with pytest.raises(InputError, match='^scenario: a commanded flight .*: leave out commands$'):
        configure('hover', scenario=file)


def test_several_drones_of_a_file_are_refused_and_one_is_flown(tmp_path):
    file = tmp_path / 'hall.yaml'
    file.write_text('title: hall\nworld: {drones: 2}\n')
    with pytest.raises(InputError, match=f'^{file}: world.drones = 2: .*mambo fly or ./run$'):
        configure('track', scenario=file)
    file.write_text('title: hall\nworld: {drones: 1}\n')
    assert configure('track', scenario=file).scenario.reference_node.plan.trajectory == 'circle'


def test_a_trajectory_replaces_one_of_a_file_that_cannot_be_read(tmp_path):
    file = tmp_path / 'lost.yaml'
    file.write_text('title: lost\ntrajectory: missing.csv\n')
    made = configure('track', scenario=file, trajectory='hover')
    assert made.scenario.reference_node.plan.trajectory == 'hover'


def test_numbers_of_numpy_are_those_of_python():
    made = configure(
        'hover', repeat=np.int64(4), episode=np.float32(2.0), handover=np.int32(3),
        parameters={MASS: np.float32(0.0625), GUST: np.array([1.0, 0.0, 0.0]),
                    'sim_node.simulator.noise': np.False_},
        randomise={'sim_node.simulator.vehicle.arm': np.array([0.04, 0.05]),
                   'sim_node.simulator.wind.velocity': np.array([[0.0] * 3, [1.0, 0.5, 0.0]])})
    plain = configure(
        'hover', repeat=4, episode=2.0, handover=3.0,
        parameters={MASS: 0.0625, GUST: (1.0, 0.0, 0.0), 'sim_node.simulator.noise': False},
        randomise={'sim_node.simulator.vehicle.arm': (0.04, 0.05),
                   'sim_node.simulator.wind.velocity': ((0.0, 0.0, 0.0), (1.0, 0.5, 0.0))})
    assert made == plain and type(made.params.repeat) is int


def test_components_from_outside_are_refused():
    file = Path(__file__).parents[4] / 'examples/pd_controller.py'
    with pytest.raises(InputError, match='environments take built-in ones only: cascaded'):
        configure('hover', parameters={'controller_node.controller': str(file)})


def test_the_observation_chooses_the_estimator():
    for given, observation, flown in (
            ('kalman', 'truth', 'ground_truth'), ('ground_truth', 'estimate', 'joint'),
            ('toolbox', 'estimate', 'toolbox')):
        made = configure('hover', observation=observation, scenario=scenario(estimator=given))
        assert made.scenario.estimator_node.estimator == flown


def test_only_a_hover_has_a_target_to_spread():
    with pytest.raises(InputError, match='^target_spread: has no effect, as only hover has a'):
        configure('track', target_spread=0.1)
    assert configure('hover', target_spread=0.1).params.target_spread == 0.1


def test_a_flight_is_as_long_as_its_episode_and_does_not_land():
    made = configure('track', handover=6.0, episode=20.0, scenario=scenario(duration=40.0))
    assert made.scenario.sim_node.duration == 26.0
    assert made.scenario.reference_node.plan.landing_time == 0.0


def test_everything_that_is_drawn_is_within_its_ends():
    made = configure('hover', target_spread=0.3, randomise={
        MASS: (0.06, 0.07), GUST: ((0.0, 0.0, 0.0), (1.0, 0.5, 0.0))})
    rng = np.random.default_rng(1)
    rows, shifts = zip(*(made.drawn(rng) for _ in range(100)))
    masses = [one.sim_node.simulator.vehicle.mass for one in rows]
    gusts = np.array([one.sim_node.simulator.wind.gust for one in rows])
    assert 0.06 <= min(masses) < 0.062 and 0.068 < max(masses) <= 0.07
    assert (gusts.max(axis=0) > [0.9, 0.45, -1.0]).all()
    assert (gusts.max(axis=0) <= [1.0, 0.5, 0.0]).all() and gusts.min() >= 0.0
    assert 0.27 < np.abs(shifts).max() <= 0.3
    assert len({one.seed for one in rows}) == 100
    assert all(one.optitrack_node.seed == one.seed for one in rows)


def test_a_function_of_a_file_that_is_edited_in_a_session_is_the_one_of_now(tmp_path):
    file, plans = tmp_path / 'mine.py', []
    for speed in (0.1, 0.2):
        (tmp_path / 'helper.py').write_text(f'SPEED = {speed}\n')
        file.write_text('from helper import SPEED\n\nduration = 8.0\n\n\n'
                        'def trajectory(t):\n    return SPEED * t, 0.0, -1.0\n')
        plans.append(configure('track', trajectory=str(file)).scenario.reference_node.plan)
    assert plans[0] != plans[1]
