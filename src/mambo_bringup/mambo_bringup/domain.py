"""One flight per ROS domain: two graphs that hear each other would spoil both."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path
import tempfile

from .processes import FlightError

_FREE = range(0, 101)  # domains whose ports are free of the ephemeral range on Linux


class Domain:
    """
    Claim of a ROS domain for as long as the object lives.

    ``ROS_DOMAIN_ID`` is taken as it is where the user has set it, else the first domain that no
    other flight of this machine holds. Discovery stays on this machine unless
    ``ROS_AUTOMATIC_DISCOVERY_RANGE`` says otherwise.

    Raises
    ------
    FlightError
        If the domain asked for is taken by another flight, or none is free.

    """

    def __init__(self) -> None:
        asked = os.environ.get('ROS_DOMAIN_ID', '')
        if asked and not asked.isdigit():
            raise FlightError(f'ROS_DOMAIN_ID = {asked!r} is not a number')
        for number in [int(asked)] if asked else _FREE:
            if self._claim(number):
                self.number = number
                break
        else:
            raise FlightError(
                f'another flight is under way in ROS domain {asked}: wait, or set ROS_DOMAIN_ID'
                if asked else 'no free ROS domain: other flights hold all of them')
        os.environ['ROS_DOMAIN_ID'] = str(self.number)
        os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')

    def _claim(self, number: int) -> bool:
        path = Path(tempfile.gettempdir()) / f'mambo_domain_{number}.lock'
        try:
            self._lock = path.open('a')
            path.chmod(0o666)
        except PermissionError:
            pass
        except OSError:
            return False
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._lock.close()
            return False
        return True
