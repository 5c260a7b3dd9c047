"""What an environment is made of, and the one line with which anything else is refused."""

from pathlib import Path

from mambo_flight.gym.configuration import configure
from mambo_flight.scenario import scenario
from mambo_model.errors import InputError
import numpy as np
import pytest

MASS, GUST = 'sim_node.simulator.vehicle.mass', 'sim_node.simulator.wind.gust'


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
    ({'randomise': {'sim_node.simulator.noise': (0.0, 1.0)}}, 'not a real number')])
def test_what_cannot_be_flown_is_refused_in_one_line(arguments, said):
    with pytest.raises(InputError, match=said) as error:
        configure(**{'task': 'hover', **arguments})
    assert '\n' not in str(error.value)


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
