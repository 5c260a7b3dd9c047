"""
The hall that several drones share: places, downwash between them, collisions.

Every drone flies in a frame of its own, whose origin is where it starts; the hall adds the place
of this origin. A drone that feels no other therefore flies, to the last bit, as if alone. Once a
step, before any sensor is read, :meth:`World.look` takes the state of all vehicles; what it finds
acts until the next step, so the order in which drones are stepped has no effect.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import itertools
import math
from typing import NamedTuple

from mambo_model.arithmetic.trigonometry import cos, sin
from mambo_model.motion.vector import Vec3
from mambo_model.schema import choice, group, ParameterError, quantity
from mambo_model.values import Parameters
from mambo_model.vehicle.parameters import Vehicle
import numpy as np
from numpy.typing import NDArray

from . import downwash, pushed
from .sensors.hall_capture import HallCaptureParams

MOST = 32
"""Most drones in one world."""
FORMATIONS = ('line', 'circle', 'follow', 'exchange')
COLLISIONS = ('report', 'stop')


@dataclass(frozen=True)
class WorldParams(Parameters):
    """
    How many drones fly in one hall, in which formation, and what they do to each other.

    line: side by side towards the east; circle: evenly on a circle; both fly the same trajectory.
    follow: a line in which each drone repeats the motion of the one before it, later by
    ``delay``. exchange: from a circle, each drone flies to the place opposite, all in the same
    sense around the centre.
    """

    drones: int = quantity(1, '1', 1, MOST, 'design choice')
    formation: str = choice('line', FORMATIONS, 'design choice: where they start, what they fly')
    spacing: float = quantity(
        3.0, 'm', 0.2, 100.0, 'between neighbours: circles of 1 m radius side by side keep 1 m')
    delay: float = quantity(1.0, 's', 0.0, 60.0, 'of a follower behind the one before it')
    turn_time: float = quantity(8.0, 's', 1.0, 600.0, 'of the exchange of places')
    least_separation: float = quantity(
        0.5, 'm', 0.0, 100.0, 'between references; a plan that comes nearer is not flown')
    collision_distance: float = quantity(
        0.18, 'm', 0.0, 10.0, 'between centres: width of a Mambo, with which two can touch')
    on_collision: str = choice(
        'report', COLLISIONS, 'report: both fly on; stop: the motors of both stop')
    downwash: downwash.DownwashParams = group(downwash.DownwashParams)
    capture: HallCaptureParams = group(HallCaptureParams)

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ('collision_distance', 'least_separation'):
            if self.drones > 1 and self.spacing < getattr(self, name):
                raise ParameterError(
                    f'spacing = {self.spacing:g} m is less than {name} = '
                    f'{getattr(self, name):g} m')


class Collision(NamedTuple):
    """Two drones that came nearer to each other than they are wide."""

    t: int  # ns, of flight time
    pair: tuple[int, int]  # numbers of the drones, from 0, rising
    distance: float  # m, between their centres when it was noticed

    def describe(self, names: Sequence[str]) -> str:
        """Return the collision as one line, with the names of the drones."""
        one, other = (names[number] for number in self.pair)
        return (f'{one} and {other} collided at t = {self.t * 1e-9:.3f} s: '
                f'{self.distance:.3f} m apart')


class World:
    """
    State of the hall.

    Parameters
    ----------
    params : WorldParams
    places : sequence of (3,) m
        Where each drone starts, in the inertial NED frame of the hall.
    vehicles : sequence of Vehicle
        The true vehicles.

    Attributes
    ----------
    seen : (n, 7)
        Row of ``pushed.observe`` of each drone in its own frame; the caller fills it before
        :meth:`look`.
    collisions : list of Collision
        In the order of their times; a pair that parts and meets again collides again.
    stopped : list of bool
        Whether a collision has stopped the motors of a drone for good.

    """

    def __init__(
        self, params: WorldParams, places: Sequence[Vec3], vehicles: Sequence[Vehicle],
    ) -> None:
        self._params, self._values = params, params.downwash.values()
        self._places = np.array(places, dtype=float).reshape(-1, 3)
        self._vehicles = np.array([downwash.vehicle_row(one) for one in vehicles])
        n = len(vehicles)
        self._pairs: list[tuple[int, int]] = list(itertools.combinations(range(n), 2))
        self._first, self._second = (
            np.array([pair[side] for pair in self._pairs], dtype=int) for side in (0, 1))
        self._touching: set[int] = set()
        self.seen = np.zeros((n, pushed.COLUMNS))
        self.collisions: list[Collision] = []
        self.stopped = [False] * n

    def look(self, t: int) -> list[float | None]:
        """
        Notice collisions at a time in ns; return the push on each drone along its b3, N.

        Without downwash each push is None. A vehicle on the floor is not pushed.
        """
        position = self.seen[:, :3] + self._places
        self._collide(t, position)
        if not self._params.downwash.enabled:
            return [None] * len(self.seen)
        losses = downwash.thrust_losses(
            position, self.seen[:, 3:6], self.seen[:, 6], self._vehicles, self._values)
        losses[self.seen[:, 2] >= 0.0] = 0.0
        return losses.tolist()

    def _collide(self, t: int, position: NDArray[np.float64]) -> None:
        """Notice the pairs that have come too near."""
        gap = position[self._first] - position[self._second]
        distance = np.sqrt((gap * gap).sum(axis=1))
        near = np.flatnonzero(distance < self._params.collision_distance).tolist()
        for index in near:
            if index in self._touching:
                continue
            pair = self._pairs[index]
            self.collisions.append(Collision(t, pair, float(distance[index])))
            if self._params.on_collision == 'stop':
                for number in pair:
                    self.stopped[number] = True
        self._touching = set(near)


def circle(n: int, spacing: float) -> list[Vec3]:
    """Return places of n drones on a circle, neighbours ``spacing`` m apart; NED, m."""
    radius = spacing / (2.0 * sin(math.pi / n)) if n > 1 else 0.0
    return [(radius * cos(2.0 * math.pi * k / n), radius * sin(2.0 * math.pi * k / n),
             0.0) for k in range(n)]


def places(params: WorldParams) -> list[Vec3]:
    """Return where the drones of a world start, (3,) m each, inertial NED of the hall."""
    if params.formation in ('circle', 'exchange'):
        return circle(params.drones, params.spacing)
    middle = 0.5 * (params.drones - 1)
    return [(0.0, params.spacing * (k - middle), 0.0) for k in range(params.drones)]
