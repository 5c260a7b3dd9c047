"""One flight per ROS domain, so that two graphs do not receive each other's messages."""

from __future__ import annotations

import fcntl
import os

from mambo_model.errors import JobError
from mambo_ros.graph import loopback
from mambo_ros.graph.domains import HIGHEST, lock_path

from .processes import FlightError, FlightInputError

_FREE = range(0, 101)  # domains whose ports are free of the ephemeral range on Linux


class Domain:
    """
    A ROS domain reserved until :meth:`release`, the end of ``with`` or of the object.

    Uses ``ROS_DOMAIN_ID`` if the user has set it, else the first domain that no other flight on
    this machine has reserved. Discovery is limited to this machine unless
    ``ROS_AUTOMATIC_DISCOVERY_RANGE`` is set. Both variables are set for nodes started from now
    on, and restored at release.

    Attributes
    ----------
    number : int
        The domain.

    Raises
    ------
    FlightInputError
        If the requested domain does not exist.
    FlightError
        If it is used by another flight, if none is free, or if the loopback interface is down.

    """

    def __init__(self) -> None:
        self._lock = -1
        self._added: list[str] = []
        try:
            loopback.check()
        except JobError as error:
            raise FlightError(str(error)) from None
        asked = os.environ.get('ROS_DOMAIN_ID', '')
        if asked and not (asked.isascii() and asked.isdigit() and int(asked) <= HIGHEST):
            raise FlightInputError(
                f'ROS_DOMAIN_ID = {asked!r} is not a whole number from 0 to {HIGHEST}')
        for number in [int(asked)] if asked else _FREE:
            if self._claim(number):
                self.number = number
                break
        else:
            raise FlightError(
                f'another flight is running in ROS domain {asked}: wait, or set ROS_DOMAIN_ID'
                if asked else 'no free ROS domain: other flights use all of them')
        for name, value in (('ROS_DOMAIN_ID', str(self.number)),
                            ('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')):
            if not os.environ.get(name):
                os.environ[name] = value
                self._added.append(name)

    def _claim(self, number: int) -> bool:
        path = lock_path(number)
        try:
            lock = os.open(path, os.O_RDONLY | os.O_CREAT, 0o666)
        # another user's file: Linux allows opening it, but not with O_CREAT
        except PermissionError:
            try:
                lock = os.open(path, os.O_RDONLY)
            except OSError:
                return False
        except OSError:
            return False
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(lock)
            return False
        self._lock = lock
        return True

    def release(self) -> None:
        """Free the domain for others; the caller must have ended the nodes that use it."""
        if self._lock >= 0:
            os.close(self._lock)
            self._lock = -1
        while self._added:
            os.environ.pop(self._added.pop(), None)

    def __enter__(self) -> Domain:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def __del__(self) -> None:
        self.release()
