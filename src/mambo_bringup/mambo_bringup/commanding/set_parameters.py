"""Change parameters of a node of a running flight, from its next control step on."""

from __future__ import annotations

import argparse
from typing import Any

from mambo_bags.command import Parser
from mambo_model.errors import InputError

from .sending import command_parser, run


def _setting(text: str) -> tuple[str, Any]:
    """Return name and value of ``NODE.PARAMETER=VALUE``."""
    from mambo_ros.commands.command_request import setting  # ROS, which --help does not need
    try:
        return setting(text)
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def parser() -> Parser:
    """Return the command line."""
    out = command_parser('set', __doc__)
    out.add_argument(
        'parameters', nargs='+', type=_setting, metavar='NODE.PARAMETER=VALUE',
        help='such as controller_node.cascaded.k_p=3.5; several of one node change together')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``mambo set``; return the exit code."""
    line = parser()
    options = line.parse_args(arguments)
    names = [name for name, _ in options.parameters]
    if twice := [name for name in names if names.count(name) > 1]:
        line.error(f'{twice[0]}: given twice')
    return run('set', argparse.Namespace(
        parameters=dict(options.parameters), drone=options.drone))
