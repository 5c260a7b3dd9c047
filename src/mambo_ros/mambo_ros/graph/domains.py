"""The ROS domains of the flights that run on this machine."""

from __future__ import annotations

import os
import socket

from mambo_model.errors import InputError

HIGHEST = 232  # a higher domain has no valid ports
_NAME = '\0mambo_domain_'  # of a socket: like a domain's ports, one for each network namespace


def claim(number: int) -> socket.socket | None:
    """
    Reserve a domain for a flight until the socket that is returned is closed; None: it is taken.

    The socket has a name and no file, so that every user on this machine sees it, whatever their
    folder for temporary files, and the kernel takes it away with the last process that has it.
    """
    held = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        held.bind(f'{_NAME}{number}')
    except OSError:
        held.close()
        return None
    return held


def _is_claimed(number: int) -> bool:
    """Return whether a flight has reserved a domain; it disturbs nobody who is about to."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as asking:
        return asking.connect_ex(f'{_NAME}{number}') == 0


def running() -> list[int]:
    """Return the domains in which flights run, sorted."""
    return [number for number in range(HIGHEST + 1) if _is_claimed(number)]


def chosen() -> int:
    """
    Return the domain of the flight that is meant: ``ROS_DOMAIN_ID``, or the one that runs.

    Raises
    ------
    InputError
        If several flights run, or the variable is not a domain.

    """
    asked = os.environ.get('ROS_DOMAIN_ID', '')
    if asked:
        if not (asked.isascii() and asked.isdigit() and int(asked) <= HIGHEST):
            raise InputError(
                f'ROS_DOMAIN_ID = {asked!r} is not a whole number from 0 to {HIGHEST}')
        return int(asked)
    found = running()
    if len(found) > 1:
        raise InputError(f'flights run in the ROS domains {", ".join(map(str, found))}: choose '
                         'one with ROS_DOMAIN_ID')
    return found[0] if found else 0
