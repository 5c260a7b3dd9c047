"""Nodes of one machine find each other by its loopback interface, and nobody else finds them."""

from __future__ import annotations

import os
from pathlib import Path
import socket

from mambo_model.errors import JobError
from mambo_model.schema import shown

RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'        # one of RANGES
RANGES = 'LOCALHOST', 'SUBNET', 'OFF', 'SYSTEM_DEFAULT'
SECURITY = 'ROS_SECURITY_ENABLE'               # of DDS: true or false
PEERS = 'ROS_STATIC_PEERS'                     # addresses of machines that a user has named
PROFILES = 'FASTRTPS_DEFAULT_PROFILES_FILE'    # Fast DDS reads it, at the first participant
OPEN, CLOSED = (str(Path(__file__).parents[1] / name)
                for name in ('fastdds.xml', 'fastdds_loopback.xml'))  # all interfaces, 127.0.0.1


def _own_profiles() -> str:
    """Return the file of profiles that the user has chosen, or '' for those of this project."""
    given = os.environ.get(PROFILES, '')
    # that of env.bash, too
    return '' if given == OPEN or Path(given).name == Path(CLOSED).name else given


def configure() -> None:
    """
    Keep the nodes of this process on this machine, unless the user has asked for more.

    Without ``ROS_AUTOMATIC_DISCOVERY_RANGE``, discovery is limited to this machine: ROS itself
    would take the subnet. Fast DDS then receives on 127.0.0.1 only, where it would listen on
    every interface otherwise. A range other than LOCALHOST, a static peer or a profile of the
    user's own is left as it is. Acts on nodes that start from now on.
    """
    if not os.environ.get(RANGE):
        os.environ[RANGE] = 'LOCALHOST'
    if not _own_profiles():
        closed = os.environ[RANGE] == 'LOCALHOST' and not os.environ.get(PEERS)
        os.environ[PROFILES] = CLOSED if closed else OPEN


def check() -> None:
    """
    Refuse to start nodes that could not find each other, or not be confined or secured as asked.

    Raises
    ------
    mambo_model.errors.JobError
        If security is on and this ROS has none, if the range of discovery is unknown or the
        profiles of Fast DDS cannot be read, or if discovery is to stay on this machine and its
        loopback interface is down.

    """
    if os.environ.get(SECURITY) == 'true' and os.environ.get('MAMBO_ROS') == 'wheels':
        raise JobError(f'{SECURITY}=true, but the wheels of ROS have no security: unset it, or '
                       'use an installed ROS 2 Jazzy (docs/how-to/network.md)')
    if (found := os.environ.get(RANGE) or RANGES[0]) not in RANGES:
        raise JobError(f'{RANGE} = {shown(found)} is not one of {", ".join(RANGES)}')
    if (profiles := _own_profiles()) and not os.access(profiles, os.R_OK):
        raise JobError(f'{PROFILES}: {profiles} cannot be read: name the file of your profiles, '
                       'or unset it')
    if found != 'LOCALHOST':
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
