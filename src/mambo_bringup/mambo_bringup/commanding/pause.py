"""Pause a simulated flight between two control steps."""

from __future__ import annotations

from mambo_bags.command import Parser

from .sending import command_parser, run


def parser() -> Parser:
    """Return the command line."""
    return command_parser('pause', __doc__)


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``mambo pause``; return the exit code."""
    return run('pause', parser().parse_args(arguments))
