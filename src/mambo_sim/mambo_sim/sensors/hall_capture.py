"""
One motion capture that sees all drones of a hall: what each rigid body's markers show in a frame.

Each drone's cameras (:mod:`.optitrack`) draw their noise, label points and fit a pose, in the
drone's own frame. What they look at comes from here: the pose of the body whose markers the rigid
body of that name follows, and which of these markers at least ``min_cameras`` cameras see past the
other drones (:mod:`.line_of_sight`).

All drones carry markers in the same layout. When two drones come nearer than ``swap_distance``,
the software takes them for each other: each rigid body follows the markers of the other drone,
until the two meet again or ``swap_time`` has passed. A body that is not swapped and not hidden
gets exactly its own pose, so its poses are, to the last bit, those that it has alone.

The result depends on poses and times of exposure alone: a flight in one process, the graph and the
NatNet server give the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
import math
from typing import NamedTuple

from mambo_model.arithmetic.trigonometry import cos, sin
from mambo_model.compiled import jit
from mambo_model.motion.quaternion import rotate
from mambo_model.motion.rigid_body import State
from mambo_model.motion.vector import add, Vec3
from mambo_model.schema import flag, ParameterError, quantity
from mambo_model.values import derived, Parameters, values_type
import numpy as np
from numpy.typing import NDArray

from .line_of_sight import count_cameras
from .marker_occlusion import COLUMNS
from .optitrack import interpolate, OptitrackParams
from .rigid_fit import COUNT, Five

Array = NDArray[np.float64]
UNKNOWN, APART, NEAR = -1, 0, 1  # of a pair in the frame before


@dataclass(frozen=True)
class HallCaptureParams(Parameters):
    """
    What drones do to each other's markers: hide them, and be taken for each other.

    The cameras stand evenly on a circle around the middle of the hall and see all of it.
    """

    occlusion: bool = flag(False, 'design choice: each drone is seen as if alone in the hall')
    cameras: int = quantity(
        8, '1', 1, 64, 'assumed: two on each side of a room, as in many flight laboratories')
    camera_distance: float = quantity(
        5.0, 'm', 1.0, 1000.0, 'assumed: of each camera from the middle of the hall, horizontally')
    camera_height: float = quantity(2.5, 'm', 0.0, 100.0, 'assumed: under the ceiling of a room')
    min_cameras: int = quantity(
        2, '1', 1, 64, 'that must see a marker to give a point: two rays make a position')
    body_radius: float = quantity(
        0.09, 'm', 0.001, 10.0, 'half the width of a Mambo, as collision_distance')
    body_height: float = quantity(
        0.04, 'm', 0.001, 10.0, 'assumed: between top and bottom of the body that hides markers')
    swap_distance: float = quantity(
        0.0, 'm', 0.0, 100.0,
        'design choice: two drones whose middles come nearer are taken for each other; 0: never')
    swap_time: float = quantity(
        0.0, 's', 0.0, 86400.0,
        'design choice: so long after the last exchange all bodies are told apart again, as by an '
        'operator; 0: not before the two meet again')

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.min_cameras > self.cameras:
            raise ParameterError(
                f'min_cameras = {self.min_cameras} is more than cameras = {self.cameras}')

    @derived('m', 'body_height')
    def half_height(self) -> float:
        """Half the height of a body."""
        return 0.5 * self.body_height

    @property
    def acts(self) -> bool:
        """Return whether the drones do anything to each other's markers."""
        return self.occlusion or self.swap_distance > 0.0

    def positions(self) -> list[Vec3]:
        """Return where the cameras are, (cameras, 3) m, inertial NED of the hall."""
        angles = [2.0 * math.pi * (k + 0.5) / self.cameras for k in range(self.cameras)]
        return [(self.camera_distance * cos(angle), self.camera_distance * sin(angle),
                 -self.camera_height) for angle in angles]


HallCaptureValues = values_type(HallCaptureParams)


class Exchange(NamedTuple):
    """Two drones that were taken for each other."""

    t: int  # ns, of the exposure
    pair: tuple[int, int]  # numbers of the drones, from 0, rising


@jit
def _exchange(
    bodies: Array, here: NDArray[np.bool_], source: NDArray[np.int64], pairs: NDArray[np.int64],
    p: HallCaptureValues, last: NDArray[np.int64],
) -> bool:
    """Exchange the names of bodies that have come near; return whether any were, `last` of all."""
    happened = False
    for i in range(len(bodies)):
        for j in range(i + 1, len(bodies)):
            if not (here[i] and here[j]):
                continue
            x, y, z = (bodies[i, 0] - bodies[j, 0], bodies[i, 1] - bodies[j, 1],
                       bodies[i, 2] - bodies[j, 2])
            near = x * x + y * y + z * z < p.swap_distance * p.swap_distance
            if near and pairs[i, j] == APART:
                happened = True
                last[0], last[1] = i, j
                for a in range(len(source)):
                    if source[a] == i:
                        source[a] = j
                    elif source[a] == j:
                        source[a] = i
            pairs[i, j] = NEAR if near else APART
    return happened


