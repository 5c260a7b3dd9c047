"""
Base class of every node of the graph.

Messages are published and received as bytes (``mambo_ros.messages``) and served by
``mambo_ros.loop``, not by ``rclpy``'s executor.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
import math
import sys
import time
from typing import Any, Generic, TypeVar

from mambo_interfaces.msg import NodeLinks
import rclpy
from rclpy.node import Node
from rclpy.subscription import Subscription

from . import diagnostics, params, topics
from .commands.bounded_service import BoundedService
from .commands.live import Live
from .commands.table import Service
from .endpoints import Input, LoopGroup, NO_EVENTS, qos, RawPublisher
from .graph import peers
from .graph.publisher_guard import live, PublisherGuard
from .graph.wire import WireParams
from .input_guard import InputGuard

P = TypeVar('P')

FLUSH = 2.0  # s to wait for readers to acknowledge what an ending process has published
LOCAL = 2**32 - 1  # number of publishers of a topic that the same process publishes


class MamboNode(diagnostics.Faulty, Live, Node, Generic[P]):
    """
    A node with schema parameters, byte topics and announced links.

    Parameters
    ----------
    name : str
        Node name; the namespace defaults to ``/mambo``.
    params_type : type
        Parameter dataclass (``mambo_model.schema``), declared and filled as ``self.params``.
    kwargs
        As of ``rclpy.node.Node``.

    Raises
    ------
    mambo_model.schema.ParameterError
        If a given parameter is unknown, of a wrong type or out of range.

    """

    # shown by ``--help`` of a node, whatever its parameters are
    publishes: tuple[topics.Topic, ...] = ()
    subscribes: tuple[topics.Topic, ...] = ()
    serves: tuple[Service, ...] = ()
    calls: tuple[Service, ...] = ()
    example = ''

    def __init__(self, name: str, params_type: type[P], **kwargs: Any) -> None:
        super().__init__(
            name, **{'namespace': 'mambo', 'start_parameter_services': False, **kwargs})
        self._bounded = BoundedService(self)
        self.wire = params.declare_group(self, WireParams, 'wire.')
        self.params = params.declare(self, params_type)
        self.outputs: list[RawPublisher] = []
        self.inputs: list[Input] = []
        self._lean = LoopGroup()
        self._sources: dict[str, Subscription] = {}  # by topic
        self._matched: list[int] | None = None
        self._refusals = diagnostics.Refusals(self)
        self._links = self.create_publisher(NodeLinks, topics.LINKS.name, qos(topics.LINKS, 1))

    def advertise(self, topic: topics.Topic) -> RawPublisher:
        """Advertise a topic; return a publisher, which is called with serialised messages."""
        name = self.resolve_topic_name(topic.name)
        for output in self.outputs:
            if output.publisher.topic_name == name:
                return output
        self.outputs.append(RawPublisher(
            self.create_publisher(topic.msg_type, topic.name, qos(topic)), topic.shared,
            self.wire.outgoing(topic, self.get_namespace(), name)))
        return self.outputs[-1]

    def subscribe(self, topic: topics.Topic, callback: Callable[[bytes], None],
                  prompt: bool = True, single: bool = False) -> None:
        """
        Call ``callback`` with each serialised message of a topic, in order.

        Parameters
        ----------
        topic
            What to subscribe to.
        callback
            Gets the bytes.
        prompt
            Whether the process wakes up for a message; otherwise it is taken together with the
            next prompt one, or some milliseconds later.
        single
            Whether messages of a second publisher are refused, with a warning and a count.

        """
        name = self.resolve_topic_name(topic.name)
        self.inputs.append(Input(topic, name, self._guard(PublisherGuard(
            name, callback, sys.maxsize)) if single else callback, prompt))

    def accept(self, topic: topics.Topic, decode: Callable[[bytes], tuple],
               callback: Callable[..., Any], prompt: bool = True, reliable: bool = True,
               **bounds: Any) -> InputGuard:
        """
        Call ``callback`` with the decoded values of each usable message; return the guard.

        Parameters
        ----------
        topic
            What to subscribe to.
        decode
            From bytes to a tuple that begins with the stamp in ns.
        callback
            Gets that tuple as arguments.
        prompt
            As of :meth:`subscribe`.
        reliable
            Whether to ask for reliable delivery; without it the node also
            receives from publishers that offer best effort only.
        bounds
            Limits of usable messages, as for ``input_guard.InputGuard``. Others are refused, with
            a warning and a count on ``/diagnostics``.

        """
        name = self.resolve_topic_name(topic.name)
        guard = InputGuard(name, self.wire.incoming(decode), callback, **bounds)
        self.inputs.append(Input(topic, name, self._guard(guard), prompt, reliable))
        return guard

    def _guard(self, guard: PublisherGuard) -> PublisherGuard:
        """Let a guard know the publishers of its topic; advertise where it reports."""
        guard.publishers = partial(peers.publishers, self, guard.topic)
        self.advertise(topics.DIAGNOSTICS)
        return guard

    def open_input(self, entry: Input) -> Subscription:
        """Create the subscription of an input at the middleware."""
        self._sources[entry.name] = self.create_subscription(
            entry.topic.msg_type, entry.name, entry.take,
            qos(entry.topic, reliable=entry.reliable), callback_group=self._lean, raw=True,
            event_callbacks=NO_EVENTS)
        return self._sources[entry.name]

    @property
    def input_guards(self) -> list[PublisherGuard]:
        """Return the guards of all inputs that have one."""
        return [entry.take for entry in self.inputs if isinstance(entry.take, PublisherGuard)]

    def refused(self) -> dict[str, int]:
        """Return how many messages were refused, by topic and reason."""
        return {f'{guard.topic} {reason}': count for guard in self.input_guards
                for reason, count in sorted(guard.refused.items())}

    def ends(self) -> list[peers.End]:
        """Return the topics of this node with their quality of service."""
        return [
            *(peers.End(entry.name, entry.topic.shared,
                        qos(entry.topic, reliable=entry.reliable), False)
              for entry in self.inputs),
            *(peers.End(output.publisher.topic_name, output.shared, output.publisher.qos_profile,
                        True) for output in self.outputs)]

    def report_refusals(self, now: float) -> None:
        """Log, once a second at most, how many messages were refused since; s of wall time."""
        self._refusals.report(now)

    def finish(self) -> None:
        """Finish the node's work; called once, after the last message, while the graph works."""

    def announce(self) -> None:
        """Publish which links of this node are matched, when that has changed."""
        matched = [output.matched for output in self.outputs] + [
            live(entry.take, self._sources[entry.name].get_publisher_count())
            if entry.name in self._sources else LOCAL for entry in self.inputs]
        if matched == self._matched:
            return
        self._matched = matched
        self._links.publish(NodeLinks(
            node=self.get_fully_qualified_name(), subscribed=[entry.name for entry in self.inputs],
            published=[output.publisher.topic_name for output in self.outputs], matched=matched))

    def flush(self, seconds: float = FLUSH) -> None:
        """Wait up to ``seconds`` until every reader has acknowledged all published messages."""
        self.report_refusals(math.inf)
        limit = time.monotonic() + seconds
        for output in self.outputs:
            output.publisher.wait_for_all_acked(
                rclpy.duration.Duration(seconds=max(limit - time.monotonic(), 0.0)))
