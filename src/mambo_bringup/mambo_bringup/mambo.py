"""
The command ``mambo``: one name for everything the workspace does.

``mambo --help`` lists the commands by use, ``mambo COMMAND --help`` explains one. Each command is
a module with two functions: ``parser()`` returns its command line, ``main(arguments)`` runs it and
returns the exit code: 0, 1 for a failed job, 2 for wrong input. A module is imported only when its
command is used.
"""

from __future__ import annotations

import argparse
from importlib import import_module
import os
from pathlib import Path
import shlex
import subprocess
import sys
from typing import NamedTuple

from mambo_bags import command
from mambo_bags.cli import environment


class Command(NamedTuple):
    """
    One command.

    Attributes
    ----------
    module : str
        Module with ``parser`` and ``main``, or a script of the checkout with its first argument.
    summary : str
        What the command does, in one line.

    """

    module: str
    summary: str


GROUPS: dict[str, dict[str, Command]] = {
    'Fly': {
        'run': Command('mambo_bringup.run', 'fly a scenario in the ROS graph, record, report'),
        'fly': Command('mambo_flight.fly', 'fly a scenario in one process without ROS, many times '
        'faster than real time'),
        'sweep': Command('mambo_flight.sweep.command', 'fly a scenario many times over seeds, '
                         'vehicles, wind, gains'),
        'trajectory check': Command('mambo_flight.course.check_course', 'whether the vehicle can '
                                    'fly a course, and where it fails'),
        'trajectory plan': Command('mambo_flight.course.plan_course', 'polynomials of minimum '
                                   'snap through waypoints'),
        'check-node': Command('mambo_bringup.checking.check', 'whether a node of yours keeps the '
                              'contract of the graph'),
        'bound': Command('mambo_analysis.capture.recorded_bound', 'compare the joint filter '
                         'with the Cramer-Rao lower bound'),
        'consistency': Command('mambo_flight.accuracy.consistency', 'whether the covariance of '
                               'the joint filter matches its errors (NEES, NIS)'),
        'estimators': Command('mambo_thesis.estimators.estimators', 'compare the joint filter, '
                              'the default, with the Kalman filters of the thesis'),
        'coverage': Command('mambo_flight.smooth.coverage', 'smooth many flights: how often the '
                            'intervals hold the true values'),
        'race': Command('mambo_flight.race.race', 'fly every controller over the same courses '
                        'in the same wind'),
    },
    'Command a running flight': {
        'takeoff': Command('mambo_bringup.commanding.takeoff', 'climb and hover'),
        'go-to': Command('mambo_bringup.commanding.go_to', 'fly to a position and hover'),
        'follow': Command('mambo_bringup.commanding.follow', 'follow the file of a course'),
        'stop': Command('mambo_bringup.commanding.halt', 'come to rest and hover'),
        'land': Command('mambo_bringup.commanding.land', 'stop, descend, motors off'),
        'pause': Command('mambo_bringup.commanding.pause', 'pause the simulation'),
        'step': Command('mambo_bringup.commanding.single_step', 'advance by single steps while '
                        'paused'),
        'resume': Command('mambo_bringup.commanding.resume', 'go on after a pause'),
        'set': Command('mambo_bringup.commanding.set_parameters', 'change gains, noise, wind, '
                       'faults or speed'),
    },
    'Watch': {
        'view': Command('mambo_view.view', 'a running flight or a bag in the browser, in 3-D'),
        'urdf': Command('mambo_description.urdf', 'the URDF of a vehicle, for RViz and others'),
    },
    'Bags': {
        'compare': Command('mambo_analysis.compare.compare', 'errors of a flight, or of flight A '
                           'against flight B; report'),
        'separation': Command('mambo_flight.world.separation', 'distances between the '
                              'drones of a flight'),
        'replay': Command('mambo_bringup.replay', "play a bag's sensors to a live estimator"),
        'estimate': Command('mambo_analysis.compare.estimate', 'run an estimator '
                            'over a bag, offline and without ROS'),
        'recover': Command('mambo_bags.recover', 'save what is readable of a damaged bag'),
        'digest': Command('mambo_bags.cli.digest', 'whether two bags hold the same messages'),
        'join': Command('mambo_analysis.importers.join', "a drone's log and its motion capture "
                        'as one bag'),
        'import bag': Command('mambo_analysis.importers.any_bag', 'any rosbag2 or MCAP bag'),
        'import crazyflie': Command('mambo_analysis.importers.crazyflie', 'Crazyflie log with '
                                    'motion capture (JSON)'),
        'import minidrone': Command('mambo_analysis.importers.minidrone', 'Parrot minidrone log '
                                    '(.mat)'),
        'import motive': Command('mambo_analysis.importers.motive', 'Optitrack Motive take (CSV)'),
        'import table': Command('mambo_analysis.importers.any_table', 'CSV or Parquet table, by a '
                                'mapping of its columns'),
    },
    'Identify, each value with its interval': {
        'identify thrust': Command('mambo_analysis.identify.thrust', 'motor map from a bench'),
        'identify inertia': Command('mambo_analysis.identify.inertia', 'moment of inertia from a '
                                    'pendulum'),
        'identify drag': Command('mambo_analysis.identify.drag', 'rotor drag from a flight'),
        'identify motor': Command('mambo_analysis.identify.motor', 'motor lag from a flight'),
        'identify flight': Command('mambo_analysis.twin.identify_flight', 'thrust, drag, lag, '
                                   'biases and noise from one flight'),
        'identify coverage': Command('mambo_analysis.twin.coverage', 'fly many seeds: how often '
                                     'the intervals of identify flight hold'),
        'identify flow': Command('mambo_analysis.identify.flow', 'factor of the optical flow'),
        'twin': Command('mambo_analysis.twin.twin', 'how well a model predicts flights it has not '
                        'seen'),
        'identify sensors': Command('mambo_analysis.identify.sensors.command',
                                    'noise, rates and delays of the sensors'),
        'identify drift': Command('mambo_thesis.drift.identify_drift', 'which mechanism makes the '
                                  'position drift'),
    },
    'Thesis': {
        'reproduce': Command('mambo_thesis.reproduce', 'fly and redraw every figure, judge every '
                             'claim'),
        'drift': Command('mambo_thesis.drift.experiments', 'the experiments on the drift'),
        'recordings': Command('mambo_thesis.recordings.validate', 'measure the public recordings'),
    },
    'Workspace': {
        'policy': Command('mambo_bringup.policy', 'write the SROS2 policy: which node may publish '
                          'and subscribe what'),
        'docs': Command('tools/docs.py', 'build or serve the documentation'),
        'test': Command('test', 'run every test'),
        'bench': Command('bench', 'measure speed beside C and another simulator'),
        'chaos': Command('chaos', 'inject faults into flights; each must end as it should'),
        'mutants': Command('mutants', 'break the equations one at a time; a test must notice'),
    },
}
TABLES = ('.csv', '.parquet', '.pq')
"""Endings of files that `mambo import FILE` takes for tables."""
_ROS = ('mambo_bringup.', 'mambo_view.')  # begin the modules of commands that use ROS
COMMANDS = {name: entry for group in GROUPS.values() for name, entry in group.items()}


