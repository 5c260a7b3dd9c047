"""
Fly a scenario in the ROS graph, record it and compare: the implementation of ``mambo run``.

Every node is a process of its own, or all are composed in one. ``./run`` and ``mambo run`` are
the command lines of this module.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
import json
from pathlib import Path
import re
import signal
from types import MappingProxyType

from mambo_analysis.compare.ending import ended_early, ENDINGS
from mambo_bags.command import guard, Parser, program
from mambo_bags.reader import read_bag
from mambo_estimation.filters import REGISTRY as ESTIMATORS
from mambo_flight import choices, recording_to_bag, scenario as scenarios, scenario_file
from mambo_model import schema
from mambo_model.motion.trajectory import COURSE
from tqdm import tqdm

from .node_group import NodeGroup
from .processes import FlightError, FlightInputError, load, NodeProcess, parameter
from .stopping import stoppable
from .stuck import stuck

FLIGHT_NODES = (
    ('mambo_sim', 'optitrack_node'), ('mambo_estimation', 'estimator_node'),
    ('mambo_control', 'reference_node'), ('mambo_control', 'controller_node'))
REPLACEABLE = {
    'optitrack': (FLIGHT_NODES[0], 'optitrack/pose'),
    'estimator': (FLIGHT_NODES[1], 'estimate/odom'),
    'reference': (FLIGHT_NODES[2], 'reference'), 'controller': (FLIGHT_NODES[3], 'motor_pwm')}
"""Choices of ``--without``: the node, and the topic that the user's node publishes instead."""
RECORDER = ('mambo_bags', 'recorder_node')
SIMULATOR = ('mambo_sim', 'sim_node')
COMPOSED = ('mambo_bringup', 'composed_node')
NAMESPACE = '/mambo'
CONTROLLER = 'flatness_drag'
"""Default controller of ``./run``; unlike that of the thesis it compensates rotor drag."""
OWN = ('clock', 'tf', 'diagnostics')
"""Absolute topics that are moved into the namespace if there are several drones."""
_FLOWN = re.compile(
    r'flew ([\d.]+) s in ([\d.]+) s of wall time, (\d+) steps without their motor command')
_DELAY = re.compile(r'IMU sample to motor command: .*')
_USED = re.compile(r'used ([\d.]+) s of CPU and (\d+) MB')
_REFUSED = re.compile(r'\[[\w.]*?(\w+)\]: refused messages: (.+)')
_LOADING = 60.0  # s that nodes may take to load, at least
_BEGUN = re.compile(r'flying in \w+ mode$')
_PACED = re.compile(r'flying in realtime mode$')
_WAITS = re.compile(r'waiting for .*')
_TIME = re.compile(r't = ([\d.]+) s$')


@dataclass
class Outcome:
    """Result of a flight."""

    bag: Path
    flown: float  # s of flight time
    took: float  # s of wall time from the first to the last step
    missed: int  # steps without a motor command in time
    delay: str  # wall time from IMU sample to motor command, one line
    stopped: signal.Signals | None  # signal by which the user ended the flight
    used: dict[str, tuple[float, int]]  # by node: s of CPU, peak memory in MB
    refused: dict[str, str]  # by node: numbers of refused messages by topic and reason
    closed: bool  # the bag
    fault: str = ''  # why the flight ended early, one line
    whole: bool = False  # whether the full duration was flown

    @property
    def real_time_factor(self) -> float:
        """Return flight time over wall time."""
        return self.flown / self.took if self.took else float('nan')

    def spent(self) -> str:
        """Return the CPU time and memory of the nodes as one line, the largest first."""
        cpu = {name.removesuffix('_node'): seconds / self.took
               for name, (seconds, _) in self.used.items()}
        nodes = ', '.join(f'{name} {cpu[name]:.2f}' for name in sorted(cpu, key=cpu.get)[::-1])
        memory = max(memory for _, memory in self.used.values())
        return f'CPU: {sum(cpu.values()):.2f} cores: {nodes}; memory: {memory} MB at most'


class FlightEndedError(FlightError):
    """A flight failed after its start; ``outcomes`` describes what was flown until then."""

    def __init__(self, outcomes: list[Outcome]) -> None:
        super().__init__(outcomes[0].fault)
        self.outcomes = outcomes


