"""What the launch files decide, without launch: which nodes, with which parameters."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from mambo_bags.reader import read_bag
from mambo_flight import scenario as scenarios
from mambo_flight.course import course_file
from mambo_model import schema

from .flight import FLIGHT_NODES, RECORDER, SIMULATOR
from .processes import FlightInputError
from .replay import ESTIMATOR, PLAYER, RECORDED

MEANING = {
    'estimator': ('estimator_node.estimator',), 'controller': ('controller_node.controller',),
    'mode': ('sim_node.mode',), 'speed': ('sim_node.speed',),
    'duration': ('sim_node.duration',),
    'seed': ('sim_node.simulator.seed', 'optitrack_node.seed')}
"""Launch argument of a flight: the parameters it stands for."""


class Plan(NamedTuple):
    """
    Nodes to start.

    The node that owns time is the last: when it ends, so does everything. Parameters of a node
    are those of the file and these besides.
    """

    nodes: list[tuple[str, str, dict[str, object]]]  # package, executable, parameters
    scenario: scenarios.Scenario | None  # for a parameter file of all nodes


def choices(argument: str) -> tuple[str, ...]:
    """Return what an argument out of ``MEANING`` may be; empty: as the parameter file says."""
    leaves = dict(schema.walk(scenarios.Scenario))
    return ('', *leaves[MEANING[argument][0]].metadata['options'])


def _read(arguments: Mapping[str, str], name: str) -> Any:
    """Return the value of a launch argument; raises ParameterError naming the argument."""
    try:
        return scenarios.read_value(arguments[name])
    except schema.ParameterError as error:
        raise schema.ParameterError(f'{name}:={arguments[name]}: {error}') from None


def _recorder(bag: str, topics: str = '') -> list[tuple[str, str, dict[str, object]]]:
    """Return the recorder, or no node where no bag is asked for."""
    if not bag:
        return []
    path = Path(bag).expanduser().absolute()
    if path.exists():
        raise FlightInputError(f'{path} exists: name another bag or remove it')
    parameters: dict[str, object] = {'bag': str(path)}
    return [(*RECORDER, {**parameters, 'topics': topics} if topics else parameters)]


def flight_plan(arguments: Mapping[str, str]) -> Plan:
    """
    Return the nodes of a flight.

    Parameters
    ----------
    arguments
        Texts by name: ``trajectory``, those of ``MEANING``, ``params_file`` and ``bag``; an empty
        one leaves the choice to the parameter file, or to the defaults: real time, until stopped.

    Raises
    ------
    mambo_model.schema.ParameterError
        For a file that cannot be read or a value out of range.
    mambo_bringup.processes.FlightError
        If the bag exists.

    """
    given = {
        name: _read(arguments, argument)
        for argument, names in MEANING.items() if arguments[argument] for name in names}
    if trajectory := arguments['trajectory']:
        course_file.check_name(trajectory)
        given |= {f'reference_node.plan.{name}': value
                  for name, value in course_file.plan(trajectory).items()}
    if arguments['params_file']:
        written = scenarios.load(Path(arguments['params_file']).expanduser())
        scenario = scenarios.override(written, given)
    else:
        scenario = scenarios.override(scenarios.scenario(duration=0.0), given)
        landing = scenarios.landing_time(scenario.sim_node.duration)
        scenario = scenarios.override(scenario, {'reference_node.plan.landing_time': landing})
    others = [*_recorder(arguments['bag']), *((*node, {}) for node in FLIGHT_NODES)]
    waits = {'wait_for': ','.join(executable for _, executable, _ in others)}
    return Plan([*others, (*SIMULATOR, waits)], scenario)


def replay_plan(arguments: Mapping[str, str]) -> Plan:
    """
    Return the nodes of a replay.

    Parameters
    ----------
    arguments
        Texts by name: ``bag``, ``rate``, ``source_namespace``, ``output`` (empty: not recorded)
        and ``params_file`` (empty: the parameters in the bag, if any).

    Raises
    ------
    mambo_model.schema.ParameterError
        For a parameter file that cannot be read.
    mambo_bags.reader.BagError
        For a bag that cannot be read.
    mambo_bringup.processes.FlightError
        If the output exists.

    """
    bag = Path(arguments['bag']).expanduser().absolute()
    scenario = None
    if arguments['params_file']:
        scenario = scenarios.load(Path(arguments['params_file']).expanduser())
    elif text := read_bag(bag, topics=()).attachments.get('scenario.yaml'):
        scenario = scenarios.from_yaml(str(text), f'scenario.yaml in {bag}')
        if scenario.estimator_node.estimator == 'ground_truth':  # which does not hear sensors
            scenario = scenarios.override(scenario, {'estimator_node.estimator': 'kalman'})
    others = [*_recorder(arguments['output'], RECORDED), (*ESTIMATOR, {})]
    player: dict[str, object] = {
        'bag': str(bag), 'rate': _read(arguments, 'rate'),
        'source_namespace': arguments['source_namespace'],
        'wait_for': ','.join(executable for _, executable, _ in others)}
    return Plan([*others, (*PLAYER, player)], scenario)
