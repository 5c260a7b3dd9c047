"""Parameters of the package's nodes, readable without ROS."""

from __future__ import annotations

from dataclasses import dataclass
from ipaddress import AddressValueError, IPv4Address
import math

from mambo_model import schema
from mambo_model.frames import flip_vector
from mambo_model.motion.vector import Vec3
from mambo_sim.sensors import hall_capture, marker_occlusion, optitrack
from mambo_sim.sensors.sampling import period_ns

from .axes import UP

VERSIONS = ('2.7', '2.9', '3.0', '3.1', '4.0', '4.1', '4.2')
TRANSMISSIONS = ('multicast', 'unicast')
GROUP = '239.255.42.99'
MOST_BODIES = 256
_PORT = (1024, 65_535)
PLACES = (
    'x y z of the origin of the frame `map` of each body in the hall, axes as `map`, in m, '
    'separated by ;; empty: that of the hall')


def check_address(name: str, value: str, multicast: bool = False) -> None:
    """Raise ParameterError if a parameter is no IPv4 address, or no multicast one."""
    try:
        right = IPv4Address(value).is_multicast == multicast
    except AddressValueError:
        right = False
    if not right:
        kind = 'a multicast address such as 239.255.42.99' if multicast else (
            'an IPv4 address such as 127.0.0.1')
        raise schema.ParameterError(f'{name} = {schema.shown(value)} must be {kind}')


@dataclass(frozen=True)
class NatNetServerNodeParams:
    """
    Parameters of ``natnet_server_node``.

    The cameras see what those of ``optitrack_node`` see: with the same seed, rate and markers the
    poses are the same.
    """

    address: str = schema.text(
        '127.0.0.1', 'IPv4 address of the interface to serve; 127.0.0.1: this machine alone')
    command_port: int = schema.quantity(1510, '-', *_PORT, "Motive's default")
    data_port: int = schema.quantity(1511, '-', *_PORT, "Motive's default")
    group: str = schema.text(GROUP, "multicast group of the frames, Motive's default")
    transmission: str = schema.choice(
        'multicast', TRANSMISSIONS, "how frames are sent; multicast is Motive's default")
    unicast_to: str = schema.choice(
        'sender', ('sender', 'data_port'),
        'where a unicast client gets its frames: at the port its commands come from, as the '
        'clients of NatNet 3 and later, or at data_port of its host, as those of NatNet 2')
    version: str = schema.choice(
        '4.1', VERSIONS, 'of the protocol; 4.1 is that of Motive 3.1, 3.1 of Motive 2.2')
    up: str = schema.choice('y', UP, "axis that is up; y is Motive's default")
    body: str = schema.text('mambo', 'name of the rigid body')
    body_id: int = schema.quantity(
        1, '-', 1, 32_767 - MOST_BODIES, 'streaming identifier of the body, the first of several')
    bodies: str = schema.text(
        '', 'NAME=TOPIC for each of several rigid bodies, separated by commas: its name and the '
        'topic of its true state; their seeds follow each other; empty: one, `body`')
    places: str = schema.text('', PLACES)
    rate: float = schema.quantity(
        120.0, 'Hz', 1.0, 1000.0, 'frames a second; usual cameras have 120 to 360')
    latency: float = schema.quantity(
        0.01, 's', 0.0, 0.05, 'exposure to transmission; 5.5 ms in a recorded session of Motive '
        '2.1, and the simulated truth is up to 5 ms old')
    marker_size: float = schema.quantity(
        0.02, 'm', 0.001, 0.1, 'diameter that is streamed, as in that session')
    seed: int = schema.quantity(1, '-', 0, 2**31 - 1, 'of the noise of the cameras')
    noise: bool = schema.flag(True, 'design choice: false switches every random part off')
    fault: str = schema.choice(
        'none', optitrack.FAULTS, 'what the cameras say from fault_begin to fault_end: nothing, '
        'the body turned by half a turn of yaw, or another body fault_distance away')
    fault_begin: float = schema.quantity(0.0, 's', 0.0, 86400.0, 'design choice')
    fault_end: float = schema.quantity(0.0, 's', 0.0, 86400.0, 'design choice')
    fault_distance: float = schema.quantity(
        1.0, 'm', 0.0, 100.0, 'to the other body, northwards: room for two drones')
    markers: marker_occlusion.MarkerParams = schema.group(marker_occlusion.MarkerParams)
    capture: hall_capture.HallCaptureParams = schema.group(hall_capture.HallCaptureParams)

    def __post_init__(self) -> None:
        schema.check(self)
        check_address('address', self.address)
        check_address('group', self.group, multicast=True)
        for name in self.topics:
            if not name or len(name.encode()) > 255:
                raise schema.ParameterError('body: a name has 1 to 255 bytes')
        places(self.places, len(self.topics))
        optitrack.check_fault(self.fault, self.fault_begin, self.fault_end)
        if self.seed + len(self.topics) > 2**31:
            raise schema.ParameterError(
                f'seed {self.seed} leaves no seeds for {len(self.topics)} bodies')
        if self.command_port == self.data_port:
            raise schema.ParameterError('data_port is command_port: give another one')

    @property
    def topics(self) -> dict[str, str]:
        """Return {name: topic of the true state} of all bodies."""
        return bodies(self.bodies) if self.bodies else {self.body: 'ground_truth/odom'}

    @property
    def period(self) -> int:
        """Return the time from frame to frame, ns."""
        return period_ns(self.rate)

    @property
    def protocol(self) -> tuple[int, int]:
        """Return the version as numbers."""
        major, minor = self.version.split('.')
        return int(major), int(minor)


