"""What the nodes of the graph announce of their links, as far as the graph confirms it."""

from __future__ import annotations

from mambo_interfaces.msg import NodeLinks
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from . import peers
from .. import topics
from .publisher_guard import LARGEST, PublisherGuard

_WARN_EVERY = 5.0  # s
_MOST = 100  # publishers whose announcements are kept


class Announcements(PublisherGuard):
    """
    Guard of the topic that every node announces its links on.

    Anybody may announce anything, at any rate. The newest message of each publisher is kept as it
    came, and read at the next look at the graph. It counts if the graph says that the node it
    names has published it; of two nodes of one name the first is accepted while it is there.

    Parameters
    ----------
    owner
        Node that wants to know.

    Attributes
    ----------
    known : dict[str, NodeLinks]
        Newest announcement of each node, by its full name.

    """

    def __init__(self, owner: Node) -> None:
        super().__init__(owner.resolve_topic_name(topics.LINKS.name), self, LARGEST)
        self._owner = owner
        self.known: dict[str, NodeLinks] = {}
        self._newest: dict[bytes, bytes] = {}  # by GID
        self._read: dict[bytes, bytes] = {}  # what was read last, by GID
        self._accepted: dict[str, bytes] = {}  # GID by node
        self._absent: set[bytes] = set()  # GIDs that the graph did not know at the last look

    def __call__(self, data: bytes, publisher: bytes = b'') -> None:
        """Keep a message in place of the one before of the same publisher."""
        if len(data) <= LARGEST and (publisher in self._newest or len(self._newest) < _MOST):
            self._newest[publisher] = data

    def look(self) -> list[str]:
        """Read what is new; return the full names of all nodes that can announce."""
        infos = self._owner.get_publishers_info_by_topic(self.topic)
        present = {bytes(info.endpoint_gid): peers.who(info) for info in infos}
        self._accepted = {name: gid for name, gid in self._accepted.items() if gid in present}
        absent = self._newest.keys() - present.keys()
        for gid in absent & self._absent:  # it has left
            del self._newest[gid]
            self._read.pop(gid, None)
        self._absent = absent
        for gid, name in present.items():
            data = self._newest.get(gid)
            if data is not None and data != self._read.get(gid) and self._take(data, gid, name):
                self._read[gid] = data
        return list(present.values())

    def _take(self, data: bytes, gid: bytes, name: str) -> bool:
        """Take what the node of a name announced; return whether it is done with."""
        try:
            links = deserialize_message(data, NodeLinks)
        except Exception:  # of a kind that the middleware chooses
            self._owner.get_logger().warning(
                f'{topics.LINKS.name}: ignored {len(data)} bytes of {name} that are not a '
                'NodeLinks', throttle_duration_sec=_WARN_EVERY)
            return True
        if links.node == name and self._accepted.setdefault(name, gid) == gid:
            self.update(links)
            return True
        return False  # the graph may not know its name yet, or the first of the name may leave

    def update(self, links: NodeLinks) -> None:
        """Take what one node announced, if it is complete."""
        if len(links.published) + len(links.subscribed) == len(links.matched):
            self.known[links.node] = links
