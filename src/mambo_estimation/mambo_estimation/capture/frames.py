r"""
``map`` and ``odom``: where the odometry stands among the cameras (REP-105).

The joint filter believes in ``map``. The pose of ``odom`` in it is a yaw and a shift,

    p_map = R_z(yaw) p_odom + shift,    q_map = q_z(yaw) (x) q_odom

and takes up what a pose of the motion capture changes of position and yaw. So the pose in
``odom`` is what the inertial and floor sensors alone make it go on to: it never jumps to where the
cameras see the vehicle. Tilt and velocity, which are the same in both, are corrected in both.
"""

from __future__ import annotations

from typing import NamedTuple

from mambo_model.arithmetic.trigonometry import atan2, sin_cos
from mambo_model.compiled import jit
from mambo_model.motion.quaternion import multiply, normalise, Quat
from mambo_model.motion.rigid_body import State
from mambo_model.motion.vector import add, sub, Vec3

from ..joint.state import Array, Nominal


class Anchor(NamedTuple):
    """Pose of ``odom`` in ``map``, axes as of NED."""

    yaw: float   # rad, about z (down)
    shift: Vec3  # (3,) m


SAME = Anchor(0.0, (0.0, 0.0, 0.0))


@jit
def about_z(yaw: float, v: Vec3) -> Vec3:
    """Return a vector turned about z by an angle in rad, (3,)."""
    s, c = sin_cos(yaw)
    return (c * v[0] - s * v[1], s * v[0] + c * v[1], v[2])


@jit
def yaw_quaternion(yaw: float) -> Quat:
    """Return the attitude of a yaw in rad, w x y z."""
    s, c = sin_cos(0.5 * yaw)
    return (c, 0.0, 0.0, s)


@jit
def wrapped(turn: float) -> float:
    """Return an angle in rad within pi of zero."""
    s, c = sin_cos(turn)
    return atan2(s, c)


@jit
def in_odom(state: State, a: Anchor) -> State:
    """Return a state of ``map`` with position and attitude in ``odom``."""
    return State(
        about_z(-a.yaw, sub(state.rho, a.shift)), state.nu,
        normalise(multiply(yaw_quaternion(-a.yaw), state.q)), state.omega)


@jit
def take_up(a: Anchor, before: Vec3, after: Vec3, turn: float) -> Anchor:
    """
    Return where ``odom`` stands after a correction in ``map``, with the same pose in ``odom``.

    Parameters
    ----------
    a
        Before.
    before, after : (3,) m
        Position in ``map``.
    turn : rad
        Of the yaw in ``map``.

    """
    return Anchor(wrapped(a.yaw + turn), sub(after, about_z(turn, sub(before, a.shift))))


@jit
def composed(first: Anchor, a: Anchor) -> Anchor:
    """Return where ``odom`` stands after all of ``map`` has been moved by ``first``."""
    return Anchor(wrapped(first.yaw + a.yaw), add(about_z(first.yaw, a.shift), first.shift))


@jit
def moved(x: Nominal, by: Anchor) -> Nominal:
    """Return the state of the joint filter, turned and shifted as a whole."""
    return Nominal(
        add(about_z(by.yaw, x.p), by.shift), about_z(by.yaw, x.v),
        normalise(multiply(yaw_quaternion(by.yaw), x.q)), x.gyro_bias, x.accel_bias, x.scale,
        x.slope, x.drag, x.latency, x.leak, x.range_offset, x.pressure_offset)


@jit
def turn_covariance(P: Array, yaw: float) -> None:
    """Turn the errors of position, velocity and attitude about z, in place."""
    s, c = sin_cos(yaw)
    for first in (0, 3, 6):
        for j in range(len(P)):
            x, y = P[first, j], P[first + 1, j]
            P[first, j], P[first + 1, j] = c * x - s * y, s * x + c * y
    for first in (0, 3, 6):
        for j in range(len(P)):
            x, y = P[j, first], P[j, first + 1]
            P[j, first], P[j, first + 1] = c * x - s * y, s * x + c * y


def odom_in_map(a: Anchor) -> State:
    """Return the pose of ``odom`` in ``map`` as a state at rest, axes as of NED."""
    still = (0.0, 0.0, 0.0)
    return State(a.shift, still, yaw_quaternion(a.yaw), still)
