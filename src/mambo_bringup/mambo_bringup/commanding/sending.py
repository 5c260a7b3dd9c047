"""What the commands to a running flight share: their options, and how they end."""

from __future__ import annotations

import argparse

from mambo_bags.cli.option_types import real
from mambo_bags.command import guard, Parser
from mambo_flight.commanded import send
from mambo_ros.topics import NAMESPACE

_LONGEST = 600.0  # s


def command_parser(name: str, description: str) -> Parser:
    """Return a parser with the option that names the drone."""
    out = Parser(name, f"""{description}

The flight is the one that runs on this machine, or that of ROS_DOMAIN_ID. It must have been
started with ./run --commanded, except for pause, resume, step and set.""")
    out.add_argument('--drone', default=NAMESPACE, metavar='NAMESPACE',
                     help=f'of the drone (default: {NAMESPACE})')
    return out


def add_duration(out: Parser, what: str) -> None:
    """Add the option of a duration."""
    out.add_argument('--duration', type=real(0.0, _LONGEST), default=0.0, metavar='S',
                     help=f'{what} in s, 0: as short as the limits allow (default: 0)')


def run(name: str, options: argparse.Namespace) -> int:
    """Send a command with the options as its arguments; print the answer, return the exit code."""
    arguments = dict(vars(options))
    drone = arguments.pop('drone')

    def work() -> None:
        """Send and print."""
        print(f'{name}: {send(name, drone, **arguments)}')
    return guard(name, work)
