"""ROS shell of the mock Optitrack system: ground truth in, poses in ``map`` out."""

from __future__ import annotations

from mambo_model.rigid_body import State
from mambo_ros import diagnostics, messages, node, topics

from . import simulator
from .parameters import OptitrackNodeParams
from .sensors import optitrack

_REPORT_EVERY = 1_000_000_000  # ns


class OptitrackNode(node.MamboNode[OptitrackNodeParams]):
    """
    Mock motion capture.

    Subscribes ``ground_truth/odom``, publishes ``optitrack/pose`` at its own rate, late by its
    latency, stamped with the exposure, and ``/diagnostics``. A body that is not tracked has no
    pose: nothing is published.
    """

    def __init__(self, **kwargs) -> None:
        super().__init__('optitrack_node', OptitrackNodeParams, **kwargs)
        self._values = self.params.optitrack.values()
        self._rng = simulator.generators(self.params.seed)[4]
        self._memory = optitrack.START
        self._before: tuple[int, State] | None = None
        self._pose = self.say(topics.OPTITRACK)
        self._diagnostics = self.say(topics.DIAGNOSTICS)
        self.hear(topics.GROUND_TRUTH, self._on_truth, prompt=False)
        still = State((0.0,) * 3, (0.0,) * 3, (1.0, 0.0, 0.0, 0.0), (0.0,) * 3)
        optitrack.step(  # have the compiled step in memory before time starts
            self._memory, 0, still, 0, still, simulator.generators(0)[4], self._values)

    def _on_truth(self, data: bytes) -> None:
        t, state = messages.decode_odometry(data)
        before = self._before or (t, state)
        if t < before[0] or (t == before[0] and self._before is not None):
            return
        self._before = (t, state)
        self._memory, sample = optitrack.step(
            self._memory, *before, t, state, self._rng, self._values)
        if sample.new:
            self._pose(messages.optitrack(sample.stamp, sample.pose.rho, sample.pose.q))
        if t % _REPORT_EVERY == 0:
            self._report(t)

    def _report(self, t: int) -> None:
        memory = self._memory
        tracked = memory.track.tracked
        self._diagnostics(diagnostics.report(
            t, self.get_name(), diagnostics.OK if tracked else diagnostics.WARN,
            'tracking' if tracked else 'body lost', {
                'visible markers': sum(memory.seen), 'frames': memory.counts.frames,
                'lost frames': memory.counts.lost, 'dropped frames': memory.counts.dropped}))


def main(args=None) -> None:
    """Entry point ``optitrack_node``."""
    node.main(OptitrackNode, args)
