"""The cameras of several drones in one hall, which see all of them in each frame."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from mambo_flight.world.world_file import Hall
from mambo_model.motion.rigid_body import State
from mambo_sim.optitrack_node import OptitrackNode
from mambo_sim.sensors import hall_capture
from mambo_sim.sensors.gathering import Gathering
from mambo_sim.sensors.marker_occlusion import COLUMNS
import numpy as np


class SharedCapture:
    """
    Lets the cameras of all drones look at all drones.

    A step is looked at when the true states of all drones at its time are there.

    Parameters
    ----------
    nodes : sequence of OptitrackNode
        In the order of the places of the hall.
    hall : Hall
    capture : HallCapture
        Of this hall.

    """

    def __init__(self, nodes: Sequence[OptitrackNode], hall: Hall,
                 capture: hall_capture.HallCapture) -> None:
        self._nodes, self._names, self._capture = nodes, list(hall.places), capture
        self._steps = Gathering(len(nodes))
        self._told = 0  # exchanges that were logged
        for number, node in enumerate(nodes):
            node.warm_up(np.zeros(COLUMNS))
            node.on_truth = partial(self.take, number)

    def take(self, number: int, t: int, state: State) -> None:
        """Take the true state of a drone at a time in ns; expose what is complete by it."""
        for at, states in self._steps.put(number, t, state):
            views = self._capture.step(at, states)
            for node, one, view in zip(self._nodes, states, views, strict=True):
                if one is not None:
                    node.expose(at, one, view)
            for exchange in self._capture.exchanges[self._told:]:
                one, other = (self._names[number] for number in exchange.pair)
                self._nodes[0].get_logger().warning(
                    f'motion capture takes {one} and {other} for each other from '
                    f't = {exchange.t * 1e-9:.3f} s on')
            self._told = len(self._capture.exchanges)


def share(nodes: Sequence[OptitrackNode], hall: Hall) -> SharedCapture | None:
    """
    Let the cameras of a hall's drones share what they see, where the drones disturb each other.

    Parameters
    ----------
    nodes
        In the order of the places; empty: somebody else publishes the poses.
    hall
        The hall.

    """
    if not nodes:
        return None
    capture = hall_capture.of_hall(
        hall.params.capture, list(hall.places.values()), [node.params.optitrack for node in nodes])
    return SharedCapture(nodes, hall, capture) if capture else None