class Progress:
    """Progress bar of flight time, updated from the lines that the simulator prints."""

    def __init__(self, duration: float, shown: bool = True) -> None:
        self.flown, self.took, self.missed, self.delay = 0.0, 0.0, 0, ''
        self.begun = False
        self._bar = tqdm(
            total=duration, desc='starting (compiles once)', leave=False,
            disable=None if shown else True,
            bar_format='{desc} {bar} {n:.1f}/{total:.0f} s of flight, {elapsed} elapsed')

    def line(self, text: str) -> None:
        """Update from one line of the simulator."""
        self.begun = self.begun or bool(_BEGUN.search(text))
        if found := _FLOWN.search(text):
            self.flown, self.took, self.missed = float(found[1]), float(found[2]), int(found[3])
        elif found := _DELAY.search(text):
            self.delay = found[0]
        elif found := _WAITS.search(text):
            self._bar.set_description_str(found[0])
        elif found := _TIME.search(text):
            self.flown = float(found[1])
            self._bar.set_description_str('flying', refresh=False)
            self._bar.update(float(found[1]) - self._bar.n)

    def close(self) -> None:
        """Remove the bar."""
        self._bar.close()


def _ours(without: Collection[str]) -> list[tuple[str, str]]:
    """Return the nodes, other than simulator and recorder, that the runner starts."""
    theirs = [REPLACEABLE[name][0] for name in without]
    return [node for node in FLIGHT_NODES if node not in theirs]


def _mode(flight: scenarios.Scenario, without: Collection[str]) -> dict[str, object]:
    """Return the parameters that belong to the run, not to the experiment."""
    waited = [name for _, name in (*_ours(without), RECORDER)]
    return {'optitrack_node.watermark': flight.estimator_node.waits_for_capture,
            'sim_node.wait_for': ','.join(waited),
            'sim_node.wait_for_publishers': ','.join(REPLACEABLE[name][1] for name in without)}


def recorder_topics(flight: scenarios.Scenario) -> dict[str, str]:
    """Return the parameter of the recorder that names its topics, none where it takes its own."""
    if not flight.estimator_node.aided:
        return {}
    return {'topics': ','.join(topic.name for topic in recording_to_bag.recorded(flight))}


def _nodes(file: Path, bag: Path, composed: bool, namespace: str, without: Collection[str] = (),
           own: Mapping[str, str] = MappingProxyType({}),
           ) -> list[tuple[tuple[str, str], list[str]]]:
    """Return the nodes of a drone and their arguments; the one that owns time is the last."""
    arguments = ['--ros-args']
    if namespace != NAMESPACE:  # one of several drones: its own clock, frames and diagnostics
        arguments += ['-r', f'__ns:={namespace}']
        for topic in OWN:
            arguments += ['-r', f'/{topic}:={topic}']
    flown = [*arguments, '--params-file', str(file)]
    if composed:
        recorder = file.with_name(f'recorder_{file.name}')
        recorder.write_text(json.dumps({f'{namespace}/recorder_node': {  # parsed as YAML
            'ros__parameters': {'bag': str(bag), 'scenario': str(file), **own}}},
            ensure_ascii=False))
        return [(COMPOSED, [*flown, '--params-file', str(recorder)])]
    recorded = [*arguments, *parameter('bag', bag), *parameter('scenario', file),
                *(one for name, value in own.items() for one in parameter(name, value))]
    return [(RECORDER, recorded), *((node, flown) for node in (*_ours(without), SIMULATOR))]


def fly(flight: scenarios.Scenario, bag: Path, composed: bool = False,
        without: Collection[str] = ()) -> Outcome:
    """
    Fly a scenario in the graph and record it.

    Parameters
    ----------
    flight
        Scenario with a duration.
    bag
        Directory to create.
    composed
        Run all nodes in one process: the same bag, faster.
    without
        Names in :data:`REPLACEABLE` of nodes that the user starts.

    Raises
    ------
    FlightError
        If a node does not start, crashes, is stopped or exits early; the bag holds the flight
        until then.

    """
    return fly_several({NAMESPACE: flight}, {NAMESPACE: bag}, composed, without)[0]


