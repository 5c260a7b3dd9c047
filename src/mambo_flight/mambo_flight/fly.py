"""
Fly a scenario in one process, without ROS running, and write its bag: the topics of the graph.

The messages are those that the graph in lockstep records, byte for byte.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
import time
from typing import Any

from mambo_bags.command import guard, Parser, refuse_existing
from mambo_model.errors import InputError, JobError

from . import flight_options, recording_to_bag, scenario_file, supervised
from .scenario import commented_yaml, Scenario
from .sweep import monte_carlo



def _scenario(options: argparse.Namespace) -> tuple[str, Scenario]:
    """Return the name and the scenario of the flight that the command line selects."""
    given = flight_options.given(options)
    if options.scenario:
        name, flight = scenario_file.load(options.scenario, given)
    elif given:
        name = Path(options.trajectory or 'flight').stem
        flight = scenario_file.from_settings(given)
    else:
        raise InputError('give a SCENARIO or one of --trajectory, --controller, --estimator')
    return name, flight_options.applied(flight, options)


def _errors(metrics: Mapping[str, Any]) -> str:
    """Return the errors of a flight in a few words."""
    ending = f'; motors stopped ({metrics["shutdown_reason"]})' if metrics['shutdown'] else ''
    return (f'tracking error {metrics["tracking_rms"]:.3g} m RMS, '
            f'{metrics["tracking_max"]:.3g} m at most; '
            f'estimation error {metrics["estimation_rms"]:.3g} m RMS{ending}')


def _run(options: argparse.Namespace) -> None:
    if options.print_scenario:
        print(commented_yaml(_scenario(options)[1]), end='')
        return
    if options.output is None:
        raise InputError('-o/--output is missing')
    refuse_existing(options.output)
    name, flight = _scenario(options)
    if not flight.sim_node.duration > 0.0:
        raise InputError(f'{name}: sim_node.duration must be more than 0 s')
    recording_to_bag.check(flight)
    for line in flight_options.remarks(flight, options.stretch):
        print(line)
    began = time.monotonic()
    recording, fault = supervised.fly(flight, inner=True)
    flown = time.monotonic()
    recording_to_bag.write(options.output, flight, recording)
    end = time.monotonic()
    seconds = recording.t[-1] * 1e-9
    print(f'{name}: {_errors(monte_carlo.measure(flight, recording))}')
    print(f'{name}: {seconds:.2f} s flown in {flown - began:.2f} s, bag written in '
          f'{end - flown:.2f} s: {seconds / (end - began):.3g} times real time\n'
          f'bag: {options.output}')
    if fault:
        raise JobError(f'{name}: {fault}')


def parser() -> Parser:
    """Return the command line."""
    out = Parser('fly', __doc__)
    out.add_argument(
        'scenario', metavar='SCENARIO', nargs='?',
        help='an experiment, experiment/flight, or a file')
    out.add_output('BAG', 'directory of the bag to create')
    flight_options.add(out)
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``fly``; return the exit code."""
    options = parser().parse_args(arguments)
    return guard('fly', lambda: _run(options))


if __name__ == '__main__':
    raise SystemExit(main())
