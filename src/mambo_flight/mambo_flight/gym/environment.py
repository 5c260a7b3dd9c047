"""One drone as a Gymnasium environment."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import gymnasium
from gymnasium import spaces
from mambo_model.errors import InputError
from mambo_sim.parameters import STEP_NS
import numpy as np
from numpy.typing import NDArray

from . import inputs
from ..scenario import Scenario
from .configuration import configure
from .drone_batch import DroneBatch
from .episode import REASONS
from .task import Channel, OBSERVED

Step = tuple[NDArray[np.float64], float, bool, bool, dict[str, Any]]


def box(channels: Sequence[Channel]) -> spaces.Box:
    """Return the space of some channels, in their units."""
    low, high = (np.array([getattr(c, end) for c in channels]) for end in ('low', 'high'))
    return spaces.Box(low, high, dtype=np.float64)


def information(batch: DroneBatch, i: int) -> dict[str, Any]:
    """Return the ``info`` of drone i; see :class:`DroneEnv`."""
    out = batch.out
    return {
        'time': float(out.tick[i] * STEP_NS * 1e-9), 'truth': out.truth[i].copy(),
        'reason': REASONS[out.reason[i]]}


class DroneEnv(gymnasium.Env):
    """
    One drone, commanded by an agent.

    An episode is a flight of the closed loop: the scenario's controller takes off, and the agent
    flies from the handover on. ``terminated`` means that a limit was reached (distance from the
    reference, tilt, the floor, a shutdown by the failsafe), ``truncated`` that the time is over.
    The ``info`` of a step has ``time`` [s] of the flight, ``truth`` (13,), the true state in the
    order of :data:`task.STATE`, and ``reason``, why an episode has terminated.

    Parameters
    ----------
    task, **arguments
        See :func:`configuration.configure`.

    """

    metadata: ClassVar[dict[str, Any]] = {'render_modes': []}

    def __init__(self, task: str = 'hover', render_mode: None = None, **arguments: Any) -> None:
        if render_mode is not None:
            raise InputError(f'render_mode = {render_mode!r}: there is none; '
                             'compare or plot a flight of env.unwrapped.scenario')
        self._configuration = configure(task, **arguments)
        self._batch = DroneBatch(self._configuration, 1)
        self._last = -1  # tick at which the episode is truncated
        self._over = True
        self.action_space = box(self._batch.channels())
        self.observation_space = box(OBSERVED)

    @property
    def scenario(self) -> Scenario:
        """Return the flight of this episode: ``mambo.fly(scenario)`` flies it without an agent."""
        return self._batch.scenarios[0]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None,
    ) -> tuple[NDArray[np.float64], dict[str, Any]]:
        """
        Begin an episode, and fly it to the handover.

        Parameters
        ----------
        seed
            Seed of all random numbers from now on; None: continue with the last seed.
        options
            None or empty: there are none.

        Raises
        ------
        InputError
            If the seed is no whole number from 0 on, or there are options.

        """
        inputs.options(options)
        super().reset(seed=None if seed is None else inputs.whole('seed', seed, 0))
        self._batch.advance(np.zeros((1, 4)), [0], [self.np_random], [])
        p = self._configuration.params
        self._last, self._over = p.ticks(p.handover) + p.ticks(p.episode), False
        return self._batch.out.observation[0].copy(), information(self._batch, 0)

    def step(self, action: Any) -> Step:
        """
        Hold an action for ``repeat`` control steps.

        Parameters
        ----------
        action : (n,)
            In the units of the action space; clipped to its limits.

        Raises
        ------
        InputError
            If it has another shape or is not finite, or the episode is over.

        """
        if self._over:
            raise InputError('the episode is over, or has not begun: call reset() before step()')
        self._batch.advance(self._batch.checked(action, None), [], [], [0])
        out = self._batch.out
        terminated = bool(out.reason[0])
        truncated = not terminated and bool(out.tick[0] >= self._last)
        self._over = terminated or truncated
        return (out.observation[0].copy(), float(out.reward[0]), terminated, truncated,
                information(self._batch, 0))

    def close(self) -> None:
        """End the threads."""
        self._batch.close()
