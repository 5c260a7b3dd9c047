"""Many drones are so many single ones, to the bit, whatever the threads and the autoreset."""

import copy
import os
import pickle
import signal

import gymnasium
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from mambo_flight.gym.registration import register
from mambo_model.errors import InputError
import numpy as np
import pytest

pytestmark = pytest.mark.long

register()
DRONES = 5
SHORT = {'observation': 'estimate', 'handover': 0.1, 'episode': 0.2, 'target_spread': 1.9,
         'randomise': {'sim_node.simulator.vehicle.mass': (0.06, 0.07)}}


def vector(**more):
    return gymnasium.make_vec('mambo/Hover-v0', num_envs=DRONES, **SHORT | more)


def singles(mode):
    return SyncVectorEnv(
        [lambda: gymnasium.make('mambo/Hover-v0', **SHORT).unwrapped] * DRONES,
        autoreset_mode=mode)


@pytest.mark.parametrize('mode', [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_the_drones_are_single_ones_with_their_seeds(mode):
    many, alone = vector(autoreset_mode=mode, threads=2), singles(mode)
    assert many.metadata['autoreset_mode'] == alone.metadata['autoreset_mode'] == mode
    assert many.action_space == alone.action_space
    assert many.observation_space == alone.observation_space
    assert data_equivalence(many.reset(seed=7), alone.reset(seed=7), exact=True)
    assert many.np_random_seed == (7, 8, 9, 10, 11)
    rng, ended = np.random.default_rng(1), np.zeros(2)
    for _ in range(130):
        actions = rng.uniform(0.0, 500.0, (DRONES, 4))
        one, other = many.step(actions), alone.step(actions)
        assert data_equivalence(one, other, exact=True)
        ended += [one[2].sum(), one[3].sum()]
    assert (ended > 3).all()  # by limits and by time


def test_the_number_of_threads_changes_nothing():
    rows = []
    for threads in (1, 2, 3, None):
        envs = vector(threads=threads)
        envs.reset(seed=[3, 1, 4, 1, 5])
        rows.append(np.array([envs.step(np.full((DRONES, 4), 270.0))[0] for _ in range(60)]))
        envs.close()
    np.testing.assert_array_equal(rows, rows[:1] * 4)
    np.testing.assert_array_equal(rows[0][:, 1], rows[0][:, 3])  # one seed


def test_a_drone_without_autoreset_rests_until_it_is_reset():
    envs = vector(autoreset_mode='Disabled', target_spread=0.3)
    envs.reset(seed=1)
    act = np.full((DRONES, 4), 270.0)
    for _ in range(40):  # 0.2 s
        seen, _, terminated, truncated, info = envs.step(act)
    assert (terminated | truncated).all()
    again, reward, still, ended, _ = envs.step(act)
    np.testing.assert_array_equal(again, seen)
    assert not reward.any() and np.array_equal(still | ended, np.ones(DRONES, dtype=bool))
    mask = np.array([False, True, False, False, True])
    new, about = envs.reset(options={'reset_mask': mask})
    assert (new[mask] != seen[mask]).any(axis=1).all()
    np.testing.assert_array_equal(new[~mask], seen[~mask])
    np.testing.assert_array_equal(about['_time'], mask)
    later, reward, *over, info = envs.step(act)
    np.testing.assert_array_equal(over[0] | over[1], ~mask)
    np.testing.assert_array_equal(info['time'] < 0.11, mask)
    assert (reward != 0.0).tolist() == mask.tolist()


@pytest.mark.parametrize(('arguments', 'said'), [
    ({'num_envs': 0}, 'num_envs = 0'), ({'threads': 0}, 'threads = 0'),
    ({'num_envs': True}, 'num_envs = True must be a whole number'),
    ({'threads': np.True_}, 'threads = True must be a whole number'),
    ({'num_envs': 2.0}, 'num_envs = 2.0'),
    ({'autoreset_mode': 'never'}, 'NextStep, SameStep, Disabled'),
    ({'render_mode': 'human'}, 'render_mode')])
def test_wrong_arguments_are_refused_in_one_line(arguments, said):
    with pytest.raises(InputError, match=said) as error:
        gymnasium.make_vec('mambo/Hover-v0', **{'num_envs': 2, **arguments})
    assert '\n' not in str(error.value)


def test_numbers_of_numpy_are_taken_for_drones_threads_and_seeds():
    envs = gymnasium.make_vec(
        'mambo/Hover-v0', num_envs=np.int64(3), threads=np.int32(2), handover=0.0)
    assert type(envs.num_envs) is int and envs.action_space.shape == (3, 4)
    for seed, each in ((np.int64(7), (7, 8, 9)), (np.array([1, 2, 3]), (1, 2, 3))):
        envs.reset(seed=seed)
        assert envs.np_random_seed == each
    envs.close()


@pytest.mark.parametrize(('arguments', 'said'), [
    ({'options': 5}, r"^options = 5 must be {'reset_mask': booleans}$"),
    ({'options': {'mask': [True]}}, "^options: there is no 'mask': give {'reset_mask': booleans}"),
    ({'options': 'x'}, "^options = 'x' must be"), ({'seed': 1.5}, '^seed = 1.5 must be a whole'),
    ({'seed': 'five5'}, "^seed = 'five5' must be"), ({'seed': True}, '^seed = True must be'),
    ({'seed': [1, 2, 3, 4, 0.5]}, r'^seed\[4\] = 0.5 must be a whole'),
    ({'seed': -1}, '^seed = -1 must be a whole number, at least 0$')])
def test_a_reset_with_what_is_no_seed_or_option_is_refused(arguments, said):
    envs = vector(threads=1)
    with pytest.raises(InputError, match=said):
        envs.reset(**arguments)


@pytest.mark.parametrize('copied', [copy.deepcopy, pickle.dumps])
def test_threads_are_not_copied(copied):
    envs = vector(threads=2)
    with pytest.raises(TypeError, match='^an environment .* same arguments and seed$'):
        copied(envs)
    envs.close()


def test_a_fork_flies_on_with_threads_of_its_own():
    envs = vector(threads=2)
    envs.reset(seed=1)
    actions = np.zeros((DRONES, 4))
    read, write = os.pipe()
    if not (child := os.fork()):
        signal.alarm(60)  # s; without its own threads it would wait for ever
        os.write(write, envs.step(actions)[0].tobytes())
        os._exit(0)
    os.close(write)
    assert os.waitpid(child, 0)[1] == 0
    with open(read, 'rb') as found:
        assert found.read() == envs.step(actions)[0].tobytes()
    envs.close()


def test_impossible_actions_seeds_and_masks_are_refused():
    envs = vector()
    with pytest.raises(InputError, match=r'call reset\(\)'):
        envs.step(np.zeros((DRONES, 4)))
    with pytest.raises(InputError, match='first reset is for every drone'):
        envs.reset(options={'reset_mask': np.ones(DRONES, dtype=bool)})
    with pytest.raises(InputError, match='seed has 2 numbers'):
        envs.reset(seed=[1, 2])
    envs.reset(seed=1)
    with pytest.raises(InputError, match='must be 5 booleans'):
        envs.reset(options={'reset_mask': np.zeros(DRONES, dtype=bool)})
    wrong = np.zeros((DRONES, 4))
    wrong[3, 1] = np.nan
    with pytest.raises(InputError, match='action of drone 3 has motor_2 = nan'):
        envs.step(wrong)
    with pytest.raises(InputError, match=r'shape \(4,\), must have \(5, 4\)'):
        envs.step(np.zeros(4))
