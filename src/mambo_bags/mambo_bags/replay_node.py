"""
Replay: publishes the recorded sensors of a bag, with ``/clock``.

It runs at a chosen rate or as fast as the estimator answers; no message is lost in either case.
The watermark of the sensors (``sensor_tick``) comes from the bag, or from the samples themselves
if the bag has none (real hardware), so that a replayed estimate is the same at every rate.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
import time

from mambo_model import schema
from mambo_ros import cdr, messages, node, process, topics
from mambo_ros.endpoints import RawPublisher
from mambo_ros.graph import links
from mambo_ros.loop import Loop

from .playback import bag_files, recorded

_SENSORS = (topics.IMU, topics.SONAR, topics.OPTICAL_FLOW, topics.BAROMETER)


@dataclass(frozen=True)
class ReplayNodeParams:
    """Parameters of ``replay_node``."""

    bag: str = schema.text('', 'rosbag2 directory or .mcap file')
    rate: float = schema.quantity(
        0.0, '-', 0.0, 1000.0, 'recorded time over wall time, 0: as fast as the estimator answers')
    capture: bool = schema.flag(
        False, 'publish the poses of the motion capture with their watermark, for an estimator '
        'that uses them')
    also: str = schema.text('', 'more topics of the bag to publish, separated by commas')
    source_namespace: str = schema.text('/mambo', 'namespace of the recorded topics')
    wait_for: str = schema.text('', 'names of nodes to wait for, separated by commas')
    start_patience: float = schema.quantity(
        300.0, 's', 1.0, 3600.0,
        'wall time to wait for nodes and links: the first start compiles the numerics')
    patience: float = schema.quantity(
        30.0, 's', 1.0, 3600.0, 'wall time without an answer after which to give up')

    def __post_init__(self) -> None:
        schema.check(self)


def _decode_stamp(data: bytes) -> tuple[int]:
    return cdr.stamp_ns(data),


def _nothing(t: int) -> None:
    """Do nothing: the guard of the estimates keeps the newest stamp."""


class ReplayNode(node.MamboNode[ReplayNodeParams]):
    """Publishes the recorded sensors of a bag with ``/clock``; subscribes ``estimate/odom``."""

    publishes = (
        *_SENSORS, topics.SENSOR_TICK, topics.OPTITRACK, topics.CAPTURE_TICK, topics.CLOCK,
        topics.DIAGNOSTICS)
    subscribes = (topics.ESTIMATE,)
    example = '--ros-args -p bag:=my_flight -p wait_for:=estimator_node'

    def __init__(self, **kwargs) -> None:
        super().__init__('replay_node', ReplayNodeParams, **kwargs)
        p = self.params
        known = {topic.name: topic for topic in topics.RECORDED}
        extra = [name.strip() for name in p.also.split(',') if name.strip()]
        unknown = [name for name in extra if name not in known]
        if unknown:
            raise schema.ParameterError(
                f"ReplayNodeParams.also: unknown topic {unknown[0]}; known: {', '.join(known)}")
        self._path = Path(p.bag)
        bag_files(self._path)
        self._topics = {}
        root = p.source_namespace.rstrip('/')
        capture = (topics.OPTITRACK, topics.CAPTURE_TICK) if p.capture else ()
        for topic in dict.fromkeys(
                (*_SENSORS, topics.SENSOR_TICK, *capture, *(known[n] for n in extra))):
            name = topic.name if topic.name.startswith('/') else f'{root}/{topic.name}'
            self._topics[name] = (topic, self.advertise(topic))
        self._clock_output = self.advertise(topics.CLOCK)
        self._t = -1  # of the newest step, ns
        self._estimates = self.accept(
            topics.ESTIMATE, _decode_stamp, _nothing, now=lambda: self._t)
        self.links = links.Links(self, p.wait_for)

    def steps(self) -> Iterator[int]:
        """Publish the bag step by step; yield the stamp in ns after each."""
        missing = [tick for tick in (topics.SENSOR_TICK, topics.CAPTURE_TICK) if self._lacks(tick)]
        counts = dict.fromkeys((*_SENSORS, topics.OPTITRACK), 0)
        held: list[tuple] = []  # messages of the step that is not yet complete
        now = -1
        for name, kind, data in recorded(self._path, set(self._topics)):
            topic, publish = self._topics[name]
            if kind != topic.type_name:
                raise schema.ParameterError(
                    f'{self._path}: {name} has type {kind}, expected {topic.type_name}')
            t = cdr.stamp_ns(data)
            if topic is topics.IMU and t > now:
                if now >= 0:
                    yield self._publish_step(now, held, counts, missing)
                    held = []
                now = t
            held.append((topic, publish, data))
        if now >= 0:
            yield self._publish_step(now, held, counts, missing)

    def _lacks(self, tick: topics.Topic) -> bool:
        """Return whether a watermark is to be published that is not in the bag."""
        names = {name for name, (entry, _) in self._topics.items() if entry is tick}
        return bool(names) and not any(True for _ in recorded(self._path, names))

    def _output(self, topic: topics.Topic) -> RawPublisher:
        return next(output for entry, output in self._topics.values() if entry is topic)

    def _publish_step(
        self, t: int, held: list[tuple], counts: dict, missing: list[topics.Topic],
    ) -> int:
        self._t = t
        self._clock_output(messages.clock(t))
        for topic, publish, data in held:
            if topic in counts:
                counts[topic] += 1
            publish(data)
        if topics.CAPTURE_TICK in missing:
            self._output(topics.CAPTURE_TICK)(messages.capture_tick(t, counts[topics.OPTITRACK]))
        if topics.SENSOR_TICK in missing:
            self._output(topics.SENSOR_TICK)(
                messages.sensor_tick(t, *(counts[topic] for topic in _SENSORS)))
        return t

    def wait_for_answer(self, loop: Loop, t: int) -> bool:
        """Serve the graph until the estimate of ``t`` has arrived."""
        began = time.monotonic()
        while self._estimates.last < t:
            loop.once(0.02)
            if loop.stopping:
                return False
            if time.monotonic() - began > self.params.patience and self._estimates.last < t:
                self.get_logger().error(
                    f'no estimate/odom for t = {t * 1e-9:.3f} s within '
                    f'{self.params.patience:g} s')
                return False
        return True


def replay(player: ReplayNode, loop: Loop) -> int:
    """Play the bag to its end or until stopped; return the exit code."""
    p, log = player.params, player.get_logger()
    if not player.links.wait(loop, p.start_patience):
        return 0 if loop.stopping else 1
    if not player.links.alone(topics.CLOCK):
        return 1
    began, first, t, count = time.monotonic(), None, 0, 0
    try:
        for t in player.steps():
            count += 1
            first = t if first is None else first
            if p.rate:
                while (left := began + (t - first) * 1e-9 / p.rate - time.monotonic()) > 0.0:
                    loop.once(left)
                    if loop.stopping:
                        return 0
            elif not player.wait_for_answer(loop, t):
                return 0 if loop.stopping else 1
    except schema.ParameterError as error:
        log.error(str(error))
        return 1
    if not count:
        log.error(f'{p.bag}: no sensor messages under {p.source_namespace}')
        return 1
    if p.wait_for and not player.wait_for_answer(loop, t):
        return 1
    took, span = time.monotonic() - began, (t - first) * 1e-9
    log.info(f'replayed {span:.3f} s, {count} steps, in {took:.3f} s of wall time')
    return 0


def main(args=None) -> None:
    """Entry point ``replay_node``."""
    process.main(ReplayNode, args, replay)
