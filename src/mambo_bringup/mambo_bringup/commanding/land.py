"""Let a commanded flight stop, descend and switch the motors off."""

from __future__ import annotations

from mambo_bags.cli.option_types import real
from mambo_bags.command import Parser

from .sending import add_duration, command_parser, run


def parser() -> Parser:
    """Return the command line."""
    out = command_parser('land', __doc__)
    out.add_argument('--height', type=real(0.0, 0.1), default=0.0, metavar='M',
                     help='of the reference in m when the motors stop (default: 0)')
    add_duration(out, 'time of the descent')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``mambo land``; return the exit code."""
    return run('land', parser().parse_args(arguments))
