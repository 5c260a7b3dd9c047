"""ROS node that publishes the rigid bodies of a NatNet server, such as Motive, as poses."""

from __future__ import annotations

import select
import socket
import time

from geometry_msgs.msg import PoseStamped
from mambo_model.errors import JobError
from mambo_model.motion.vector import sub
from mambo_model.schema import ParameterError, shown
from mambo_ros import diagnostics, messages, node, process, topics
from mambo_ros.endpoints import RawPublisher
from mambo_ros.loop import Loop

from . import udp
from .client import Client
from .natnet.wire import DISCONNECT, message
from .parameters import bodies, NatNetClientNodeParams, places
from .watch import Watch

_REPORT_EVERY = 1.0  # s of wall time
_WAIT = 0.005  # s for a packet, before the node has its turn
_LONGEST = 0.1  # s for the packets of a socket; one of 65 kB alone may take that
_RETRY = 1.0  # s between tries to open the data socket


class NatNetClientNode(node.MamboNode[NatNetClientNodeParams]):
    """
    NatNet client: rigid bodies of a motion capture as poses in ``map``.

    Publishes a ``geometry_msgs/PoseStamped`` for each name of ``bodies``, by default
    ``optitrack/pose``, and ``/diagnostics`` with the latency of the frames and what was refused. A
    body that is not tracked has no pose: nothing is published.
    """

    publishes = (topics.OPTITRACK, topics.DIAGNOSTICS)
    example = '--ros-args -p server:=192.168.1.5 -p address:=192.168.1.20 -p bodies:=drone=pose'

    def __init__(self, **kwargs) -> None:
        super().__init__('natnet_client_node', NatNetClientNodeParams, **kwargs)
        p = self.params
        self._client = Client(p.up, p.stamp == 'server', round(p.patience * 1e9),
                              round(p.least_delay * 1e9))
        self._diagnostics = self.advertise(topics.DIAGNOSTICS)
        self._publish: dict[str, RawPublisher] = {
            name: self._pose(topic) for name, topic in bodies(p.bodies).items()}
        self._places = dict(zip(
            self._publish, places(p.places, len(self._publish)), strict=True))
        self._watch = Watch(self._publish, p.stamp == 'server', time.monotonic())
        self._commands = udp.open_socket(p.address, 0)
        self._data: socket.socket | None = None
        self._place = ('', 0)  # group and port of the data socket
        self._obstacle = ''    # why there is none
        self._next_try = self._next_report = self._slowest = 0.0

    def _pose(self, topic: str) -> RawPublisher:
        """Advertise the pose of a body; ParameterError if another one has the same topic."""
        name = self.resolve_topic_name(topic)
        if name in {output.publisher.topic_name for output in self.outputs}:
            raise ParameterError(
                f'bodies: {shown(topic)} is {name}, which this node publishes already: give each '
                'body a topic of its own')
        return self.advertise(topics.Topic(topic, PoseStamped, topics.OPTITRACK.rate))

    @property
    def connected(self) -> bool:
        """Return whether the next frame gives poses: server, its bodies and the port are there."""
        client = self._client
        return client.info is not None and client.defined is not None and not self._obstacle

    def turn(self, wait: float) -> None:
        """Wait for packets, at most some seconds, and publish the poses in them."""
        for packet in self._client.due(time.time_ns()):
            udp.send(self._commands, packet, (self.params.server, self.params.command_port))
        sources = [self._commands, *([self._data] if self._data else [])]
        for source in select.select(sources, [], [], wait)[0]:
            end = time.monotonic() + _LONGEST
            for data, sender, arrived in udp.receive(source):
                if sender[0] == self.params.server:
                    self._take(data, arrived)
                else:
                    self._client.counts['from another host'] += 1
                if time.monotonic() >= end:
                    break
        self._join()
        if time.monotonic() >= self._next_report:
            self._next_report = time.monotonic() + _REPORT_EVERY
            self._report()

    def _take(self, data: bytes, arrived: int) -> None:
        found = self._client.take(data, arrived)
        self._watch.follow(self._client)
        for seen in found:
            names = self._watch.names(seen.identifier)
            if not names:
                self._client.counts['bodies not asked for'] += 1
            for name in names:
                if not self._watch.accept(name, seen.stamp, arrived, time.monotonic()):
                    self._client.counts['stamps not after the last one'] += 1
                    continue
                self._slowest = max(self._slowest, seen.latency)
                rho = sub(seen.rho, self._places[name])
                self._publish[name](messages.optitrack(seen.stamp, rho, seen.q))

    def _join(self) -> None:
        """Open the socket that the server's reply asks for."""
        info = self._client.info
        if info is None:
            return
        multicast = info.multicast if info.sender.version >= (3, 0) else False
        place = (info.group if multicast else '', info.data_port)
        now = time.monotonic()
        if place == self._place and not (self._obstacle and now >= self._next_try):
            return
        self._next_try = now + _RETRY
        if self._data is not None:
            self._data.close()
        self._place, self._data, self._obstacle = place, None, ''
        try:
            if multicast or info.sender.version < (3, 0):
                self._data = udp.open_socket(self.params.address, place[1], place[0])
        except JobError as error:
            self._obstacle = str(error)

    def _report(self) -> None:
        p, watch = self.params, self._watch
        watch.follow(self._client)
        level, line = watch.report(
            self._client, f'{p.server}:{p.command_port}', self._obstacle, time.monotonic())
        self._publish_report(diagnostics.LEVELS[level], line)
        self._slowest = 0.0

    def _publish_report(self, level: bytes, line: str) -> None:
        client = self._client
        fit, delays = client.match.line, client.delays
        now = max(self._watch.stamps.values()) if self.params.stamp == 'server' else time.time_ns()
        self._diagnostics(diagnostics.report(max(now, 0), self.get_name(), level, line, {
            'latency [ms]': f'{1e3 * delays.total:.3f}',
            'largest latency [ms]': f'{1e3 * self._slowest:.3f}',
            'camera latency [ms]': f'{1e3 * delays.camera:.3f}',
            'software latency [ms]': f'{1e3 * delays.software:.3f}',
            'network latency [ms]': f'{1e3 * delays.network:.3f}',
            'drift of the clocks [ppm]': f'{1e6 * fit.drift:.2f}' if fit else 'unknown',
            'clocks matched by echoes': client.match.answered,
            'clocks matched anew': client.match.resets,
            'NatNet': '.'.join(map(str, client.version)), **client.counts,
            **{f'poses of {name}': self._watch.poses[name] for name in self._publish}}))

    def finish(self) -> None:
        """Leave the server and close the sockets."""
        udp.send(self._commands, message(DISCONNECT, b''),
                 (self.params.server, self.params.command_port))
        self._commands.close()
        if self._data is not None:
            self._data.close()


def follow(client: NatNetClientNode, loop: Loop) -> int:
    """Publish poses until stopped; return the exit code."""
    end = time.monotonic() + client.params.connect_within
    while not loop.stopping and not client.connected and time.monotonic() < end:
        client.turn(_WAIT)
    while not loop.stopping:
        client.turn(_WAIT)
        loop.once(0.0)
    return 0


def main(args=None) -> None:
    """Entry point ``natnet_client_node``."""
    process.main(NatNetClientNode, args, follow)
