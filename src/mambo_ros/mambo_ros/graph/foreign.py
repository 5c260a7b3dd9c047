"""A node that does not announce its links: its topics, taken from the ROS graph."""

from __future__ import annotations

import time

from rclpy.node import Node, NodeNameNonExistentError

# s of wall time without a new subscription, after which the node counts as complete
_SETTLED = 1.0
_NOT_ITS_OWN = ('/parameter_events', '/rosout')


class ForeignNode:
    """
    A node that publishes a topic but does not announce its links.

    Parameters
    ----------
    owner
        Node that waits.
    topic
        Full name of the topic that the node publishes.

    Attributes
    ----------
    published, subscribed : list[str]
        Full names of the topics whose links must be matched before a flight begins: ``topic``,
        and, once nothing is :meth:`missing`, every topic that the node subscribes to.

    """

    def __init__(self, owner: Node, topic: str) -> None:
        self._owner, self._topic = owner, topic
        self.published = [topic]
        self.subscribed: list[str] = []
        self._since = time.monotonic()  # s, time of the last change of its subscriptions

    def missing(self) -> str:
        """Return a phrase that names what is still missing; empty if nothing is."""
        infos = self._owner.get_publishers_info_by_topic(self._topic)
        if not infos:
            self._since = time.monotonic()
            return f'a publisher of {self._topic}'
        found = self._subscriptions(infos[0].node_name, infos[0].node_namespace)
        if found != self.subscribed:
            self.subscribed, self._since = found, time.monotonic()
        if time.monotonic() - self._since < _SETTLED:
            return f'the subscriptions of the publisher of {self._topic}'
        return ''

    def _subscriptions(self, name: str, namespace: str) -> list[str]:
        """Return what a node subscribes to; nothing if the middleware does not know its name."""
        if not namespace.startswith('/'):
            return []
        try:
            found = self._owner.get_subscriber_names_and_types_by_node(name, namespace)
        except NodeNameNonExistentError:
            return []
        return sorted(topic for topic, _ in found if topic not in _NOT_ITS_OWN)
