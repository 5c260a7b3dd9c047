"""
A hostile process in the domain of a flight: makes one attack, says what it did, and stays or goes.

``python -m chaos_files.strangers KIND SEED NUMBER MOMENT NAMESPACE`` prints ``there``, waits for
the flight (its first topic if MOMENT is ``start``, else its second second), chooses a target by
its arguments, attacks it for some seconds, and prints what it did as JSON.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
import json
import os
import random
import signal
import struct
import sys
import time
from typing import Any

from mambo_bags.cli.parent_end import end_with
from mambo_ros import cdr, topics
import rclpy
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.publisher import Publisher
from rclpy.qos import (
    DurabilityPolicy, HistoryPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy)
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from std_msgs.msg import String

from . import asking, wild

RCLError = rclpy_implementation.RCLError
NAME = 'stranger'
PATIENCE = 60.0  # s until the flight begins
MATCH = 3.0  # s for the readers to be matched
LISTEN = 0.5  # s for a message to take as a pattern
LASTS = 3.5  # s of an attack that is not counted in messages
STEP = 5_000_000  # ns
BEGUN = 1_000_000_000  # ns of flight after which an attack of the moment 'flight' begins
RATE = 10_000.0  # messages a second of a flood
KNOWN = (*topics.RECORDED, topics.LINKS, topics.TF_STATIC, topics.JOY, topics.SETPOINT,
         topics.COMMAND, topics.CAPTURE_TICK, topics.LOCATED)
"""Topics that an attack at the start may have: the others are not there yet."""
_STAMPS = ((0, 0), (-1, 0), (-2**31, 0), (2**31 - 1, 999_999_999), (5, 1_000_000_000),
           (1, 2**32 - 1), (1_795_307_261, 0))
TIMELY = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
STRICT = (
    QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT),
    QoSProfile(depth=2000, durability=DurabilityPolicy.TRANSIENT_LOCAL),
    QoSProfile(history=HistoryPolicy.KEEP_ALL),
    QoSProfile(depth=1, deadline=Duration(nanoseconds=1_000_000)),
    QoSProfile(depth=1, liveliness=LivelinessPolicy.MANUAL_BY_TOPIC,
               liveliness_lease_duration=Duration(nanoseconds=1_000_000)),
    QoSProfile(depth=1, lifespan=Duration(nanoseconds=1)))


class Stranger:
    """
    The hostile node and what it did.

    Parameters
    ----------
    seed, number
        Of the attack.
    namespace
        Of the first drone.

    """

    def __init__(self, kind: str, seed: int, number: int, namespace: str) -> None:
        self._salt = f'{seed} {kind} {number}'
        self.rng = random.Random(self._salt)
        self._namespace = namespace
        self.node = rclpy.create_node(NAME)
        self.now = -1  # ns of flight
        self.sent = self.matched = 0
        self.topic = ''
        self.readers: list[str] = []

    def spin(self, seconds: float = 0.0) -> None:
        """Serve the node for so many s."""
        limit = time.monotonic() + seconds
        while True:
            rclpy.spin_once(self.node, timeout_sec=min(max(seconds, 0.0), 0.02))
            if time.monotonic() >= limit:
                return

    def wait(self, moment: str) -> bool:
        """Wait for the flight; return whether it came."""
        limit = time.monotonic() + PATIENCE
        def follow(data: bytes) -> None:
            with suppress(struct.error):  # garbage, of itself
                self.now = cdr.stamp_ns(data)
        clock = topics.full_name(topics.CLOCK, self._namespace)
        self.node.create_subscription(Clock, clock, follow, TIMELY, raw=True)
        while time.monotonic() < limit:
            self.spin(0.02)
            there = {name for name, _ in self.node.get_topic_names_and_types()} - {clock}
            if self.now >= BEGUN or moment == 'start' and any(
                    name.startswith(self._namespace) for name in there):
                return True
        return False

    def offered(self, moment: str) -> dict[str, type]:
        """Return the topics that there are to attack, with their types."""
        if moment == 'start':
            return {topics.full_name(topic, self._namespace): topic.msg_type for topic in KNOWN}
        before: list[str] = []
        names = [('', [''])]
        while before != [name for name, _ in names]:  # until the graph is settled
            before = [name for name, _ in names]
            self.spin(0.3)
            names = self.node.get_topic_names_and_types()
        return {name: wild.found(kinds[0]) for name, kinds in names}

    def choose(self, offered: dict[str, type]) -> str:
        """Choose a topic, by seed and number, mostly one that the flight reads."""
        rank = {name: random.Random(f'{self._salt} {name}').random() for name in offered}
        read = [name for name in offered if self.read_by(name)]
        wide = self.rng.random() < 0.25 or not read
        return min(offered if wide else read, key=rank.__getitem__)

    def read_by(self, topic: str) -> list[str]:
        """Return the nodes of the flight that subscribe to a topic."""
        infos = self.node.get_subscriptions_info_by_topic(topic)
        return sorted({info.node_name for info in infos} - {NAME})

    def pattern(self, topic: str, kind: type) -> Any:
        """Return the newest message of a topic, or an empty one."""
        heard: list[bytes] = []
        source = self.node.create_subscription(kind, topic, heard.append, TIMELY, raw=True)
        self.spin(LISTEN)
        self.node.destroy_subscription(source)
        return deserialize_message(heard[-1], kind) if heard else kind()

    def publisher(self, topic: str, kind: type) -> Publisher:
        """Return a publisher that matches the readers of a topic, once it has."""
        infos = self.node.get_subscriptions_info_by_topic(topic)
        durable = any(info.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
                      for info in infos)
        out = self.node.create_publisher(kind, topic, QoSProfile(
            depth=100, durability=(DurabilityPolicy.TRANSIENT_LOCAL if durable
                                   else DurabilityPolicy.VOLATILE)))
        limit = time.monotonic() + MATCH
        while time.monotonic() < limit and (
                out.get_subscription_count() < len(self.read_by(topic))):
            self.spin(0.02)
        return out

    def send(self, out: Publisher, data: bytes) -> None:
        """Publish a serialised message; a full queue is no error."""
        self.matched = max(self.matched, out.get_subscription_count())
        with suppress(RCLError):
            out.publish(data)
            self.sent += 1

    def near(self, message: Any) -> None:
        """Stamp a message near the time of the flight."""
        t = self.now + self.rng.choice((0, STEP, 2 * STEP, -STEP, 10 * STEP))
        wild.stamp(message, *divmod(max(t, 0), cdr.SECOND))


def _until(seconds: float) -> Iterator[None]:
    """Yield for so many s."""
    limit = time.monotonic() + seconds
    while time.monotonic() < limit:
        yield


def values(me: Stranger, topic: str, kind: type) -> None:
    """Publish messages with wild values in some fields."""
    out, like = me.publisher(topic, kind), serialize_message(me.pattern(topic, kind))
    for _ in range(300):
        message = deserialize_message(like, kind)
        me.near(message)
        wild.spoil(me.rng, message)
        me.send(out, serialize_message(message))
        me.spin()


def stamps(me: Stranger, topic: str, kind: type) -> None:
    """Publish good messages with wrong stamps."""
    out, message = me.publisher(topic, kind), me.pattern(topic, kind)
    for count in range(300):
        seconds, rest = me.rng.choice((*_STAMPS, *(divmod(max(t, 0), cdr.SECOND) for t in (
            me.now + STEP, me.now - STEP, me.now - count * STEP, me.now + cdr.SECOND))))
        wild.stamp(message, seconds, rest)
        me.send(out, serialize_message(message))
        me.spin()


def flood(me: Stranger, topic: str, kind: type) -> None:
    """Publish thousands of messages a second, good ones or garbage."""
    out, message = me.publisher(topic, kind), me.pattern(topic, kind)
    me.near(message)
    data = serialize_message(message)
    if me.rng.random() < 0.3:
        data = wild.garbage(me.rng, data)
    began = time.monotonic()
    before = me.sent
    for _ in _until(me.rng.uniform(1.0, 3.0)):
        while me.sent - before < RATE * (time.monotonic() - began):
            me.send(out, data)
        time.sleep(0.0002)


def large(me: Stranger, topic: str, kind: type) -> None:
    """Publish messages of several megabytes."""
    out, like = me.publisher(topic, kind), serialize_message(me.pattern(topic, kind))
    for _ in range(me.rng.randint(1, 20)):
        me.send(out, wild.enlarged(me.rng, deserialize_message(like, kind)))
        me.spin(0.05)


def rival(me: Stranger, topic: str, kind: type) -> None:
    """Repeat what is published, a little changed or not, as a second publisher."""
    out = me.publisher(topic, kind)
    changed = me.rng.random() < 0.5

    def repeat(data: bytes) -> None:
        message = deserialize_message(data, kind)
        if changed:
            me.near(message)
        me.send(out, serialize_message(message))
    source = me.node.create_subscription(kind, topic, repeat, TIMELY, raw=True)
    me.spin(LASTS)
    me.node.destroy_subscription(source)
    if not me.sent:  # nobody publishes it
        for _ in range(100):
            message = kind()
            me.near(message)
            me.send(out, serialize_message(message))
            me.spin()


def garbage(me: Stranger, topic: str, kind: type) -> None:
    """Publish bytes that are no message."""
    out, data = me.publisher(topic, kind), serialize_message(me.pattern(topic, kind))
    for _ in range(300):
        me.send(out, wild.garbage(me.rng, data))
        me.spin()


def other_type(me: Stranger, topic: str, kind: type) -> None:
    """Publish, and subscribe to, the topic with another type, as one process has one of each."""
    other = me.rng.choice([one for one in (String, Clock, topics.ESTIMATE.msg_type)
                           if one is not kind])
    context = rclpy.Context()
    context.init()
    node = rclpy.create_node(NAME, context=context, enable_rosout=False)
    if topic in ('/rosout', '/parameter_events'):  # every node has these with their own types
        topic = me.topic = f'{topics.NAMESPACE}/{topics.REFERENCE.name}'
    out = node.create_publisher(other, topic, QoSProfile(depth=10))
    node.create_subscription(other, topic, lambda data: None, QoSProfile(depth=10), raw=True)
    for _ in _until(LASTS):
        message = other()
        wild.spoil(me.rng, message)
        me.send(out, serialize_message(message))
        me.spin(0.02)


def qos(me: Stranger, topic: str, kind: type) -> None:
    """Publish and subscribe with every quality of service, and never read."""
    message = me.pattern(topic, kind)
    outs = []
    for profile in STRICT:
        outs.append(me.node.create_publisher(kind, topic, profile))
        me.node.create_subscription(kind, topic, lambda data: None, profile, raw=True)
    for _ in _until(LASTS):
        me.near(message)
        for out in outs:
            me.send(out, serialize_message(message))
        time.sleep(0.01)


def churn(me: Stranger, topic: str, kind: type) -> None:
    """Create and destroy publishers, subscriptions and nodes as quickly as possible."""
    message = me.pattern(topic, kind)
    for _ in _until(LASTS):
        me.near(message)
        node = rclpy.create_node(f'{NAME}_{me.rng.randrange(10)}')
        outs = [node.create_publisher(kind, topic, QoSProfile(depth=10)) for _ in range(5)]
        node.create_subscription(kind, topic, lambda data: None, QoSProfile(depth=10), raw=True)
        for out in outs:
            me.send(out, serialize_message(message))
        node.destroy_node()


def clock(me: Stranger, topic: str, kind: type) -> None:
    """Publish a second clock: as fast, leaping, going backwards, or years ahead."""
    me.topic = topic = topics.full_name(topics.CLOCK, me._namespace)
    me.readers = me.read_by(topic)
    out = me.publisher(topic, Clock)
    way = me.rng.choice(('rival', 'leap', 'backwards', 'years', 'negative'))
    for count in range(600):
        t = {'rival': me.now + STEP, 'leap': me.now + 2 * cdr.SECOND + count * STEP,
             'backwards': max(me.now - count * STEP, 0), 'negative': -cdr.SECOND,
             'years': 10**18 + count * STEP}[way]
        message = Clock()
        wild.stamp(message, *divmod(t, cdr.SECOND))
        me.send(out, serialize_message(message))
        me.spin(0.003)


ATTACKS = {'values': values, 'stamps': stamps, 'flood': flood, 'large': large, 'rival': rival,
           'garbage': garbage, 'type': other_type, 'qos': qos, 'churn': churn, 'clock': clock}
"""Of topics, by kind; ``requests`` goes to services."""


def attack(me: Stranger, kind: str, moment: str) -> dict[str, Any]:
    """Make an attack; return what was done."""
    if kind == 'requests':
        me.topic, me.sent = asking.attack(me.node, me.rng, NAME)
    else:
        offered = me.offered(moment)
        me.topic = me.choose(offered)
        me.readers = me.read_by(me.topic)
        ATTACKS[kind](me, me.topic, offered[me.topic])
        me.readers = me.readers or me.read_by(me.topic)
    return {'target': me.topic, 'readers': me.readers, 'sent': me.sent, 'matched': me.matched}


def main() -> None:
    """Attack, and leave without traces of its own in shared memory."""
    end_with(os.getppid(), signal.SIGTERM)
    rclpy.init()
    try:
        act(*sys.argv[1:])
    except (ExternalShutdownException, RCLError):
        if rclpy.ok():
            raise  # it was no signal, which comes when the flight is over
    finally:
        rclpy.try_shutdown()


def act(kind: str, seed: str, number: str, moment: str, namespace: str) -> None:
    """Wait, attack, tell, and stay or go."""
    me = Stranger(kind, int(seed), int(number), namespace)
    print('there', flush=True)
    if not me.wait(moment):
        return
    me.spin(me.rng.uniform(0.0, 1.5) if moment == 'flight' else me.rng.uniform(0.0, 0.3))
    before = me.now
    done = attack(me, kind, moment)
    me.spin(0.2)
    print(json.dumps({**done, 'from': before, 'to': me.now}), flush=True)
    if me.rng.random() < 0.7:
        me.spin(600.0)


if __name__ == '__main__':
    main()
