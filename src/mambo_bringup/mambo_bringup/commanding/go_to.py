"""Let a commanded flight fly to a position and hover."""

from __future__ import annotations

import argparse

from mambo_bags.cli.option_types import real
from mambo_bags.command import Parser

from .sending import add_duration, command_parser, run


def parser() -> Parser:
    """Return the command line."""
    out = command_parser('go-to', __doc__)
    for axis in 'xyz':
        out.add_argument(axis, type=real(-1000.0, 1000.0), metavar=axis.upper(),
                         help='of the goal in m, z up')
    out.add_argument('--yaw', type=real(-10.0, 10.0), default=0.0, metavar='RAD',
                     help='about z up, the shorter way round (default: 0)')
    out.add_argument('--relative', action='store_true',
                     help='position and yaw from where the reference is now')
    add_duration(out, 'time of the way')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``mambo go-to``; return the exit code."""
    options = vars(parser().parse_args(arguments))
    goal = tuple(options.pop(axis) for axis in 'xyz')
    return run('go_to', argparse.Namespace(goal=goal, **options))
