"""
Recorder: writes every topic of the flight, undecoded, to one bag.

Log and publish time are the stamp of the message, never the wall clock, so that a simulated flight
gives the same bag at any time and speed. A message older than the previous one of its topic (a
sensor that is out of order) gets the time of that one, which keeps the order.

Any node may publish on these topics. A message without a readable stamp, or with one outside of
this flight (``recording.log_times``), is recorded at the time of ``/clock``; a message of more
than a megabyte is not recorded. The first of each kind and topic is logged as a warning, and all
are counted at the end. On a topic that only one node publishes, messages of a second publisher are
refused. While ``/clock`` goes on, it may take over from one that has left; nobody takes over from
the nodes of a flight that is over. A ``/clock`` with nothing else was no flight. If messages were
lost, because the machine or a flood was too much for the queue, the node ends with exit code 1.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
import struct
from typing import NoReturn

from mambo_model import schema
from mambo_ros import cdr, node, process, topics
from mambo_ros.graph.publisher_guard import PublisherGuard, same_process, SECOND_PUBLISHER

from .recorder_parameters import RecorderNodeParams
from .recording.log_times import EarlyMessages, LogTimes
from .recording.losses import Losses
from .writer import BagWriter, BagWriterError, GRACE, Qos

_TF_STAMP = 4  # bytes between the encapsulation and the stamp of the first transform: their count
_LARGEST = 1_000_000  # largest message, bytes; those of a flight have less than a thousand
_STAMP = 'with a stamp outside of the flight, recorded at the time of /clock'
_SIZE = f'of more than {_LARGEST // 1_000_000} MB, not recorded'


def _stamp(data: bytes, offset: int) -> int | None:
    """Return the stamp of a message in ns, None if it is too short."""
    try:
        if offset and not any(data[4:4 + offset]):  # a sequence without elements
            return None
        return cdr.stamp_ns(data, offset)
    except (IndexError, struct.error):
        return None


class RecorderNode(node.MamboNode[RecorderNodeParams]):
    """Records the graph's topics to a rosbag2 directory with an MCAP file."""

    publishes, subscribes = (topics.DIAGNOSTICS,), topics.RECORDED
    example = '--ros-args -p bag:=my_flight'

    def __init__(self, **kwargs) -> None:
        super().__init__('recorder_node', RecorderNodeParams, **kwargs)
        p = self.params
        selected = topics.selected(p.topics)
        files = {'scenario.yaml': p.scenario, 'world.yaml': p.world}
        attachments = {name: Path(file).read_text('utf-8') for name, file in files.items() if file}
        self._times, self._early, self._failed = LogTimes(), EarlyMessages(), False
        self._odd: Counter[tuple[str, str]] = Counter()  # by topic and kind
        self._losses = Losses(self._full(*topics.COUNTED), self._full(*topics.STEADY))
        try:
            self._bag = BagWriter(Path(p.bag), attachments=attachments)
        except BagWriterError as error:
            raise schema.ParameterError(f'bag: {error}') from None
        try:
            self._record(selected)
        except BaseException:  # also after a signal: nothing else would close the bag yet
            self._bag.close()
            raise

    def _full(self, *some: topics.Topic) -> tuple[str, ...]:
        """Return the full names of topics."""
        return tuple(self.resolve_topic_name(topic.name) for topic in some)

    def _record(self, selected: list[topics.Topic]) -> None:
        """Subscribe to topics and declare them in the bag."""
        for topic in selected:
            name = self.resolve_topic_name(topic.name)
            self._bag.add_topic(
                name, topic.type_name, Qos(depth=topics.QUEUE), shared=topic.shared)
            self.subscribe(topic, self._writer(name, topic), prompt=False, single=not topic.shared)
        if topics.CLOCK not in selected:
            self.subscribe(topics.CLOCK, self._on_clock, prompt=False, single=True)
        clock = next(guard for guard in self.input_guards if guard.topic.endswith('/clock'))
        others = [guard for guard in self.input_guards if guard is not clock]
        command, reference = self._full(topics.COMMAND, topics.REFERENCE)
        for guard in others:
            guard.replaceable = lambda since: not clock.first or clock.latest > since
            if guard.topic == command:  # silent until the first one: a stranger may come before
                guard.belongs = lambda gid: all(
                    same_process(gid, one.first) for one in others if one.topic == reference)
        clock.replaceable = lambda since: not any(guard.first for guard in others)
        for guard in self.input_guards:
            guard.incomplete, guard.forgotten = self._miss, self._forget

    def _on_clock(self, data: bytes) -> None:
        """Update the time from a ``/clock`` that is not recorded."""
        self._times.update(_stamp(data, 0))
        self._release()

    def _writer(self, name: str, topic: topics.Topic) -> Callable[[bytes], None]:
        """
        Return the callback that records one topic.

        Messages of one publisher keep their order even if one is late. With several publishers the
        order of arrival is random, and only the stamp counts.
        """
        offset = _TF_STAMP if topic is topics.TF else 0
        times, write, ends, shared = self._times, self._bag.write, self._losses.ends, topic.shared
        is_clock = topic is topics.CLOCK

        def put(data: bytes, log_time: int) -> None:
            """Write a message with a log time, or a later one that keeps the order."""
            ends[name] = newest = log_time if shared else max(ends.get(name, 0), log_time)
            try:
                write(name, data, newest, now_ns=times.now)
            except BagWriterError as error:
                self._fail(error)

        def record(data: bytes) -> None:
            """Write a message at its stamp if in this flight, else at the clock's time."""
            stamp = _stamp(data, offset)
            if is_clock and not times.update(stamp):
                stamp = None
            log_time, own = times.of(stamp)
            if not own:
                self._notice(name, _STAMP)
            put(data, log_time)

        def take(data: bytes) -> None:
            """Write a message, hold it until there is a clock, or drop it."""
            stamp = None if is_clock else _stamp(data, offset)
            if stamp is not None and times.low <= stamp <= times.high and len(data) <= _LARGEST:
                put(data, stamp)  # nearly every message
            elif len(data) > _LARGEST:
                self._notice(name, _SIZE)
            elif times.now is not None:
                record(data)
            elif is_clock and times.update(_stamp(data, offset)):
                record(data)
                self._release()
            elif self._early.hold(name, record, data):
                self._release()
        return self._losses.counting(take) if topic is topics.SENSOR_TICK else take

    def _release(self) -> None:
        """Record what was held back."""
        if self._early and self._times.now is None:
            self.get_logger().warning('no /clock: stamps are limited by the clock of this machine')
            self._times.use_wall_clock()
        self._early.release()

    def _forget(self, guard: PublisherGuard) -> None:
        """Refuse what is held back of a publisher that has left before any flight."""
        if count := self._early.forget(guard.topic):
            guard.refused[SECOND_PUBLISHER] += count

    def _miss(self, guard: PublisherGuard, reason: str) -> None:
        """End with exit code 1, but only after the flight: its bag is not whole."""
        self.fail(f'{guard.topic}: the bag misses messages that were {reason}')

    def _notice(self, name: str, kind: str) -> None:
        """Count an irregular message, and warn of the first."""
        if not self._odd[name, kind]:
            self.get_logger().warning(f'{name}: a message {kind}')
        self._odd[name, kind] += 1

    def _fail(self, error: BagWriterError) -> NoReturn:
        """End the process, because an unrecorded flight shall not continue."""
        self._failed = True
        self.get_logger().error(str(error))
        raise SystemExit(1)

    def finish(self) -> None:
        """Close the bag and log its irregular messages."""
        if self._failed:
            return
        self._release()
        end = None if self._times.now is None else self._times.now + GRACE
        try:
            self._bag.close(end_ns=end)
        except BagWriterError as error:
            self._fail(error)
        for line in self._losses.lines(self._bag.counts, self._times.now):
            self.fail(line if self.params.whole else '')
        odd = [f'{name}: {count} {kind}' for (name, kind), count in sorted(self._odd.items())]
        if self._bag.beyond:
            odd.append(f'{self._bag.beyond} with a stamp after the end, recorded at the end')
        odd.insert(0, f'closed {self.params.bag}, {self._bag.late} late messages')
        self.get_logger().info('; '.join(odd))


def main(args=None) -> None:
    """Entry point ``recorder_node``."""
    process.main(RecorderNode, args)