def fly_several(flights: Mapping[str, scenarios.Scenario], bags: Mapping[str, Path],
                composed: bool = False, without: Collection[str] = ()) -> list[Outcome]:
    """
    Fly several drones at once, each with its own clock and its own bag.

    Parameters
    ----------
    flights, bags
        Scenario and bag of each drone by namespace; see :func:`fly`.
    composed
        One process per drone instead of one per node.
    without
        As of :func:`fly`.

    Raises
    ------
    FlightError
        As of :func:`fly`; a :class:`FlightEndedError` once the nodes were started.

    """
    for bag in bags.values():
        if bag.exists():
            raise FlightInputError(f'{bag} exists: give another --output or remove it')
    progress: dict[str, Progress] = {}
    started: dict[str, list[NodeProcess]] = {}
    with ExitStack() as bars, NodeGroup(RECORDER[1], len(flights)) as group:
        last = []
        for number, (namespace, flight) in enumerate(flights.items()):
            file = group.folder / f'scenario{number or ""}.yaml'
            file.write_text(scenarios.commented_yaml(
                scenarios.override(flight, _mode(flight, without)), namespace))
            progress[namespace] = bar = Progress(flight.sim_node.duration, shown=not number)
            bars.callback(bar.close)
            started[namespace] = []
            *nodes, owner = _nodes(
                file, bags[namespace], composed, namespace, without, recorder_topics(flight))
            last.append((namespace, *owner))
            for node, arguments in nodes:
                started[namespace].append(
                    group.start(*node, arguments, label=_label(namespace, node)))
        for namespace, node, arguments in last:
            started[namespace].append(group.start(
                *node, arguments, _listener(progress[namespace], started[namespace]),
                _label(namespace, node)))
        if without:
            print(_invitation(without, flights, group.domain), flush=True)
        patience = max(flight.sim_node.start_patience for flight in flights.values())
        group.watch(  # the nodes' patience begins when they are loaded
            lambda: all(each.begun for each in progress.values()),
            patience + max(patience, _LOADING))
    outcomes = [
        _outcome(bags[namespace], progress[namespace], started[namespace],
                 flights[namespace], group)
        for namespace in flights]
    if group.fault and not group.interrupts.first:
        raise FlightEndedError(outcomes)
    return outcomes


def _invitation(without: Collection[str], namespaces: Collection[str], domain: int) -> str:
    """Return instructions for the user who starts the missing nodes."""
    topics = ', '.join(f'{namespace}/{REPLACEABLE[name][1]}'
                       for namespace in namespaces for name in without)
    return (f'waiting for your {" and ".join(without)} to publish {topics}; in its shell:\n'
            f'  export ROS_DOMAIN_ID={domain} ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST')


def _label(namespace: str, node: tuple[str, str]) -> str:
    """Return the name of a node in messages, with its namespace if there are several drones."""
    return node[1] if namespace == NAMESPACE else f'{namespace}/{node[1]}'


def _outcome(bag: Path, progress: Progress, nodes: list[NodeProcess],
             flight: scenarios.Scenario, group: NodeGroup) -> Outcome:
    """Return the result of one drone's flight."""
    asked = flight.sim_node.duration
    killed = [node.name for node in nodes if node.exit_code == -signal.SIGKILL]
    closed = nodes[0].exit_code == 0 and bag.exists()
    fault = '; '.join(filter(None, (group.fault, stuck(flight, killed))))
    if fault and progress.flown:
        fault = f'flew {progress.flown:.2f} of {asked:g} s: {fault}'
    return Outcome(
        bag, progress.flown, progress.took, progress.missed, progress.delay,
        group.interrupts.first, _used(nodes), _refused(nodes), closed, fault,
        whole=progress.flown >= asked)


def _listener(progress: Progress, children: list[NodeProcess]) -> Callable[[str], None]:
    """Return a callback for the simulator's lines: in real time it raises the nodes' priority."""
    def on_line(text: str) -> None:
        progress.line(text)
        for child in children if _PACED.search(text) else ():
            if child.name != RECORDER[1]:
                child.raise_priority()
    return on_line


def _used(nodes: list[NodeProcess]) -> dict[str, tuple[float, int]]:
    """Return the CPU time and memory that the nodes printed when they ended."""
    matches = {child.name: _USED.search('\n'.join(child.lines)) for child in nodes}
    return {name: (float(found[1]), int(found[2])) for name, found in matches.items() if found}


def _refused(nodes: list[NodeProcess]) -> dict[str, str]:
    """Return the last line that each node printed about refused messages, by node."""
    lines = '\n'.join(line for child in nodes for line in child.lines)
    return {found[1]: found[2] for found in _REFUSED.finditer(lines)}


def _free(folder: Path, name: str) -> Path:
    """Return folder/name, with a number appended if it exists."""
    path, number = folder / name, 2
    while path.exists():
        path, number = folder / f'{name}_{number}', number + 1
    return path


