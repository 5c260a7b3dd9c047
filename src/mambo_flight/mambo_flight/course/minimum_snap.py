r"""
Minimum-snap and minimum-jerk polynomials through waypoints at given times.

.. math:: \min \int \| d^r x / dt^r \|^2 dt, \quad r = 4 \text{ (snap)}, 3 \text{ (jerk)}

The unknowns are the derivatives at the waypoints; they determine a polynomial of degree 2 r - 1 on
each leg: D. Mellinger, V. Kumar, ICRA 2011; C. Richter, A. Bry, N. Roy, ISRR 2013. Without
inequalities the optimum solves one banded linear system; :mod:`constrained` adds corridors and
limits. The optimum is 2 r - 2 times continuously differentiable.
"""

from __future__ import annotations

from math import comb, factorial
from typing import NamedTuple

from mambo_model.motion.polynomial import AXES, Course
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solveh_banded

Array = NDArray[np.float64]

ORDERS = {'snap': 4, 'jerk': 3}  # r for each objective


class Waypoints(NamedTuple):
    """Times and fixed values of waypoints; free values are NaN."""

    t: Array      # (n,) s, increasing
    fixed: Array  # (n, 4, 4) x, y, z in m, inertial NED, yaw in rad; each with three derivatives


def from_points(t: Array, points: Array, yaw: Array | None = None) -> Waypoints:
    """
    Return waypoints that are flown in order, from rest to rest.

    Parameters
    ----------
    t : (n,) s
        Increasing.
    points : (n, 3) m, inertial NED
        NaN where a coordinate is free.
    yaw : (n,) rad
        NaN where it is free; None: zero.

    """
    fixed = np.full((len(t), 4, 4), np.nan)
    fixed[:, :3, 0] = points
    fixed[:, 3, 0] = 0.0 if yaw is None else yaw
    fixed[[0, -1], :, 1:] = 0.0
    return Waypoints(np.asarray(t, dtype=float), fixed)


def hermite(order: int) -> Array:
    """
    Return the matrix (2 r, 2 r) from end values to coefficients of ascending powers of u.

    End values are r derivatives by u, from the 0th on, at u = 0 and then at u = 1.
    """
    ends = np.zeros((2 * order, 2 * order))
    for k in range(order):
        ends[k, k] = factorial(k)
        ends[order + k] = [comb(i, k) * factorial(k) for i in range(2 * order)]
    return np.linalg.inv(ends)


def _energy(order: int) -> Array:
    """Return H such that c^T H c is the integral of the squared r-th derivative over u."""
    H = np.zeros((2 * order, 2 * order))
    for i in range(order, 2 * order):
        for j in range(order, 2 * order):
            scale = factorial(i) * factorial(j) / factorial(i - order) / factorial(j - order)
            H[i, j] = scale / (i + j - 2 * order + 1)
    return H


def leg_energy(duration: float, order: int) -> Array:
    """Return the energy of a leg as a quadratic form of its 2 r end values, (2 r, 2 r)."""
    ends = end_scale(duration, order)
    basis = hermite(order) * ends
    return basis.T @ _energy(order) @ basis * duration ** (1 - 2 * order)


def end_scale(duration: float, order: int) -> Array:
    """Return the factors from derivatives by time to derivatives by u, (2 r,)."""
    return np.tile(duration ** np.arange(order), 2)


def solve(waypoints: Waypoints, order: int) -> Array:
    """
    Return the derivatives of the optimum at the waypoints, (n, 4, r).

    Parameters
    ----------
    waypoints
        Each axis has at least one given value; an axis without one stays zero.
    order
        r of :data:`ORDERS`.

    """
    n, scale = len(waypoints.t), float(np.diff(waypoints.t).mean())
    powers = scale ** np.arange(order)  # for numbers of similar size
    legs = [leg_energy(T / scale, order) for T in np.diff(waypoints.t)]
    out = np.zeros((n, len(AXES), order))
    for axis in range(len(AXES)):
        given = (waypoints.fixed[:, axis, :order] * powers).ravel()
        if not np.isnan(given).any():
            out[:, axis] = given.reshape(n, order) / powers
            continue
        if np.isnan(given.reshape(n, order)[:, 0]).all():
            continue
        free = np.flatnonzero(np.isnan(given))
        position = np.full(n * order, -1)
        position[free] = np.arange(len(free))
        band = np.zeros((2 * order, len(free)))
        right = np.zeros(len(free))
        for leg, H in enumerate(legs):
            at = np.arange(leg * order, (leg + 2) * order)
            known = ~np.isnan(given[at])
            rows = position[at[~known]]
            right[rows] -= H[np.ix_(~known, known)] @ given[at[known]]
            inner = H[np.ix_(~known, ~known)]
            for i, row in enumerate(rows):  # lower band: row - column, column
                band[row - rows[:i + 1], rows[:i + 1]] += inner[i, :i + 1]
        solved = given.copy()
        solved[free] = solveh_banded(band, right, lower=True)
        out[:, axis] = solved.reshape(n, order) / powers
    return out


def to_course(t: Array, derivatives: Array) -> Course:
    """
    Return the polynomials with given derivatives at given times.

    Parameters
    ----------
    t : (n,) s
    derivatives : (n, 4, r)
        From the 0th derivative on.

    """
    order, duration = derivatives.shape[2], np.diff(t)
    basis = hermite(order)
    coefficients = np.empty((len(duration), len(AXES), 2 * order))
    for leg, T in enumerate(duration):
        ends = np.concatenate((derivatives[leg], derivatives[leg + 1]), axis=1)
        coefficients[leg] = (ends * end_scale(T, order)) @ basis.T / T ** np.arange(2 * order)
    return Course(duration, coefficients)


def minimum(waypoints: Waypoints, minimise: str = 'snap') -> Course:
    """Return the course of minimum ``snap`` or ``jerk`` through waypoints."""
    return to_course(waypoints.t, solve(waypoints, ORDERS[minimise]))


def energy(course: Course, minimise: str = 'snap') -> float:
    """Return the integral of the squared snap or jerk of x, y and z, in m^2/s^7 or m^2/s^5."""
    order, total = ORDERS[minimise], 0.0
    for T, piece in zip(course.duration, course.coefficients, strict=True):
        for axis in piece[:3]:
            p = np.polynomial.Polynomial(axis).deriv(order)
            total += float((p * p).integ()(T))
    return total
