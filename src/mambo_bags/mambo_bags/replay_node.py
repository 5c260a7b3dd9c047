"""
Replay: publishes the recorded sensors of a bag, with ``/clock``.

It runs at a chosen rate or as fast as the estimator answers; no message is lost in either case.
The watermark of the sensors (``sensor_tick``) comes from the bag, or from the samples themselves
if the bag has none (real hardware), so that a replayed estimate is the same at every rate. An
estimator learns from the samples after it that one was lost: where an answer is missing, the
replay goes on for a moment of the flight without it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
import time

from mambo_model import schema
from mambo_model.errors import InputError
from mambo_ros import cdr, messages, node, process, topics
from mambo_ros.endpoints import RawPublisher
from mambo_ros.graph import links
from mambo_ros.loop import Loop

from .playback import (
    bag_files, before, COUNTED, counted_from, COUNTS, Hesitation, Losses, recorded, SENSORS, steps,
    uncounted, Watermarks)
from .reader import read_bag


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
        *SENSORS, topics.SENSOR_TICK, topics.OPTITRACK, topics.CAPTURE_TICK, topics.CLOCK,
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
        self._topics: dict[str, topics.Topic] = {}
        self._outputs: dict[topics.Topic, RawPublisher] = {}
        self._root = f"{p.source_namespace.rstrip('/')}/"
        capture = (topics.OPTITRACK, topics.CAPTURE_TICK) if p.capture else ()
        for topic in dict.fromkeys(
                (*SENSORS, topics.SENSOR_TICK, *capture, *(known[n] for n in extra))):
            name = topic.name if topic.name.startswith('/') else f'{self._root}{topic.name}'
            self._topics[name], self._outputs[topic] = topic, self.advertise(topic)
        self._clock_output = self.advertise(topics.CLOCK)
        self._t = -1  # of the newest step, ns
        self._due = -1  # of the newest step that has an answer, ns
        self._hesitation = Hesitation()
        self._estimates = self.accept(
            topics.ESTIMATE, _decode_stamp, _nothing, now=lambda: self._t)
        self.links = links.Links(self, p.wait_for)

    def steps(self) -> Iterator[int]:
        """Publish the bag step by step; yield the stamp in ns after each."""
        bag = read_bag(self._path, set(self._topics), self._root.rstrip('/'))
        there = {topic for name, topic in self._topics.items() if name in bag}
        missing = [tick for tick in COUNTS if tick in self._outputs and (
            tick not in there or not there.intersection(COUNTS[tick]))]
        left_out, first = uncounted(bag, self._root), before(bag, self._root)
        self._losses = Losses(topics.CAPTURE_TICK in there.difference(missing))
        del bag
        marks = Watermarks(len(COUNTED))
        for now, held in steps(self._recorded(missing, first), left_out):
            yield self._publish_step(now, held, marks, missing)

    def _recorded(
        self, missing: list[topics.Topic], first: dict[topics.Topic, int],
    ) -> Iterator[tuple[topics.Topic, bytes]]:
        """Yield the messages to play; ParameterError if one has another type."""
        names = {name for name, topic in self._topics.items() if topic not in missing}
        for name, kind, data in recorded(self._path, names):
            topic = self._topics[name]
            if kind != topic.type_name:
                raise schema.ParameterError(
                    f'{self._path}: {name} has type {kind}, expected {topic.type_name}')
            shifted = topic in COUNTS and any(first[one] for one in COUNTS[topic])
            yield topic, counted_from(data, topic, first) if shifted else data

    def _publish_step(
        self, t: int, held: list[tuple[topics.Topic, bytes]], marks: Watermarks,
        missing: list[topics.Topic],
    ) -> int:
        self._t = t
        if self._hesitation.ends_gap(held, self._estimates.last):
            time.sleep(Hesitation.WAIT)  # topics overtake each other on the way
        self._clock_output(messages.clock(t))
        for topic, data in held:
            if missing and topic in COUNTED:
                marks.add(COUNTED.index(topic), cdr.stamp_ns(data))
            self._losses.play(topic, data)
            self._outputs[topic](data)
        *samples, poses = marks.announced(t)
        if topics.CAPTURE_TICK in missing:
            self._outputs[topics.CAPTURE_TICK](messages.capture_tick(t, poses))
        if topics.SENSOR_TICK in missing:
            self._outputs[topics.SENSOR_TICK](messages.sensor_tick(t, *samples))
        if self._losses.answered(t) or topics.SENSOR_TICK in missing:
            self._due = t
        return t

    def wait_for_answer(self, loop: Loop, last: bool = False) -> bool:
        """Serve the graph until the estimate that is due is here, not long but for the last."""
        looked, waited, t = time.monotonic(), 0.0, self._due
        while self._estimates.last < t:
            loop.once(0.0 if not last and self._hesitation.over(self._estimates.last) else 0.02)
            if loop.stopping:
                return False
            newest, now = self._estimates.last, time.monotonic()
            waited, looked = waited + min(now - looked, Hesitation.LONGEST), now
            if newest < t and not last and self._hesitation.goes_on(newest, waited):
                break
            if newest < t and waited > self.params.patience:
                self.get_logger().error(
                    f'no estimate/odom for t = {t * 1e-9:.3f} s within '
                    f'{self.params.patience:g} s{self._losses}')
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
            elif not player.wait_for_answer(loop):
                return 0 if loop.stopping else 1
    except InputError as error:
        log.error(str(error))
        return 1
    if not count:
        log.error(f'{p.bag}: no sensor messages under {p.source_namespace}')
        return 1
    if (p.wait_for or not p.rate) and not player.wait_for_answer(loop, last=True):
        return 0 if loop.stopping else 1
    took, span = time.monotonic() - began, (t - first) * 1e-9
    log.info(f'replayed {span:.3f} s, {count} steps, in {took:.3f} s of wall time')
    return 0


def main(args=None) -> None:
    """Entry point ``replay_node``."""
    process.main(ReplayNode, args, replay)
