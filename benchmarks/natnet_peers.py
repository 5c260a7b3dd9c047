"""
Three public NatNet clients, unmodified, at the server of the simulated hall.

    python3 -m benchmarks.natnet_peers --rate 360 --minutes 10

Feeds three servers with a true state in real time: one multicast of version 4.1 with ``natnet``
and ``motioncapture``, one unicast of 3.1 with ``natnet``, one of 2.9 with ``NatNetClient``, which
knows no later version. Prints how many frames were sent and what each client got. The clients are
in an environment of their own in .cache, from natnet_peers.txt.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager, ExitStack
import json
import math
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

from mambo_model.motion.quaternion import exp_map
from mambo_model.motion.rigid_body import State
from mambo_ros import messages, topics
import rclpy
from rclpy.qos import QoSProfile

from .rotorpy_peer import environment, install

ROOT = Path(__file__).parents[1]
REQUIREMENTS = Path(__file__).with_name('natnet_peers.txt')
CLIENT = Path(__file__).with_name('natnet_peer_client.py')
STEP = 5_000_000  # ns
SERVERS = {  # command port: parameters
    21_510: {'transmission': 'multicast', 'version': "'4.1'"},
    21_610: {'transmission': 'unicast', 'version': "'3.1'"},
    21_710: {'transmission': 'unicast', 'version': "'2.9'", 'unicast_to': 'data_port'}}
CLIENTS = {  # name: argument and port
    'natnet 0.3.0, multicast 4.1': ('natnet', 21_510),
    'motioncapture 1.1, multicast 4.1': ('motioncapture', 21_510),
    'natnet 0.3.0, unicast 3.1': ('natnet_unicast', 21_610),
    'NatNetClient 0.8.3, unicast 2.9': ('natnetclient', 21_710)}


def truth(t: int) -> State:
    """Return the true state of a body on a circle, t in ns."""
    s = t * 1e-9
    return State((math.cos(s), math.sin(s), -1.5), (0.0, 0.0, 0.0), exp_map((0.0, 0.05, 0.1)),
                 (0.0, 0.0, 0.0))


@contextmanager
def running(command: list[str], **options: object) -> Iterator[subprocess.Popen]:
    """Run a process; interrupt it at the end."""
    with subprocess.Popen(command, text=True, **options) as process:
        try:
            yield process
        finally:
            if process.poll() is None:
                process.send_signal(signal.SIGINT)


def feed(publisher: rclpy.publisher.Publisher, seconds: float) -> int:
    """Publish the true state in real time; return the last stamp, ns."""
    steps, begun = round(seconds * 1e9) // STEP, time.monotonic()
    for k in range(steps + 1):
        time.sleep(max(begun + k * STEP * 1e-9 - time.monotonic(), 0.0))
        publisher.publish(messages.ground_truth(k * STEP, truth(k * STEP)))
    return steps * STEP


def measure(rate: float, seconds: float) -> dict[str, dict[str, int]]:
    """Return what was sent and what each client got."""
    python = install(ROOT / '.cache/natnet-peers', REQUIREMENTS, 'the clients')
    with ExitStack() as stack:
        rclpy.init()
        stack.callback(rclpy.try_shutdown)
        node = rclpy.create_node('natnet_feed', namespace='mambo')
        publisher = node.create_publisher(
            topics.GROUND_TRUTH.msg_type, topics.GROUND_TRUTH.name, QoSProfile(depth=2000))
        for number, (port, given) in enumerate(SERVERS.items()):
            given = {**given, 'rate': float(rate), 'command_port': port, 'data_port': port + 1}
            stack.enter_context(running(
                ['ros2', 'run', 'mambo_mocap', 'natnet_server_node', '--ros-args',
                 '-r', f'__node:=server{number}',
                 *(word for name, value in given.items() for word in ('-p', f'{name}:={value}'))],
                stdout=subprocess.DEVNULL))
        limit = time.monotonic() + 300.0
        while publisher.get_subscription_count() < len(SERVERS) and time.monotonic() < limit:
            time.sleep(0.5)
        clients = {name: stack.enter_context(running(
            [str(python), str(CLIENT), kind, str(port)], stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL, env=environment()))
            for name, (kind, port) in CLIENTS.items()}
        for client in clients.values():
            while 'ready' not in (line := client.stdout.readline()) and line:
                pass
        time.sleep(2.0)
        last = feed(publisher, seconds)
        sent = last // round(1e9 / rate) + 1
        found = {name: json.loads(([line for line in client.stdout if '{' in line] or ['{}'])[-1])
                 for name, client in clients.items()}
    return {'sent': {'frames': sent}, **found}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[1])
    parser.add_argument('--rate', type=float, default=120.0, help='Hz (default: 120)')
    parser.add_argument('--minutes', type=float, default=10.0, help='(default: 10)')
    options = parser.parse_args()
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    for name, counts in measure(options.rate, 60.0 * options.minutes).items():
        print(f'{name:<36}', *(f'{value} {what}' for what, value in counts.items()))
    sys.stdout.flush()


if __name__ == '__main__':
    main()
