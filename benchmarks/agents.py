"""Environments of Gymnasium: how many control steps of a drone an agent can take per second."""

from __future__ import annotations

import math
import os
from pathlib import Path
import time

import gymnasium
import mambo.gym  # noqa: F401 (registers the environments)
import numpy as np

from .measure import Contender

DRONES = 256
WANTED = 3e5  # control steps of a drone per second, on two cores
HOVER = 276.66  # PWM


def _measure(envs: gymnasium.vector.VectorEnv, steps: int) -> dict[str, float]:
    """Step all drones so often; a step is a control step of 5 ms of one drone."""
    actions = np.full((envs.num_envs, 4), HOVER)
    wall, cpu = time.perf_counter(), time.process_time()
    for _ in range(steps):
        envs.step(actions)
    count = steps * envs.num_envs
    return {'agent': 1e-3 * count / (time.perf_counter() - wall),
            'agent_cpu': 1e-3 * count / (time.process_time() - cpu)}


def contenders(quick: bool, folder: Path) -> list[Contender]:
    """Return the vector environment on one core and on all, observing truth and estimate."""
    cores = len(os.sched_getaffinity(0))
    made: dict[tuple[str, int], gymnasium.vector.VectorEnv] = {}

    def contender(observation: str, threads: int) -> Contender:
        def prepare() -> None:
            made[observation, threads] = gymnasium.make_vec(
                'mambo/Hover-v0', num_envs=DRONES, observation=observation, threads=threads,
                episode=3600.0, position_limit=100.0, tilt_limit=math.pi)

        def run() -> dict[str, float]:
            envs = made[observation, threads]
            envs.reset(seed=1)
            return _measure(envs, 50 if quick else 400)
        what = 'true state' if observation == 'truth' else 'sensors and estimator'
        return Contender(
            'gym', f'gym_{observation}_{threads}',
            f'{what}, {threads} thread{"" if threads == 1 else "s"}', run, prepare,
            at_least={'agent': 1e-3 * WANTED} if threads == cores else {})
    return [contender(observation, threads) for observation in ('truth', 'estimate')
            for threads in sorted({1, cores})]
