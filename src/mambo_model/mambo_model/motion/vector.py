"""
Compiled functions on vectors, which are tuples of three floats.

The only equations are the derivatives of a direction, which (3.21) and the reference attitude of
(3.14) both need. Units and frames are those of the arguments.
"""

from __future__ import annotations

import math

from ..compiled import jit

Vec3 = tuple[float, float, float]


@jit
def add(a: Vec3, b: Vec3) -> Vec3:
    """Return a + b, (3,), both in one frame and unit."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


@jit
def sub(a: Vec3, b: Vec3) -> Vec3:
    """Return a - b, (3,), both in one frame and unit."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


@jit
def scale(s: float, a: Vec3) -> Vec3:
    """Return the scalar s times a, (3,), in the frame of a."""
    return (s * a[0], s * a[1], s * a[2])


@jit
def mul(a: Vec3, b: Vec3) -> Vec3:
    """Return the elementwise product, (3,): diag(a) b."""
    return (a[0] * b[0], a[1] * b[1], a[2] * b[2])


@jit
def dot(a: Vec3, b: Vec3) -> float:
    """Return the inner product of a and b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@jit
def cross(a: Vec3, b: Vec3) -> Vec3:
    """Return a x b = S(a) b, (3,), S the skew-symmetric matrix of (3.1)."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@jit
def norm(a: Vec3) -> float:
    """Return the Euclidean length of a."""
    return math.sqrt(dot(a, a))


@jit
def hypot(x: float, y: float) -> float:
    """Return the length of (x, y), within 1 ulp where no square overflows or underflows."""
    return math.sqrt(x * x + y * y)


@jit
def direction(x: Vec3, x_dot: Vec3, x_ddot: Vec3) -> tuple[float, Vec3, Vec3, Vec3]:
    r"""
    Return the length of a time-varying vector, and its direction with two time derivatives.

    .. math:: u = x / |x|, \quad \dot u = (\dot x - u n_1) / |x|, \quad
              \ddot u = (\ddot x - u n_2 - 2 \dot u n_1) / |x|

    with :math:`n_1 = u \cdot \dot x` and :math:`n_2 = \dot u \cdot \dot x + u \cdot \ddot x`,
    the derivatives of the length.

    Parameters
    ----------
    x, x_dot, x_ddot : (3,) any unit, 1/s, 1/s^2, inertial
        The vector and its time derivatives; a zero vector gives NaN.

    Returns
    -------
    length : unit of x
    u, u_dot, u_ddot : (3,) 1, 1/s, 1/s^2, same frame

    """
    length = norm(x)
    u = scale(1.0 / length, x)
    n1 = dot(u, x_dot)
    u_dot = scale(1.0 / length, sub(x_dot, scale(n1, u)))
    n2 = dot(u_dot, x_dot) + dot(u, x_ddot)
    u_ddot = scale(1.0 / length, sub(sub(x_ddot, scale(n2, u)), scale(2.0 * n1, u_dot)))
    return length, u, u_dot, u_ddot
