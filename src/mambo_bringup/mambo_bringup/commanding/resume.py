"""Let a paused flight go on."""

from __future__ import annotations

from mambo_bags.command import Parser

from .sending import command_parser, run


def parser() -> Parser:
    """Return the command line."""
    return command_parser('resume', __doc__)


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``mambo resume``; return the exit code."""
    return run('resume', parser().parse_args(arguments))
