"""
The node that every node of the graph extends, and the loop that runs it.

``rclpy``'s executor rebuilds its wait set and makes a task for every message, which costs most
of a simulated step. Messages of the graph instead go through one wait set built once
(:func:`spin`); timers, parameters and services keep their turn in an ordinary executor every
few milliseconds. Messages are published and taken as bytes (``mambo_ros.messages``).
"""

from __future__ import annotations

from collections.abc import Callable
import signal
import sys
import time
from typing import Any, Generic, TypeVar

from mambo_interfaces.msg import NodeLinks
from mambo_model.schema import ParameterError
import rclpy
from rclpy.callback_groups import CallbackGroup
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription

from . import params, topics

P = TypeVar('P')

QUEUE = topics.QUEUE

_HOUSEKEEPING = 0.02  # s between turns of the ordinary executor
_AT_ONCE = 100  # messages of one topic before timers and the other topics get their turn
_QUIET = 0.1  # s without a message after which a stopping node has taken everything
_REFUSALS = (ParameterError, FileNotFoundError, FileExistsError, _rclpy.RCLError)


class _Lean(CallbackGroup):
    """Entities that only :func:`spin` serves: the ordinary executor passes them over."""

    def can_execute(self, entity: Any) -> bool:
        """Refuse."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Refuse."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Do nothing."""


def qos(topic: topics.Topic, depth: int = QUEUE) -> QoSProfile:
    """Return the quality of service of a topic: reliable, deep, volatile unless it says so."""
    durability = (DurabilityPolicy.TRANSIENT_LOCAL if topic.transient_local
                  else DurabilityPolicy.VOLATILE)
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=depth,
                      reliability=ReliabilityPolicy.RELIABLE, durability=durability)


class MamboNode(Node, Generic[P]):
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

    def __init__(self, name: str, params_type: type[P], **kwargs: Any) -> None:
        kwargs.setdefault('namespace', 'mambo')
        super().__init__(name, **kwargs)
        self.params = params.declare(self, params_type)
        self.heard: list[tuple[Subscription, Callable[[bytes], None]]] = []
        self._lean = _Lean()
        self._said: list[Publisher] = []
        self._matched: list[int] | None = None
        self._links = self.create_publisher(
            topics.LINKS.msg_type, topics.LINKS.name, qos(topics.LINKS, 1))
        self.create_timer(_HOUSEKEEPING, self._announce)

    def say(self, topic: topics.Topic) -> Callable[[bytes], None]:
        """Advertise a topic; return the function that publishes serialised messages on it."""
        publisher = self.create_publisher(topic.msg_type, topic.name, qos(topic))
        self._said.append(publisher)
        return publisher.publish

    def hear(self, topic: topics.Topic, callback: Callable[[bytes], None]) -> None:
        """Subscribe a topic; ``callback`` gets each serialised message, in order."""
        subscription = self.create_subscription(
            topic.msg_type, topic.name, callback, qos(topic), callback_group=self._lean, raw=True)
        self.heard.append((subscription, callback))

    def finish(self) -> None:
        """Do what is left after the last message; called once while the graph still works."""

    def _announce(self) -> None:
        """Tell the graph which links of this node are matched, when that has changed."""
        matched = [publisher.get_subscription_count() for publisher in self._said]
        if matched == self._matched:
            return
        self._matched = matched
        self._links.publish(NodeLinks(
            node=self.get_fully_qualified_name(),
            subscribed=[subscription.topic_name for subscription, _ in self.heard],
            published=[publisher.topic_name for publisher in self._said], matched=matched))

    def flush(self, seconds: float = 2.0) -> None:
        """Wait until every reader has acknowledged what this node published."""
        limit = rclpy.duration.Duration(seconds=seconds)
        for publisher in self._said:
            publisher.wait_for_all_acked(limit)


