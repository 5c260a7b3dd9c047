"""
Small matrices as tuples of rows, compiled: the blocks that the filters' covariances are made of.

Written out instead of numpy: nothing is allocated, and every caller gets the same bits. Units are
those of the arguments.
"""

from __future__ import annotations

from mambo_model.compiled import jit
from mambo_model.motion.vector import Vec3

Vec2 = tuple[float, float]
Matrix2 = tuple[Vec2, Vec2]
Matrix3 = tuple[Vec3, Vec3, Vec3]

ZERO2: Matrix2 = ((0.0, 0.0), (0.0, 0.0))
ZERO3: Matrix3 = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


@jit
def diagonal2(a: float) -> Matrix2:
    """Return a times the (2, 2) identity."""
    return ((a, 0.0), (0.0, a))


@jit
def diagonal3(a: float, b: float, c: float) -> Matrix3:
    """Return the (3, 3) diagonal matrix of a, b, c."""
    return ((a, 0.0, 0.0), (0.0, b, 0.0), (0.0, 0.0, c))


@jit
def add2(A: Matrix2, B: Matrix2) -> Matrix2:
    """Return A + B, (2, 2)."""
    return ((A[0][0] + B[0][0], A[0][1] + B[0][1]), (A[1][0] + B[1][0], A[1][1] + B[1][1]))


@jit
def sub2(A: Matrix2, B: Matrix2) -> Matrix2:
    """Return A - B, (2, 2)."""
    return ((A[0][0] - B[0][0], A[0][1] - B[0][1]), (A[1][0] - B[1][0], A[1][1] - B[1][1]))


@jit
def scale2(s: float, A: Matrix2) -> Matrix2:
    """Return s times A, (2, 2)."""
    return ((s * A[0][0], s * A[0][1]), (s * A[1][0], s * A[1][1]))


@jit
def transpose2(A: Matrix2) -> Matrix2:
    """Return the transpose of A, (2, 2)."""
    return ((A[0][0], A[1][0]), (A[0][1], A[1][1]))


@jit
def apply2(A: Matrix2, v: Vec2) -> Vec2:
    """Return A v, (2,)."""
    return (A[0][0] * v[0] + A[0][1] * v[1], A[1][0] * v[0] + A[1][1] * v[1])


@jit
def mul2(A: Matrix2, B: Matrix2) -> Matrix2:
    """Return A B, (2, 2)."""
    return (
        (A[0][0] * B[0][0] + A[0][1] * B[1][0], A[0][0] * B[0][1] + A[0][1] * B[1][1]),
        (A[1][0] * B[0][0] + A[1][1] * B[1][0], A[1][0] * B[0][1] + A[1][1] * B[1][1]))


@jit
def mul2_t(A: Matrix2, B: Matrix2) -> Matrix2:
    """Return A times the transpose of B, (2, 2)."""
    return (
        (A[0][0] * B[0][0] + A[0][1] * B[0][1], A[0][0] * B[1][0] + A[0][1] * B[1][1]),
        (A[1][0] * B[0][0] + A[1][1] * B[0][1], A[1][0] * B[1][0] + A[1][1] * B[1][1]))


@jit
def outer2(a: Vec2, b: Vec2) -> Matrix2:
    """Return a times the transpose of b, (2, 2)."""
    return ((a[0] * b[0], a[0] * b[1]), (a[1] * b[0], a[1] * b[1]))


@jit
def symmetric2(A: Matrix2) -> Matrix2:
    """Return the symmetric part of A, (2, 2): rounding leaves nothing else of a covariance."""
    c = 0.5 * (A[0][1] + A[1][0])
    return ((A[0][0], c), (c, A[1][1]))


@jit
def inverse2(A: Matrix2) -> Matrix2:
    """Return the inverse of A, (2, 2), which must be regular."""
    d = 1.0 / (A[0][0] * A[1][1] - A[0][1] * A[1][0])
    return ((d * A[1][1], -d * A[0][1]), (-d * A[1][0], d * A[0][0]))


@jit
def sub3(A: Matrix3, B: Matrix3) -> Matrix3:
    """Return A - B, (3, 3)."""
    return (
        (A[0][0] - B[0][0], A[0][1] - B[0][1], A[0][2] - B[0][2]),
        (A[1][0] - B[1][0], A[1][1] - B[1][1], A[1][2] - B[1][2]),
        (A[2][0] - B[2][0], A[2][1] - B[2][1], A[2][2] - B[2][2]))


@jit
def scale3(s: float, A: Matrix3) -> Matrix3:
    """Return s times A, (3, 3)."""
    return (
        (s * A[0][0], s * A[0][1], s * A[0][2]), (s * A[1][0], s * A[1][1], s * A[1][2]),
        (s * A[2][0], s * A[2][1], s * A[2][2]))


@jit
def transpose3(A: Matrix3) -> Matrix3:
    """Return the transpose of A, (3, 3)."""
    return (
        (A[0][0], A[1][0], A[2][0]), (A[0][1], A[1][1], A[2][1]), (A[0][2], A[1][2], A[2][2]))


@jit
def _row3(a: Vec3, B: Matrix3) -> Vec3:
    return (
        a[0] * B[0][0] + a[1] * B[1][0] + a[2] * B[2][0],
        a[0] * B[0][1] + a[1] * B[1][1] + a[2] * B[2][1],
        a[0] * B[0][2] + a[1] * B[1][2] + a[2] * B[2][2])


@jit
def mul3(A: Matrix3, B: Matrix3) -> Matrix3:
    """Return A B, (3, 3)."""
    return (_row3(A[0], B), _row3(A[1], B), _row3(A[2], B))


@jit
def symmetric3(A: Matrix3) -> Matrix3:
    """Return the symmetric part of A, (3, 3)."""
    c01, c02 = 0.5 * (A[0][1] + A[1][0]), 0.5 * (A[0][2] + A[2][0])
    c12 = 0.5 * (A[1][2] + A[2][1])
    return ((A[0][0], c01, c02), (c01, A[1][1], c12), (c02, c12, A[2][2]))


@jit
def less_outer3(A: Matrix3, a: Vec3, b: Vec3, s: float) -> Matrix3:
    """Return A - a b^T / s, (3, 3): what a scalar measurement of variance s takes away."""
    x, y, z = a[0] / s, a[1] / s, a[2] / s
    return (
        (A[0][0] - x * b[0], A[0][1] - x * b[1], A[0][2] - x * b[2]),
        (A[1][0] - y * b[0], A[1][1] - y * b[1], A[1][2] - y * b[2]),
        (A[2][0] - z * b[0], A[2][1] - z * b[1], A[2][2] - z * b[2]))
