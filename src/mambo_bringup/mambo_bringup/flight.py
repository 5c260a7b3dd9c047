"""
Fly a scenario in the real graph: every node its own process, or all of them composed in one,
everything recorded, then compared.

``./run`` and ``ros2 run mambo_bringup fly`` end here.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
import json
from pathlib import Path
import re
import signal
import sys
import tempfile

from mambo_analysis import scenario as scenarios, scenario_file
from mambo_analysis.bag import read_bag
from mambo_analysis.cli import guard
from mambo_control.parameters import ControllerNodeParams
from mambo_estimation.parameters import EstimatorNodeParams
from mambo_model import schema
from mambo_model.trajectory import TRAJECTORIES
from mambo_model.vehicle import PRESETS
from tqdm import tqdm

from .domain import Domain
from .processes import FlightError, Interrupts, load, NodeProcess, parameter, watch

FLIGHT_NODES = (
    ('mambo_sim', 'optitrack_node'), ('mambo_estimation', 'estimator_node'),
    ('mambo_control', 'reference_node'), ('mambo_control', 'controller_node'))
RECORDER = ('mambo_sim', 'recorder_node')
SIMULATOR = ('mambo_sim', 'sim_node')
COMPOSED = ('mambo_bringup', 'composed_node')
NAMESPACE = '/mambo'
_ORDER = {RECORDER[1]: 0, SIMULATOR[1]: 2, COMPOSED[1]: 2}  # those that own time are the last
_FLOWN = re.compile(
    r'flew ([\d.]+) s in ([\d.]+) s of wall time, (\d+) steps without their motor command')
_DELAY = re.compile(r'IMU sample to motor command: .*')
_USED = re.compile(r'used ([\d.]+) s of CPU and (\d+) MB')
_PACED = re.compile(r'flying in realtime mode$')
_TIME = re.compile(r't = ([\d.]+) s$')


@dataclass
class Outcome:
    """What a flight was."""

    bag: Path
    flown: float  # s of flight time
    took: float  # s of wall time, from the first to the last step
    missed: int  # steps that had no motor command in time
    delay: str  # wall time from IMU sample to motor command, one line
    stopped: bool  # by the user
    used: dict[str, tuple[float, int]]  # by node: s of CPU, MB of memory at most

    @property
    def real_time_factor(self) -> float:
        """Return flight time over wall time."""
        return self.flown / self.took if self.took else float('nan')

    def spent(self) -> str:
        """Return what the nodes used as one line, those with most first."""
        cpu = {name.removesuffix('_node'): seconds / self.took
               for name, (seconds, _) in self.used.items()}
        nodes = ', '.join(f'{name} {cpu[name]:.2f}' for name in sorted(cpu, key=cpu.get)[::-1])
        memory = max(memory for _, memory in self.used.values())
        return f'CPU: {sum(cpu.values()):.2f} cores: {nodes}; memory: {memory} MB at most'


class Progress:
    """Progress bar of flight time, fed by the simulator's own lines."""

    def __init__(self, duration: float, shown: bool = True) -> None:
        self.flown, self.took, self.missed, self.delay = 0.0, 0.0, 0, ''
        self._bar = tqdm(
            total=duration, desc='starting (compiles once)', leave=False,
            disable=None if shown else True,
            bar_format='{desc} {bar} {n:.1f}/{total:.0f} s of flight, {elapsed} elapsed')

    def line(self, text: str) -> None:
        """Take one line of the simulator."""
        if found := _FLOWN.search(text):
            self.flown, self.took, self.missed = float(found[1]), float(found[2]), int(found[3])
        elif found := _DELAY.search(text):
            self.delay = found[0]
        elif found := _TIME.search(text):
            self._bar.set_description_str('flying', refresh=False)
            self._bar.update(float(found[1]) - self._bar.n)

    def close(self) -> None:
        """Take the bar away."""
        self._bar.close()