def overview(first: str = '') -> str:
    """Return the help: every command by use, a line each; or those of one first word."""
    width = max(map(len, COMMANDS)) + 2
    lines = [f'usage: mambo {f"{first} " * bool(first)}COMMAND [options]', '',
             'The ROS 2 twin of the Parrot Mambo minidrone. mambo COMMAND --help explains one.']
    for title, group in GROUPS.items():
        shown = [f'  {name:<{width}}{entry.summary}' for name, entry in group.items()
                 if first in ('', name.split()[0])]
        lines += ['', f'{title}:', *shown] if shown else []
    return '\n'.join(lines) + '\n'


def find(words: list[str]) -> tuple[str, list[str]]:
    """
    Split a command line into the command and its arguments.

    Raises
    ------
    LookupError
        If there is no such command; the one-line message suggests the nearest one.

    """
    for count in (2, 1):
        name = ' '.join(words[:count])
        if name in COMMANDS:
            return name, words[count:]
    if words[0] == 'import' and Path(words[1] if len(words) > 1 else '').suffix in TABLES:
        return 'import table', words[1:]
    kinds = [name for name in COMMANDS if name.split()[0] == words[0]]
    if kinds:
        given = f'{words[1]} is none' if len(words) > 1 else 'say which'
        hint = command.nearest(' '.join(words[:2]), kinds) if len(words) > 1 else ''
        raise LookupError(f"{words[0]}: {given} of {', '.join(kinds)}{hint}")
    hint = command.nearest(words[0], {part for name in COMMANDS for part in (
        name, name.split()[0])})
    raise LookupError(f'{words[0]} is not a command{hint}; mambo --help lists them')


