"""Let a commanded flight come to rest and hover."""

from __future__ import annotations

from mambo_bags.command import Parser

from .sending import command_parser, run


def parser() -> Parser:
    """Return the command line."""
    return command_parser('stop', __doc__)


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``mambo stop``; return the exit code."""
    return run('stop', parser().parse_args(arguments))
