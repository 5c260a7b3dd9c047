"""
Recorder: every topic of the flight, undecoded, into one bag.

Log and publish time are the stamp inside the message, never the wall clock, so that a simulated
flight has the same bag whenever and however fast it is flown. A message older than one before it
on its topic (a sensor that is out of order) gets the time of that one: the order stays.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mambo_model import schema
from mambo_ros import layout, node, topics

from .bag_writer import BagWriter, BagWriterError, Qos

_TF_STAMP = 4  # bytes between the encapsulation and the stamp of the first transform: the count


@dataclass(frozen=True)
class RecorderNodeParams:
    """Parameters of ``recorder_node``."""

    bag: str = schema.text('', 'directory of the bag, must not exist')
    topics: str = schema.text('', 'names separated by commas, default: every topic of the flight')
    scenario: str = schema.text('', 'file kept inside the bag: scenario and parameters')

    def __post_init__(self) -> None:
        schema.check(self)
        if not self.bag:
            raise schema.ParameterError('RecorderNodeParams.bag: give the directory of the bag')


def _selected(names: str) -> list[topics.Topic]:
    """Return the topics to record, refusing unknown names."""
    known = {topic.name: topic for topic in topics.RECORDED}
    wanted = [name.strip() for name in names.split(',') if name.strip()] or list(known)
    for name in wanted:
        if name not in known:
            raise schema.ParameterError(
                f"RecorderNodeParams.topics: unknown topic {name}; known: {', '.join(known)}")
    return [known[name] for name in wanted]


class RecorderNode(node.MamboNode[RecorderNodeParams]):
    """Records the graph's topics to a rosbag2 directory with an MCAP file."""

    def __init__(self, **kwargs) -> None:
        super().__init__('recorder_node', RecorderNodeParams, **kwargs)
        p = self.params
        selected = _selected(p.topics)
        attachments = {}
        if p.scenario:
            attachments['scenario.yaml'] = Path(p.scenario).read_text()
        try:
            self._bag = BagWriter(Path(p.bag), attachments=attachments)
        except BagWriterError as error:
            raise schema.ParameterError(f'RecorderNodeParams.bag: {error}') from None
        for topic in selected:
            name = self.resolve_topic_name(topic.name)
            self._bag.add_topic(
                name, topic.type_name, Qos(depth=node.QUEUE), shared=topic.shared)
            self.hear(topic, self._writer(name, topic), prompt=False)

    def _writer(self, name: str, topic: topics.Topic):
        """
        Return the callback that writes one topic.

        A late message of one publisher stays behind the one it came after; of several publishers
        the order of arrival is chance, and the stamp alone counts.
        """
        offset = _TF_STAMP if topic is topics.TF else 0
        write, shared, newest = self._bag.write, topic.shared, 0

        def take(data: bytes) -> None:
            nonlocal newest
            stamp = layout.stamp_ns(data, offset)
            newest = stamp if shared else max(newest, stamp)
            write(name, data, newest)
        return take

    def finish(self) -> None:
        """Close the bag and say what is in it."""
        self._bag.close()
        self.get_logger().info(f'closed {self.params.bag}, {self._bag.late} late messages')


def main(args=None) -> None:
    """Entry point ``recorder_node``."""
    node.main(RecorderNode, args)
