"""One flight per ROS domain, so that two graphs do not receive each other's messages."""

from __future__ import annotations

import os
import socket

from mambo_model.errors import JobError
from mambo_ros.graph import loopback
from mambo_ros.graph.domains import claim, HIGHEST

from .processes import FlightError, FlightInputError

_FREE = range(0, 101)  # domains whose ports are free of the ephemeral range on Linux


def check() -> str:
    """
    Return the domain that the user has set, '' for none, if nodes of a flight can be connected.

    Raises
    ------
    FlightInputError
        If the requested domain does not exist.
    FlightError
        If :func:`mambo_ros.graph.loopback.check` refuses the environment.

    """
    try:
        loopback.check()
    except JobError as error:
        raise FlightError(str(error)) from None
    asked = os.environ.get('ROS_DOMAIN_ID', '')
    if asked and not (asked.isascii() and asked.isdigit() and int(asked) <= HIGHEST):
        raise FlightInputError(
            f'ROS_DOMAIN_ID = {asked!r} is not a whole number from 0 to {HIGHEST}')
    return asked


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
        self._held: socket.socket | None = None
        self._added: list[str] = []
        asked = check()
        for number in [int(asked)] if asked else _FREE:
            self._held = claim(number)
            if self._held:
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

    def release(self) -> None:
        """Free the domain for others; the caller must have ended the nodes that use it."""
        if self._held:
            self._held.close()
            self._held = None
        while self._added:
            os.environ.pop(self._added.pop(), None)

    def __enter__(self) -> Domain:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def __del__(self) -> None:
        self.release()
