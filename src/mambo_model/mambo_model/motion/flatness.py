"""
Feasible reference (3.14) from a position and its derivatives up to snap.

The vehicle is differentially flat with position and yaw as flat outputs: thrust direction,
attitude, rates, thrust and torque follow from their derivatives. There are two attitudes: the
least rotation of e3 onto the thrust axis, constructed as in (3.21)-(3.24), and one with a
prescribed ZYX yaw.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..arithmetic.trigonometry import atan2, sin_cos
from ..compiled import jit
from .quaternion import from_euler, Quat, rotate_inverse
from .vector import add, cross, direction, dot, mul, scale, sub, Vec3


class Reference(NamedTuple):
    """A point of a trajectory that satisfies (3.14), with the thrust and torque it requires."""

    rho: Vec3        # (3,) m, inertial NED
    v: Vec3          # (3,) m/s, inertial NED
    a: Vec3          # (3,) m/s^2, inertial NED
    j: Vec3          # (3,) m/s^3, inertial NED
    s: Vec3          # (3,) m/s^4, inertial NED
    q: Quat          # (4,) w x y z, body to inertial, unit
    omega: Vec3      # (3,) rad/s, body FRD
    omega_dot: Vec3  # (3,) rad/s^2, body FRD
    f: float         # N, total thrust along -b3
    tau: Vec3        # (3,) N m, body FRD


@jit
def _thrust_axis(
    a: Vec3, j: Vec3, s: Vec3, gravity: float,
) -> tuple[float, Vec3, Vec3, Vec3]:
    """Return |g e3 - a| in m/s^2 and b3 with two derivatives, (3,) inertial, by (3.14b)."""
    return direction(
        sub((0.0, 0.0, gravity), a), scale(-1.0, j), scale(-1.0, s))


@jit
def minimal_rotation(b: Vec3, b_dot: Vec3, b_ddot: Vec3) -> tuple[Quat, Vec3, Vec3]:
    """
    Return the least rotation of e3 onto a time-varying unit vector, with its rates.

    Parameters
    ----------
    b, b_dot, b_ddot : (3,) 1, 1/s, 1/s^2
        Unit vector and its time derivatives in the frame before the rotation; b = -e3 is
        singular (NaN).

    Returns
    -------
    q : (4,)
        ``rotate(q, e3) = b`` (3.23).
    omega, omega_dot : (3,) rad/s, rad/s^2, in the rotated frame
        (3.24) and its time derivative.

    """
    b1, b2, b3 = b
    d1, d2, d3 = b_dot
    e1, e2, e3 = b_ddot
    k = 1.0 + b3
    n = math.sqrt(2.0 * k)
    q = (k / n, -b2 / n, b1 / n, 0.0)
    turn = (b2 * d1 - b1 * d2) / k
    omega = (-d2 + b2 * d3 / k, d1 - b1 * d3 / k, turn)
    omega_dot = (
        -e2 + (d2 * d3 + b2 * e3) / k - b2 * d3 * d3 / (k * k),
        e1 - (d1 * d3 + b1 * e3) / k + b1 * d3 * d3 / (k * k),
        (b2 * e1 - b1 * e2) / k - turn * d3 / k)
    return q, omega, omega_dot


@jit
def torque(omega: Vec3, omega_dot: Vec3, inertia: Vec3) -> Vec3:
    """Return the torque in N m, (3,) body FRD, of (3.14d); rates in rad/s and rad/s^2."""
    return sub(mul(inertia, omega_dot), cross(mul(inertia, omega), omega))


@jit
def from_flat_output(
    rho: Vec3, v: Vec3, a: Vec3, j: Vec3, s: Vec3,
    mass: float, inertia: Vec3, gravity: float,
) -> Reference:
    """
    Return the reference (3.14) whose attitude is the least rotation, (3.23) with f_d = b3.

    Parameters
    ----------
    rho, v, a, j, s : (3,) m ... m/s^4, inertial NED
        Position and its first four derivatives; free fall (a = g e3) has no attitude (NaN).
    mass, inertia, gravity : kg, (3,) kg m^2, m/s^2
        Properties of the vehicle, as assumed by the controller that follows the reference.

    """
    length, b3, b3_dot, b3_ddot = _thrust_axis(a, j, s, gravity)
    q, omega, omega_dot = minimal_rotation(b3, b3_dot, b3_ddot)
    return Reference(
        rho, v, a, j, s, q, omega, omega_dot, mass * length, torque(omega, omega_dot, inertia))


@jit
def from_flat_output_yaw(
    rho: Vec3, v: Vec3, a: Vec3, j: Vec3, s: Vec3,
    psi: float, psi_dot: float, psi_ddot: float,
    mass: float, inertia: Vec3, gravity: float,
) -> Reference:
    """
    Return the reference (3.14) with a prescribed ZYX yaw; q is a continuous function of psi.

    Parameters
    ----------
    rho, v, a, j, s : (3,) m ... m/s^4, inertial NED
        Position and its first four derivatives; thrust along the yawed y axis is singular (NaN).
    psi, psi_dot, psi_ddot : rad, rad/s, rad/s^2
        Yaw and its derivatives.
    mass, inertia, gravity : kg, (3,) kg m^2, m/s^2
        As for :func:`from_flat_output`.

    """
    length, b3, b3_dot, b3_ddot = _thrust_axis(a, j, s, gravity)
    sine, cosine = sin_cos(psi)
    x_C, y_C = (cosine, sine, 0.0), (-sine, cosine, 0.0)
    y_C_dot = scale(-psi_dot, x_C)
    y_C_ddot = sub(scale(-psi_ddot, x_C), scale(psi_dot * psi_dot, y_C))
    c = cross(y_C, b3)
    c_dot = add(cross(y_C_dot, b3), cross(y_C, b3_dot))
    c_ddot = add(
        cross(y_C_ddot, b3), add(scale(2.0, cross(y_C_dot, b3_dot)), cross(y_C, b3_ddot)))
    _, b1, b1_dot, b1_ddot = direction(c, c_dot, c_ddot)
    b2 = cross(b3, b1)
    w1, w2, w3 = -dot(b2, b3_dot), dot(b1, b3_dot), dot(b2, b1_dot)
    omega_dot = (
        -dot(b2, b3_ddot) + w2 * w3, dot(b1, b3_ddot) - w1 * w3, dot(b2, b1_ddot) - w1 * w2)
    x, y, z = dot(x_C, b3), dot(y_C, b3), b3[2]
    q = from_euler(atan2(-y, math.sqrt(x * x + z * z)), atan2(x, z), psi)
    return Reference(
        rho, v, a, j, s, q, (w1, w2, w3), omega_dot, mass * length,
        torque((w1, w2, w3), omega_dot, inertia))


@jit
def body_velocity(ref: Reference) -> Vec3:
    """Return nu_r = q_r* (.) v_r, (3,) m/s, body FRD of the reference (3.14a)."""
    return rotate_inverse(ref.q, ref.v)
