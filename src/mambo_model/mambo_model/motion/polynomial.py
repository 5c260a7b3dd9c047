"""
Piecewise polynomials of time: position and yaw with exact derivatives up to snap.

A :class:`Course` is the form that people plan, read and write. :class:`Pieces` is the form that
compiled code evaluates: the pieces of a whole flight with the times at which they begin.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled import jit

Array = NDArray[np.float64]
Jet = tuple[float, float, float, float, float]  # a function of time and four derivatives

AXES = ('x', 'y', 'z', 'yaw')  # of coefficients, in their order
DEGREE = 9  # of the pieces of a flight: value and four derivatives at both ends
STILL = np.array([1e-3, 1e-2, 1e-1])
"""Derivatives of m and rad, first to third, that a course in a file of few digits rests with."""
_FACTORIALS = np.array([math.factorial(order) for order in range(5)], dtype=float)


class Pieces(NamedTuple):
    """Pieces of a flight for compiled code; ``begin`` is empty if there are none."""

    begin: Array         # (n,) s of flight time, increasing; a piece lasts until the next begins
    coefficients: Array  # (n, 4, 10) x, y, z in m, inertial NED, yaw in rad; ascending powers of
    # the time since the piece began, in s


NO_PIECES = Pieces(np.empty(0), np.empty((0, len(AXES), DEGREE + 1)))


class Course(NamedTuple):
    """A path to fly, one polynomial after the other, from time 0 to the sum of the durations."""

    duration: Array      # (n,) s
    coefficients: Array  # (n, 4, k) x, y, z in m, inertial NED, yaw in rad; ascending powers of
    # the time since the piece began, in s

    @property
    def total(self) -> float:
        """Return the duration of the course in s."""
        return float(self.duration.sum())

    @property
    def begin(self) -> Array:
        """Return the time at which each piece begins, (n,) s."""
        return np.concatenate(([0.0], np.cumsum(self.duration)[:-1]))


@jit
def jet(coefficients: Array, x: float) -> Jet:
    """
    Return a polynomial and its first four derivatives, by Horner's rule.

    Parameters
    ----------
    coefficients : (k,)
        Ascending powers.
    x : s

    """
    p0 = p1 = p2 = p3 = p4 = 0.0
    for i in range(len(coefficients) - 1, -1, -1):
        p4 = p4 * x + p3
        p3 = p3 * x + p2
        p2 = p2 * x + p1
        p1 = p1 * x + p0
        p0 = p0 * x + coefficients[i]
    return (p0, p1, 2.0 * p2, 6.0 * p3, 24.0 * p4)


@jit
def evaluate(t: float, pieces: Pieces) -> tuple[Jet, Jet, Jet, Jet]:
    """
    Return x, y, z and yaw with four derivatives at t seconds; t is not taken before the start.

    Units are metres and radians, axes inertial NED. There must be at least one piece.
    """
    i = max(np.searchsorted(pieces.begin, t, side='right') - 1, 0)
    x, c = max(t - pieces.begin[i], 0.0), pieces.coefficients[i]
    return jet(c[0], x), jet(c[1], x), jet(c[2], x), jet(c[3], x)


def state_at(course: Course, t: float) -> Array:
    """Return the four axes with four derivatives at course time t in s, (4, 5); t is clamped."""
    t = min(max(t, 0.0), course.total)
    i = max(int(np.searchsorted(course.begin, t, side='right')) - 1, 0)
    x = min(t - course.begin[i], course.duration[i])
    return np.array([jet(axis, x) for axis in course.coefficients[i]])


def settled(state: Array) -> Array:
    """
    Return a state, (4, 5); rest if it is rest but for its fourth derivative, and for ``STILL``.

    So a course of least snap begins and ends. Its pieces join up to the third derivative only, as
    it joins rest; to carry the fourth on over seconds would lead metres away.
    """
    if (np.abs(state[:, 1:4]) > STILL).any():
        return state
    out = np.zeros_like(state)
    out[:, 0] = state[:, 0]
    return out


def ends(course: Course) -> tuple[Array, Array]:
    """Return the states at which every piece begins and ends, (n, 4, 5) each."""
    first = np.array([[jet(axis, 0.0) for axis in piece] for piece in course.coefficients])
    last = np.array([
        [jet(axis, x) for axis in piece]
        for piece, x in zip(course.coefficients, course.duration, strict=True)])
    return first, last


def connect(start: Array, end: Array, duration: float) -> Array:
    """
    Return the polynomials of degree 9 between two states, (4, 10), ascending powers.

    Parameters
    ----------
    start, end : (4, 5) m, rad, per s, s^2 ... s^4
        Four axes with four derivatives.
    duration : s

    """
    powers = np.cumprod([1.0] + [duration] * 9)
    scale = powers[:5] / _FACTORIALS
    low, wanted = start * scale, end * scale
    # end values of x^0 ... x^9 at 1, each derivative over its factorial: binomial coefficients
    binomial = np.array([[math.comb(i, k) for i in range(10)] for k in range(5)], dtype=float)
    high = np.linalg.solve(binomial[:, 5:], (wanted - low @ binomial[:, :5].T).T).T
    return np.hstack((low, high)) / powers


def stretched(course: Course, factor: float) -> Course:
    """Return the course along the same path in ``factor`` times its duration."""
    powers = np.cumprod([1.0] + [factor] * (course.coefficients.shape[2] - 1))
    return Course(course.duration * factor, course.coefficients / powers)


def resized(course: Course, factor: float) -> Course:
    """Return the course with its path scaled by ``factor`` about its first point."""
    c = course.coefficients.copy()
    first = c[0, :3, 0].copy()
    c[:, :3] *= factor
    c[:, :3, 0] += (1.0 - factor) * first
    return Course(course.duration, c)


def raised(course: Course, height: float) -> Course:
    """Return the course shifted vertically so that it begins at a height in m."""
    c = course.coefficients.copy()
    c[:, 2, 0] -= height + c[0, 2, 0]
    return Course(course.duration, c)


def largest(coefficients: Array, duration: float, order: int) -> tuple[float, float]:
    """
    Return the largest value of a derivative of one polynomial, and the time of that value.

    Parameters
    ----------
    coefficients : (k,)
        Ascending powers.
    duration : s
        Duration of the piece.
    order
        Order of the derivative; 0: the polynomial itself.

    Returns
    -------
    value, time since the beginning in s

    """
    p = np.polynomial.Polynomial(coefficients).deriv(order)
    roots = p.deriv().roots() if np.any(p.coef[1:]) else np.empty(0)
    real = roots.real[np.abs(roots.imag) < 1e-6 * duration]
    times = np.concatenate(([0.0, duration], real[(real > 0.0) & (real < duration)]))
    found = p(times)
    best = int(np.argmax(found))
    return float(found[best]), float(times[best])
