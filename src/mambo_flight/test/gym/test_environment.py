"""One drone: Gymnasium's contract, and the numbers of the closed loop."""

import copy
import pickle
import warnings

import gymnasium
from gymnasium.utils.env_checker import check_env
from mambo_control import failsafe
from mambo_flight import closed_loop
from mambo_flight.gym.registration import register
from mambo_model.errors import InputError
from mambo_model.motion.rigid_body import State
from mambo_model.motion.trajectory import reference_at
import numpy as np
import pytest

pytestmark = pytest.mark.long

register()
HOVER = np.full(4, 276.66)  # PWM


def make(name='Hover', **arguments):
    return gymnasium.make(f'mambo/{name}-v0', **arguments).unwrapped


def flown(env, seed, act, steps=10**6):
    """Return observations, rewards, information and how the episode ended."""
    seen, info = env.reset(seed=seed)
    rows, rewards, infos, over = [seen], [], [info], (False, False)
    while not any(over) and len(rewards) < steps:
        seen, reward, *over, info = env.step(act(seen, info))
        rows, rewards, infos = [*rows, seen], [*rewards, reward], [*infos, info]
    return np.array(rows), np.array(rewards), infos, tuple(over)


def state(row):
    """Return the state in a row of 13 numbers."""
    x = row.tolist()
    return State(tuple(x[0:3]), tuple(x[3:6]), tuple(x[6:10]), tuple(x[10:13]))


@pytest.mark.parametrize('observation', [
    'truth', pytest.param('estimate', marks=pytest.mark.long)])
@pytest.mark.parametrize('action', ['pwm', 'attitude_thrust', 'setpoint'])
def test_gymnasiums_checker_passes(observation, action):
    env = make(observation=observation, action=action, handover=0.1, episode=0.5)
    with warnings.catch_warnings():
        warnings.simplefilter('error')  # but for one: actions are in units, RescaleAction scales
        warnings.filterwarnings('ignore', '.*For Box action spaces, we recommend')
        check_env(env, skip_render_check=True)


@pytest.mark.parametrize('observation', ['truth', 'estimate'])
def test_the_built_in_controller_through_the_environment_flies_the_closed_loop(observation):
    """From the floor to the circle: what it is told as PWM from outside gives the same bits."""
    env = make('Track', observation=observation, handover=0.0, episode=9.0, position_limit=100.0)
    control = None

    def act(seen, info):
        nonlocal control
        node = env.scenario.controller_node
        control = control or failsafe.initial(node.law)
        ref, phase = reference_at(
            info['time'], env.scenario.reference_node.plan, env.scenario.reference_node.vehicle)
        control, command = failsafe.step(
            control, state(seen), failsafe.EXACT, ref, phase, node.period, node.law.values(),
            node.failsafe.values(), node.vehicle.values())
        return command.pwm
    rows, _, infos, over = flown(env, 4, act)
    known = closed_loop.fly(env.scenario)
    assert over == (False, True)  # the time is over
    np.testing.assert_array_equal(rows[:, :13], (
        known.estimate if observation == 'estimate' else known.truth))
    np.testing.assert_array_equal([info['truth'] for info in infos], known.truth)


@pytest.mark.parametrize('observation', ['truth', 'estimate'])
def test_a_setpoint_that_is_not_moved_is_the_closed_loop(observation):
    env = make('Track', observation=observation, action='setpoint', episode=3.0)
    rows, _, infos, over = flown(env, 4, lambda *_: np.zeros(3))
    known = closed_loop.fly(env.scenario)
    assert over == (False, True) and len(rows) == 601  # 3 s of 5 ms
    np.testing.assert_array_equal(rows[:, :13], (
        known.estimate if observation == 'estimate' else known.truth)[1000:])
    np.testing.assert_array_equal([info['truth'] for info in infos], known.truth[1000:])
    np.testing.assert_allclose(
        rows[:, 13:16], known.reference[1000:, :3] - rows[:, :3], rtol=0.0, atol=1e-15)