def parser() -> Parser:
    """Return the command line of ``./run``."""
    out = Parser(
        'run', 'Fly the simulated Mambo in its ROS 2 graph, record a bag, compare, plot.',
        epilog='examples:\n'
               '  ./run                                 the circle (5.3) at 1.5 m\n'
               '  ./run --trajectory z_sine --seed 7    another flight\n'
               '  ./run --scenario fig_5_11             an experiment of the thesis\n'
               '  ./run --composed                      all nodes in one process\n'
               '  ./run --composed --drones 4           four drones, a process each\n'
               '  ./run --mode realtime --duration 30   paced to the wall clock\n'
               '  ./run --set sim_node.simulator.vehicle.drag_coefficient=0.3\n')
    add = out.add_argument
    add('--scenario', metavar='NAME',
        help='an experiment: a name from --list-scenarios, NAME/FLIGHT for one of its flights, or '
                     'a file; the options below override it')
    add('--list-scenarios', action='store_true', help='print the experiments and end')
    choices.add(out, 'circle', CONTROLLER)
    add('--mode', default='lockstep', choices=('lockstep', 'realtime'),
        help='lockstep: as fast as the machine allows, bit-for-bit repeatable (default)')
    add('--speed', type=float, metavar='X',
        help='flight time over wall time, only with --mode realtime (default: 1)')
    add('--composed', action='store_true',
        help='all nodes of a drone in one process: the same bag, faster')
    add('--without', action='append', default=[], choices=tuple(REPLACEABLE), metavar='NODE',
        help=f"leave a node out and wait for yours: one of {', '.join(REPLACEABLE)}; repeatable")
    add('--drones', type=int, default=1, metavar='N',
        help='number of drones, in namespaces /mambo1 to /mamboN, with consecutive seeds from '
                     '--seed, each with its own clock and bag (default: 1)')
    out.add_output('BAG', 'bag to create (default: a new one under bags/)')
    add('--no-report', action='store_true', help='record only: no table, no page of plots')
    return out


def _scenario(options: argparse.Namespace) -> tuple[str, scenarios.Scenario]:
    """Return name and scenario of the flight that the command line selects."""
    given = choices.given(options)
    if options.scenario:
        name, flight = scenario_file.load(options.scenario, given)
    else:
        flight = scenario_file.from_settings(
            {'controller': scenario_file.Place(CONTROLLER, 'default'), **given})
        plan = flight.reference_node.plan
        flown = plan.trajectory if plan.trajectory != COURSE else (
            Path(options.trajectory).stem)
        estimator = ESTIMATORS.find(flight.estimator_node.estimator)
        name = f'{flown}_{estimator.name if estimator else flight.estimator_node.estimator}'
    flight = scenarios.override(flight, {
        'sim_node.mode': options.mode, 'sim_node.speed': 1.0 if options.speed is None else
        options.speed, **choices.overrides(options.set)})
    if options.speed is not None and flight.sim_node.mode != 'realtime':
        raise schema.ParameterError(
            f'--speed {options.speed:g} needs --mode realtime: lockstep always runs at full speed')
    if options.without and options.composed:
        raise schema.ParameterError(
            '--without and --composed exclude each other: your node needs the others as processes')
    if not 1 <= options.drones <= 16:
        raise schema.ParameterError(f'--drones {options.drones} must be within 1 to 16')
    if not flight.sim_node.duration > 0.0:
        raise schema.ParameterError(f'{name}: sim_node.duration must be more than 0 s')
    return f'{name}_seed{flight.seed}', flight


def _list_scenarios() -> None:
    """Print every experiment with its flights."""
    for name in scenario_file.names():
        experiment = scenario_file.read(scenario_file.find(name))
        print(f'{name:<10} {experiment.title}')
        for flight in filter(None, experiment.flights):
            print(f'{"":<10}   {name}/{flight}')


def main(arguments: list[str] | None = None) -> int:
    """Entry point of ``./run``; return the exit code."""
    options = parser().parse_args(arguments)
    return stoppable(program('run'), lambda: guard('run', lambda: _run(options)))


def _run(options: argparse.Namespace) -> None:
    """List the scenarios, print the parameters, or fly."""
    if options.list_scenarios:
        _list_scenarios()
        return
    name, flight = _scenario(options)
    if options.print_scenario:
        print(scenarios.commented_yaml(flight), end='')
    else:
        for line in choices.remarks(flight):
            print(line)
        _fly_and_report(name, flight, options)


