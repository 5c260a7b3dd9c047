"""ROS node that publishes the rigid bodies of a NatNet server, such as Motive, as poses."""

from __future__ import annotations

import select
import socket
import time

from geometry_msgs.msg import PoseStamped
from mambo_model.errors import JobError, visible
from mambo_model.motion.vector import sub
from mambo_ros import diagnostics, messages, node, process, topics
from mambo_ros.endpoints import RawPublisher
from mambo_ros.loop import Loop

from . import udp
from .client import Client
from .natnet.wire import DISCONNECT, message
from .parameters import bodies, NatNetClientNodeParams, places

_REPORT_EVERY = 1.0  # s of wall time
_WAIT = 0.005  # s for a packet, before the node has its turn


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
        self._publish: dict[str, RawPublisher] = {
            name: self.advertise(topics.Topic(topic, PoseStamped, topics.OPTITRACK.rate))
            for name, topic in bodies(p.bodies).items()}
        self._places = dict(zip(
            self._publish, places(p.places, len(self._publish)), strict=True))
        self._stamps = dict.fromkeys(self._publish, -1)
        self._diagnostics = self.advertise(topics.DIAGNOSTICS)
        self._commands = udp.open_socket(p.address, 0)
        self._data: socket.socket | None = None
        self._place = ('', 0)  # group and port of the data socket
        self._obstacle = ''    # why there is none
        self._next_report, self._reported = 0.0, 0
        self._slowest = 0.0

    def turn(self, wait: float) -> None:
        """Wait for packets, at most some seconds, and publish the poses in them."""
        for packet in self._client.due(time.time_ns()):
            udp.send(self._commands, packet, (self.params.server, self.params.command_port))
        sources = [self._commands, *([self._data] if self._data else [])]
        for source in select.select(sources, [], [], wait)[0]:
            for data, sender, arrived in udp.receive(source):
                if sender[0] == self.params.server:
                    self._take(data, arrived)
                else:
                    self._client.counts['from another host'] += 1
        self._join()
        if time.monotonic() >= self._next_report:
            self._next_report = time.monotonic() + _REPORT_EVERY
            self._report()

    def _take(self, data: bytes, arrived: int) -> None:
        for seen in self._client.take(data, arrived):
            name = seen.name if seen.name in self._publish else str(seen.identifier)
            if name not in self._publish:
                self._client.counts['bodies not asked for'] += 1
            elif seen.stamp > self._stamps[name]:
                self._stamps[name] = seen.stamp
                self._slowest = max(self._slowest, seen.latency)
                rho = sub(seen.rho, self._places[name])
                self._publish[name](messages.optitrack(seen.stamp, rho, seen.q))
            else:
                self._client.counts['stamps not after the last one'] += 1

    def _join(self) -> None:
        """Open the socket that the server's reply asks for."""
        info = self._client.info
        if info is None:
            return
        multicast = info.multicast if info.sender.version >= (3, 0) else False
        place = (info.group if multicast else '', info.data_port)
        if place == self._place:
            return
        if self._data is not None:
            self._data.close()
        self._place, self._data, self._obstacle = place, None, ''
        try:
            if multicast or info.sender.version < (3, 0):
                self._data = udp.open_socket(self.params.address, place[1], place[0])
        except JobError as error:
            self._obstacle = str(error)

    def _report(self) -> None:
        client, p = self._client, self.params
        frames = client.counts['frames']
        level, line = diagnostics.OK, f'{frames - self._reported} frames a second'
        if client.info is None:
            level, line = diagnostics.ERROR, (
                f'no reply from {p.server}:{p.command_port}: is streaming switched on there?')
        elif frames == self._reported:
            level, line = diagnostics.ERROR, self._obstacle or 'connected, but no frame comes'
        elif client.counts['malformed']:
            level, line = diagnostics.WARN, f'malformed packets: {client.problem}'
        elif missing := sorted({*self._publish} - {
                *client.names.values(), *map(str, client.names)}):
            level, line = diagnostics.WARN, (
                f'the server does not stream {", ".join(missing)}; it has: '
                f'{visible(", ".join(client.names.values()))[:200]}')
        self._publish_report(level, line)
        self._reported, self._slowest = frames, 0.0

    def _publish_report(self, level: bytes, line: str) -> None:
        client = self._client
        fit, delays = client.match.line, client.delays
        now = max(self._stamps.values()) if self.params.stamp == 'server' else time.time_ns()
        self._diagnostics(diagnostics.report(max(now, 0), self.get_name(), level, line, {
            'latency [ms]': f'{1e3 * delays.total:.3f}',
            'largest latency [ms]': f'{1e3 * self._slowest:.3f}',
            'camera latency [ms]': f'{1e3 * delays.camera:.3f}',
            'software latency [ms]': f'{1e3 * delays.software:.3f}',
            'network latency [ms]': f'{1e3 * delays.network:.3f}',
            'drift of the clocks [ppm]': f'{1e6 * fit.drift:.2f}' if fit else 'unknown',
            'clocks matched by echoes': client.match.answered,
            'clocks matched anew': client.match.resets,
            'NatNet': '.'.join(map(str, client.version)), **client.counts}))

    def finish(self) -> None:
        """Leave the server and close the sockets."""
        udp.send(self._commands, message(DISCONNECT, b''),
                 (self.params.server, self.params.command_port))
        self._commands.close()
        if self._data is not None:
            self._data.close()


def follow(client: NatNetClientNode, loop: Loop) -> int:
    """Publish poses until stopped; return the exit code."""
    while not loop.stopping:
        client.turn(_WAIT)
        loop.once(0.0)
    return 0


def main(args=None) -> None:
    """Entry point ``natnet_client_node``."""
    process.main(NatNetClientNode, args, follow)