class Loop:
    """
    The wait set of some nodes of one process.

    Attributes
    ----------
    stopping : bool
        Set by :meth:`stop` or a signal; :meth:`run` then takes what has arrived and returns.

    """

    def __init__(self, *nodes: MamboNode) -> None:
        self.stopping = False
        self._executor = SingleThreadedExecutor()
        for node in nodes:
            self._executor.add_node(node)
        self._entries = [
            (subscription.handle, subscription.msg_type, callback)
            for node in nodes for subscription, callback in node.heard]
        self._context = rclpy.get_default_context()
        with self._context.handle:
            self._wait_set = _rclpy.WaitSet(
                len(self._entries), 0, 0, 0, 0, 0, self._context.handle)
        self._next_turn = 0.0

    def stop(self) -> None:
        """Ask :meth:`run` to return."""
        self.stopping = True

    def once(self, timeout: float) -> bool:
        """
        Wait for messages and handle all that have arrived.

        Parameters
        ----------
        timeout : s
            Longest wait; 0 returns at once.

        Returns
        -------
        handled : bool
            Whether any message was handled.

        """
        now = time.monotonic()
        if now >= self._next_turn:
            self._executor.spin_once(timeout_sec=0.0)
            self._next_turn = now + _HOUSEKEEPING
        if not self._entries:  # an empty wait set cannot wait
            time.sleep(min(timeout, _HOUSEKEEPING))
            return False
        wait_set = self._wait_set
        wait_set.clear_entities()
        for handle, _, _ in self._entries:
            wait_set.add_subscription(handle)
        wait_set.wait(int(min(timeout, _HOUSEKEEPING) * 1e9))
        ready = wait_set.get_ready_entities('subscription')
        for handle, msg_type, callback in self._entries:
            if handle.pointer in ready:
                for _ in range(_AT_ONCE):
                    taken = handle.take_message(msg_type, True)
                    if taken is None:
                        break
                    callback(taken[0])
        return bool(ready)

    def run(self) -> None:
        """Handle messages until :meth:`stop`, then what has arrived by then."""
        while not self.stopping and self._context.ok():
            self.once(_HOUSEKEEPING)
        self.drain()

    def drain(self) -> None:
        """Handle messages until none has come for a moment."""
        limit = time.monotonic() + 5.0
        quiet_since = time.monotonic()
        while time.monotonic() < limit and time.monotonic() - quiet_since < _QUIET:
            if self.once(_HOUSEKEEPING):
                quiet_since = time.monotonic()

    def turn(self) -> None:
        """Give timers, parameters and services their turn."""
        self._executor.spin_once(timeout_sec=0.0)

    def close(self) -> None:
        """Release the executor."""
        self._executor.shutdown()


def _line(error: BaseException) -> str:
    """Return what an error says as one line, without places in the sources of ROS."""
    return ' '.join(str(error).split(', at /')[0].split())


def main(node_type: type[MamboNode], args: list[str] | None = None,
         run: Callable[[MamboNode, Loop], int | None] | None = None) -> None:
    """
    Run one node as a process: entry point of every ``*_node``.

    SIGINT and SIGTERM let the node take what has arrived, finish and leave; a wrong parameter or
    parameter file ends it with one line and exit code 2.

    Parameters
    ----------
    node_type
        Class of the node.
    args
        Command line, default ``sys.argv``.
    run
        What to do with the node and its loop; returns the exit code. Default: serve messages.

    """
    loop: Loop | None = None
    stopped = False

    def stop(*_: Any) -> None:
        nonlocal stopped
        stopped = True
        if loop is None:
            raise KeyboardInterrupt
        loop.stop()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, stop)
    try:
        rclpy.init(args=args, signal_handler_options=SignalHandlerOptions.NO)
        node = node_type()
        loop = Loop(node)
    except BaseException as error:  # stopped while numerics compile, the compiler raises anything
        if not stopped:
            if not isinstance(error, _REFUSALS):
                raise
            print(f'{node_type.__name__}: {_line(error)}', file=sys.stderr)
        rclpy.try_shutdown()
        sys.exit(0 if stopped else 2)
    if stopped:
        loop.stop()
    code: int | None = 0
    try:
        if run is None:
            loop.run()
        else:
            code = run(node, loop)
        node.finish()
        node.flush()
    finally:
        loop.close()
        node.destroy_node()
        rclpy.try_shutdown()
    sys.exit(code or 0)
