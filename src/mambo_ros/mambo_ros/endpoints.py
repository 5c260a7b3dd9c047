"""Endpoints of a node's topics: raw publishers, inputs and their quality of service."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from itertools import islice
from typing import Any, NamedTuple

from rclpy.callback_groups import CallbackGroup
from rclpy.context import Context
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from . import topics
from .graph.publisher_guard import PublisherGuard, UNREAD
from .message_taker import MessageTaker

AT_ONCE = 100
"""Most messages taken from one topic before timers and other topics are served."""
_BYTES_AT_ONCE = 1_000_000  # most bytes, likewise


# of a subscription that a loop waits for: an event that nobody takes would end every wait at once;
# graph.peers tells what the events would
NO_EVENTS = SubscriptionEventCallbacks(use_default_callbacks=False)


class LoopGroup(CallbackGroup):
    """Entities that only ``loop.Loop`` serves; the ordinary executor skips them."""

    def can_execute(self, entity: Any) -> bool:
        """Refuse."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Refuse."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Do nothing."""


def qos(topic: topics.Topic, depth: int = topics.QUEUE, reliable: bool = True) -> QoSProfile:
    """Return the quality of service of a topic; volatile unless the topic is transient local."""
    durability = (DurabilityPolicy.TRANSIENT_LOCAL if topic.transient_local
                  else DurabilityPolicy.VOLATILE)
    reliability = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=depth,
                      reliability=reliability, durability=durability)


class RawPublisher:
    """
    Publisher of serialised messages on one topic.

    Attributes
    ----------
    publisher
        Publisher of the middleware, for subscriptions outside this loop.
    local
        Callbacks of the subscriptions in the same loop.
    shared : bool
        Whether nodes of other processes publish the topic too.

    Parameters
    ----------
    change
        Returns what is published in place of a message; None: the message itself.

    """

    def __init__(self, publisher: Publisher, shared: bool,
                 change: Callable[[bytes], bytes] | None = None) -> None:
        self.publisher, self.shared, self._change = publisher, shared, change
        self.local: list[Callable[[bytes], None]] = []
        self.queue: deque[tuple[Callable[[bytes], None], bytes]] = deque()
        self._publish = publisher.handle.publish_raw

    def __call__(self, data: bytes) -> None:
        """Publish a serialised message."""
        if self._change is not None:
            data = self._change(data)
        if self.local:
            for take in self.local:
                self.queue.append((take, data))
            if not self.publisher.handle.get_subscription_count():
                return
        self._publish(data)

    def divert(self, publish: Callable[[bytes], None]) -> Callable[[bytes], None]:
        """Have a function get what goes to other processes; return what got it until now."""
        before, self._publish = self._publish, publish
        return before

    @property
    def matched(self) -> int:
        """Return how many subscriptions the next message reaches."""
        return len(self.local) + self.publisher.get_subscription_count()


class Input(NamedTuple):
    """One subscription of a node."""

    topic: topics.Topic
    name: str  # resolved
    take: Callable[[bytes], None] | PublisherGuard
    prompt: bool
    reliable: bool = True


class Entry:
    """
    A subscription that a loop serves.

    Parameters
    ----------
    handle
        Of the subscription.
    source
        The input that it serves; a :class:`PublisherGuard` also gets the publisher of each
        message.

    """

    def __init__(self, handle: Any, source: Input) -> None:
        self.handle, self.take = handle, source.take
        self._msg_type, self._reliable = source.topic.msg_type, source.reliable
        self.take_all = self._take_unguarded
        self._taker: MessageTaker | None = None
        if isinstance(source.take, PublisherGuard):
            self._taker = MessageTaker(handle, source.take.largest + 1)
            self.take_all = source.take.pull = self._take_guarded

    def close(self) -> None:
        """Release the subscription, which is served no more."""
        if self._taker is not None:
            self._taker.close()

    def _take_unguarded(self) -> bool:
        """Handle the messages that wait at the middleware; return whether there were any."""
        take, callback, msg_type, size = (
            self.handle.take_message, self.take, self._msg_type, 0)
        for _ in range(AT_ONCE):
            taken = take(msg_type, True)
            if taken is None:
                break
            callback(taken[0])
            size += len(taken[0])
            if size > _BYTES_AT_ONCE:
                break
        return size > 0

    def _take_guarded(self) -> bool:
        """Do the same for a guarded input."""
        take, callback, size = self._taker, self.take, 0
        for _ in range(AT_ONCE):
            taken = take()
            if taken is None:
                break
            data, length, publisher = taken
            # before the callback, which may take the next messages (PublisherGuard.pull)
            number, known = take.number, publisher == callback.first
            if known and self._reliable:
                callback.follow(number)
            callback(data, publisher)
            if not known and publisher == callback.first and self._reliable:
                callback.follow(number)
            size += length
            if size > _BYTES_AT_ONCE:
                break
        return size > 0

    def drop_waiting(self) -> bool:
        """Drop what waits of a guarded input; return whether its accepted publisher sent any."""
        if self._taker is None:
            return False
        first, waiting = self.take.first, islice(iter(self._taker, None), topics.QUEUE)
        return any(not first or publisher == first for _, _, publisher in waiting)


def any_waiting(entries: Sequence[Entry], context: Context) -> bool:
    """Return whether a message waits at the middleware for one of some entries."""
    with context.handle:
        wait_set = _rclpy.WaitSet(len(entries), 0, 0, 0, 0, 0, context.handle)
        for entry in entries:
            wait_set.add_subscription(entry.handle)
        if entries:  # an empty wait set cannot wait
            wait_set.wait(0)
        return bool(wait_set.get_ready_entities('subscription'))


def tell_unread(entries: Sequence[Entry]) -> None:
    """Tell the guards of some entries if messages wait that they accept and nobody will read."""
    for entry in entries:
        if entry.drop_waiting():
            entry.take.incomplete(entry.take, UNREAD)