def _mode() -> dict[str, object]:
    """Return the sim_node parameters that belong to the run and not to the experiment."""
    waited = [name for _, name in (*FLIGHT_NODES, RECORDER)]
    return {'sim_node.wait_for': ','.join(waited)}


def _start(file: Path, bag: Path, composed: bool, namespace: str,
           on_line: Callable[[str], None]) -> Iterator[NodeProcess]:
    """Start the processes of a drone; yield each as it starts."""
    arguments = ['--ros-args']
    if namespace != NAMESPACE:  # one of several: its own time, frames and health
        arguments += ['-r', f'__ns:={namespace}']
        for topic in ('clock', 'tf', 'diagnostics'):
            arguments += ['-r', f'/{topic}:={topic}']
    flown = [*arguments, '--params-file', str(file)]
    if composed:
        recorder = file.with_name(f'recorder_{file.name}')
        recorder.write_text(json.dumps({f'{namespace}/recorder_node': {  # which is YAML
            'ros__parameters': {'bag': str(bag), 'scenario': str(file)}}}, ensure_ascii=False))
        yield NodeProcess(*COMPOSED, [*flown, '--params-file', str(recorder)], on_line)
        return
    yield NodeProcess(*RECORDER, [
        *arguments, *parameter('bag', bag), *parameter('scenario', file)])
    for node in FLIGHT_NODES:
        yield NodeProcess(*node, flown)
    yield NodeProcess(*SIMULATOR, flown, on_line)


def fly(flight: scenarios.Scenario, bag: Path, composed: bool = False) -> Outcome:
    """
    Fly a scenario in the graph and record it.

    Parameters
    ----------
    flight
        Scenario with a duration.
    bag
        Directory to make.
    composed
        All nodes in one process instead of one each: the same bag, sooner.

    Raises
    ------
    FlightError
        If a node does not start or dies; the bag holds what was flown until then.

    """
    return fly_several({NAMESPACE: flight}, {NAMESPACE: bag}, composed)[0]


def fly_several(flights: Mapping[str, scenarios.Scenario], bags: Mapping[str, Path],
                composed: bool = False) -> list[Outcome]:
    """
    Fly drones side by side, each by its own clock, and record each in its own bag.

    Parameters
    ----------
    flights, bags
        By the namespace of the drone; further as :func:`fly`.
    composed
        One process for each drone instead of one for each node.

    Raises
    ------
    FlightError
        If a node does not start or dies; the bags hold what was flown until then.

    """
    for bag in bags.values():
        if bag.exists():
            raise FlightError(f'{bag} exists: give another --output or remove it')
    with (Domain(), tempfile.TemporaryDirectory(prefix='mambo_') as folder,
          Interrupts() as interrupts):
        progress: list[Progress] = []
        children: list[NodeProcess] = []
        crews: list[list[NodeProcess]] = []  # of each drone
        try:
            for number, (namespace, flight) in enumerate(flights.items()):
                file = Path(folder) / f'scenario{number or ""}.yaml'
                file.write_text(scenarios.commented_yaml(
                    scenarios.override(flight, _mode()), namespace))
                progress.append(Progress(flight.sim_node.duration, shown=not number))
                before = len(children)
                children.extend(_start(
                    file, bags[namespace], composed, namespace,
                    _listener(progress[-1], children)))
                crews.append(children[before:])
            children.sort(key=lambda child: _ORDER.get(child.name, 1))
            watch(children, interrupts, len(flights))
        finally:
            codes = _end(children)
            for bar in progress:
                bar.close()
    for child, code in codes:  # the cause before its consequences
        # a node that is interrupted while Python still loads it ends by the signal
        if code not in (0, -signal.SIGINT):
            raise FlightError(f'{child.name} ended with exit code {code}: {child.complaint()}')
    return [Outcome(bag, p.flown, p.took, p.missed, p.delay, interrupts.count > 0, _used(crew))
            for bag, p, crew in zip(bags.values(), progress, crews, strict=True)]


