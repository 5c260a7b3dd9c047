r"""
The rigid motion that best carries the markers of a body onto the points that cameras see.

Least squares with unit quaternions, B. K. P. Horn 1987 ("Closed-form solution of absolute
orientation using unit quaternions", JOSA A 4(4)). With positions taken from their centroids and
``S = sum a b^T`` over pairs of marker a and point b, the attitude is the eigenvector of the
largest eigenvalue of a symmetric 4 by 4 matrix N of trace 0. That eigenvalue is found by Newton's
method on

.. math:: l^4 - 2 |S|^2 l^2 - 8 \det(S) l + \det(N) = 0

from the bound ``sum (|a|^2 + |b|^2) / 2``: all roots are real and the start lies above them, so
every step comes nearer from above and none can reach another root. The eigenvector is a column of
the adjugate of ``N - l I``. Nothing is inverted, so half a turn is as good as any other attitude.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from mambo_model.compiled import jit
from mambo_model.motion.quaternion import Matrix3, Matrix4, normalise, Quat, rotate
from mambo_model.motion.vector import add, dot, scale, sub, Vec3

COUNT = 5  # markers of the body
UNLABELLED = -1

Five = tuple[Vec3, Vec3, Vec3, Vec3, Vec3]
Labels = tuple[int, int, int, int, int]

NEWTON_STEPS = 50  # at most: two for good points, some thirty for points on a line
LINE = 0.02  # of the shape, below which markers lie on a line: about 1/20 as wide as long


class Fit(NamedTuple):
    """A body placed onto points."""

    # false: the points do not define an attitude, and the other fields are undefined
    found: bool
    rho: Vec3         # (3,) m, inertial NED
    q: Quat           # (4,) w x y z, body to inertial, unit
    deviation: float  # m, largest distance of a point from its marker
    square: float     # m^2, sum of their squares


NO_FIT = Fit(False, (math.nan,) * 3, (math.nan,) * 4, math.inf, math.inf)
_ZERO: Vec3 = (0.0, 0.0, 0.0)


@jit
def _det3(a: Vec3, b: Vec3, c: Vec3) -> float:
    """Return the determinant of three rows."""
    return (a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0])
            + a[2] * (b[0] * c[1] - b[1] * c[0]))


@jit
def _without(row: Quat, k: int) -> Vec3:
    """Return a row of four without its element k."""
    if k == 0:
        return (row[1], row[2], row[3])
    if k == 1:
        return (row[0], row[2], row[3])
    if k == 2:
        return (row[0], row[1], row[3])
    return (row[0], row[1], row[2])


@jit
def _cofactors(a: Quat, b: Quat, c: Quat, sign: float) -> Quat:
    """Return the minors of three rows of four with signs that alternate from ``sign``."""
    return (
        sign * _det3(_without(a, 0), _without(b, 0), _without(c, 0)),
        -sign * _det3(_without(a, 1), _without(b, 1), _without(c, 1)),
        sign * _det3(_without(a, 2), _without(b, 2), _without(c, 2)),
        -sign * _det3(_without(a, 3), _without(b, 3), _without(c, 3)))


@jit
def horn_matrix(S: Matrix3) -> Matrix4:
    """Return N, rows of (4, 4): ``q^T N q = trace(R S)`` for the rotation R of a unit q."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = S
    return (
        (xx + yy + zz, yz - zy, zx - xz, xy - yx),
        (yz - zy, xx - yy - zz, xy + yx, zx + xz),
        (zx - xz, xy + yx, yy - xx - zz, yz + zy),
        (xy - yx, zx + xz, yz + zy, zz - xx - yy))