def is_script(entry: Command) -> bool:
    """Return whether a command is a script of the checkout."""
    return '.' not in entry.module or '/' in entry.module


def run_script(entry: Command, arguments: list[str]) -> int:
    """Run a script of the checkout; return its exit code."""
    root = os.environ.get('MAMBO_ROOT')
    script = Path(root or '.') / entry.module
    if not root or not script.is_file():
        print('mambo: this command needs the checkout: source its env.bash first', file=sys.stderr)
        return 2
    start = [sys.executable] if script.suffix == '.py' else []
    return subprocess.call([*start, str(script), *arguments])


def completion_parser(line: str) -> argparse.ArgumentParser:
    """Return the parser that completes ``line``: all commands, or the options of one command."""
    try:
        words = shlex.split(line)[1:]
    except ValueError:  # an open quote
        words = line.split()[1:]
    out = argparse.ArgumentParser(prog='mambo')
    first = out.add_subparsers()
    second: dict[str, argparse._SubParsersAction] = {}
    for name, entry in COMMANDS.items():
        chosen = words[:len(name.split())] == name.split() and not is_script(entry)
        parents = [import_module(entry.module).parser()] if chosen else []
        head, _, kind = name.partition(' ')
        if kind and head not in second:
            second[head] = first.add_parser(head).add_subparsers()
        (second[head] if kind else first).add_parser(
            kind or head, parents=parents, add_help=not parents, help=entry.summary)
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``mambo``; return the exit code."""
    if '_ARGCOMPLETE' in os.environ:  # the shell requests completions
        import argcomplete
        argcomplete.autocomplete(completion_parser(os.environ.get('COMP_LINE', 'mambo')))
    words = sys.argv[1:] if arguments is None else arguments
    if not words or words[0] in ('-h', '--help', 'help'):
        if len(words) > 1 and words[0] == 'help':
            return main([*words[1:], '--help'])
        return command.guard('mambo', lambda: print(overview(), end='')) or (0 if words else 2)
    if len(words) == 2 and words[1] in ('-h', '--help') and any(
            name.startswith(f'{words[0]} ') for name in COMMANDS):
        return command.guard('mambo', lambda: print(overview(words[0]), end=''))
    try:
        name, rest = find(words)
    except LookupError as error:
        print(f'mambo: {command.one_line(error.args[0])}', file=sys.stderr)
        return 2
    entry = COMMANDS[name]
    if is_script(entry):
        return run_script(entry, rest)
    if wrong := environment.complaint(entry.module.startswith(_ROS)):
        print(f'mambo: {wrong}', file=sys.stderr)
        return 2
    command.set_program(f'mambo {name}')
    if arguments is None:  # this process does nothing else
        command.own_process()
    return import_module(entry.module).main(rest)


if __name__ == '__main__':
    sys.exit(main())
