"""The ROS domains of the flights that run on this machine."""

from __future__ import annotations

import os
from pathlib import Path
import tempfile

from mambo_model.errors import InputError

HIGHEST = 232  # a higher domain has no valid ports
_LOCKS = Path('/proc/locks')


def lock_path(number: int) -> Path:
    """Return the file that a flight in a domain locks while it runs."""
    return Path(tempfile.gettempdir()) / f'mambo_domain_{number}.lock'


def running() -> list[int]:
    """
    Return the domains in which flights run, sorted.

    The system's table of locks is read, which disturbs nobody who is about to take one.
    """
    held = set()
    for line in _LOCKS.read_text().splitlines() if _LOCKS.exists() else ():
        words = line.split()
        if 'FLOCK' in words:
            held |= {int(word.rpartition(':')[2]) for word in words if word.count(':') == 2}
    found = []
    for number in range(HIGHEST + 1):
        try:
            if lock_path(number).stat().st_ino in held:
                found.append(number)
        except OSError:
            continue
    return found


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