def _listener(progress: Progress, children: list[NodeProcess]) -> Callable[[str], None]:
    """Return what hears a simulator: once time is real, all hurry who must answer in time."""
    def hear(text: str) -> None:
        progress.line(text)
        for child in children if _PACED.search(text) else ():
            if child.name != RECORDER[1]:
                child.hurry()
    return hear


def _used(crew: list[NodeProcess]) -> dict[str, tuple[float, int]]:
    """Return what nodes said at their end that they had used."""
    said = {child.name: _USED.search('\n'.join(child.lines)) for child in crew}
    return {name: (float(found[1]), int(found[2])) for name, found in said.items() if found}


def _end(children: list[NodeProcess]) -> list[tuple[NodeProcess, int]]:
    """End all processes, recorders when the others have left; return those that failed first."""
    failed = [child for child in children if child.exit_code]
    for child in children:
        if child.name != RECORDER[1]:
            child.interrupt()
    codes = {id(child): child.end(20.0) for child in reversed(children)}
    return [(child, codes[id(child)]) for child in [*failed, *children]]


def _free(folder: Path, name: str) -> Path:
    """Return folder/name, numbered where that exists."""
    path, number = folder / name, 2
    while path.exists():
        path, number = folder / f'{name}_{number}', number + 1
    return path


def _overrides(assignments: list[str]) -> dict[str, object]:
    """Read ``node.parameter=value`` arguments."""
    out = {}
    for assignment in assignments:
        name, equals, value = assignment.partition('=')
        if not equals:
            raise schema.ParameterError(f'--set {assignment}: write node.parameter=value')
        try:
            out[name.strip()] = scenarios.read_value(value)
        except schema.ParameterError:
            raise schema.ParameterError(f'--set {assignment}: cannot read the value') from None
    return out


def _options(params_type: type, name: str) -> tuple[str, ...]:
    return dict(schema.walk(params_type))[name].metadata['options']


def parser() -> argparse.ArgumentParser:
    """Return the command line of ``./run``."""
    out = argparse.ArgumentParser(
        prog='run', formatter_class=argparse.RawDescriptionHelpFormatter,
        description='Fly the simulated Mambo in its ROS 2 graph, record a bag, compare, plot.',
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
        help='an experiment: a name of --list-scenarios, NAME/FLIGHT for one of its flights, or '
        'a file; the choices below replace its own')
    add('--list-scenarios', action='store_true', help='print the experiments and end')
    add('--print-scenario', action='store_true',
        help='print every parameter with unit, range and source and end')
    add('--trajectory', choices=tuple(TRAJECTORIES), metavar='NAME',
        help=f"one of: {', '.join(TRAJECTORIES)} (default: circle)")
    add('--estimator', choices=_options(EstimatorNodeParams, 'estimator'),
        help='default: kalman')
    add('--controller', choices=_options(ControllerNodeParams, 'controller'),
        help='default: cascaded')
    add('--duration', type=float, metavar='S',
        help='flight time in s, landing included where it fits (default: 40)')
    add('--seed', type=int, metavar='N', help='of every noise stream (default: 1)')
    add('--vehicle', metavar='NAME',
        help=f"true vehicle, one of: {', '.join(PRESETS)}, or a file (default: identified)")
    add('--believed', metavar='NAME',
        help='vehicle that the controller believes in (default: the true one)')
    add('--mode', default='lockstep', choices=('lockstep', 'realtime'),
        help='lockstep: as fast as the machine allows, repeatable to the bit (default)')
    add('--speed', type=float, default=1.0, metavar='X',
        help='flight over wall time in realtime mode (default: 1)')
    add('--composed', action='store_true',
        help='all nodes of a drone in one process: the same bag, sooner')
    add('--drones', type=int, default=1, metavar='N',
        help='drones side by side, in namespaces /mambo1 to /mamboN, with seeds from --seed on, '
        'each by its own clock, in its own bag (default: 1)')
    add('--no-noise', dest='noise', action='store_false', default=None,
        help='sensors without noise and bias')
    add('--no-landing', dest='landing', action='store_false', default=None,
        help='stay on the trajectory to the end')
    add('--set', action='append', default=[], metavar='NODE.PARAMETER=VALUE',
        help='any parameter of any node, repeatable')
    add('--output', type=Path, metavar='DIR',
        help='bag to make (default: a new one under bags/)')
    add('--no-report', action='store_true', help='record only: no table, no page of plots')
    return out


