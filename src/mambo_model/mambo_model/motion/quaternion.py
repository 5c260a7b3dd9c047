"""
Quaternion algebra (2.1)-(2.16).

Convention: Hamilton (ij = k, ijk = -1), scalar first. A unit quaternion maps body vectors to the
inertial frame: ``v_I = rotate(q, v_B)``. q and -q are the same attitude. Functions that assume a
unit quaternion do not check it; (2.12) preserves lengths only for unit q.
"""

from __future__ import annotations

import math

from ..arithmetic.trigonometry import asin, atan2, sin_cos
from ..compiled import jit
from .vector import add, cross, norm as vector_norm, scale, Vec3

Quat = tuple[float, float, float, float]
Matrix3 = tuple[Vec3, Vec3, Vec3]
Matrix4 = tuple[Quat, Quat, Quat, Quat]

IDENTITY: Quat = (1.0, 0.0, 0.0, 0.0)
UNIT_TOLERANCE = 1e-3  # of |q|^2: far above rounding, far below a wrong quaternion


@jit
def is_unit(q: Quat) -> bool:
    """Tell whether q (4,) has length 1 up to UNIT_TOLERANCE of its square; NaN has not."""
    n = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
    return abs(n - 1.0) <= UNIT_TOLERANCE


@jit
def multiply(p: Quat, q: Quat) -> Quat:
    """Return the Hamilton product of two quaternions, (4,) (2.9): first q, then p."""
    return (
        p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
        p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
        p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
        p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0])


@jit
def conjugate(q: Quat) -> Quat:
    """Return q*, (4,) (2.7): the inverse rotation if q is unit."""
    return (q[0], -q[1], -q[2], -q[3])


@jit
def norm(q: Quat) -> float:
    """Return the length of q (2.6); 1 for an attitude."""
    return math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])


@jit
def inverse(q: Quat) -> Quat:
    """Return q* / |q|^2, (4,) (2.8); q need not be unit, NaN for q = 0."""
    n = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]
    return (q[0] / n, -q[1] / n, -q[2] / n, -q[3] / n)


@jit
def normalise(q: Quat) -> Quat:
    """Return q / |q|, (4,) of unit length; NaN for q = 0."""
    n = norm(q)
    return (q[0] / n, q[1] / n, q[2] / n, q[3] / n)


@jit
def rotate(q: Quat, v: Vec3) -> Vec3:
    """Return v rotated by unit q, (3,) (2.12), (2.13): body axes to inertial axes."""
    r = (q[1], q[2], q[3])
    return add(v, scale(2.0, cross(r, add(cross(r, v), scale(q[0], v)))))


@jit
def rotate_inverse(q: Quat, v: Vec3) -> Vec3:
    """Return v rotated by q* for unit q, (3,) (2.12): inertial axes to body axes."""
    return rotate(conjugate(q), v)


@jit
def derivative(q: Quat, omega: Vec3) -> Quat:
    """Return the time derivative of q, (4,) 1/s (2.14), at body rate omega, (3,) rad/s."""
    p = multiply(q, (0.0, omega[0], omega[1], omega[2]))
    return (0.5 * p[0], 0.5 * p[1], 0.5 * p[2], 0.5 * p[3])


@jit
def norm_control(q: Quat, k: float) -> Quat:
    """
    Return the term that keeps the length of q at 1, (4,) 1/s: ``k (1 - q.q) q`` (2.15), (2.16).

    The term is added to :func:`derivative`. The gain k is in 1/s; a step of h seconds is stable
    for h k < 1 with explicit Euler and for h k < 1.39 with the classical Runge-Kutta method.
    """
    c = k * (1.0 - (q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]))
    return (c * q[0], c * q[1], c * q[2], c * q[3])


@jit
def to_matrix(q: Quat) -> Matrix3:
    """Return the rows of the (3, 3) rotation matrix of unit q, body to inertial (2.1)."""
    w, x, y, z = q
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)))


@jit
def from_euler(phi: float, theta: float, psi: float) -> Quat:
    """Return the attitude of roll, pitch and yaw in rad, ZYX order, unit (4,) (2.4)."""
    s1, c1 = sin_cos(0.5 * phi)
    s2, c2 = sin_cos(0.5 * theta)
    s3, c3 = sin_cos(0.5 * psi)
    return (
        c1 * c2 * c3 + s1 * s2 * s3,
        s1 * c2 * c3 - c1 * s2 * s3,
        c1 * s2 * c3 + s1 * c2 * s3,
        c1 * c2 * s3 - s1 * s2 * c3)


@jit
def to_euler(q: Quat) -> Vec3:
    """
    Return roll, pitch and yaw of unit q, (3,) rad, ZYX order (2.5).

    The sine of the pitch is clamped to [-1, 1] against rounding. At a pitch of +-90 degrees roll
    and yaw are about the same axis, and only their sum or difference is determined.
    """
    sine = max(-1.0, min(1.0, 2.0 * (q[0] * q[2] - q[3] * q[1])))
    return (
        atan2(2.0 * (q[0] * q[1] + q[2] * q[3]),
              q[0] * q[0] - q[1] * q[1] - q[2] * q[2] + q[3] * q[3]),
        asin(sine),
        atan2(2.0 * (q[0] * q[3] + q[1] * q[2]),
              q[0] * q[0] + q[1] * q[1] - q[2] * q[2] - q[3] * q[3]))


@jit
def angle(q: Quat) -> float:
    """Return the rotation angle of q in rad, in [0, pi], the same for q and -q."""
    return 2.0 * atan2(vector_norm((q[1], q[2], q[3])), abs(q[0]))


@jit
def exp_map(rotvec: Vec3) -> Quat:
    """Return the unit quaternion, (4,), of a rotation vector (axis times angle), (3,) rad."""
    a = vector_norm(rotvec)
    s, c = sin_cos(0.5 * a)
    k = 0.5 if a == 0.0 else s / a
    return (c, k * rotvec[0], k * rotvec[1], k * rotvec[2])