def _fly_and_report(
    name: str, flight: scenarios.Scenario, options: argparse.Namespace,
) -> None:
    bag = options.output or _free(Path('bags'), name)
    load('.'.join(node) for node in (COMPOSED, *FLIGHT_NODES, RECORDER, SIMULATOR))
    spaces = [NAMESPACE] if options.drones == 1 else [
        f'{NAMESPACE}{number + 1}' for number in range(options.drones)]
    bags = {space: bag if len(spaces) == 1 else bag / space.strip('/') for space in spaces}
    flights = {space: _reseeded(flight, number) for number, space in enumerate(spaces)}
    problem: FlightError | None = None
    try:
        outcomes = fly_several(
            flights, {space: path.absolute() for space, path in bags.items()}, options.composed,
            tuple(dict.fromkeys(options.without)))
    except FlightEndedError as error:
        problem, outcomes = error, error.outcomes
    stopped = outcomes[0].stopped
    for space, outcome in zip(spaces, outcomes, strict=True):
        if len(spaces) > 1:
            print(f'{space}:')
        reasons = _print_outcome(outcome, bags[space], options.no_report)
        problem = problem or (FlightError(reasons[0]) if reasons else None)
    if stopped:
        raise KeyboardInterrupt(stopped)
    if problem:
        raise problem


def _reseeded(flight: scenarios.Scenario, number: int) -> scenarios.Scenario:
    """Return the flight of a drone: that of the first drone with its own seeds."""
    return scenarios.override(flight, {
        'sim_node.simulator.seed': flight.sim_node.simulator.seed + number,
        'optitrack_node.seed': flight.optitrack_node.seed + number})


def _print_outcome(outcome: Outcome, bag: Path, no_report: bool) -> list[str]:
    """Print the result of a flight; return the reasons for an early end, one line each."""
    what = 'stopped by you after' if outcome.stopped else 'flew'
    print(f'{what} {outcome.flown:.2f} s in {outcome.took:.2f} s of wall time, '
          f'{outcome.missed} steps without their motor command')
    if outcome.delay:
        print(outcome.delay)
    if outcome.used and outcome.took:
        print(outcome.spent())
    for name, counts in outcome.refused.items():
        print(f'warning: {name} refused messages: {counts}')
    if not outcome.closed:
        print(f'bag: {bag} is not closed; mambo recover {bag} NEW_BAG'
              if bag.exists() else 'bag: none')
        return [outcome.fault or f'{bag} is not closed']
    print(f'bag: {bag}\n')
    if outcome.stopped and (
            outcome.whole or not outcome.flown or outcome.stopped != signal.SIGINT):
        return []  # no page, but the reasons for an early end
    reasons = [outcome.fault] if outcome.fault else []
    if reasons and not outcome.flown:
        return reasons  # nothing to compare: the bag has at most the messages of the start
    if no_report:
        reasons += [] if outcome.stopped else ended_early(read_bag(bag, ENDINGS), bool(reasons))
        print(*reasons, sep='\n', end='\n' if reasons else '')
        return reasons
    page, reasons = report(bag, outcome.real_time_factor, reasons, bool(outcome.stopped))
    print(f'\npage: {page}')
    return reasons


def report(bag: Path, real_time_factor: float | None = None, fault: Sequence[str] = (),
           stopped: bool = False) -> tuple[Path, list[str]]:
    """
    Print the table of a flight and write its page of plots into the bag's directory.

    Parameters
    ----------
    bag
        Bag of the flight.
    real_time_factor
        Flight time over wall time, if known.
    fault
        Known reasons for the end of the flight, one line each.
    stopped
        Whether the user ended the flight, which may then be shorter than planned.

    Returns
    -------
    Path of the page; reasons for an early end, one line each.

    Raises
    ------
    mambo_bags.reader.BagError
        If the bag cannot be read.

    """
    from mambo_analysis.compare.compare import compare, table
    from mambo_analysis.compare.page import write_page
    recording = read_bag(bag)
    result = compare(recording)
    if real_time_factor is not None:
        result['real_time_factor'] = real_time_factor
    result['ending'] = [*fault, *ended_early(recording, bool(fault) or stopped)]
    print(table(result))
    return write_page(recording, result, bag), result['ending']


if __name__ == '__main__':
    raise SystemExit(main())
