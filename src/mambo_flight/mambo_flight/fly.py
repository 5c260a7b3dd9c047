"""
Fly a scenario in one process, without ROS running, and write its bag: the topics of the graph.

The messages are those that the graph in lockstep records, byte for byte.
"""

from __future__ import annotations

import argparse
from pathlib import Path
import sys
import time

from mambo_bags.command import guard
from mambo_bags.writer import BagWriterError

from . import closed_loop, recording_to_bag, scenario_file


def _run(options: argparse.Namespace) -> None:
    if options.out.exists():  # before anything is flown
        raise BagWriterError(f'{options.out} exists: give another --out or remove it')
    given = {} if options.seed is None else {
        'seed': scenario_file.Place(options.seed, '--seed')}
    name, flight = scenario_file.load(options.scenario, given)
    if not flight.sim_node.duration > 0.0:
        raise ValueError(f'{name}: sim_node.duration must be more than 0 s')
    recording_to_bag.check(flight)
    began = time.monotonic()
    recording = closed_loop.fly(flight, inner=True)
    flown = time.monotonic()
    recording_to_bag.write(options.out, flight, recording)
    end = time.monotonic()
    seconds = flight.sim_node.duration
    print(f'{name}: {seconds:.2f} s flown in {flown - began:.2f} s, bag written in '
          f'{end - flown:.2f} s: {seconds / (end - began):.0f} times real time\n'
          f'bag: {options.out}')


def main(arguments: list[str] | None = None) -> None:
    """Entry point ``fly``."""
    parser = argparse.ArgumentParser(
        prog='fly', description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        'scenario', metavar='SCENARIO', help='an experiment, experiment/flight, or a file')
    parser.add_argument(
        '--out', type=Path, required=True, metavar='BAG', help='directory of the bag to make')
    parser.add_argument('--seed', type=int, metavar='N', help='of every noise stream')
    options = parser.parse_args(arguments)
    sys.exit(guard('fly', lambda: _run(options), ValueError))


if __name__ == '__main__':
    main()
