"""Nodes and parameters of the launch files, without importing launch."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from mambo_bags.reader import read_bag
from mambo_flight import scenario as scenarios
from mambo_flight.course import course_file
from mambo_model import schema
from mambo_ros import topics

from .flight.nodes import FLIGHT_NODES, RECORDER, recorder_topics, SIMULATOR
from .processes import FlightInputError
from .replay import ESTIMATOR, PLAYER, RECORDED

MEANING = {
    'estimator': ('estimator_node.estimator',), 'controller': ('controller_node.controller',),
    'mode': ('sim_node.mode',), 'speed': ('sim_node.speed',),
    'duration': ('sim_node.duration',),
    'seed': ('sim_node.simulator.seed', 'optitrack_node.seed')}
"""Parameters that each launch argument of a flight sets."""


class Plan(NamedTuple):
    """
    Nodes to start.

    The last node owns time; when it ends, all end. The parameters given here override those of
    the file.
    """

    nodes: list[tuple[str, str, dict[str, object]]]  # package, executable, parameters
    scenario: scenarios.Scenario | None  # for a parameter file of all nodes


def choices(argument: str) -> tuple[str, ...]:
    """Return the choices of an argument in ``MEANING``; empty: as in the parameter file."""
    leaves = dict(schema.walk(scenarios.Scenario))
    return ('', *leaves[MEANING[argument][0]].metadata['options'])


def _read(arguments: Mapping[str, str], name: str) -> Any:
    """Return the value of a launch argument; raises ParameterError naming the argument."""
    try:
        return scenarios.read_value(arguments[name])
    except schema.ParameterError as error:
        raise schema.ParameterError(f'{name}:={arguments[name]}: {error}') from None


def _recorder(bag: str, topics: str = '') -> list[tuple[str, str, dict[str, object]]]:
    """Return the recorder, or no node if no bag is requested."""
    if not bag:
        return []
    path = Path(bag).expanduser().absolute()
    if path.exists():
        raise FlightInputError(f'{path} exists: name another bag or remove it')
    parameters: dict[str, object] = {'bag': str(path)}
    return [(*RECORDER, {**parameters, 'topics': topics} if topics else parameters)]


ROOM = 22.0  # s, for a function that does not state its duration: as in a flight of 40 s


def flight_plan(arguments: Mapping[str, str]) -> Plan:
    """
    Return the nodes of a flight.

    Parameters
    ----------
    arguments
        Texts by name: ``trajectory``, those of ``MEANING``, ``params_file`` and ``bag``. An empty
        text means the value of the parameter file, or the default: real time, until stopped.

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
                  for name, value in course_file.plan(trajectory, room=ROOM).items()}
    if arguments['params_file']:
        written = scenarios.load(Path(arguments['params_file']).expanduser())
        scenario = scenarios.override(written, given)
    else:
        scenario = scenarios.override(scenarios.scenario(duration=0.0), given)
        landing = scenarios.landing_time(scenario.sim_node.duration)
        scenario = scenarios.override(scenario, {'reference_node.plan.landing_time': landing})
    scenario = scenarios.override(
        scenario, {'optitrack_node.watermark': scenario.estimator_node.waits_for_capture})
    others = [*_recorder(arguments['bag'], **recorder_topics(scenario)),
              *((*node, {}) for node in FLIGHT_NODES)]
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
        # the recorder does not subscribe to sensors
        if scenario.estimator_node.estimator == 'ground_truth':
            scenario = scenarios.override(scenario, {'estimator_node.estimator': 'kalman'})
    aided = scenario is not None and scenario.estimator_node.aided
    recorded = f'{RECORDED},{topics.LOCATED.name}' if aided else RECORDED
    others = [*_recorder(arguments['output'], recorded), (*ESTIMATOR, {})]
    player: dict[str, object] = {
        'capture': aided,
        'bag': str(bag), 'rate': _read(arguments, 'rate'),
        'source_namespace': arguments['source_namespace'],
        'wait_for': ','.join(executable for _, executable, _ in others)}
    return Plan([*others, (*PLAYER, player)], scenario)
