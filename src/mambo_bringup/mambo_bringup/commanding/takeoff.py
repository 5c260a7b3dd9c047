"""Let a commanded flight take off, straight up, and hover."""

from __future__ import annotations

from mambo_bags.cli.option_types import real
from mambo_bags.command import Parser

from .sending import add_duration, command_parser, run


def parser() -> Parser:
    """Return the command line."""
    out = command_parser('takeoff', __doc__)
    out.add_argument('--height', type=real(0.0, 1000.0), default=1.0, metavar='M',
                     help='above the floor in m (default: 1)')
    add_duration(out, 'time of the climb')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``mambo takeoff``; return the exit code."""
    return run('takeoff', parser().parse_args(arguments))
