"""ROS node that serves the simulated hall as Motive serves a real one."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from functools import partial
import time

from mambo_model.motion.rigid_body import State
from mambo_ros import diagnostics, input_guard, messages, node, process, topics
from mambo_ros.loop import Loop
from mambo_sim.sensors.gathering import Gathering

from . import udp
from .hall import content, Hall, View
from .natnet.frame import Times
from .pace import Pace
from .parameters import NatNetServerNodeParams
from .server import Server, ticks

_REPORT_EVERY = 1_000_000_000  # ns
_QUEUE = 2000  # views that wait for their time
_CAMERA = 5_000_000  # ns of the latency that is spent before the server has the images


class NatNetServerNode(node.MamboNode[NatNetServerNodeParams]):
    """
    NatNet server of the simulated hall, for the clients of a real one.

    Subscribes ``ground_truth/odom`` of a flight in real time, or the truth of each of several
    drones, and sends each frame its latency after the exposure; publishes ``/diagnostics``.
    """

    publishes = (topics.DIAGNOSTICS,)
    subscribes = (topics.GROUND_TRUTH,)
    example = "--ros-args -p transmission:=unicast -p version:=\"'3.1'\" -p rate:=360.0"

    def __init__(self, **kwargs) -> None:
        super().__init__('natnet_server_node', NatNetServerNodeParams, **kwargs)
        p = self.params
        self._hall, self._server = Hall(p), Server(p)
        still = State((0.0,) * 3, (0.0,) * 3, (1.0, 0.0, 0.0, 0.0), (0.0,) * 3)
        # have the compiled steps in memory before time starts
        Hall(p).look(0, [still] * len(p.topics))
        self._commands = udp.open_socket(p.address, p.command_port)
        self._group = udp.open_socket(p.address, 0)
        self._steps = Gathering(len(p.topics))
        self._waiting: deque[tuple[View, ...]] = deque(maxlen=_QUEUE)
        self._pace = Pace()
        self._newest, self._apart = 0, p.period // 2  # ns, when the last frame left; least gap
        self._sent = self._failed = self._next_report = 0
        self._diagnostics = self.advertise(topics.DIAGNOSTICS)
        for number, name in enumerate(p.topics.values()):
            self.accept(
                replace(topics.GROUND_TRUTH, name=name), messages.decode_odometry,
                partial(self._on_truth, number), check=input_guard.check_state)

    def _on_truth(self, number: int, t: int, state: State) -> None:
        for at, states in self._steps.put(number, t, state):
            self._pace.add(at, time.time_ns())
            self._waiting.extend(self._hall.look(at, states))
        if t >= self._next_report:
            self._next_report = (t // _REPORT_EVERY + 1) * _REPORT_EVERY
            self._report(t)

    def turn(self) -> float:
        """Answer commands and send the frames that are due; return the time to the next, s."""
        for data, sender, arrived in udp.receive(self._commands):
            reply = self._server.answer(data, sender, arrived)
            if reply is not None:
                udp.send(self._commands, reply, sender)
        latency = round(self.params.latency * 1e9)
        while self._waiting:
            exposed = self._waiting[0][0].exposure + self._pace.offset
            # a client that takes the newest packet alone loses one of two that come together
            now, due = time.time_ns(), max(exposed + latency, self._newest + self._apart)
            if now < due <= now + 2 * self._apart + latency:
                return (due - now) * 1e-9
            self._send(self._waiting.popleft(), exposed, now)
        return 0.005

    def _send(self, views: tuple[View, ...], exposed: int, now: int) -> None:
        times = Times(views[0].exposure * 1e-9, ticks(exposed),
                      ticks(min(exposed + _CAMERA, now)), ticks(now))
        target = self._group if self.params.transmission == 'multicast' else self._commands
        for data, address in self._server.packets(content(views, self.params, times), now):
            if udp.send(target, data, address):
                self._sent += 1
            else:
                self._failed += 1
        self._newest = time.time_ns()

    def _report(self, t: int) -> None:
        refused = self._server.refused
        level, line = diagnostics.OK, 'serving'
        if self._failed:
            level, line = diagnostics.WARN, 'frames were not sent'
        elif refused:
            level, line = diagnostics.WARN, 'commands were refused'
        self._diagnostics(diagnostics.report(t, self.get_name(), level, line, {
            'frames sent': self._sent, 'frames not sent': self._failed,
            'unicast clients': len(self._server.clients),
            **{f'commands {reason}': count for reason, count in sorted(refused.items())}}))

    def finish(self) -> None:
        """Close the sockets."""
        self._commands.close()
        self._group.close()


def serve(server: NatNetServerNode, loop: Loop) -> int:
    """Serve until stopped; return the exit code."""
    while not loop.stopping:
        loop.once(min(server.turn(), 0.005))
    return 0


def main(args=None) -> None:
    """Entry point ``natnet_server_node``."""
    process.main(NatNetServerNode, args, serve)
