"""ROS shell of the flight plan: clock in, feasible reference (3.14) out."""

from __future__ import annotations

from mambo_model import trajectory
from mambo_model.flatness import Reference
from mambo_ros import layout, messages, node, topics

from .parameters import ReferenceNodeParams


class ReferenceNode(node.MamboNode[ReferenceNodeParams]):
    """Reference generator: subscribes ``/clock``, publishes ``reference`` with the same stamp."""

    def __init__(self, **kwargs) -> None:
        super().__init__('reference_node', ReferenceNodeParams, **kwargs)
        self._plan = self.params.plan.values()
        self._vehicle = self.params.vehicle.values()
        self._last = -1
        self._reference = self.say(topics.REFERENCE)
        self.hear(topics.CLOCK, self._on_clock)
        self._evaluate(0)  # have the compiled step in memory before time starts

    def _on_clock(self, data: bytes) -> None:
        t = layout.stamp_ns(data)
        if t <= self._last:
            return
        self._last = t
        self._reference(messages.reference(t, *self._evaluate(t)))

    def _evaluate(self, t: int) -> tuple[Reference, int]:
        vehicle = self._vehicle
        return trajectory.reference_step(
            t * 1e-9, self._plan, vehicle.mass, vehicle.inertia, vehicle.gravity)


def main(args=None) -> None:
    """Entry point ``reference_node``."""
    node.main(ReferenceNode, args)
