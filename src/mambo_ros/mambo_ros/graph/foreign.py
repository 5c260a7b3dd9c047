"""A node of another origin, as the graph knows it: what it publishes and subscribes to."""

from __future__ import annotations

import time

from rclpy.node import Node, NodeNameNonExistentError

_SETTLED = 1.0  # s of wall time for which a node has made no further subscription
_NOT_ITS_OWN = ('/parameter_events', '/rosout')


class ForeignNode:
    """
    The node that publishes a topic and announces no links.

    Parameters
    ----------
    owner
        Node that waits.
    topic
        Full name of the topic that the other one publishes.

    Attributes
    ----------
    published, subscribed : list[str]
        Full names of its topics, as far as others must have found it for a flight to begin:
        ``topic``, and all that it has subscribed to when nothing is :meth:`missing`.

    """

    def __init__(self, owner: Node, topic: str) -> None:
        self._owner, self._topic = owner, topic
        self.published = [topic]
        self.subscribed: list[str] = []
        self._since = time.monotonic()  # s, since when its subscriptions are these

    def missing(self) -> str:
        """Return what is not there yet as a phrase, empty when nothing is."""
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
