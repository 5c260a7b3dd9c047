"""Mass and inertia of a body with point masses fixed to it, by the parallel-axis theorem."""

from __future__ import annotations

from collections.abc import Sequence
import math

from ..motion.vector import Vec3

Point = tuple[float, Vec3]
"""Mass in kg and position in m of a point mass."""

Matrix = tuple[Vec3, Vec3, Vec3]

MAX_EXCESS = 0.1
"""Share by which a measured moment may exceed the sum of the others; the thesis's own has 2 %."""


def impossible(inertia: Vec3) -> str:
    """
    Return in words why no body has the principal moments (3,) kg m^2; '' if one may.

    The largest is at most the sum of the others, as each is the integral of two squared distances.
    """
    largest = max(inertia)
    excess = largest / (math.fsum(inertia) - largest) - 1.0
    return '' if excess <= MAX_EXCESS else (
        f'the largest moment, {largest:.4g} kg m^2, exceeds the sum of the others by '
        f'{100.0 * excess:.0f} %, which no body can: check the axes and the unit')


def _steiner(mass: float, at: Vec3) -> Matrix:
    """Return the inertia of a point mass about the origin, (3, 3) kg m^2: m (|r|^2 I - r r^T)."""
    x, y, z = at
    return (
        (mass * (y * y + z * z), -mass * x * y, -mass * x * z),
        (-mass * x * y, mass * (x * x + z * z), -mass * y * z),
        (-mass * x * z, -mass * y * z, mass * (x * x + y * y)))


def with_points(
    mass: float, inertia: Vec3, points: Sequence[Point],
) -> tuple[float, Vec3, Matrix]:
    r"""
    Return the mass properties of a body with point masses fixed to it.

    .. math:: J' = J + \sum_i m_i (|r_i|^2 I - r_i r_i^T) - m' (|c|^2 I - c c^T)

    with the new centre of mass :math:`c = \sum_i m_i r_i / m'`.

    Parameters
    ----------
    mass : kg
        Mass of the body.
    inertia : (3,) kg m^2
        Inertia of the body about its centre of mass; its principal axes are the axes used.
    points
        Mass in kg and position in m relative to the centre of mass of the body, for each point.

    Returns
    -------
    mass : kg
    centre : (3,) m
        New centre of mass, relative to that of the body alone.
    inertia : (3, 3) kg m^2
        Inertia about the new centre of mass.

    """
    total = mass + math.fsum(m for m, _ in points)
    cx, cy, cz = (math.fsum(m * r[i] for m, r in points) / total for i in range(3))
    terms = [_steiner(m, r) for m, r in points] + [_steiner(-total, (cx, cy, cz))]
    rows = [
        [math.fsum(term[i][j] for term in terms) + (inertia[i] if i == j else 0.0)
         for j in range(3)]
        for i in range(3)]
    return total, (cx, cy, cz), tuple(tuple(row) for row in rows)
