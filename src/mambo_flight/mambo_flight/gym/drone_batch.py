"""N drones flown by compiled code on several threads; both environments are built on it."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
import os
from typing import Any

from mambo_control import failsafe
from mambo_estimation import filters
from mambo_model.compiled import Held, hold_again, jit, lengthen, row_of
from mambo_model.errors import InputError, JobError
from mambo_model.motion.flatness import from_flat_output
from mambo_model.vehicle.parameters import Vehicle
from mambo_sim import simulator
import numpy as np
from numpy.typing import NDArray

from . import episode, inputs
from .. import closed_loop
from ..scenario import Scenario
from .configuration import Configuration
from .task import ACTIONS, Channel, commanded, PLAN

_ZERO = (0.0, 0.0, 0.0)


def _target(flight: Scenario, shift: tuple[float, float, float]) -> Any:
    """Return a reference at rest, shifted from the hover point of the flight plan."""
    v: Vehicle = flight.reference_node.vehicle
    x, y, z = (a + b for a, b in zip(flight.reference_node.plan.hover(), shift))
    return from_flat_output(
        (x, y, z), _ZERO, _ZERO, _ZERO, _ZERO, v.mass, v.inertia, v.gravity)


@jit
def _hold(memory, rng, values):
    """
    Return a holder of a drone's state, as :func:`mambo_model.compiled.hold` does.

    It is a function of its own so that the nodes do not load its compiled variants.
    """
    return Held(memory, rng, values)


class DroneBatch:
    """
    Drones in flight.

    Attributes
    ----------
    scenarios : list of Scenario
        Scenario of each drone's current episode. Flown by ``closed_loop.fly`` it gives the same
        flight up to the handover.
    out : episode.Outcome
        Result of the last steps; the next steps overwrite it.

    """

    def __init__(
        self, configuration: Configuration, count: int, threads: int | None = None,
    ) -> None:
        self.configuration, self.out = configuration, episode.outcome(count)
        self.scenarios: list[Scenario] = [configuration.scenario] * count
        self._kind = ACTIONS.index(configuration.action)
        self._handover = configuration.params.ticks(configuration.params.handover)
        self._estimating = closed_loop.estimates(closed_loop.settings(configuration.scenario))
        self._holders: list[Any] = []
        self._row: Any = None
        self._threads = min(threads or len(os.sched_getaffinity(0)), count)
        self._pool = ThreadPoolExecutor(self._threads - 1) if self._threads > 1 else None
        self._process = os.getpid()

    def __getstate__(self) -> dict[str, Any]:
        if self._holders or self._pool is not None:
            raise TypeError(
                'an environment with drones in flight or threads cannot be copied or pickled: '
                'make another environment with the same arguments and seed')
        return self.__dict__

    def close(self) -> None:
        """End the threads."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None

    def _episode(self, flight: Scenario, shift: tuple[float, float, float]) -> tuple[Any, ...]:
        """Return state, random generators and constants of a drone at the start of an episode."""
        sim, settings = flight.sim_node.simulator, closed_loop.settings(flight)
        state, target = simulator.initial_state(sim), _target(flight, shift)
        drone = episode.Drone(
            state, filters.initial(settings.estimator), failsafe.begin(settings.gains),
            state.plant.body, failsafe.EXACT, target, 0, episode.WAITING, (0.0, 0.0, 0.0, 0.0),
            False)
        values = episode.Episode(
            settings, flight.controller_node.cascaded.values(),
            self.configuration.params.values(), self.configuration.task == 'hover', target,
            self._handover)
        return drone, simulator.generators(sim.seed), values

    def _prepare(self, i: int, rng: np.random.Generator) -> None:
        """Draw an episode for a drone and put it on the floor."""
        self.scenarios[i], shift = self.configuration.drawn(rng)
        parts = self._episode(self.scenarios[i], shift)
        if i < len(self._holders):
            hold_again(self._holders[i], *parts)
            return
        self._holders.append(_hold(*parts))
        if self._row is None:
            self._row = row_of(self._holders[0])
        else:
            lengthen(self._row, self._holders[-1])

    def advance(
        self, actions: NDArray[np.float64], begin: Sequence[int],
        rngs: Sequence[np.random.Generator], go_on: Sequence[int],
    ) -> None:
        """
        Begin new episodes of some drones, and fly others for one action.

        Parameters
        ----------
        actions : (N, 4)
            As returned by :meth:`checked`; only the rows of ``go_on`` are read.
        begin : (n,)
            Drones whose episode begins, in rising order; in the first call all drones.
        rngs : (N,)
            Random generator of each drone, from which its episodes are drawn.
        go_on : (m,)
            Drones that continue their episode.

        Raises
        ------
        InputError
            If the drawn parameters contradict each other.
        JobError
            If the scenario's controller does not fly a drone to the handover.

        """
        for i in begin:
            self._prepare(i, rngs[i])
        work = [(rows, PLAN, self._handover + 1) for rows in self._shares(begin)]
        repeat = self.configuration.params.repeat
        work += [(rows, self._kind, repeat) for rows in self._shares(go_on)]
        self._fly(actions, work)
        for i in begin:
            self.out.reward[i], self.out.reason[i] = 0.0, episode.NOTHING
            if self.out.stage[i] not in (failsafe.FLYING, failsafe.HOLDING):
                raise JobError(
                    f'the controller {self.scenarios[i].controller_node.controller} has not '
                    f'brought the vehicle to the handover (seed {self.scenarios[i].seed}): it is '
                    f'{failsafe.STAGES[self.out.stage[i]]}')

    def _shares(self, rows: Sequence[int]) -> list[NDArray[np.int64]]:
        """Split the rows into one array for each thread."""
        whole = np.asarray(rows, dtype=np.int64)
        return [share for share in np.array_split(whole, self._threads) if len(share)]

    def _fly(self, actions: NDArray[np.float64], work: list[tuple[Any, int, int]]) -> None:
        """Run all pieces of work, the first one in this thread."""
        def fly(piece: tuple[Any, int, int]) -> None:
            episode.fly(self._row, piece[0], actions, piece[1], piece[2], self.out,
                        self._estimating)
        if self._pool is None or len(work) < 2:
            for piece in work:
                fly(piece)
            return
        if self._process != os.getpid():  # a fork: it has none of the threads
            self._pool, self._process = ThreadPoolExecutor(self._threads - 1), os.getpid()
        others = [self._pool.submit(fly, piece) for piece in work[1:]]
        fly(work[0])
        for other in others:
            other.result()

    def channels(self) -> tuple[Channel, ...]:
        """Return the channels of an action."""
        return commanded(
            self.configuration.action, self.configuration.scenario.controller_node.vehicle)

    def checked(self, actions: Any, count: int | None) -> NDArray[np.float64]:
        """
        Return actions as compiled code reads them, (N, 4), clipped to their limits.

        Parameters
        ----------
        actions : (count, n), or (n,) without a count
            In the units of :meth:`channels`, of which there are n.
        count
            Number of drones; None: one drone, whose action is a vector.

        Raises
        ------
        InputError
            If they have another shape or are not finite numbers.

        """
        channels = self.channels()
        shape = (len(channels),) if count is None else (count, len(channels))
        names = ', '.join(f'{c.name} [{c.unit}]' for c in channels)
        given = inputs.floats('action', actions, names)
        if given.shape != shape:
            raise InputError(f'action has shape {given.shape}, must have {shape}: {names}')
        if not np.isfinite(given).all():
            row, column = np.argwhere(~np.isfinite(given.reshape(-1, len(channels))))[0]
            where = '' if count is None else f' of drone {row}'
            raise InputError(
                f'action{where} has {channels[column].name} = '
                f'{given.reshape(-1, len(channels))[row, column]}, must be finite')
        out = np.zeros((len(self.scenarios), 4))
        np.clip(given, [c.low for c in channels], [c.high for c in channels],
                out=out[:, :len(channels)] if count is not None else out[0, :len(channels)])
        return out
