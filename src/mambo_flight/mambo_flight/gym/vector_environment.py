"""N drones as one Gymnasium environment, stepped in compiled code by several threads."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from mambo_model.errors import InputError
from mambo_sim.parameters import STEP_NS
import numpy as np
from numpy.typing import NDArray

from . import inputs
from ..scenario import Scenario
from .configuration import configure
from .drone_batch import DroneBatch
from .environment import box, information
from .episode import REASONS
from .task import OBSERVED

Steps = tuple[
    NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_],
    dict[str, Any]]
MOST_DRONES, MOST_THREADS = 1_000_000, 1024
_REASONS = np.array(REASONS, dtype=object)


class DroneVectorEnv(VectorEnv):
    """
    N drones, each commanded by an agent.

    Drone i equals a :class:`DroneEnv` with the seed ``seed + i``, to the last bit.

    Parameters
    ----------
    num_envs
        N, at most ``MOST_DRONES``.
    task, **arguments
        See :func:`configuration.configure`.
    autoreset_mode
        When a drone begins its next episode, see Gymnasium. ``NextStep``: with the next step,
        whose action is ignored and whose reward is 0; ``SameStep``: within the same step;
        ``Disabled``: only by ``reset(options={'reset_mask': ...})``, until then its reward is 0.
    threads
        Number of threads; None: one for each core.

    """

    def __init__(
        self, num_envs: int = 1, task: str = 'hover',
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int | None = None, render_mode: None = None, **arguments: Any,
    ) -> None:
        if render_mode is not None:
            raise InputError(f'render_mode = {render_mode!r}: there is none')
        num_envs = inputs.whole('num_envs', num_envs, 1, MOST_DRONES)
        if threads is not None:
            threads = inputs.whole('threads', threads, 1, MOST_THREADS)
        try:
            self.autoreset_mode = AutoresetMode(autoreset_mode)
        except ValueError:
            known = ', '.join(mode.value for mode in AutoresetMode)
            raise InputError(
                f'autoreset_mode = {autoreset_mode!r} is not one of {known}') from None
        self.metadata: dict[str, Any] = {
            'render_modes': [], 'autoreset_mode': self.autoreset_mode}
        self._configuration = configure(task, **arguments)
        self._batch = DroneBatch(self._configuration, num_envs, threads)
        self.num_envs = num_envs
        self._rngs: list[np.random.Generator] = []
        self._seeds: list[int] = []
        self._over = np.ones(num_envs, dtype=bool)
        p = self._configuration.params
        self._last = p.ticks(p.handover) + p.ticks(p.episode)
        self.single_action_space = box(self._batch.channels())
        self.single_observation_space = box(OBSERVED)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)

    @property
    def scenarios(self) -> list[Scenario]:
        """Return the flight of the episode of each drone."""
        return list(self._batch.scenarios)

    @property
    def np_random_seed(self) -> tuple[int, ...]:
        """Return the seed of each drone."""
        return tuple(self._seeds)

    @property
    def np_random(self) -> tuple[np.random.Generator, ...]:
        """Return the generator of each drone."""
        return tuple(self._rngs)

    def _seed(self, seed: int | Sequence[int | None] | None, rows: NDArray[np.int64]) -> None:
        """Give drones new generators; those without a seed keep theirs."""
        seeds = inputs.seeds(seed, self.num_envs)
        if not self._rngs:
            made = [seeding.np_random(one) for one in seeds]
            self._rngs, self._seeds = [rng for rng, _ in made], [own for _, own in made]
            return
        for i in rows:
            if seeds[i] is not None:
                self._rngs[i], self._seeds[i] = seeding.np_random(seeds[i])

    def _masked(self, options: dict[str, Any] | None) -> NDArray[np.int64]:
        """Return the drones that a reset is for."""
        mask = inputs.options(options, "{'reset_mask': booleans}", 'reset_mask').get('reset_mask')
        if mask is None:
            return np.arange(self.num_envs)
        if not (isinstance(mask, np.ndarray) and mask.dtype == bool
                and mask.shape == (self.num_envs,) and mask.any()):
            raise InputError(f"options['reset_mask'] must be {self.num_envs} booleans in an "
                             'array, at least one of them true')
        if not self._rngs:
            raise InputError("options['reset_mask']: the first reset is for every drone")
        return np.flatnonzero(mask)

    def _begin(self, rows: NDArray[np.int64]) -> None:
        self._batch.advance(np.zeros((self.num_envs, 4)), rows, self._rngs, ())
        self._over[rows] = False

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[NDArray[np.float64], dict[str, Any]]:
        """
        Begin an episode of every drone, and fly it to the handover.

        Parameters
        ----------
        seed
            Drone i gets ``seed + i``; or one seed for each drone.
        options
            ``reset_mask``: (N,) booleans, the drones that begin; the others continue.

        """
        rows = self._masked(options)
        self._seed(seed, rows)
        self._begin(rows)
        return self._batch.out.observation.copy(), self._information(rows)

    def _information(self, rows: NDArray[np.int64]) -> dict[str, Any]:
        """Return the ``infos`` of some drones, in the format of Gymnasium."""
        out, mask = self._batch.out, np.zeros(self.num_envs, dtype=bool)
        mask[rows] = True
        values = {
            'time': np.where(mask, out.tick * STEP_NS * 1e-9, 0.0),
            'truth': np.where(mask[:, None], out.truth, 0.0),
            'reason': np.where(mask, _REASONS[out.reason], None)}
        return values | {f'_{name}': mask.copy() for name in values}

    def step(self, actions: Any) -> Steps:
        """
        Hold an action of each drone for ``repeat`` control steps.

        Parameters
        ----------
        actions : (N, n)
            In the units of the action space; clipped to its limits.

        Raises
        ------
        InputError
            If they have another shape or are not finite, or no episode has begun.

        """
        out, again = self._batch.out, ()
        if not self._rngs:
            raise InputError('no episode has begun: call reset() before step()')
        given = self._batch.checked(actions, self.num_envs)
        if self.autoreset_mode == AutoresetMode.NEXT_STEP:
            again = np.flatnonzero(self._over)
        out.reward[self._over] = 0.0  # of drones that wait for a reset
        self._batch.advance(given, again, self._rngs, np.flatnonzero(~self._over))
        terminated = out.reason != 0
        truncated = ~terminated & (out.tick >= self._last)
        self._over = terminated | truncated
        reward, infos, ended = out.reward.copy(), {}, np.flatnonzero(self._over)
        if self.autoreset_mode == AutoresetMode.SAME_STEP and len(ended):
            for i in ended:
                infos = self._add_info(infos, {
                    'final_obs': out.observation[i].copy(),
                    'final_info': information(self._batch, i)}, i)
            self._begin(ended)
        infos |= self._information(np.arange(self.num_envs))
        return out.observation.copy(), reward, terminated, truncated, infos

    def close_extras(self, **kwargs: Any) -> None:
        """End the threads."""
        self._batch.close()
