"""
Occlusion of motion-capture markers, and the points that cameras reconstruct of visible ones.

The body has five markers. Each point is a marker's true position with white noise. A marker is
occluded at times, by the body or because too few cameras see it: a two-state Markov process per
marker, sampled when a frame is exposed. The points are unlabelled;
:mod:`mambo_sim.sensors.tracker` labels them.
"""

from __future__ import annotations

from dataclasses import dataclass
import itertools
import math

from mambo_model.arithmetic.exponential import expm1
from mambo_model.arithmetic.normal import standard_normal
from mambo_model.compiled import jit
from mambo_model.motion.quaternion import Quat, rotate
from mambo_model.motion.vector import add, Vec3
from mambo_model.schema import choice, ParameterError, quantity
from mambo_model.values import derived, Parameters, values, values_type
from mambo_model.vehicle import parameters
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from .rigid_fit import COUNT, Five

LAYOUTS = ('asymmetric', 'symmetric')
NARROW = 0.01  # m, standard deviation of markers across their line below which they are on one

Seen = tuple[bool, bool, bool, bool, bool]
ALL: Seen = (True,) * COUNT
COLUMNS = 7 + COUNT
"""Of a view: position (3) m and attitude (4) of the markers' body, and which of them show."""


def file_positions() -> tuple[float, ...]:
    """Return the positions in ``presets/identified_markers.yaml``, (15,) m, body FRD."""
    return tuple(x for _, at in parameters.markers('identified_markers') for x in at)


@dataclass(frozen=True)
class MarkerParams(Parameters):
    """
    Positions of the markers, occlusion and noise, and limits of the tracker.

    ``positions`` are x, y, z of one marker after the other. The symmetric layout puts the first
    four at their mean distances from the axes and the fifth on the axis: half a turn of yaw then
    looks like none, and a tracker that loses the body may find it half a turn off.
    """

    layout: str = choice('asymmetric', LAYOUTS, 'design choice; symmetric as in thesis sec. 5.3')
    positions: tuple[float, ...] = quantity(
        file_positions(), 'm', -1.0, 1.0,
        'body FRD, presets/identified_markers.yaml: four corners and the top')
    noise: float = quantity(
        0.0001, 'm', 0.0, 0.01,
        'each axis; what gives the attitude noise of Crazyflie flights under Optitrack')
    occlusion: float = quantity(
        0.0, '1', 0.0, 0.9, 'design choice: share of time that each marker is hidden')
    occlusion_time: float = quantity(
        0.1, 's', 0.001, 60.0, 'assumed: mean time that a marker stays hidden')
    min_markers: int = quantity(3, '1', 3, COUNT, 'visible markers needed for a pose')
    deflection: float = quantity(
        0.003, 'm', 0.0001, 0.05,
        'assumed: how far a point may be from its marker; deflection in Motive')

    def __post_init__(self) -> None:
        super().__post_init__()
        five = np.array(self.five())
        if np.linalg.svd(five - five.mean(axis=0))[1][1] < NARROW * math.sqrt(COUNT):
            raise ParameterError(
                'positions lie on a line, which defines no attitude: spread them')
        if not self.gate() > 2.0 * self.deflection:
            raise ParameterError(
                f'positions: two markers are {2000.0 * self.gate():.3g} mm apart, '
                f'which takes a deflection below {500.0 * self.gate():.3g} mm, '
                f'not {1000.0 * self.deflection:.3g} mm')

    @derived('m', 'layout', 'positions')
    def five(self) -> Five:
        """Positions of the layout, (5, 3) body FRD."""
        x = [float(number) for number in self.positions]
        five = tuple((x[i], x[i + 1], x[i + 2]) for i in range(0, 3 * COUNT, 3))
        if self.layout == 'asymmetric':
            return five
        corners = np.array(five[:4])
        mean = np.abs(corners[:, :2]).mean(axis=0).tolist()
        height = corners[:, 2].mean().item()
        return (*((math.copysign(mean[0], a[0]), math.copysign(mean[1], a[1]), height)
                  for a in five[:4]), (0.0, 0.0, five[4][2]))

    @derived('m')
    def gate(self) -> float:
        """Half the least distance between two markers."""
        return 0.5 * min(math.dist(a, b) for a, b in itertools.combinations(self.five(), 2))

    @derived('-', 'occlusion')
    def hide(self, period: int) -> float:
        """Probability that a visible marker is hidden in the next frame, after a period of ns."""
        return self.occlusion * self._change(period)

    @derived('-', 'occlusion_time')
    def show(self, period: int) -> float:
        """Probability that a hidden marker is visible in the next frame, after a period of ns."""
        return (1.0 - self.occlusion) * self._change(period)

    def _change(self, period: int) -> float:
        """
        Return the probability of a change in a period of ns, of either kind.

        A marker that is hidden for a share s of the time, for a mean time T each, changes with
        the rates 1/T and s/(1 - s)/T; between frames their sum decays exponentially.
        """
        return -expm1(-period * 1e-9 / (self.occlusion_time * (1.0 - self.occlusion)))

    def values(self, period: int) -> MarkerValues:
        """Return the values for compiled code, for frames a period of ns apart."""
        return values(self, hide=self.hide(period), show=self.show(period))


