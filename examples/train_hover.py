"""
Train a linear policy that hovers, from nothing, by augmented random search: numpy alone.

    python3 examples/train_hover.py [ITERATIONS] [--observation truth|estimate] [--seed N]

Each iteration tries the policy with weights W + s D and W - s D for several random directions D,
and moves W towards those that earned more (H. Mania, A. Guy, B. Recht, Simple random search of
static linear policies is competitive for reinforcement learning, NeurIPS 2018, algorithm 1, V1-t).
All of them fly at once in one vector environment. Needs Gymnasium: pip install -r
requirements/gym.txt.
"""

from __future__ import annotations

import argparse
import time

import gymnasium
import mambo.gym
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DIRECTIONS = 32     # tried in each iteration, each both ways
BEST = 16           # of them that move the weights
SIZE = 0.05         # of a trial, in the units of the weights
STEP = 0.05         # of the weights in an iteration
SECONDS = 4.0       # length of an episode
HOVER, SPAN = 275.0, 125.0  # PWM: about that of hovering; what one unit of the policy is
COLUMN = {channel.name: i for i, channel in enumerate(mambo.gym.OBSERVED)}
SCALE = {'error_x': 1.0, 'error_y': 1.0, 'error_z': 1.0, 'error_vx': 1.0, 'error_vy': 1.0,
         'error_vz': 1.0, 'qx': 0.2, 'qy': 0.2, 'qz': 0.2, 'p': 2.0, 'q': 2.0, 'r': 2.0}
"""What the policy sees, and what is one unit of it [m, m/s, 1, rad/s]."""


def act(weights: Array, observations: Array) -> Array:
    """
    Return the PWM of the motors, (N, 4).

    Parameters
    ----------
    weights : (N, 4, 12) or (4, 12)
        Of each drone, or of all.
    observations : (N, 22)
        Of the environment.

    """
    seen = observations[:, [COLUMN[name] for name in SCALE]] / list(SCALE.values())
    seen[:, 6:9] *= np.sign(observations[:, [COLUMN['qw']]])  # q and -q are one attitude
    return HOVER + SPAN * np.clip((weights @ seen[:, :, None])[:, :, 0], -1.0, 1.0)


def rollout(
    envs: gymnasium.vector.VectorEnv, weights: Array, seeds: list[int],
) -> tuple[Array, Array]:
    """Return what each drone earns in an episode, (N,), and how far it ends from its target."""
    observations, _ = envs.reset(seed=seeds)
    total, over = np.zeros(envs.num_envs), np.zeros(envs.num_envs, dtype=bool)
    while not over.all():
        observations, reward, terminated, truncated, _ = envs.step(act(weights, observations))
        total += reward
        over = terminated | truncated
    errors = observations[:, [COLUMN[f'error_{axis}'] for axis in 'xyz']]
    return total, np.linalg.norm(errors, axis=1)


def train(envs: gymnasium.vector.VectorEnv, iterations: int, seed: int) -> Array:
    """Return weights, (4, 12)."""
    rng = np.random.default_rng(seed)
    weights, began = np.zeros((4, len(SCALE))), time.monotonic()
    for number in range(iterations):
        directions = rng.standard_normal((DIRECTIONS, *weights.shape))
        tried = np.concatenate([weights + SIZE * directions, weights - SIZE * directions])
        seeds = rng.integers(2**31, size=DIRECTIONS).tolist()
        total, _ = rollout(envs, tried, seeds * 2)  # both ways from the same begin
        up, down = total[:DIRECTIONS], total[DIRECTIONS:]
        best = np.argsort(-np.maximum(up, down))[:BEST]
        spread = np.std([up[best], down[best]])
        if spread > 0.0:
            gain = np.tensordot((up - down)[best], directions[best], 1) / BEST
            weights = weights + STEP / spread * gain
        if number % 10 == 0 or number == iterations - 1:
            print(f'iteration {number:4d}: mean return {total.mean():7.3f}, '
                  f'{time.monotonic() - began:6.1f} s', flush=True)
    return weights


def main() -> None:
    """Train, fly episodes that were not trained on, and keep the weights."""
    parser = argparse.ArgumentParser(description=(__doc__ or '').strip().splitlines()[0])
    parser.add_argument('iterations', nargs='?', type=int, default=100)
    parser.add_argument('--observation', choices=('truth', 'estimate'), default='truth')
    parser.add_argument('--seed', type=int, default=1)
    options = parser.parse_args()
    envs = gymnasium.make_vec(
        'mambo/Hover-v0', num_envs=2 * DIRECTIONS, observation=options.observation,
        episode=SECONDS, autoreset_mode='Disabled')
    others = list(range(envs.num_envs))
    untrained = rollout(envs, np.zeros((4, len(SCALE))), others)
    weights = train(envs, options.iterations, options.seed)
    for name, (total, distance) in (
            ('constant PWM', untrained), ('trained', rollout(envs, weights, others))):
        print(f'{name}: return {total.mean():.3f} in {len(others)} other episodes, '
              f'{np.median(distance):.3f} m from the target at the end (median)')
    np.savez('hover_policy.npz', weights=weights)
    print('weights: hover_policy.npz')
    envs.close()


if __name__ == '__main__':
    main()
