"""Let a paused flight make control steps of 5 ms."""

from __future__ import annotations

from mambo_bags.cli.option_types import whole
from mambo_bags.command import Parser

from .sending import command_parser, run


def parser() -> Parser:
    """Return the command line."""
    out = command_parser('step', __doc__)
    out.add_argument('steps', nargs='?', type=whole(1, 1_000_000), default=1, metavar='N',
                     help='how many (default: 1)')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``mambo step``; return the exit code."""
    return run('step', parser().parse_args(arguments))