@jit
def _largest_root(S: Matrix3, N: Matrix4) -> tuple[float, float]:
    """
    Return the largest eigenvalue of N and the slope of the polynomial there, for a bound of 1.

    The slope is the product of the distances to the other three eigenvalues.
    """
    n0, n1, n2, n3 = N
    minors = _cofactors(n1, n2, n3, 1.0)
    c0 = n0[0] * minors[0] + n0[1] * minors[1] + n0[2] * minors[2] + n0[3] * minors[3]
    c1 = -8.0 * _det3(S[0], S[1], S[2])
    c2 = -2.0 * (dot(S[0], S[0]) + dot(S[1], S[1]) + dot(S[2], S[2]))
    root, slope = 1.0, 0.0
    for _ in range(NEWTON_STEPS):
        square = root * root
        slope = (4.0 * square + 2.0 * c2) * root + c1
        if not slope > 0.0:
            return root, 0.0
        step = ((square + c2) * square + c1 * root + c0) / slope
        root -= step
        if abs(step) < 1e-15:
            break
    return root, slope


@jit
def _eigenvector(N: Matrix4, root: float, slope: float) -> Quat:
    """
    Return the unit eigenvector v of a single eigenvalue with the slope there.

    The adjugate of ``N - root I`` is ``-slope v v^T``. A unit vector has a component with a square
    of a quarter or more: the column of the first that does is taken.
    """
    a = (N[0][0] - root, N[0][1], N[0][2], N[0][3])
    b = (N[1][0], N[1][1] - root, N[1][2], N[1][3])
    c = (N[2][0], N[2][1], N[2][2] - root, N[2][3])
    d = (N[3][0], N[3][1], N[3][2], N[3][3] - root)
    enough = 0.2499 * slope
    column = _cofactors(b, c, d, 1.0)
    if abs(column[0]) < enough:
        column = _cofactors(a, c, d, -1.0)
        if abs(column[1]) < enough:
            column = _cofactors(a, b, d, 1.0)
            if abs(column[2]) < enough:
                column = _cofactors(a, b, c, -1.0)
    return normalise(column)


@jit
def fit(markers: Five, points: Five, labels: Labels) -> Fit:
    """
    Place a body so that its markers come nearest to points, in least squares.

    Parameters
    ----------
    markers : (5, 3) m, body FRD
    points : (5, 3) m, inertial NED
        What is unlabelled is not looked at.
    labels : (5,)
        Which marker each point is, ``UNLABELLED`` for one that is none.

    Returns
    -------
    fit
        Not found with fewer than three pairs, or with markers on a line (nearly: see ``LINE``),
        about which any rotation would do.

    """
    n, centre, middle = 0, _ZERO, _ZERO
    for i in range(COUNT):
        if labels[i] >= 0:
            n += 1
            centre, middle = add(centre, markers[labels[i]]), add(middle, points[i])
    if n < 3:
        return NO_FIT
    centre, middle = scale(1.0 / n, centre), scale(1.0 / n, middle)
    bound, x, y, z = 0.0, _ZERO, _ZERO, _ZERO
    for i in range(COUNT):
        if labels[i] >= 0:
            a, b = sub(markers[labels[i]], centre), sub(points[i], middle)
            bound += 0.5 * (dot(a, a) + dot(b, b))
            x, y, z = add(x, scale(a[0], b)), add(y, scale(a[1], b)), add(z, scale(a[2], b))
    if not bound > 0.0:
        return NO_FIT
    S = (scale(1.0 / bound, x), scale(1.0 / bound, y), scale(1.0 / bound, z))
    N = horn_matrix(S)
    root, slope = _largest_root(S, N)
    if not slope > LINE * root * root * root:
        return NO_FIT
    q = _eigenvector(N, root, slope)
    rho = sub(middle, rotate(q, centre))
    square = farthest = 0.0
    for i in range(COUNT):
        if labels[i] >= 0:
            miss = sub(points[i], add(rho, rotate(q, markers[labels[i]])))
            square += dot(miss, miss)
            farthest = max(farthest, dot(miss, miss))
    return Fit(True, rho, q, math.sqrt(farthest), square)