def test_one_seed_is_one_flight_and_another_is_another():
    env = make(observation='estimate', randomise={'sim_node.simulator.vehicle.mass': (0.06, 0.07)})
    first, again, other = (flown(env, seed, lambda *_: HOVER, 50)[0] for seed in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert (first[:, :3] != other[:, :3]).all()
    next_one = env.reset()[0]
    flown(env, 1, lambda *_: HOVER, 50)
    np.testing.assert_array_equal(next_one, flown_next(env))


def flown_next(env):
    """Return the first observation of the episode after the present one."""
    env.reset(seed=2)
    return env.reset()[0]


def test_what_is_drawn_is_in_the_scenario_of_the_episode():
    name = 'sim_node.simulator.vehicle.mass'
    env = make(handover=0.0, randomise={name: (0.06, 0.07)})
    masses = []
    for _ in range(20):
        env.reset(seed=None if masses else 1)
        masses.append(env.scenario.sim_node.simulator.vehicle.mass)
        assert env.scenario.controller_node.vehicle.mass == 0.068  # believes what it did
    assert 0.06 <= min(masses) < 0.063 and 0.067 < max(masses) <= 0.07


def test_the_target_is_near_the_hover_point_and_differs():
    env = make(handover=0.0, target_spread=0.5)
    targets = np.array([
        (row := env.reset(seed=seed)[0])[:3] + row[13:16] for seed in range(50)])
    off = targets - [0.0, 0.0, -1.5]
    assert np.abs(off).max() <= 0.5 and (np.abs(off).max(axis=0) > 0.4).all()


@pytest.mark.parametrize(('arguments', 'act', 'reason'), [
    ({}, np.zeros(4), 'touched the floor'),
    ({'position_limit': 0.2, 'target_spread': 0.0}, np.full(4, 500.0),
     'too far from the reference'),
    ({'position_limit': 100.0}, np.array([350.0, 200.0, 200.0, 350.0]), 'tilted too far'),
    ({'action': 'setpoint', 'parameters': {'controller_node.cascaded.tilt_limit': 0.05}},
     np.array([1.0, 0.0, 0.0]), 'motors shut down by the failsafe')])
def test_an_episode_ends_by_a_limit_and_says_which(arguments, act, reason):
    env = make(**arguments)
    _, rewards, infos, over = flown(env, 1, lambda *_: act)
    assert over == (True, False)
    assert infos[-1]['reason'] == reason
    assert rewards[-1] < -4.9 and (np.array([i['reason'] for i in infos[:-1]]) == '').all()


def test_the_reward_is_what_the_page_says():
    env = make('Track', observation='estimate')
    acts = iter([np.array([290.0, 270.0, 285.0, 275.0]), np.array([390.0, 170.0, 285.0, 225.0])])
    _, rewards, infos, _ = flown(env, 1, lambda *_: next(acts), 2)
    ref, _ = reference_at(
        infos[2]['time'], env.scenario.reference_node.plan, env.scenario.reference_node.vehicle)
    x = infos[2]['truth']
    w, i, j, k = x[6:10]
    turn = np.array([[1 - 2 * (j * j + k * k), 2 * (i * j - k * w), 2 * (i * k + j * w)],
                     [2 * (i * j + k * w), 1 - 2 * (i * i + k * k), 2 * (j * k - i * w)],
                     [2 * (i * k - j * w), 2 * (j * k + i * w), 1 - 2 * (i * i + j * j)]])
    a, b, c, d = ref.q
    yaw = np.arctan2(turn[1, 0], turn[0, 0]) - np.arctan2(
        2 * (b * c + a * d), 1 - 2 * (c * c + d * d))
    expected = 0.005 * (
        2.0 - np.linalg.norm(np.subtract(ref.rho, x[:3]))
        - 0.2 * np.linalg.norm(np.subtract(ref.v, turn @ x[3:6])) - 0.1 * abs(yaw)
        - 0.05 * np.linalg.norm(x[10:13]) - np.mean(np.square([100.0, 100.0, 0.0, 50.0]) / 500**2))
    assert rewards[1] == pytest.approx(expected, abs=1e-14)


def test_an_action_that_is_held_is_that_many_steps():
    act = np.array([280.0, 275.0, 280.0, 275.0])
    held, single = make(repeat=4), make()
    rows, rewards, _, _ = flown(held, 1, lambda *_: act, 5)
    fine, each, _, _ = flown(single, 1, lambda *_: act, 20)
    np.testing.assert_array_equal(rows, fine[::4])
    np.testing.assert_allclose(rewards, each.reshape(5, 4).sum(axis=1), rtol=0.0, atol=1e-15)


def test_attitude_and_thrust_go_through_the_inner_loop():
    """A tilt of 0.2 rad and the thrust that bears the weight: g tan(0.2) sideways."""
    env = make('Track', trajectory='hover', action='attitude_thrust', position_limit=100.0)
    thrust = 0.068 * 9.81 / np.cos(0.2)
    rows, _, _, _ = flown(env, 1, lambda *_: np.array([0.0, -0.2, 0.0, thrust]), 200)
    early, late = rows[160], rows[200]
    acceleration, speed = (late[3] - early[3]) / 0.2, 0.5 * (early[3] + late[3])
    assert 2.0 * np.arctan2(late[8], late[6]) == pytest.approx(-0.2, abs=0.003)
    # along the body's x axis, where the thrust has no part; rotor drag is 0.22/4 s/m of it (3.13)
    drag = 0.22 / 4.0 * thrust / 0.068 * speed
    assert acceleration == pytest.approx(9.81 * np.sin(0.2) - drag, abs=0.03)


@pytest.mark.parametrize(('action', 'said'), [
    (np.array([1.0, np.nan, 1.0, 1.0]), 'motor_2 = nan'), (np.zeros(3), r'shape \(3,\)'),
    (np.zeros((1, 4)), r'shape \(1, 4\)'), ('full', 'must be numbers'),
    (np.array([1.0, 1.0, 1.0, np.inf]), 'motor_4 = inf')])
def test_an_impossible_action_is_refused_in_one_line_and_nothing_is_lost(action, said):
    env = make(handover=0.0)
    env.reset(seed=1)
    with pytest.raises(InputError, match=said) as error:
        env.step(action)
    assert '\n' not in str(error.value)
    assert env.step(HOVER)[4]['time'] == 0.005


def test_a_flown_environment_is_not_copied_and_a_new_one_is():
    env = gymnasium.make('mambo/Hover-v0', handover=0.0)
    assert copy.deepcopy(env).unwrapped.scenario == env.unwrapped.scenario
    env.reset(seed=1)
    for copied in (copy.deepcopy, pickle.dumps):
        with pytest.raises(TypeError, match='^an environment .* same arguments and seed$'):
            copied(env)


def test_a_seed_is_a_whole_number():
    env = make(handover=0.0)
    np.testing.assert_array_equal(env.reset(seed=np.int64(3))[0], env.reset(seed=3)[0])
    for seed in (1.5, True, -1):
        with pytest.raises(InputError, match=f'^seed = {seed} must be a whole number'):
            env.reset(seed=seed)


def test_an_option_is_refused():
    env = make(handover=0.0)
    env.reset(seed=1, options={})
    with pytest.raises(InputError, match="^options: there is no 'speed': what an episode draws"):
        env.reset(options={'speed': 2.0})
    with pytest.raises(InputError, match=r'^options = 5 must be \{\}$'):
        env.reset(options=5)


def test_a_step_before_or_after_an_episode_is_refused():
    env = make(handover=0.0, episode=0.01)
    with pytest.raises(InputError, match=r'call reset\(\)'):
        env.step(HOVER)
    flown(env, 1, lambda *_: HOVER)
    with pytest.raises(InputError, match=r'call reset\(\)'):
        env.step(HOVER)


def test_an_action_beyond_its_limits_is_cut():
    env = make(handover=0.0)
    ends = [flown(env, 1, lambda *_, pwm=pwm: np.full(4, pwm), 20)[0] for pwm in (500.0, 1e6)]
    np.testing.assert_array_equal(*ends)
