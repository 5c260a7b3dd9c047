"""Who else publishes or reads a node's topics: what keeps them apart is said in one line each."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo


_UNKNOWN = '_NODE_NAME_UNKNOWN_'  # in the graph until the node itself is discovered
_LOOKS = 5  # at a topic before a publisher without a node is taken for one of another middleware


class End(NamedTuple):
    """One topic of a node."""

    name: str  # full
    shared: bool  # whether it may have several publishers
    profile: QoSProfile
    published: bool  # by the node, else read


def who(info: TopicEndpointInfo) -> str:
    """Return the full name of the node that an endpoint belongs to."""
    if info.node_name == _UNKNOWN:
        return 'a publisher or reader without a node'
    return f"{info.node_namespace.rstrip('/')}/{info.node_name}"


def publishers(node: Node, topic: str) -> set[bytes]:
    """Return the GIDs of the publishers of a topic that the graph knows."""
    return {bytes(info.endpoint_gid) for info in node.get_publishers_info_by_topic(topic)}


def incompatible(name: str, offered: QoSProfile, asked: QoSProfile, publisher: str,
                 reader: str) -> Iterator[str]:
    """Yield a line for each policy of a reader that a publisher does not fulfil."""
    for policy, weak, strong, remedy in (
            ('reliability', ReliabilityPolicy.BEST_EFFORT, ReliabilityPolicy.RELIABLE,
             'have the reader ask for best_effort (sensor_reliability of the estimator) or the '
             'publisher offer reliable'),
            ('durability', DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL,
             'have the reader ask for volatile or the publisher offer transient_local')):
        if getattr(offered, policy) == weak and getattr(asked, policy) == strong:
            yield (f'{name}: {publisher} offers {policy} {weak.name.lower()}, {reader} asks for '
                   f'{strong.name.lower()}: nothing arrives; {remedy}')


class Peers:
    """
    Watch over the topics of one node.

    Parameters
    ----------
    node
        The node.
    ends
        Its topics.

    """

    def __init__(self, node: Node, ends: list[End]) -> None:
        self._node, self._ends = node, ends
        self._next = 0
        self._counts: dict[int, int] = {}  # by the number of the topic
        self._waited: dict[int, int] = {}  # looks at one whose nodes are not all known
        self._said: set[str] = set()

    def look(self) -> None:
        """Look at one topic, the next one each time; warn of what is new."""
        if not self._ends:
            return
        number = self._next
        self._next = (number + 1) % len(self._ends)
        end = self._ends[number]
        count = (self._node.count_subscribers if end.published
                 else self._node.count_publishers)(end.name)
        if count == self._counts.get(number):
            return
        infos = self._infos(end)
        self._waited[number] = self._waited.get(number, 0) + 1
        if self._waited[number] < _LOOKS and any(info.node_name == _UNKNOWN for info in infos):
            return
        self._counts[number], self._waited[number] = count, 0
        for line in self._lines(end, infos):
            if line not in self._said:
                self._said.add(line)
                self._node.get_logger().warning(line)

    def _infos(self, end: End) -> list[TopicEndpointInfo]:
        """Return who is at the other end of a topic."""
        look = (self._node.get_subscriptions_info_by_topic if end.published
                else self._node.get_publishers_info_by_topic)
        return look(end.name)

    def _lines(self, end: End, infos: list[TopicEndpointInfo]) -> Iterator[str]:
        me = self._node.get_fully_qualified_name()
        for info in infos:
            if end.published:
                yield from incompatible(end.name, end.profile, info.qos_profile, me, who(info))
            else:
                yield from incompatible(end.name, info.qos_profile, end.profile, who(info), me)
        if len(infos) > 1 and not end.shared and not end.published:
            names = ', '.join(sorted(map(who, infos)))
            yield (f'{end.name}: {len(infos)} publishers ({names}), there must be one: '
                   'only the first is believed; end the others')