def _scenario(options: argparse.Namespace) -> tuple[str, scenarios.Scenario]:
    """Return name and scenario of the flight that the command line asks for."""
    given = {
        name: scenario_file.Place(value, f'--{name}') for name in scenario_file.FIELDS
        if (value := getattr(options, name, None)) is not None}
    if options.scenario:
        name, flight = scenario_file.load(options.scenario, given)
    else:
        flight = scenario_file.from_settings(given)
        plan, estimator = flight.reference_node.plan, flight.estimator_node.estimator
        name = f'{plan.trajectory}_{estimator}'
    flight = scenarios.override(flight, {
        'sim_node.mode': options.mode, 'sim_node.speed': options.speed, **_overrides(options.set)})
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


def main(arguments: list[str] | None = None) -> None:
    """Entry point of ``./run``."""
    options = parser().parse_args(arguments)
    try:
        if options.list_scenarios:
            sys.exit(guard('run', _list_scenarios))
        name, flight = _scenario(options)
    except schema.ParameterError as error:
        print(f'run: {error}', file=sys.stderr)
        sys.exit(2)
    if options.print_scenario:
        sys.exit(guard('run', lambda: print(scenarios.commented_yaml(flight), end='')))
    sys.exit(guard('run', lambda: _fly_and_report(name, flight, options), FlightError))


def _fly_and_report(
    name: str, flight: scenarios.Scenario, options: argparse.Namespace,
) -> None:
    bag = options.output or _free(Path('bags'), name)
    load('.'.join(node) for node in (COMPOSED, *FLIGHT_NODES, RECORDER, SIMULATOR))
    if options.drones == 1:
        _tell(fly(flight, bag.absolute(), options.composed), bag, options.no_report)
        return
    spaces = [f'{NAMESPACE}{number + 1}' for number in range(options.drones)]
    bags = {space: bag / space.strip('/') for space in spaces}
    flights = {space: _reseeded(flight, flight.seed + number)
               for number, space in enumerate(spaces)}
    outcomes = fly_several(
        flights, {space: path.absolute() for space, path in bags.items()}, options.composed)
    for space, outcome in zip(spaces, outcomes, strict=True):
        print(f'{space}:')
        _tell(outcome, bags[space], options.no_report)


def _reseeded(flight: scenarios.Scenario, seed: int) -> scenarios.Scenario:
    return scenarios.override(
        flight, {'sim_node.simulator.seed': seed, 'optitrack_node.seed': seed})


def _tell(outcome: Outcome, bag: Path, no_report: bool) -> None:
    """Print what a flight was."""
    what = 'stopped by you after' if outcome.stopped else 'flew'
    print(f'{what} {outcome.flown:.2f} s in {outcome.took:.2f} s of wall time, '
          f'{outcome.missed} steps without their motor command')
    if outcome.delay:
        print(outcome.delay)
    if outcome.used and outcome.took:
        print(outcome.spent())
    print(f'bag: {bag}\n')
    if not no_report:
        print(f'\npage: {report(bag, outcome.real_time_factor)}')


def report(bag: Path, real_time_factor: float | None = None) -> Path:
    """
    Print the table of a flight and write its page of plots into the bag's directory.

    Returns
    -------
    Path of the page.

    Raises
    ------
    mambo_analysis.bag.BagError
        If the bag cannot be read.

    """
    from mambo_analysis.compare import compare, table
    from mambo_analysis.page import write_page
    recording = read_bag(bag)
    result = compare(recording)
    if real_time_factor is not None:
        result['real_time_factor'] = real_time_factor
    print(table(result))
    return write_page(recording, result, bag)


if __name__ == '__main__':
    main()
