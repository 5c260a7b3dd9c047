"""Nodes and parameters of the launch files, without importing launch."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
import difflib
import json
from pathlib import Path
from typing import Any, NamedTuple

from mambo_bags.reader import read_bag
from mambo_estimation.filters import DEFAULT
from mambo_flight import recorded_changes, scenario as scenarios, scenario_file, unused
from mambo_flight.course import course_file
from mambo_flight.scenario_file import build_world, Place
from mambo_flight.world import formation, world_file
from mambo_flight.world.world_file import Hall
from mambo_model import schema
from mambo_model.frames import flip_vector
from mambo_ros import topics
from mambo_ros.commands.client import check_namespace
from mambo_ros.graph.wire import WireParams

from .flight.nodes import (
    COMPOSED, DESCRIPTION, HALL_CAPTURE, RECORDER, recorder_topics, run_parameters,
    start_arguments, take_cameras, world_process)
from .processes import FlightInputError, parameter, refuse_bag, refuse_not_utf8
from .replay import ESTIMATOR, PLAYER, RECORDED

PARAMETERS = ('estimator', 'controller', 'mode', 'speed', 'duration', 'seed')
"""Launch arguments of a flight that set a parameter."""


class Plan(NamedTuple):
    """
    Nodes of a replay.

    The last node owns time; when it ends, all end. The parameters given here override those of
    the file.
    """

    nodes: list[tuple[str, str, dict[str, object]]]  # package, executable, parameters
    scenario: scenarios.Scenario | None  # for a parameter file of all nodes


def almost(given: Iterable[str], known: Collection[str]) -> Iterator[str]:
    """Yield a line for each name that is not known but is close to one that is."""
    for name in given:
        close = difflib.get_close_matches(name, known, 1, 0.75)
        if close and name not in known:
            yield f'{name}:= is unknown and ignored; did you mean {close[0]}:= ?'


def choices(argument: str) -> tuple[str, ...]:
    """Return the choices of an argument in ``PARAMETERS``; empty: as in the parameter file."""
    leaves = dict(schema.walk(scenarios.Scenario))
    return ('', *leaves[scenario_file.SETS[argument][0]].metadata['options'])


def _read(arguments: Mapping[str, str], name: str) -> Any:
    """Return the value of a launch argument; raises ParameterError naming the argument."""
    try:
        return scenarios.read_value(arguments[name])
    except schema.ParameterError as error:
        raise schema.ParameterError(f'{name}:={arguments[name]}: {error}') from None


def _recorder(bag: str, topics: str) -> list[tuple[str, str, dict[str, object]]]:
    """Return the recorder of a replay, or no node if no bag is requested."""
    if not bag:
        return []
    path = Path(bag).expanduser().absolute()
    refuse_bag(path, 'name another bag')
    return [(*RECORDER, {'bag': str(path), 'topics': topics, 'whole': False})]


ROOM = 22.0  # s, for a function that does not state its duration: as in a flight of 40 s


class Flight(NamedTuple):
    """What a launch flies."""

    scenarios: dict[str, scenarios.Scenario]  # by namespace of the drone
    bags: dict[str, Path]  # likewise; empty: not recorded
    hall: Hall | None      # of several drones
    composed: bool
    own_clock: bool
    vehicle: str           # of the description; empty: there is none
    wire: dict[str, dict[str, object]]  # parameters of what is published, by namespace


class Process(NamedTuple):
    """A process of a launch."""

    package: str
    executable: str
    namespace: str  # of its drone; empty: of all drones
    arguments: list[str]


def _scenario(arguments: Mapping[str, str]) -> scenarios.Scenario:
    """Return the scenario of a flight of one drone; errors as :func:`flight`."""
    given = {
        name: _read(arguments, argument)
        for argument in PARAMETERS if arguments[argument]
        for name in scenario_file.SETS[argument]}
    sources = [f'{name}:={arguments[name]}' for name in ('scenario', 'params_file')
               if arguments[name]]
    if len(sources) > 1 or arguments['params_file'] and arguments['vehicle']:
        raise FlightInputError(
            f'{sources[0]} cannot be combined with '
            f'{[*sources, "vehicle:=" + arguments["vehicle"]][1]}: leave one out')
    if arguments['scenario']:
        settings = {name: Place(value, f'{name}:={value}') for name in ('trajectory', 'vehicle')
                    if (value := arguments[name])}
        _, flight = scenario_file.load(arguments['scenario'], settings)
        return scenarios.override(flight, given)
    if trajectory := arguments['trajectory']:
        course_file.check_name(trajectory)
        given |= {f'reference_node.plan.{name}': value
                  for name, value in course_file.plan(trajectory, room=ROOM).items()}
    if arguments['params_file']:
        written = scenarios.load(Path(arguments['params_file']).expanduser())
        if trajectory:
            unused.refuse_plan(
                written.reference_node, {'trajectory': f'trajectory:={trajectory}'})
        return scenarios.override(written, given)
    flight = scenarios.override(scenarios.scenario(
        duration=0.0, vehicle=arguments['vehicle'] or 'identified'), given)
    landing = scenarios.landing_time(flight.sim_node.duration)
    return scenarios.override(flight, {'reference_node.plan.landing_time': landing})


def flight(arguments: Mapping[str, str]) -> Flight:
    """
    Return what a launch flies.

    Parameters
    ----------
    arguments
        Texts by name, as in ``flight.launch.py``. An empty text means the value of the scenario
        or parameter file, or the default: real time, until stopped.

    Raises
    ------
    mambo_model.errors.MamboError
        For a file that cannot be read, a value out of range, arguments that exclude each other, or
        a bag that exists.

    """
    check_namespace(arguments['namespace'].strip('/'))
    base, composed = _scenario(arguments), arguments['composed'] == 'true'
    if arguments['speed'] and base.sim_node.mode != 'realtime':
        raise FlightInputError(
            f'speed:={arguments["speed"]} needs mode:=realtime: lockstep always runs at full '
            'speed')
    world = build_world(
        {'world.drones': _read(arguments, 'drones')} if arguments['drones'] else {},
        scenario_file.load_world(arguments['scenario']) if arguments['scenario'] else None)
    unused.refuse_alone(world, f'scenario:={arguments["scenario"]}')
    space = '/' + arguments['namespace'].strip('/')
    if world.drones > 1 and space != topics.NAMESPACE:
        raise FlightInputError(
            f'namespace:={arguments["namespace"]} is for one drone: several have /mambo1, '
            '/mambo2 and so on')
    if composed and not arguments['bag']:
        raise FlightInputError('composed:=true records always: give bag:=')
    hall, flown = None, {space: base}
    if world.drones > 1:
        drones = formation.hall(base, world, bool(arguments['duration']))
        world_file.check_cameras(drones.hall, drones.flights)
        hall, flown = drones.hall, dict(zip(drones.hall.places, drones.flights, strict=True))
    bag = Path(arguments['bag']).expanduser().absolute() if arguments['bag'] else None
    if bag is not None:
        refuse_bag(bag, 'name another bag')
    bags = {name: bag if hall is None else bag / name.strip('/') for name in flown} if bag else {}
    described = arguments['description'] == 'true'
    own_clock = hall is not None or arguments['own_clock'] == 'true'
    return Flight(flown, bags, hall, composed, own_clock,
                  (arguments['vehicle'] or 'identified') if described else '',
                  {name: _wire(arguments, name, hall is not None) for name in flown})


def _wire(arguments: Mapping[str, str], space: str, several: bool) -> dict[str, object]:
    """Return what the nodes of a drone change in what they publish; see ``WireParams``."""
    name = space.strip('/')
    if arguments['prefixed'] == 'true' and not several:
        raise FlightInputError('prefixed:=true is for several drones: give drones:=')
    given: dict[str, object] = {
        'start_date': arguments['start_date'],
        'sensor_frames': arguments['sensor_frames'] == 'true',
        'frame_prefix': f'{name}/' if arguments['prefixed'] == 'true' else '',
        'hardware_id': name if arguments['hardware_ids'] == 'true' else ''}
    schema.build(WireParams, given)
    return {key: value for key, value in given.items() if value}


def processes(plan: Flight, folder: Path) -> list[Process]:
    """
    Return the processes of a flight; the one that owns time is the last of them.

    Parameters
    ----------
    plan
        What is flown.
    folder
        Where the parameters of the nodes are written; it must last as long as the processes.

    """
    out: list[Process] = []
    world = folder / world_file.NAME
    owners = []
    if plan.hall is not None:
        world.write_text(world_file.to_text(plan.hall))
    for number, (space, flown) in enumerate(plan.scenarios.items()):
        file = folder / f'scenario{number or ""}.yaml'
        file.write_text(scenarios.to_yaml(scenarios.override(flown, run_parameters(
            flown, (), recorded=bool(plan.bags))), space))
        started = start_arguments(
            file, plan.bags.get(space, Path()), plan.composed, space, (), {
                **recorder_topics(flown), **({'world': str(world)} if plan.hall else {})},
            own=plan.own_clock)
        if plan.wire[space]:
            wire = folder / f'wire{number or ""}.json'  # parsed as YAML
            wire.write_text(json.dumps({f'{space}/*': {'ros__parameters': {
                'wire': plan.wire[space]}}}))
            started = [(node, [*words, '--params-file', str(wire)]) for node, words in started]
        *nodes, owner = started
        owners.append((*owner, space))
        out += [Process(*node, space, words) for node, words in nodes
                if plan.bags or node != RECORDER]
    if plan.vehicle:
        out.append(Process(*DESCRIPTION, '', _description(plan)))
    if plan.hall is not None:
        flown, cameras = take_cameras(
            world, [(one.namespace, one[:2], one.arguments) for one in out])
        out = [Process(*node, space, words) for space, node, words in flown]
        out += [Process(*HALL_CAPTURE, '', cameras)] if cameras else []
        return [*out, Process(*COMPOSED, '', world_process(
            world, [words for _, words, _ in owners], plan.composed))]
    [(node, words, space)] = owners
    return [*out, Process(*node, space, words)]


def _description(plan: Flight) -> list[str]:
    """Return the arguments of the node that describes the drones to viewers."""
    words = ['--ros-args', *parameter('drones', ','.join(plan.scenarios)),
             *parameter('vehicle', plan.vehicle), '-p', 'paths:=true', '-p', 'markers:=true']
    if plan.hall is not None:
        places = '; '.join(' '.join(f'{x:g}' for x in flip_vector(place))
                           for place in plan.hall.places.values())
        words += ['-p', 'prefixed:=true', *parameter('places', places)]
    return words


def replay_plan(arguments: Mapping[str, str]) -> Plan:
    """
    Return the nodes of a replay.

    Parameters
    ----------
    arguments
        Texts by name: ``bag``, ``rate``, ``source_namespace``, ``output`` (empty: not recorded)
        and ``params_file`` (empty: the parameters in the bag, if any), ``namespace``.

    Raises
    ------
    mambo_model.schema.ParameterError
        For a parameter file that cannot be read.
    mambo_bags.reader.BagError
        For a bag that cannot be read.
    mambo_bringup.processes.FlightError
        If the output exists.

    """
    check_namespace(arguments['namespace'].strip('/'))
    bag = Path(arguments['bag']).expanduser().absolute()
    refuse_not_utf8(bag)
    scenario = None
    if arguments['params_file']:
        scenario = scenarios.load(Path(arguments['params_file']).expanduser())
    elif text := (recording := read_bag(bag, recorded_changes.RECORD)).attachments.get(
            'scenario.yaml'):
        scenario = scenarios.from_yaml(str(text), f'scenario.yaml in {bag}')
        # the recorder does not subscribe to sensors
        if scenario.estimator_node.estimator == 'ground_truth':
            scenario = scenarios.override(scenario, {'estimator_node.estimator': DEFAULT})
        else:
            scenario = recorded_changes.estimated(scenario, recording)
    aided = scenario is not None and scenario.estimator_node.aided
    recorded = f'{RECORDED},{topics.LOCATED.name}' if aided else RECORDED
    others = [*_recorder(arguments['output'], recorded), (*ESTIMATOR, {})]
    player: dict[str, object] = {
        'capture': aided,
        'bag': str(bag), 'rate': _read(arguments, 'rate'),
        'source_namespace': arguments['source_namespace'],
        'wait_for': ','.join(executable for _, executable, _ in others)}
    return Plan([*others, (*PLAYER, player)], scenario)
