"""ROS shell of the flight plan: clock in, feasible reference (3.14) out."""

from __future__ import annotations

from mambo_model.compiled import hold, jit
from mambo_model.motion import trajectory
from mambo_model.motion.flatness import Reference
from mambo_ros import messages, node, process, topics

from .parameters import ReferenceNodeParams


@jit
def _step(held, t):
    """Return the reference at t in s and the phase."""
    plan, vv = held.values
    return trajectory.reference_step(t, plan, vv.mass, vv.inertia, vv.gravity)


class ReferenceNode(node.MamboNode[ReferenceNodeParams]):
    """Reference generator: subscribes ``/clock``, publishes ``reference`` with the same stamp."""

    publishes = (topics.REFERENCE, topics.DIAGNOSTICS)
    subscribes = (topics.CLOCK,)
    example = '--ros-args -p plan.trajectory:=circle'

    def __init__(self, **kwargs) -> None:
        super().__init__('reference_node', ReferenceNodeParams, **kwargs)
        p = self.params
        self._held = hold(None, None, (p.plan.values(), p.vehicle.values()))
        self._reference = self.advertise(topics.REFERENCE)
        self.accept(topics.CLOCK, messages.decode_clock, self._on_clock)
        self._evaluate(0)  # have the compiled step in memory before time starts

    def _on_clock(self, t: int) -> None:
        self._reference(messages.reference(t, *self._evaluate(t)))

    def _evaluate(self, t: int) -> tuple[Reference, int]:
        return _step(self._held, t * 1e-9)


def main(args=None) -> None:
    """Entry point ``reference_node``."""
    process.main(ReferenceNode, args)
