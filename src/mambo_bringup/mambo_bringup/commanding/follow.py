"""Let a commanded flight follow the file of a course, and hover."""

from __future__ import annotations

from pathlib import Path

from mambo_bags.cli.option_types import real
from mambo_bags.command import Parser

from .sending import add_duration, command_parser, run


def parser() -> Parser:
    """Return the command line."""
    out = command_parser('follow', __doc__)
    out.add_argument('trajectory', type=Path, metavar='COURSE',
                     help='file of polynomials or of waypoints, .csv or .yaml')
    out.add_argument('--timescale', type=real(0.05, 20.0), default=1.0, metavar='FACTOR',
                     help='fly it in so many times its own duration (default: 1)')
    out.add_argument('--relative', action='store_true',
                     help='move it so that it begins where the reference is now')
    add_duration(out, 'time of the way to its beginning')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``mambo follow``; return the exit code."""
    return run('follow', parser().parse_args(arguments))
