"""Configuration of an environment: scenario, observation, action and randomised parameters."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mambo_estimation.filters import DEFAULT
from mambo_model import schema
from mambo_model.components import look_again
from mambo_model.errors import InputError
import numpy as np

from . import inputs
from .. import changes, scenario as scenarios, scenario_file, unused
from ..scenario import Scenario
from .task import ACTIONS, OBSERVATIONS, TaskParams

TASKS = ('hover', 'track')
Ranges = Mapping[str, tuple[Any, Any]]
_REPLACED = {
    'sim_node.duration': 'a flight ends with its episode: set handover and episode',
    'reference_node.plan.landing_time': 'an episode does not land: leave it out',
    **dict.fromkeys(scenarios.SEEDS, 'the seed is that of reset(): leave it out')}
"""Parameters that an episode sets itself, and what to do about them."""
_CAPTURED = ('optitrack_node.', 'estimator_node.joint.pose.')  # nothing reads them
_CAPTURE = 'estimator_node.joint.pose.enabled'


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


def _ranges(given: Mapping[str, Any]) -> Ranges:
    """Return the checked ranges of the parameters that are drawn for each episode."""
    out = {}
    for name, pair in given.items():
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


def _refuse_unused(places: Mapping[str, str], made: Configuration) -> None:
    """
    Refuse parameters without effect.

    Parameters
    ----------
    places
        {'node.parameter': name of the argument that sets it}.
    made
        Configuration of the environment.

    Raises
    ------
    InputError
        Naming the parameter and what to do.

    """
    for name, where in places.items():
        if name in _REPLACED:
            raise InputError(f'{where}: {name}: has no effect, as {_REPLACED[name]}')
        if made.observation == 'truth' and name.startswith('estimator_node.'):
            raise InputError(
                f"{where}: {name}: has no effect, as the observation is 'truth': choose "
                "observation='estimate', or leave it out")
        if name.startswith(_CAPTURED) and name != _CAPTURE:
            raise InputError(f'{where}: {name}: has no effect, as an episode has no motion '
                             'capture: leave it out')
    controllers = {made.scenario.controller_node.controller}
    if made.action == 'attitude_thrust':
        controllers.add('cascaded')  # its inner loop
    unused.refuse(places, estimators=[made.scenario.estimator_node.estimator],
                  controllers=controllers)


def _flight(scenario: Scenario | Path | str | None, task: str, trajectory: str | None) -> Scenario:
    """Return the scenario that the arguments select."""
    if isinstance(scenario, Scenario):
        if trajectory is not None:
            raise InputError('trajectory: a Scenario has its own; give it as parameters')
        return scenario
    if scenario is None:
        default = 'hover' if task == 'hover' else 'circle'
        return scenario_file.from_settings({'trajectory': scenario_file.Place(
            default if trajectory is None else trajectory, 'trajectory')})
    over = {} if trajectory is None else {
        'trajectory': scenario_file.Place(trajectory, 'trajectory')}
    return scenario_file.load_alone(str(scenario), over)[1]


def _refuse_estimator(chosen: Scenario, given: Mapping[str, Any]) -> None:
    """Refuse an observation of the estimate without an estimator, or with motion capture."""
    name = 'estimator_node.estimator'
    if given.get(name) == 'ground_truth':
        raise InputError(
            f"parameters: {name} = 'ground_truth': choose observation='truth' instead")
    if chosen.estimator_node.aided:
        raise InputError(
            f'scenario: an episode has no motion capture: set {_CAPTURE}: false')


def _episode(chosen: Scenario, observation: str, numbers: TaskParams) -> Scenario:
    """Return a scenario with the length and the estimator of an episode."""
    values: dict[str, Any] = {
        'sim_node.duration': numbers.handover + numbers.episode,
        'reference_node.plan.landing_time': 0.0}
    if observation == 'truth':
        values['estimator_node.estimator'] = 'ground_truth'
    elif chosen.estimator_node.estimator == 'ground_truth':
        values['estimator_node.estimator'] = DEFAULT
    return scenarios.override(chosen, values)


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
        estimator, with all sensors but motion capture. A scenario on the true state gets the
        default estimator.
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
        For an unknown argument, a value out of range, a parameter without effect, or a flight
        that an agent cannot fly.

    """
    look_again()
    _one_of('observation', observation, OBSERVATIONS)
    _one_of('action', action, ACTIONS)
    numbers = schema.build(
        TaskParams, {name: inputs.plain(value) for name, value in params.items()})
    given = inputs.by_name('parameters', "{'node.parameter': value}", parameters)
    drawn = inputs.by_name('randomise', "{'node.parameter': (low, high)}", randomise)
    for name in given:
        if name in drawn:
            raise InputError(f'parameters: {name}: has no effect, as randomise draws it')
    chosen = scenarios.override(
        _flight(scenario, _one_of('task', task, TASKS), trajectory), given)
    if chosen.sim_node.simulator.hand.enabled:
        raise InputError('scenario: a vehicle carried by hand has no motors to command')
    if chosen.reference_node.commands.enabled:
        raise InputError(
            'scenario: a commanded flight has no plan of its own to hand over from: '
            'leave out commands')
    if task != 'hover' and 'target_spread' in params:
        raise InputError('target_spread: has no effect, as only hover has a target: leave it out')
    if observation == 'estimate':
        _refuse_estimator(chosen, given)
    if changes.changes_at_all(chosen):
        raise InputError('scenario: nothing changes within an episode: leave out changes')
    made = Configuration(
        task, numbers, _episode(chosen, observation, numbers), observation, action,
        _ranges(drawn))
    for name, registry in scenarios.COMPONENTS.items():
        value = schema.flatten(made.scenario)[name]
        if registry.is_own(value):
            raise InputError(
                f'{name} = {schema.shown(value)}: environments take built-in ones only: '
                f'{", ".join(registry.names)}')
    _refuse_unused(
        {**dict.fromkeys(drawn, 'randomise'), **dict.fromkeys(given, 'parameters')}, made)
    return made
