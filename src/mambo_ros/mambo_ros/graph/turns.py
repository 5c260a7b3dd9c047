"""
Turns of ``rclpy``'s executor, which serves timers, parameters, services and events.

A turn takes the executor about half a millisecond even if nothing has happened, because it builds
a wait set of every entity. :class:`Turns` keeps a wait set, asks the middleware with it first, and
lets the executor work only if there is something to do.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.node import Node
from rclpy.waitable import NumberOfEntities

_MOST_SKIPPED = 10  # turns; coroutines wait for no entity
_KINDS = ('subscriptions', 'guards', 'timers', 'clients', 'services')  # as WaitSet takes numbers
_ADD = ('add_subscription', 'add_guard_condition', 'add_timer', 'add_client', 'add_service')
_READY = ('subscription', 'guard_condition', 'timer', 'client', 'service')


class Turns:
    """
    The ordinary executor of nodes.

    Parameters
    ----------
    nodes
        Their entities are served, except those whose callback group refuses.

    """

    def __init__(self, nodes: Sequence[Node]) -> None:
        self._nodes, self._skipped = nodes, 0
        self._executor = SingleThreadedExecutor()
        for node in nodes:
            self._executor.add_node(node)
        self._context = rclpy.get_default_context()
        self._entities: list[list[Any]] = []  # by kind, the waitables last
        self._wait_set: Any = None

    def take(self) -> None:
        """Serve one timer, service or event, if one is ready."""
        if self._skipped < _MOST_SKIPPED and not self.ready():
            self._skipped += 1
            return
        self._skipped = 0
        self._executor.spin_once(timeout_sec=0.0)

    def ready(self) -> bool:
        """Return whether a timer, a service or an event is ready."""
        can = self._executor.can_execute
        entities = [[entity for node in self._nodes for entity in getattr(node, kind)
                     if can(entity)] for kind in (*_KINDS, 'waitables')]
        if entities != self._entities:
            self._entities, self._wait_set = entities, self._build(entities)
        wait_set, *kinds, waitables = self._wait_set, *entities
        wait_set.clear_entities()
        for name, kind in zip(_ADD, kinds, strict=True):
            add = getattr(wait_set, name)
            for entity in kind:
                add(entity.handle)
        for waitable in waitables:
            waitable.add_to_wait_set(wait_set)
        wait_set.wait(0)
        return any(wait_set.get_ready_entities(kind) for kind in _READY) or any(
            waitable.is_ready(wait_set) for waitable in waitables)

    def _build(self, entities: list[list[Any]]) -> Any:
        """Return a wait set with room for entities by kind."""
        *kinds, waitables = entities
        room = NumberOfEntities(*map(len, kinds))
        for waitable in waitables:
            room += waitable.get_num_entities()
        with self._context.handle:
            return _rclpy.WaitSet(
                room.num_subscriptions, room.num_guard_conditions, room.num_timers,
                room.num_clients, room.num_services, room.num_events, self._context.handle)

    def close(self) -> None:
        """Release the executor."""
        self._executor.shutdown()
