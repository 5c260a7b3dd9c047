"""ROS shell of the mock Optitrack system: ground truth in, poses in ``map`` out."""

from __future__ import annotations

from mambo_model.compiled import Held, hold, jit, memory_of
from mambo_model.motion.rigid_body import State
from mambo_ros import diagnostics, input_guard, messages, node, process, topics
import numpy as np
from numpy.typing import NDArray

from . import simulator
from .parameters import OptitrackNodeParams
from .sensors import optitrack

_REPORT_EVERY = 1_000_000_000  # ns
_STILL = State((0.0,) * 3, (0.0,) * 3, (1.0, 0.0, 0.0, 0.0), (0.0,) * 3)


@jit
def _step(held, t, state, view):
    """Process the next sample of the true state; return the result of the cameras."""
    memory, before_t, before = held.memory
    memory, sample = optitrack.step(
        memory, before_t, before, t, state, held.rng, held.values, view)
    held.memory = (memory, t, state)
    return sample


def _begin(p: OptitrackNodeParams, t: int, state: State) -> Held:
    """Return the cameras before their first sample of the truth."""
    rng = simulator.generators(p.seed)[4]
    return hold((optitrack.START, t, state), rng, p.optitrack.values())


class OptitrackNode(node.MamboNode[OptitrackNodeParams]):
    """
    Mock motion capture.

    Subscribes ``ground_truth/odom``, publishes ``optitrack/pose`` at its own rate, late by its
    latency, stamped with the exposure, and ``/diagnostics``. A body that is not tracked has no
    pose: nothing is published. With ``watermark`` ``optitrack/tick`` says so for every step.
    """

    publishes = (topics.OPTITRACK, topics.CAPTURE_TICK, topics.DIAGNOSTICS)
    subscribes = (topics.GROUND_TRUTH,)
    example = '--ros-args -p seed:=2'

    def __init__(self, **kwargs) -> None:
        super().__init__('optitrack_node', OptitrackNodeParams, **kwargs)
        self._begun = False
        self.on_truth = self.expose  # what is called with each sample of the truth
        self.warm_up(None)
        self._pose = self.advertise(topics.OPTITRACK)
        self._tick = self.advertise(topics.CAPTURE_TICK) if self.params.watermark else None
        self._published = 0
        self._diagnostics = self.advertise(topics.DIAGNOSTICS)
        self.accept(topics.GROUND_TRUTH, messages.decode_odometry, self._on_truth,
                    prompt=self.params.watermark, check=input_guard.check_state)

    @staticmethod
    def compile(p: OptitrackNodeParams, view: NDArray[np.float64] | None = None) -> None:
        """Have the compiled steps in memory before time starts; view: see ``expose``."""
        held = _begin(p, 0, _STILL)
        _step(held, 0, _STILL, view)
        memory_of(held)

    def warm_up(self, view: NDArray[np.float64] | None) -> None:
        """Compile, and begin; view: see ``expose``."""
        self.compile(self.params, view)
        self._held = _begin(self.params, 0, _STILL)

    def expose(self, t: int, state: State, view: NDArray[np.float64] | None = None) -> None:
        """
        Take the true state at a time in ns; publish the pose that is due.

        Parameters
        ----------
        t, state
            A sample of the truth.
        view : (12,)
            What several drones in one hall show, of ``HallCapture``; None: this one is alone.

        """
        if not self._begun:
            self._held, self._begun = _begin(self.params, t, state), True
        sample = _step(self._held, t, state, view)
        if sample.new:
            self._pose(messages.optitrack(sample.stamp, sample.pose.rho, sample.pose.q))
            self._published += 1
        if self._tick is not None:
            self._tick(messages.capture_tick(t, self._published))
        if t % _REPORT_EVERY == 0:
            self._report(t)

    def _on_truth(self, t: int, state: State) -> None:
        self.on_truth(t, state)

    def _report(self, t: int) -> None:
        memory = memory_of(self._held)[0]
        tracked = memory.track.tracked
        self._diagnostics(diagnostics.report(
            t, self.get_name(), diagnostics.OK if tracked else diagnostics.WARN,
            'tracking' if tracked else 'body lost', {
                'visible markers': sum(memory.seen), 'frames': memory.counts.frames,
                'lost frames': memory.counts.lost, 'dropped frames': memory.counts.dropped}))


def main(args=None) -> None:
    """Entry point ``optitrack_node``."""
    process.main(OptitrackNode, args)
