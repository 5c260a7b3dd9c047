"""
Environments of Gymnasium: ``import mambo.gym`` registers them.

>>> import gymnasium, mambo.gym
>>> env = gymnasium.make('mambo/Hover-v0', observation='estimate')
>>> envs = gymnasium.make_vec('mambo/Track-v0', num_envs=256, trajectory='circle')

Needs Gymnasium: ``pip install -r requirements/gym.txt``.
"""

try:
    import gymnasium  # noqa: F401
except ModuleNotFoundError:
    raise ModuleNotFoundError(
        'mambo.gym needs Gymnasium: pip install -r requirements/gym.txt') from None

from mambo_flight.gym.environment import DroneEnv
from mambo_flight.gym.registration import register
from mambo_flight.gym.task import OBSERVED, STATE, TaskParams
from mambo_flight.gym.vector_environment import DroneVectorEnv

__all__ = ['DroneEnv', 'DroneVectorEnv', 'OBSERVED', 'STATE', 'TaskParams']

register()
