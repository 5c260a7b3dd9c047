"""Start of a flight: wait until every expected node is up and every link is matched."""

from __future__ import annotations

from collections import Counter
import time

from mambo_interfaces.msg import NodeLinks
from rclpy.serialization import deserialize_message

from .. import node, topics
from ..endpoints import qos
from ..loop import Loop
from .foreign import ForeignNode

_ASK_AGAIN = 5.0  # s of wall time between log lines that name what a node waits for


class Links:
    """
    The nodes of the graph and the state of their links.

    Both ends of a link discover each other independently, and a volatile message that is sent
    before both have done so is lost. A publisher that has found its reader cannot tell whether
    the reader has found it, or whether the next link is matched. Every node therefore announces
    what its publishers and subscriptions have matched (``NodeLinks``), and the node that owns
    time starts when both sides of every link are matched.

    Parameters
    ----------
    owner
        Node that waits.
    wait_for
        Names of the expected nodes, separated by commas, relative to the owner's namespace;
        empty: wait for nobody.
    wait_for_publishers
        Topics of the expected publishers that do not announce their links, likewise.

    """

    def __init__(self, owner: node.MamboNode, wait_for: str, wait_for_publishers: str = '',
                 ) -> None:
        namespace = owner.get_namespace().rstrip('/')
        self._owner = owner
        self._expected = [
            name if name.startswith('/') else f'{namespace}/{name}'
            for name in map(str.strip, wait_for.split(',')) if name]
        self._foreign = [
            ForeignNode(owner, owner.resolve_topic_name(name))
            for name in map(str.strip, wait_for_publishers.split(',')) if name]
        self._known: dict[str, NodeLinks] = {}
        owner.create_subscription(
            topics.LINKS.msg_type, topics.LINKS.name, self._on_links, qos(topics.LINKS, 100),
            raw=True)

    def _on_links(self, data: bytes) -> None:
        """Decode and store the links of one node; ignore a message that cannot be read."""
        try:
            links = deserialize_message(data, NodeLinks)
        except Exception:  # the type of the exception depends on the middleware
            self._owner.get_logger().warning(
                f'{topics.LINKS.name}: ignored {len(data)} bytes that are not a NodeLinks',
                throttle_duration_sec=_ASK_AGAIN)
            return
        self.update(links)

    def update(self, links: NodeLinks) -> None:
        """Store the links of one node, if they are complete."""
        if len(links.published) + len(links.subscribed) == len(links.matched):
            self._known[links.node] = links

    def missing(self) -> str:
        """Return a phrase that names the first thing still missing; empty if there is none."""
        absent = [name for name in self._expected if name not in self._known]
        if absent:
            return f"node {', '.join(absent)}"
        for foreign in self._foreign:
            if absence := foreign.missing():
                return absence
        if not self._expected:
            return ''
        known = [*self._known.values(), *self._foreign]
        readers = Counter(topic for links in known for topic in links.subscribed)
        writers = Counter(topic for links in known for topic in links.published)
        for links in self._known.values():
            for topic, matched in zip(links.published, links.matched):
                if matched < readers[topic]:
                    return (f'{readers[topic] - matched} of {readers[topic]} readers of {topic} '
                            f'at {links.node}')
            for topic, matched in zip(links.subscribed, links.matched[len(links.published):]):
                if matched < writers[topic]:
                    return (f'{writers[topic] - matched} of {writers[topic]} publishers of '
                            f'{topic} at {links.node}')
        return ''

    def alone(self, topic: topics.Topic) -> bool:
        """Return whether only the owner publishes a topic; log the names of other publishers."""
        name = self._owner.resolve_topic_name(topic.name)
        others = [f'{info.node_namespace.rstrip("/")}/{info.node_name}'
                  for info in self._owner.get_publishers_info_by_topic(name)]
        me = self._owner.get_fully_qualified_name()
        if me in others:
            others.remove(me)
        if others:
            self._owner.get_logger().error(
                f'{", ".join(others)} publishes {name} too: give each of several drones a '
                'namespace and a clock of its own (launch: own_clock:=true), or another '
                'ROS_DOMAIN_ID')
        return not others

    def wait(self, loop: Loop, patience: float) -> bool:
        """
        Serve the graph until nothing is missing.

        Parameters
        ----------
        loop
            Loop of the waiting node.
        patience : s
            Wall time after which to give up.

        Returns
        -------
        complete : bool
            False if the patience ran out, the loop was stopped, or another node publishes
            ``/clock`` (two flights in one domain would mix their messages).

        """
        began = logged = time.monotonic()
        while missing := self.missing():
            loop.once(0.01)
            loop.turn()
            now = time.monotonic()
            if loop.stopping:
                return False
            if now - began > patience:
                self._owner.get_logger().error(f'gave up after {patience:g} s without {missing}')
                return False
            if now - logged > _ASK_AGAIN:
                logged = now
                if not self.alone(topics.CLOCK):
                    return False
                self._owner.get_logger().warning(f'waiting for {missing}')
        return True