@jit
def _look(
    poses: Array, bodies: Array, places: Array, here: NDArray[np.bool_],
    source: NDArray[np.int64], markers: Array, cameras: Array, p: HallCaptureValues,
    views: Array,
) -> None:
    """Store the view of each body: the pose that its markers have, and which of them show."""
    for a in range(len(poses)):
        b = source[a] if here[source[a]] else a
        for i in range(7):
            views[a, i] = poses[b, i]
        if b != a:
            for i in range(3):
                views[a, i] = poses[b, i] + (places[b, i] - places[a, i])
        q = (poses[b, 3], poses[b, 4], poses[b, 5], poses[b, 6])
        centre = (bodies[b, 0], bodies[b, 1], bodies[b, 2])
        for k in range(COUNT):
            views[a, 7 + k] = 1.0
            if p.occlusion:
                at = add(centre, rotate(q, (
                    markers[a, k, 0], markers[a, k, 1], markers[a, k, 2])))
                free = count_cameras(
                    at, b, cameras, bodies, here, p.body_radius, p.half_height)
                views[a, 7 + k] = 1.0 if free >= p.min_cameras else 0.0


class HallCapture:
    """
    The motion capture of a hall.

    Parameters
    ----------
    params : HallCaptureParams
    places : sequence of (3,) m
        Where each drone starts, in the inertial NED frame of the hall.
    fives : sequence of (5, 3) m
        Markers of each drone, body FRD.
    period : ns
        From frame to frame.

    Attributes
    ----------
    exchanges : list of Exchange
        Drones that were taken for each other, in the order of their times.

    """

    def __init__(
        self, params: HallCaptureParams, places: Sequence[Vec3], fives: Sequence[Five],
        period: int,
    ) -> None:
        n = len(places)
        self._params, self._values, self._period = params, params.values(), period
        self._places = np.array(places, dtype=float).reshape(n, 3)
        self._markers = np.array(fives, dtype=float).reshape(n, COUNT, 3)
        self._cameras = np.array(params.positions())
        self._source = np.arange(n)
        self._pairs = np.full((n, n), UNKNOWN)
        self._last = np.zeros(2, dtype=np.int64)
        self._before: list[tuple[int, State] | None] = [None] * n
        self.exchanges: list[Exchange] = []
        self.views = np.zeros((n, COLUMNS))

    def frame(self, exposure: int, poses: Array, here: NDArray[np.bool_]) -> Array:
        """
        Expose a frame; return the view of each body, (n, COLUMNS), valid until the next frame.

        Parameters
        ----------
        exposure : ns
            Later than that of the frame before.
        poses : (n, 7)
            Position in m and attitude w x y z of each drone in its own frame.
        here : (n,)
            Whose pose is known in this frame; the others hide nothing.

        """
        p = self._params
        if self.exchanges and p.swap_time > 0.0 and (
                exposure - self.exchanges[-1].t >= round(p.swap_time * 1e9)):
            self._source[:] = np.arange(len(self._source))
        bodies = poses.copy()
        bodies[:, :3] += self._places
        if p.swap_distance > 0.0 and _exchange(
                bodies, here, self._source, self._pairs, self._values, self._last):
            self.exchanges.append(Exchange(exposure, tuple(self._last.tolist())))
        _look(poses, bodies, self._places, here, self._source, self._markers, self._cameras,
              self._values, self.views)
        return self.views

    def step(self, t: int, states: Sequence[State | None]) -> Array:
        """
        Expose the frame that falls between the samples of the truth before and these, if any.

        Parameters
        ----------
        t : ns
            Stamp of the samples, later than before.
        states
            True state of each drone in its own frame; None where there is no sample.

        Returns
        -------
        views : (n, COLUMNS)
            For ``optitrack.step`` of each drone that has a sample.

        """
        exposure = t // self._period * self._period
        here = np.zeros(len(states), dtype=np.bool_)
        poses = np.zeros((len(states), 7))
        for number, state in enumerate(states):
            if state is None:
                continue
            before_t, before = self._before[number] or (t, state)
            first = before_t == t
            if exposure > before_t or (first and exposure == t):
                share = 1.0 if first else (exposure - before_t) / (t - before_t)
                rho, q = interpolate(before, state, share)
                here[number], poses[number] = True, (*rho, *q)
            self._before[number] = (t, state)
        return self.frame(exposure, poses, here) if here.any() else self.views


def of_hall(
    params: HallCaptureParams, places: Sequence[Vec3], cameras: Sequence[OptitrackParams],
) -> HallCapture | None:
    """
    Return the motion capture of a hall, None if its drones do nothing to each other's markers.

    Parameters
    ----------
    params
        Of the hall.
    places
        Where each drone starts, (3,) m, inertial NED of the hall.
    cameras
        The motion capture of each drone.

    Raises
    ------
    ParameterError
        If the drones have different frame rates, or poses without markers.

    """
    if not params.acts:
        return None
    if any(one.model != 'markers' for one in cameras):
        raise ParameterError(
            'occlusion and swaps between drones need optitrack_node.optitrack.model: markers')
    if len({one.period() for one in cameras}) != 1:
        raise ParameterError('drones of one hall need the same optitrack_node.optitrack.rate')
    return HallCapture(params, places, [one.markers.five() for one in cameras],
                       cameras[0].period())
