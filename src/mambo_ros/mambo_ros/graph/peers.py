"""Other publishers and readers of a node's topics: one warning for each incompatibility."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from rclpy.duration import Duration, Infinite
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy
from rclpy.topic_endpoint_info import TopicEndpointInfo


_UNKNOWN = '_NODE_NAME_UNKNOWN_'  # name in the graph until the node itself is discovered
_LOOKS = 5  # looks before a publisher without a node is assumed to belong to another middleware


class End(NamedTuple):
    """One topic of a node."""

    name: str  # full name
    shared: bool  # whether it may have several publishers
    profile: QoSProfile
    published: bool  # True: the node publishes it; False: it subscribes to it


def who(info: TopicEndpointInfo) -> str:
    """Return the full name of the node that an endpoint belongs to."""
    if info.node_name == _UNKNOWN:
        return 'a publisher or reader without a node'
    return f"{info.node_namespace.rstrip('/')}/{info.node_name}"


def publishers(node: Node, topic: str) -> set[bytes]:
    """Return the GIDs of the publishers of a topic that the graph knows."""
    return {bytes(info.endpoint_gid) for info in node.get_publishers_info_by_topic(topic)}


def crowd(topic: str, infos: list[TopicEndpointInfo]) -> str:
    """Return a line that names the publishers of a topic that should have one."""
    names = ', '.join(sorted(map(who, infos)))
    return f'{topic}: {len(infos)} publishers ({names}), expected one'


def incompatible(name: str, offered: QoSProfile, asked: QoSProfile, publisher: str,
                 reader: str) -> Iterator[str]:
    """Yield a line for each policy that a reader requests and a publisher does not offer."""
    for policy, weak, strong, remedy in (
            ('reliability', ReliabilityPolicy.BEST_EFFORT, ReliabilityPolicy.RELIABLE,
             'let the reader request best_effort (sensor_reliability of the estimator) or the '
             'publisher offer reliable'),
            ('durability', DurabilityPolicy.VOLATILE, DurabilityPolicy.TRANSIENT_LOCAL,
             'let the reader request volatile or the publisher offer transient_local')):
        if getattr(offered, policy) == weak and getattr(asked, policy) == strong:
            yield (f'{name}: {publisher} offers {policy} {weak.name.lower()}, {reader} requests '
                   f'{strong.name.lower()}: nothing arrives; {remedy}')
    manual = LivelinessPolicy.MANUAL_BY_TOPIC
    weaker = [policy for policy, yes in (
        ('deadline', _later(offered.deadline, asked.deadline)),
        ('liveliness', asked.liveliness == manual != offered.liveliness),
        ('liveliness lease duration', _later(
            offered.liveliness_lease_duration, asked.liveliness_lease_duration))) if yes]
    if weaker:
        yield (f'{name}: {reader} requests a stricter {" and ".join(weaker)} than {publisher} '
               'offers: nothing arrives; leave it out')


def _later(offered: Duration, asked: Duration) -> bool:
    """Return whether an offered duration is longer than the one asked; 0 is not stated."""
    return (offered.nanoseconds or Infinite.nanoseconds) > (
        asked.nanoseconds or Infinite.nanoseconds)


class Peers:
    """
    Monitor of the other ends of one node's topics.

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
        self._waited: dict[int, int] = {}  # looks at a topic while some of its nodes are unknown
        self._warned: set[str] = set()

    def look(self) -> None:
        """Check one topic per call, in turn; log new warnings."""
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
            if line not in self._warned:
                self._warned.add(line)
                self._node.get_logger().warning(line)

    def _infos(self, end: End) -> list[TopicEndpointInfo]:
        """Return the endpoints at the other end of a topic."""
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
            yield f'{crowd(end.name, infos)}: only the first is used; end the others'