MarkerValues = values_type(MarkerParams)


@jit
def view_of(view: NDArray[np.float64]) -> tuple[Vec3, Quat, Seen]:
    """Return position and attitude of the markers' body and which markers show, of a view."""
    return ((view[0], view[1], view[2]), (view[3], view[4], view[5], view[6]),
            (view[7] > 0.0, view[8] > 0.0, view[9] > 0.0, view[10] > 0.0, view[11] > 0.0))


@jit
def both(one: Seen, other: Seen) -> Seen:
    """Return which markers are seen in both ways."""
    return (one[0] and other[0], one[1] and other[1], one[2] and other[2], one[3] and other[3],
            one[4] and other[4])


@jit
def _see(
    at: Vec3, seen: bool, rho: Vec3, q: Quat, rng: Generator, p: MarkerValues,
) -> tuple[Vec3, bool]:
    """Return the point of one marker and whether it is visible; draws four numbers."""
    s = p.noise
    error = (s * standard_normal(rng), s * standard_normal(rng), s * standard_normal(rng))
    chance = rng.random()
    return add(add(rho, rotate(q, at)), error), chance >= p.hide if seen else chance < p.show


@jit
def reconstruct(
    seen: Seen, rho: Vec3, q: Quat, rng: Generator, noise: bool, p: MarkerValues,
) -> tuple[Five, Seen]:
    """
    Expose one frame: return the points of all markers, and which of them are visible.

    Parameters
    ----------
    seen : (5,)
        Which markers were visible in the frame before, ``ALL`` at first.
    rho : (3,) m, inertial NED
    q : (4,) unit, body to inertial
        The true pose.
    rng
        Twenty numbers are drawn, whatever is visible.
    noise
        False: exact points, all visible, nothing drawn.
    p
        From :meth:`MarkerParams.values`.

    """
    a, b, c, d, e = p.five
    if not noise:
        return (
            add(rho, rotate(q, a)), add(rho, rotate(q, b)), add(rho, rotate(q, c)),
            add(rho, rotate(q, d)), add(rho, rotate(q, e))), ALL
    point_a, seen_a = _see(a, seen[0], rho, q, rng, p)
    point_b, seen_b = _see(b, seen[1], rho, q, rng, p)
    point_c, seen_c = _see(c, seen[2], rho, q, rng, p)
    point_d, seen_d = _see(d, seen[3], rho, q, rng, p)
    point_e, seen_e = _see(e, seen[4], rho, q, rng, p)
    return (point_a, point_b, point_c, point_d, point_e), (seen_a, seen_b, seen_c, seen_d, seen_e)
