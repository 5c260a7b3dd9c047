"""The environments as a user finds them."""

import subprocess
import sys

import gymnasium
import mambo.gym
import numpy as np
import pytest


def test_the_ids_are_registered_and_make_both_kinds():
    for name in ('mambo/Hover-v0', 'mambo/Track-v0'):
        one = gymnasium.make(name, handover=0.0)
        many = gymnasium.make_vec(name, num_envs=3, handover=0.0)
        assert isinstance(one.unwrapped, mambo.gym.DroneEnv)
        assert isinstance(many, mambo.gym.DroneVectorEnv)
        assert one.reset(seed=1)[0].shape == (len(mambo.gym.OBSERVED),)
        np.testing.assert_array_equal(many.reset(seed=1)[0][0], one.reset(seed=1)[0])


@pytest.mark.long
def test_without_gymnasium_one_line_says_what_to_install():
    code = 'import sys; sys.modules["gymnasium"] = None; import mambo, mambo.gym'
    done = subprocess.run([sys.executable, '-c', code], text=True, capture_output=True)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1] == (
        'ModuleNotFoundError: mambo.gym needs Gymnasium: pip install -r requirements/gym.txt')
