"""Start of a flight: wait until every expected node is up and every link is matched."""

from __future__ import annotations

from collections import Counter
import math
import time

from . import peers
from .. import node, topics
from ..endpoints import Entry, Input
from ..loop import Loop
from .announcements import Announcements
from .foreign import ForeignNode

_LOOK_EVERY = 0.1  # s of wall time between looks at who announces
_ASK_AGAIN = 5.0  # s of wall time after which a waiting node says what it waits for
_GUESTS = 5.0  # s of wall time for which the links of nodes that nobody expects are waited for
_CROWDED = 10.0  # s of wall time that a second publisher or a namesake has to leave
_CLEARED = 0.3  # s of wall time for the nodes to notice that it has
_DISCOVERY = 1.0  # s of wall time to find another flight, for an owner that expects nobody


class Links:
    """
    The nodes of the graph and the state of their links.

    Both ends of a link discover each other independently, and a volatile message that is sent
    before both have done so is lost. A publisher that has found its reader cannot tell whether
    the reader has found it, or whether the next link is matched. Every node therefore announces
    what its publishers and subscriptions have matched (``NodeLinks``), and the node that owns
    time starts when both sides of every link are matched.

    Anybody may announce anything (``announcements``). Nodes that nobody expects
    hold up the start by ``_GUESTS`` at most, and a topic with a second publisher or a second node
    of one name by ``_CROWDED``: the flight then does not begin. An owner that expects nobody looks
    for another flight for ``_DISCOVERY``.

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
        self._crowd, self._next_look = '', 0.0  # what is one too many; s of wall time
        self._heard = Announcements(owner)
        # served here until the flight begins: an input of the loop would be polled in every step
        source = Input(topics.LINKS, self._heard.topic, self._heard, False)
        self._subscription = owner.open_input(source)
        self._entry = Entry(self._subscription.handle, source)

    def _look(self, now: float) -> None:
        """Take what is new from the nodes of the graph, at a wall time in s."""
        self._entry.take_all()
        if now >= self._next_look:
            self._next_look = now + _LOOK_EVERY
            self._crowd = self._too_many(self._heard.look())

    def _too_many(self, announcing: list[str]) -> str:
        """Return what there is one too many of, by the names of nodes that announce, or ''."""
        mine = self._owner.get_fully_qualified_name()
        for name in (mine, *self._expected):
            if announcing.count(name) > 1:
                return (f'{announcing.count(name)} nodes are named {name}, expected one: '
                        'end the other flight, or set another ROS_DOMAIN_ID')
        shared = {self._owner.resolve_topic_name(topic.name)
                  for topic in (topics.TF, topics.DIAGNOSTICS, topics.LINKS)}
        members = [links for name in (mine, *self._expected)
                   if (links := self._heard.known.get(name)) is not None]
        writers = Counter(topic for links in (*members, *self._foreign)
                          for topic in links.published if topic not in shared)
        for topic in sorted(writers):
            if self._owner.count_publishers(topic) > 1:
                infos = self._owner.get_publishers_info_by_topic(topic)
                return f'{peers.crowd(topic, infos)}: end the others'
        for links in members:  # which may have found a publisher that the owner has not
            for topic, matched in zip(links.subscribed, links.matched[len(links.published):]):
                if 0 < writers[topic] < matched < node.LOCAL:
                    return (f'{topic}: {matched} publishers at {links.node}, expected '
                            f'{writers[topic]}: end the others')
        return ''

    def look(self) -> str:
        """Take the announcements that have come; return what is missing, also one's own."""
        self._look(time.monotonic())
        return self.missing() or self._unannounced()

    def close(self) -> None:
        """Take no more announcements."""
        self._entry.close()
        self._owner.destroy_subscription(self._subscription)

    def missing(self, guests: bool = True) -> str:
        """
        Return the first thing that is not there yet as a phrase, empty when all is matched.

        Parameters
        ----------
        guests
            Whether nodes that nobody expects count.

        """
        absent = [name for name in self._expected if name not in self._heard.known]
        if absent:
            return f"node {', '.join(absent)}"
        for foreign in self._foreign:
            if absence := foreign.missing():
                return absence
        if not self._expected:
            return ''
        mine = self._owner.get_fully_qualified_name()
        announced = [links for name, links in self._heard.known.items()
                     if guests or name == mine or name in self._expected]
        known = [*announced, *self._foreign]
        readers = Counter(topic for links in known for topic in links.subscribed)
        writers = Counter(topic for links in known for topic in links.published)
        for links in announced:
            for topic, matched in zip(links.published, links.matched):
                if matched < readers[topic]:
                    return (f'{readers[topic] - matched} of {readers[topic]} readers of {topic} '
                            f'at {links.node}')
            for topic, matched in zip(links.subscribed, links.matched[len(links.published):]):
                if matched < writers[topic]:
                    return (f'{writers[topic] - matched} of {writers[topic]} publishers of '
                            f'{topic} at {links.node}')
        return ''

    def _unannounced(self) -> str:
        """Return what is missing while the owner's own announcement has not come back, or ''."""
        mine = self._owner.get_fully_qualified_name()
        return f'the announcement of {mine}' if (
            self._expected and mine not in self._heard.known) else ''

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
        Serve the graph until nothing is missing, once; announcements are not taken any more.

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
        try:
            return self._wait(loop, patience)
        finally:
            self.close()

    def _wait(self, loop: Loop, patience: float) -> bool:
        """Wait, as :meth:`wait` says."""
        began = logged = time.monotonic()
        since, crowded = dict.fromkeys(('crowd', 'guests'), began), -math.inf
        while True:
            now, missing = time.monotonic(), self.look()
            crowded = now if self._crowd else crowded
            since['crowd'] = since['crowd'] if self._crowd else now
            since['guests'] = since['guests'] if missing and not self.missing(False) else now
            stranded = missing and now - since['guests'] > _GUESTS
            looked = self._expected or now - began > _DISCOVERY
            if looked and now - crowded > _CLEARED and (not missing or stranded):
                self._crowd = self._too_many(self._heard.look())  # now, not a moment ago
                if not self._crowd and stranded:
                    self._owner.get_logger().warning(f'begins without {missing}')
                if not self._crowd:
                    return True
            if now - since['crowd'] > _CROWDED:
                self._owner.get_logger().error(f'the flight does not begin: {self._crowd}')
                return False
            if now - began > patience:
                self._owner.get_logger().error(
                    f'gave up after {patience:g} s without {missing}')
                return False
            if now - logged > _ASK_AGAIN:
                logged = now
                if not self.alone(topics.CLOCK):
                    return False
                self._owner.get_logger().warning(
                    f'waiting for {missing}' if missing else f'waiting: {self._crowd}')
            loop.once(0.01)
            loop.turn()
            if loop.stopping:
                return False
