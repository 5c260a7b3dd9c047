"""
The command ``mambo run``: fly a scenario in the ROS graph, record it, compare and plot.

``./run`` and ``mambo run`` are the command lines of this module.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
import os
from pathlib import Path
import signal

from mambo_analysis.compare.ending import (
    ended_early, ended_in_the_air, ENDINGS, landed_by_itself)
from mambo_bags.cli.option_types import real, whole
from mambo_bags.command import guard, Parser, program
from mambo_bags.reader import read_bag
from mambo_estimation.filters import REGISTRY as ESTIMATORS
from mambo_flight import flight_options, scenario as scenarios, scenario_file
from mambo_flight.world import formation, plot_separation, separation
from mambo_flight.world.world_file import check_cameras, Hall
from mambo_model import schema
from mambo_model.errors import InputError, readable
from mambo_model.motion.trajectory import COURSE
from mambo_model.whole_file import exists
from mambo_ros.graph import loopback
from mambo_ros.topics import NAMESPACE
from mambo_sim import lockstep
from mambo_view import page as view
from mambo_view.page import PORT

from . import domain
from .flight import natnet
from .flight.nodes import (
    COMPOSED, FLIGHT_NODES, HALL_CAPTURE, RECORDER, REPLACEABLE, SIMULATOR)
from .flight.outcome import FlightEndedError, Outcome, print_refused
from .flight.runner import fly_several
from .processes import FlightError, load, refuse_bag
from .stopping import stoppable

CONTROLLER = 'flatness_drag'
"""Default controller of ``./run``; unlike that of the thesis it compensates rotor drag."""


_SPEED = scenarios.LEAVES['sim_node.speed'].metadata


def _free(folder: Path, name: str) -> Path:
    """Return folder/name, with a number appended if it exists."""
    path, number = folder / name, 2
    while exists(path):
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
               '  ./run --drones 4                      four drones in one hall\n'
               '  ./run --processes                     every node a process of its own\n'
               '  ./run --mode realtime --duration 30   paced to the wall clock\n'
               '  ./run --scenario motion_capture --natnet   poses through a NatNet server\n'
               '  ./run --set sim_node.simulator.vehicle.drag_coefficient=0.3\n')
    add = out.add_argument
    add('--scenario', metavar='NAME',
        help='an experiment: a name from --list-scenarios, NAME/FLIGHT for one of its flights, or '
                     'a file; the options below override it')
    add('--list-scenarios', action='store_true', help='print the experiments and end')
    flight_options.add(out, 'circle', CONTROLLER)
    add('--mode', choices=('lockstep', 'realtime'),
        help='lockstep: as fast as the machine allows, bit-for-bit repeatable (default)')
    add('--speed', type=real(_SPEED['low'], _SPEED['high']), metavar='X',
        help='flight time over wall time, only with --mode realtime (default: 1)')
    add('--commanded', action='store_true', default=None,
        help='wait on the floor for commands, such as mambo takeoff, in place of a trajectory; '
             'best with --mode realtime, or with --paused')
    add('--paused', action='store_true', default=None,
        help='begin paused: mambo step makes single steps, mambo resume goes on')
    add('--composed', action='store_true',
        help='all nodes of a drone in one process (default in lockstep, without --without)')
    add('--processes', action='store_true',
        help='every node a process of its own (default otherwise): the same bag, slower')
    add('--without', action='append', default=[], choices=tuple(REPLACEABLE), metavar='NODE',
        help=f"leave a node out and wait for yours: one of {', '.join(REPLACEABLE)}; repeatable")
    add('--natnet', type=whole(1024, 65534), nargs='?', const=natnet.PORT, default=0,
        metavar='PORT',
        help='serve the hall as Motive does, by NatNet at this command port of 127.0.0.1 and the '
             f'data port after it, and take the poses from there, in real time '
             f'(default port: {natnet.PORT})')
    add('--view', type=whole(1, 65535), nargs='?', const=PORT, default=0, metavar='PORT',
        help='show the flight in the browser while it flies, best with --mode realtime '
             f'(default port: {PORT})')
    out.add_output('BAG', 'bag to create (default: a new one under bags/)')
    add('--no-report', action='store_true', help='record only: no table, no page of plots')
    return out


def _scenario(options: argparse.Namespace) -> scenario_file.Selected:
    """Return the flight that the command line selects."""
    others: list[str] = []
    if options.scenario:
        name, flight, others = scenario_file.select(
            options.scenario, flight_options.over(options))
    else:
        flight = scenario_file.from_settings({
            'controller': scenario_file.Place(CONTROLLER, 'default'),
            **flight_options.given(options)})
        plan = flight.reference_node.plan
        path = plan.trajectory if plan.trajectory != COURSE else Path(options.trajectory).stem
        estimator = ESTIMATORS.find(flight.estimator_node.estimator)
        name = f'{path}_{estimator.name if estimator else flight.estimator_node.estimator}'
    if options.commanded:
        if options.trajectory:
            raise schema.ParameterError(
                '--commanded and --trajectory exclude each other: mambo follow FILE flies one')
        flight = scenarios.override(flight, {'reference_node.commands.enabled': True})
        name = name if options.scenario else 'commanded'
    mode, speed = options.mode or ('realtime' if options.natnet else 'lockstep'), options.speed
    if speed is None:  # that of a scenario is for real time
        speed = flight.sim_node.speed if mode == 'realtime' else 1.0
    flight = flight_options.applied(scenarios.override(flight, {
        **({'sim_node.paused': True} if options.paused else {}),
        'sim_node.mode': mode, 'sim_node.speed': speed}), options)
    if options.composed and options.processes:
        raise schema.ParameterError('--composed and --processes exclude each other')
    if options.without and options.composed:
        raise schema.ParameterError(
            '--without and --composed exclude each other: your node needs the others as processes')
    if options.natnet:
        flight = _with_natnet(flight, options)
    if 'optitrack' in options.without and flight.estimator_node.waits_for_capture:
        # a hall of the user's publishes poses, and no ticks
        flight = scenarios.override(flight, {'estimator_node.synchronise': 'arrival'})
    flown = flight.sim_node
    if flown.mode != 'realtime' and (options.speed is not None or flown.speed != 1.0):
        option = '--speed' if options.speed is not None else '--set sim_node.speed'
        raise schema.ParameterError(
            f'{option} {flown.speed:g} needs --mode realtime: lockstep always runs at full speed')
    if not flight.sim_node.duration > 0.0:
        raise schema.ParameterError(f'{name}: sim_node.duration must be more than 0 s')
    return scenario_file.Selected(f'{name}_seed{flight.seed}', flight, others)


def _composed(options: argparse.Namespace, mode: str) -> bool:
    """Return whether the nodes of a drone share a process, in a mode of the simulator."""
    if options.composed or options.processes or options.without:
        return options.composed
    return mode == 'lockstep'  # where it is faster and gives the same bag


def _with_natnet(
    flight: scenarios.Scenario, options: argparse.Namespace,
) -> scenarios.Scenario:
    """Return the flight with a NatNet server; ParameterError if the options exclude it."""
    if options.mode == 'lockstep':
        raise schema.ParameterError(
            '--natnet needs --mode realtime, its default: it serves poses by the wall clock')
    for given, option in ((options.composed, '--composed'),
                          ('optitrack' in options.without, '--without optitrack')):
        if given:
            raise schema.ParameterError('--natnet serves drones with their nodes as processes: '
                                        f'leave out {option}')
    return natnet.scenario(flight)


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
    name, flight, others = _scenario(options)
    world = flight_options.world(options)
    if flight_options.only_prints(options):
        print(scenarios.commented_yaml(flight), end='')
        return
    for line in flight_options.remarks(flight, options.stretch, options.trajectory):
        print(line)
    if others:
        print(f'the first of {1 + len(others)} flights of the file; the others: '
              f'{", ".join(others)}')
    if world.drones == 1:
        _fly_and_report(name, {NAMESPACE: flight}, options)
        return
    drones = formation.hall(flight, world, flight_options.timed(options))
    check_cameras(drones.hall, drones.flights)
    for line in formation.remarks(drones):
        print(line)
    _fly_and_report(
        name, dict(zip(drones.hall.places, drones.flights, strict=True)), options, drones.hall)


def _fly_and_report(
    name: str, flights: dict[str, scenarios.Scenario], options: argparse.Namespace,
    hall: Hall | None = None,
) -> None:
    """Fly one drone, or several in a hall; print the result of each, and of all."""
    bag = options.output or _free(Path('bags'), readable(name))
    refuse_bag(bag)
    domain.check()  # before anything is compiled
    spaces = list(flights)
    composed = _composed(options, flights[spaces[0]].sim_node.mode)
    if os.environ.get(loopback.RANGE) == 'OFF' and not composed:
        raise InputError(f'{loopback.RANGE}=OFF keeps nodes from finding each other: unset it, or '
                         'fly with --composed')
    if options.natnet:
        natnet.check_ports(options.natnet)
    if options.view:
        view.check(options.view)
        print(f'view: {view.address(options.view)}', flush=True)
    copies = load('.'.join(node) for node in (
        COMPOSED, *FLIGHT_NODES, HALL_CAPTURE, RECORDER, SIMULATOR,
        *((natnet.SERVER, natnet.CLIENT) if options.natnet else ())))
    if copies and composed:
        from .compiling import compile_ahead  # imports all nodes, as `load` has
        compile_ahead(flights[spaces[0]])
    bags = {space: bag if len(spaces) == 1 else bag / space.strip('/') for space in spaces}
    told: list[str] = []
    try:
        outcomes = fly_several(
            flights, {space: path.absolute() for space, path in bags.items()},
            composed, tuple(dict.fromkeys(options.without)), options.natnet, options.view, hall)
    except FlightEndedError as error:
        told, outcomes = [str(error)], error.outcomes
    stopped = outcomes[0].stopped
    for space, outcome in zip(spaces, outcomes, strict=True):
        if len(spaces) > 1:
            print(f'{space}:')
        reasons = _print_outcome(outcome, bags[space], options.no_report)
        if options.natnet and outcome.closed and outcome.flown:
            reasons += _without_poses(bags[space], flights[space])
        told += [reason if len(spaces) == 1 or reason in told else f'{space}: {reason}'
                 for reason in reasons]
    if hall is not None:
        _print_hall(outcomes[0])
        told = _print_separation(bag, outcomes, hall, options.no_report) + told
    if stopped:
        raise KeyboardInterrupt(stopped)
    if told:
        raise FlightError('; '.join(dict.fromkeys(told)))


def _without_poses(bag: Path, flight: scenarios.Scenario) -> list[str]:
    """Print which poses a flight through NatNet lacks; return it if that is a failure."""
    line, failed = natnet.missing(bag, flight)
    if line:
        print(line)
    return [line] if failed else []


def _print_hall(outcome: Outcome) -> None:
    """Print what the outcome of any drone of a hall says of all of them."""
    lines = [f'warning: {line}' for line in outcome.hall_remarks]
    if outcome.hall_used and outcome.took:
        lines.append(outcome.hall_spent())
    if lines:
        print('all drones:', *lines, sep='\n')


def _print_separation(
    bag: Path, outcomes: list[Outcome], hall: Hall, no_report: bool,
) -> list[str]:
    """Print the separation of drones, draw it, print collisions; return these."""
    if all(outcome.closed and outcome.flown for outcome in outcomes):
        found = separation.pairs(separation.read([bag])[0])
        print(separation.table(found, hall.params.collision_distance))
        picture = bag / 'separation.png'
        plot_separation.draw(picture, found, hall.params.collision_distance)
        print(f'picture: {picture}')
        if not no_report:
            from mambo_analysis.compare import separation_page
            print(f"page: {separation_page.write(bag / 'index.html', bag)}")
    collisions = outcomes[0].collisions
    print(*collisions, sep='\n', end='\n' if collisions else '')
    return collisions


def _print_outcome(outcome: Outcome, bag: Path, no_report: bool) -> list[str]:
    """Print the result of a flight; return the reasons for an early end, one line each."""
    what = 'stopped by you after' if outcome.stopped else 'flew'
    if outcome.took:
        print(f'{what} {outcome.flown:.2f} s in {outcome.took:.2f} s of wall time, '
              f'{lockstep.answers(outcome.missed, outcome.late)}')
    elif outcome.flown or outcome.closed or not outcome.recorded:
        # the simulator was ended before it could say
        print(f'{what} at least {outcome.flown:.2f} s')
    else:
        print('how long it flew is in the bag, which is not closed')
    if outcome.delay:
        print(outcome.delay)
    if line := outcome.overloaded():
        print(line)
    for line in outcome.remarks:
        print(f'warning: {line}')
    if outcome.used and outcome.took:
        print(outcome.spent())
    print_refused(outcome.refused)
    if not outcome.closed:
        print(f'bag: {bag} is not closed; mambo recover {bag} NEW_BAG'
              if outcome.recorded else 'bag: none')
        return [outcome.fault or f'{bag} is not closed']
    print(f'bag: {bag}\n')
    if outcome.stopped and (
            outcome.whole or not outcome.flown or outcome.stopped != signal.SIGINT):
        return []  # no page, but the reasons for an early end
    reasons = [outcome.fault] if outcome.fault else []
    if reasons and not outcome.flown:
        return reasons  # nothing to compare: the bag has at most the messages of the start
    reasons += outcome.dropped
    if no_report:
        recording = read_bag(bag, ENDINGS)
        recording.leave_out_unreadable()
        reasons += [] if outcome.stopped else ended_early(recording, bool(reasons))
        notes = [*landed_by_itself(recording), *ended_in_the_air(recording)]
        lines = [*reasons, *(f'note: {note}' for note in notes)]
        print(*lines, sep='\n', end='\n' if lines else '')
        return reasons
    page, reasons = report(bag, outcome.real_time_factor, reasons, bool(outcome.stopped))
    print(f'\npage: {page}')
    return reasons


def report(bag: Path, real_time_factor: float | None = None, fault: Sequence[str] = (),
           stopped: bool = False) -> tuple[Path, list[str]]:
    """
    Print the table of a flight and write its page into the bag's directory.

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
    from mambo_analysis.compare import report as page
    from mambo_analysis.compare.compare import compare, table
    recording = read_bag(bag)
    recording.leave_out_unreadable()
    result = compare(recording)
    if real_time_factor is not None:
        result['real_time_factor'] = real_time_factor
    result['ending'] = [*fault, *ended_early(recording, bool(fault) or stopped)]
    print(table(result))
    written = page.write(bag / 'index.html', page.of_one(recording, result))
    return written, result['ending']


if __name__ == '__main__':
    raise SystemExit(main())
