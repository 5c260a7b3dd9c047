"""Nodes of one machine find each other by its loopback interface: whether it works."""

from __future__ import annotations

import os
import socket

from mambo_model.errors import JobError


def check() -> None:
    """
    Refuse to start nodes that could not find each other.

    Raises
    ------
    mambo_model.errors.JobError
        If discovery is to stay on this machine and its loopback interface is down.

    """
    if os.environ.get('ROS_AUTOMATIC_DISCOVERY_RANGE') not in ('', None, 'LOCALHOST'):
        return
    try:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.bind(('127.0.0.1', 0))
            probe.settimeout(1.0)
            probe.sendto(b'mambo', probe.getsockname())
            probe.recv(16)
    except OSError as error:
        raise JobError(
            f'nodes cannot find each other, the loopback interface does not work ({error}): '
            'ip link set lo up') from None
