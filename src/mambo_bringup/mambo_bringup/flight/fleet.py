"""The simulators of several drones in one hall, stepped together on one clock."""

from __future__ import annotations

from collections.abc import Sequence
import math
from typing import Any

from mambo_flight.world.world_file import Hall
from mambo_ros import topics
from mambo_ros.loop import Loop
from mambo_sim import lockstep, pushed
from mambo_sim.optitrack_node import OptitrackNode
from mambo_sim.sim_node import SimNode
from mambo_sim.world import World

from . import shared_capture


class Fleet:
    """
    Simulators of one hall as one simulator for ``lockstep.run``.

    Every step all of them publish their sensors, all motor commands are awaited, and all vehicles
    move. Mode, speed and duration are those of the first; a pause is one of all. Each simulator
    counts its own motor commands: those that were missing, those that were late, and all delays.

    Parameters
    ----------
    sims : sequence of SimNode
        In the order of the places of the hall.
    hall : Hall

    Attributes
    ----------
    drones : sequence of SimNode
        The simulators.
    pause : lockstep.Pause

    """

    def __init__(self, sims: Sequence[SimNode], hall: Hall) -> None:
        self.drones, self._names = sims, list(hall.places)
        self.pause = sims[0].pause
        for sim in sims:
            sim.pause = self.pause  # whoever pauses one pauses all
        for sim in sims[1:]:
            sim.decided = {'speed': f'it is that of {sims[0].get_namespace()} in the whole hall'}
        self._world = World(hall.params, list(hall.places.values()), [
            sim.params.simulator.vehicle for sim in sims])
        self._pushes: list[float | None] = []
        self._told = 0  # collisions that were logged
        if hall.params.downwash.enabled:
            for sim in sims:
                sim.warm_up(0.0)

    def get_logger(self) -> Any:
        """Return the logger of the first simulator."""
        return self.drones[0].get_logger()

    @property
    def params(self) -> Any:
        """Return the parameters of the first simulator."""
        return self.drones[0].params

    @property
    def t(self) -> int:
        """Return the flight time of the current step in ns."""
        return self.drones[0].t

    @property
    def answered(self) -> bool:
        """Return whether all motor commands of the current step have arrived."""
        return all(sim.answered for sim in self.drones)

    @property
    def sensed(self) -> float:
        """Return the wall time of the newest IMU sample, s."""
        return self.drones[-1].sensed

    @property
    def starved(self) -> int:
        """Return when the last motors were stopped for lack of commands, ns; -1: some turn."""
        times = [sim.starved for sim in self.drones]
        return max(times) if min(times) >= 0 else -1

    def start(self, away: float = math.inf) -> None:
        """Start to wait for motor commands, as ``SimNode.start``."""
        for sim in self.drones:
            sim.start(away)

    def sense(self) -> None:
        """Look at all vehicles, log collisions, and publish the sensors of all drones."""
        for sim, row in zip(self.drones, self._world.seen, strict=True):
            pushed.observe_held(sim.held, row)
        self._pushes = self._world.look(self.t)
        for collision in self._world.collisions[self._told:]:
            self.get_logger().error(collision.describe(self._names))
        self._told = len(self._world.collisions)
        for sim, push in zip(self.drones, self._pushes, strict=True):
            sim.sense(push)

    def advance(self) -> None:
        """Move all vehicles to the next step."""
        for sim, push, stop in zip(
                self.drones, self._pushes, self._world.stopped, strict=True):
            sim.advance(push, stop)

    def is_deserted(self, now: float) -> bool:
        """Return whether a drone had no motor command for its patience, at a wall time in s."""
        return any(sim.is_deserted(now) for sim in self.drones)

    def give_up(self) -> None:
        """Stop the motors of the drones whose command is missing."""
        for sim in self.drones:
            if not sim.answered:
                sim.give_up()


def fly(hall: Hall, _: SimNode, loop: Loop) -> int:
    """Run the simulators of a loop to their end or until stopped; return the exit code."""
    sims = [node for node in loop.nodes if isinstance(node, SimNode)]
    shared_capture.share([node for node in loop.nodes if isinstance(node, OptitrackNode)], hall)
    for sim in sims:
        if not sim.links.wait(loop, sim.params.start_patience):
            return 0 if loop.stopping else 1
        if not sim.links.alone(topics.CLOCK):
            return 1
    return lockstep.run(Fleet(sims, hall), loop)