def bodies(text: str) -> dict[str, str]:
    """
    Return {name or identifier: topic} of the parameter ``bodies``.

    Raises
    ------
    ParameterError
        If it is not ``NAME=TOPIC, ...`` with different names and topics.

    """
    found: dict[str, str] = {}
    for entry in filter(None, (part.strip() for part in text.split(','))):
        name, equals, topic = (part.strip() for part in entry.rpartition('='))
        if not (equals and name and topic):
            raise schema.ParameterError(
                f'bodies: {schema.shown(entry)} must be NAME=TOPIC, as in mambo=optitrack/pose')
        if name in found or topic in found.values():
            raise schema.ParameterError(f'bodies: {schema.shown(entry)} repeats a name or topic')
        found[name] = topic
    if not 1 <= len(found) <= MOST_BODIES:
        raise schema.ParameterError(
            f'bodies names {len(found)} bodies: give 1 to {MOST_BODIES}')
    return found


def places(text: str, drones: int) -> list[Vec3]:
    """
    Return the places of a parameter ``places``, (3,) m, inertial NED of the hall.

    Raises
    ------
    ParameterError
        If they are not as many as the drones.

    """
    if not text:
        return [(0.0, 0.0, 0.0)] * drones
    try:
        found = [tuple(map(float, place.split())) for place in text.split(';')]
    except ValueError:
        found = []
    if len(found) != drones or any(
            len(place) != 3 or not all(map(math.isfinite, place)) for place in found):
        raise schema.ParameterError(
            f'places = {schema.shown(text)} must be {drones} times x y z in m, separated by ;')
    return [flip_vector(place) for place in found]


@dataclass(frozen=True)
class NatNetClientNodeParams:
    """Parameters of ``natnet_client_node``."""

    server: str = schema.text('127.0.0.1', 'IPv4 address of the machine that runs Motive')
    address: str = schema.text(
        '127.0.0.1', 'IPv4 address of this machine in the network of the server')
    command_port: int = schema.quantity(1510, '-', *_PORT, "Motive's default")
    bodies: str = schema.text(
        'mambo=optitrack/pose',
        'NAME=TOPIC for each rigid body, separated by commas; NAME is its name or its streaming '
        'identifier; an absolute topic leaves the namespace of the node')
    places: str = schema.text('', PLACES)
    up: str = schema.choice('y', UP, "axis that is up; y is Motive's default")
    stamp: str = schema.choice(
        'system', ('system', 'server'),
        "what a stamp means: the exposure on this machine's clock, or the timestamp of the "
        'server, which is the flight time where the server is natnet_server_node')
    patience: float = schema.quantity(
        2.0, 's', 0.1, 60.0, 'time without a frame after which the client connects again: assumed')
    least_delay: float = schema.quantity(
        0.0, 's', 0.0, 0.1, 'of a frame on its way; only for a server that answers no echo')
    connect_within: float = schema.quantity(
        0.0, 's', 0.0, 3600.0, 'time to connect before it takes part in the graph: a flight that '
        'waits for this node then begins with its first pose')

    def __post_init__(self) -> None:
        schema.check(self)
        check_address('server', self.server)
        check_address('address', self.address)
        places(self.places, len(bodies(self.bodies)))
