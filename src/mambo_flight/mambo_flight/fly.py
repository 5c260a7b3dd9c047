"""
Fly a scenario in one process, without ROS running, and write its bag: the topics of the graph.

The messages are those that the graph in lockstep records, byte for byte.
"""

from __future__ import annotations

import argparse
from pathlib import Path
import time

from mambo_bags.command import guard, Parser, refuse_existing
from mambo_model import slots
from mambo_model.components import remarks
from mambo_model.errors import InputError, JobError

from . import closed_loop, recording_to_bag, scenario_file

CHOICES = ('trajectory', 'controller', 'estimator')  # what a command line may name


def _run(options: argparse.Namespace) -> None:
    refuse_existing(options.output)
    given = {
        name: scenario_file.Place(value, f'--{name}') for name in ('seed', *CHOICES)
        if (value := getattr(options, name)) is not None}
    if options.scenario:
        name, flight = scenario_file.load(options.scenario, given)
    elif given:
        name = Path(options.trajectory or 'flight').stem
        flight = scenario_file.from_settings(given)
    else:
        raise InputError(f'give a SCENARIO or one of --{", --".join(CHOICES)}')
    if not flight.sim_node.duration > 0.0:
        raise InputError(f'{name}: sim_node.duration must be more than 0 s')
    recording_to_bag.check(flight)
    for line in remarks(flight):
        print(line)
    slots.latest_fault()  # what went wrong before is not of this flight
    began = time.monotonic()
    recording = closed_loop.fly(flight, inner=True)
    flown = time.monotonic()
    recording_to_bag.write(options.output, flight, recording)
    end = time.monotonic()
    seconds = flight.sim_node.duration
    print(f'{name}: {seconds:.2f} s flown in {flown - began:.2f} s, bag written in '
          f'{end - flown:.2f} s: {seconds / (end - began):.0f} times real time\n'
          f'bag: {options.output}')
    if fault := slots.latest_fault():
        raise JobError(f'{name}: {fault}')


def parser() -> Parser:
    """Return the command line."""
    out = Parser('fly', __doc__)
    out.add_argument(
        'scenario', metavar='SCENARIO', nargs='?',
        help='an experiment, experiment/flight, or a file')
    out.add_output('BAG', 'directory of the bag to create', required=True)
    for name in CHOICES:
        kinds = ('or the file of a course' if name == 'trajectory' else
                 'FILE.py, FILE.py:NAME, or an installed one')
        out.add_argument(f'--{name}', metavar='NAME', help=(
            f'{name} instead of that of the scenario: a built-in one, {kinds}'))
    out.add_argument('--seed', type=int, metavar='N', help='of every noise stream')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``fly``; return the exit code."""
    options = parser().parse_args(arguments)
    return guard('fly', lambda: _run(options))


if __name__ == '__main__':
    raise SystemExit(main())
