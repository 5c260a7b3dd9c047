"""Configuration of an environment: scenario, observation, action and randomised parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mambo_estimation.filters import DEFAULT
from mambo_model import schema
from mambo_model.errors import InputError
import numpy as np

from .. import scenario as scenarios, scenario_file
from ..scenario import Scenario
from .task import ACTIONS, OBSERVATIONS, TaskParams

TASKS = ('hover', 'track')
Ranges = Mapping[str, tuple[Any, Any]]


@dataclass(frozen=True)
class Configuration:
    """
    Configuration of an environment, made by :func:`configure` from its arguments.

    Attributes
    ----------
    task : str
        One of :data:`TASKS`.
    params : TaskParams
        Parameters of the task.
    scenario : Scenario
        Scenario of an episode, before parameters are drawn.
    observation, action : str
        One of :data:`task.OBSERVATIONS` and of :data:`task.ACTIONS`.
    ranges
        {'node.parameter': (low, high)} of parameters that are drawn for each episode.

    """

    task: str
    params: TaskParams
    scenario: Scenario
    observation: str
    action: str
    ranges: Ranges

    def drawn(self, rng: np.random.Generator) -> tuple[Scenario, tuple[float, float, float]]:
        """
        Draw an episode; return its scenario and the shift of its target, (3,) m NED.

        Raises
        ------
        InputError
            If the drawn values contradict each other.

        """
        values = dict.fromkeys(scenarios.SEEDS, int(rng.integers(2**31)))
        spread = self.params.target_spread
        shift = tuple(rng.uniform(-spread, spread, 3).tolist())
        for name, (low, high) in self.ranges.items():
            value = rng.uniform(low, high)
            values[name] = tuple(value.tolist()) if isinstance(low, tuple) else float(value)
        return scenarios.replaced(self.scenario, values), shift


def _one_of(name: str, value: Any, known: tuple[str, ...]) -> str:
    if value not in known:
        raise InputError(f'{name} = {schema.shown(value)} is not one of {", ".join(known)}')
    return value


def _ranges(given: Mapping[str, Any] | None) -> Ranges:
    """Return the checked ranges of the parameters that are drawn for each episode."""
    out = {}
    for name, pair in (given or {}).items():
        field = scenarios.LEAVES.get(name)
        if field is None:
            raise InputError(f'randomise: {schema.unknown(name, scenarios.LEAVES)}')
        whole = isinstance(field.default, int)
        if 'unit' not in field.metadata or whole:
            raise InputError(f'randomise: {name} is not a real number')
        if not isinstance(pair, tuple | list) or len(pair) != 2:
            raise InputError(f'randomise: {name} = {schema.shown(pair)} must be (low, high)')
        ends = tuple(tuple(end) if isinstance(end, list) else end for end in pair)
        for end in ends:
            schema.check_field('randomise', field, end)
        if np.any(np.greater(*ends)):
            raise InputError(f'randomise: {name} = {schema.shown(pair)} must be (low, high)')
        out[name] = ends
    return out


def _flight(scenario: Scenario | Path | str | None, task: str, trajectory: str | None) -> Scenario:
    """Return the scenario that the arguments select."""
    if isinstance(scenario, Scenario):
        if trajectory is not None:
            raise InputError('trajectory: a Scenario has its own; give it as parameters')
        return scenario
    if scenario is None:
        default = 'hover' if task == 'hover' else 'circle'
        return scenario_file.from_settings(
            {'trajectory': scenario_file.Place(trajectory or default, 'trajectory')})
    over = {} if trajectory is None else {
        'trajectory': scenario_file.Place(trajectory, 'trajectory')}
    return scenario_file.load(str(scenario), over)[1]


def configure(
    task: str, observation: str = 'truth', action: str = 'pwm',
    scenario: Scenario | Path | str | None = None, trajectory: str | None = None,
    parameters: Mapping[str, Any] | None = None, randomise: Mapping[str, Any] | None = None,
    **params: Any,
) -> Configuration:
    """
    Check the arguments of an environment and return its configuration.

    Parameters
    ----------
    task
        ``hover``: at a target near the hover point; ``track``: along the flight plan.
    observation
        ``truth``: the true state, without sensors; ``estimate``: that of the scenario's
        estimator, with all its sensors.
    action
        See :func:`task.commanded`.
    scenario
        An experiment as ``mambo fly`` takes it, or a :class:`Scenario`; None: the default one.
    trajectory
        Built-in trajectory or file of a course, instead of that of the scenario.
    parameters
        {'node.parameter': value}, applied last.
    randomise
        {'node.parameter': (low, high)}: drawn uniformly for each episode. For a vector
        parameter, low and high are vectors.
    params
        Parameters of the task, see :class:`TaskParams`.

    Raises
    ------
    InputError
        For an unknown argument, a value out of range, or a flight that an agent cannot fly.

    """
    _one_of('observation', observation, OBSERVATIONS)
    _one_of('action', action, ACTIONS)
    numbers = schema.build(TaskParams, params)
    flight = scenarios.override(
        _flight(scenario, _one_of('task', task, TASKS), trajectory), parameters or {})
    if flight.sim_node.simulator.hand.enabled:
        raise InputError('scenario: a vehicle carried by hand has no motors to command')
    duration = numbers.handover + numbers.episode
    values = {'sim_node.duration': duration, 'reference_node.plan.landing_time': 0.0}
    chosen = flight.estimator_node.estimator
    if observation == 'truth':
        values['estimator_node.estimator'] = 'ground_truth'
    elif chosen == 'ground_truth':
        values['estimator_node.estimator'] = DEFAULT
    flight = scenarios.override(flight, values)
    for name, registry in scenarios.COMPONENTS.items():
        value = schema.flatten(flight)[name]
        if registry.is_own(value):
            raise InputError(
                f'{name} = {schema.shown(value)}: environments take built-in ones only: '
                f'{", ".join(registry.names)}')
    return Configuration(task, numbers, flight, observation, action, _ranges(randomise))

