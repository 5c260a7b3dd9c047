"""
The loop that serves the nodes of one process.

``rclpy``'s executor rebuilds its wait set and makes a task for every message, which costs most
of a simulated step. Messages of the graph instead go through one wait set built once
(:class:`Loop`); timers, parameters and services keep their turn in an ordinary executor every
few milliseconds.

Nodes that share a loop pass each other their messages directly. The middleware gets a message
only if a node outside the loop subscribes to it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
import math
import time

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy

from .endpoints import any_waiting, AT_ONCE, Entry, Input, RawPublisher, tell_unread
from .graph import peers
from .graph.floods import Floods
from .graph.publisher_guard import PublisherGuard
from .node import MamboNode

_HOUSEKEEPING = 0.02  # s, the longest wait at once
_TURN = 0.05  # s between turns of the ordinary executor; one turn costs most of a step
_LAZY = 0.005  # s between looks at topics that are not prompt
_SOON = 0.0003  # s, within which the messages that belong to a prompt one arrive
_LONGEST = 5.0  # s that a stopping node takes for what has arrived
_SETTLED = 1.0  # s after which it does not wait for publishers that go on
_QUIET = 0.1  # s without a message after which a stopping node has received everything


class Loop:
    """
    Runs nodes of one process: holds their wait set and the message queue between them.

    Nodes of the loop get each other's messages from this queue, in the order of publication. They
    subscribe at the middleware only to topics that no node of the loop publishes, and to shared
    topics, which nodes outside the loop publish too.

    Attributes
    ----------
    nodes : tuple[MamboNode, ...]
        Served by the loop.
    stopping : bool
        Set by :meth:`stop` or a signal; :meth:`run` then handles what has arrived and returns.
    urgent : bool
        Set by a second signal; messages that have arrived are then dropped.

    """

    def __init__(self, *nodes: MamboNode) -> None:
        self.stopping = self.urgent = False
        self.nodes = nodes
        self._executor = SingleThreadedExecutor()
        self._queue: deque[tuple[Callable[[bytes], None], bytes]] = deque()
        for node in nodes:
            self._executor.add_node(node)
            for output in node.outputs:
                output.queue = self._queue
        far = [(node, source) for node in nodes for source in node.inputs
              if not self._join(source)]
        # after a prompt message wakes the loop, the other topics are handled first
        far.sort(key=lambda pair: pair[1].prompt)
        self._entries = [
            Entry(node.open_input(source).handle, source) for node, source in far]
        self._prompt = [
            entry for entry, (_, source) in zip(self._entries, far, strict=True) if source.prompt]
        self._longest = _HOUSEKEEPING if len(self._prompt) == len(far) else _LAZY
        self._mixed = 0 < len(self._prompt) < len(far)
        self._stirred = False
        self._context = rclpy.get_default_context()
        with self._context.handle:
            self._wait_set = _rclpy.WaitSet(
                len(self._prompt), 0, 0, 0, 0, 0, self._context.handle)
        self._next_turn, self._asked = 0.0, math.inf
        floods = Floods(nodes)
        for node in nodes:
            for guard in node.input_guards:
                guard.flooded = floods.ignore
        self._peers = [peers.Peers(node, node.ends()) for node in nodes]

    def _join(self, source: Input) -> bool:
        """Connect an input to the publishers of this loop; return whether there are any."""
        local = [output for node in self.nodes for output in node.outputs
                  if output.publisher.topic_name == source.name and not output.shared]
        for output in local:
            output.local.append(
                source.take.local if isinstance(source.take, PublisherGuard) else source.take)
        return bool(local)

    def output(self, name: str) -> RawPublisher:
        """Return the publisher of a topic by its full name; LookupError if no node has it."""
        for node in self.nodes:
            for output in node.outputs:
                if output.publisher.topic_name == name:
                    return output
        raise LookupError(f'no node of this process publishes {name}')

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
            self.turn()
            self._next_turn = now + _TURN
        queue = self._queue
        handled = bool(queue)
        for _ in range(AT_ONCE):
            if not queue:
                break
            take, data = queue.popleft()
            take(data)
        if not handled:  # topics are not in order: a prompt message may overtake a lazy one
            self._wait(min(timeout, _SOON if self._stirred else self._longest))
        taken = self._take()
        self._stirred = taken and self._mixed
        return taken or handled

    def _wait(self, timeout: float) -> None:
        """Wait for a prompt message of the middleware."""
        if not self._prompt:  # an empty wait set cannot wait
            time.sleep(timeout)
            return
        wait_set = self._wait_set
        wait_set.clear_entities()
        for entry in self._prompt:
            wait_set.add_subscription(entry.handle)
        wait_set.wait(int(timeout * 1e9))

    def _take(self) -> bool:
        """Handle the messages that wait at the middleware; return whether there were any."""
        handled = False
        for entry in self._entries:
            handled = entry.take_all() or handled
        return handled

    def run(self) -> None:
        """Handle messages until :meth:`stop`, then those that have arrived by then."""
        while not self.stopping and self._context.ok():
            self.once(_HOUSEKEEPING)
        self.drain()

    def drain(self) -> None:
        """
        Handle messages until none has come for a moment or a second signal arrives.

        Nobody takes over from a publisher that has left: the others leave, too. If others go on,
        it is enough after ``_SETTLED`` that no message waits at one instant.
        """
        for node in self.nodes:
            for guard in node.input_guards:
                guard.replaceable = lambda since: False
        now = quiet_since = time.monotonic()
        self._asked = min(self._asked, now)
        while not self.urgent and now < min(self._asked + _LONGEST, quiet_since + _QUIET):
            if self.once(_HOUSEKEEPING):
                quiet_since = now
                if now > self._asked + _SETTLED and not (
                        self._queue or any_waiting(self._entries, self._context)):
                    break
            now = time.monotonic()
        tell_unread(self._entries)

    def turn(self) -> None:
        """Announce links, report refusals, and serve timers, parameters and services once."""
        for node in self.nodes:
            node.announce()
            node.report_refusals(time.monotonic())
        for watch in self._peers:
            watch.look()
        self._executor.spin_once(timeout_sec=0.0)

    def close(self) -> None:
        """Release the executor and the subscriptions, which keep their nodes alive."""
        self._executor.shutdown()
        for entry in self._entries:
            entry.close()
