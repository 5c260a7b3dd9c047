"""Published estimate of the joint filter, from its state and covariance."""

from __future__ import annotations

import math
from typing import NamedTuple

from mambo_model.compiled import jit
from mambo_model.motion.quaternion import rotate_inverse, to_matrix
from mambo_model.motion.rigid_body import State
from mambo_model.motion.vector import sub, Vec3

from ..blocks import Matrix3, Vec2
from ..health import Sensors
from .joint_parameters import MotionValues
from .state import Array, ATTITUDE, GYRO_BIAS, Nominal, VELOCITY

NONE2: Vec2 = (math.nan, math.nan)


class Result(NamedTuple):
    """Result of one measurement update."""

    innovation: Vec2   # unit of the measurement, NaN: not compared; a scalar stands in both
    ratio: float       # -, squared innovation over variance times squared gate
    used: bool


class Results(NamedTuple):
    """Results of the measurement updates of one step."""

    sonar: Result
    flow: Result
    barometer: Result


NOT_COMPARED = Result(NONE2, math.nan, False)
NOTHING = Results(NOT_COMPARED, NOT_COMPARED, NOT_COMPARED)


@jit
def state_of(x: Nominal, gyro: Vec3, shake: Vec3, aligning: bool) -> State:
    """
    Return position, body velocity, attitude and body rate; no rate before the alignment.

    The velocity is without ``shake``, (3,) m/s, which vibration adds to its integral.
    """
    nu = sub(rotate_inverse(x.q, x.v), shake)
    omega = (0.0, 0.0, 0.0) if aligning else sub(gyro, x.gyro_bias)
    return State(x.p, nu, x.q, omega)


@jit
def pose_covariance(P: Array) -> tuple[float, ...]:
    """Return the (36,) covariance of position and rotation, inertial axes, m and rad."""
    a, b, c, d, e, f = 0, 1, 2, ATTITUDE, ATTITUDE + 1, ATTITUDE + 2
    return (
        P[a, a], P[a, b], P[a, c], P[a, d], P[a, e], P[a, f],
        P[b, a], P[b, b], P[b, c], P[b, d], P[b, e], P[b, f],
        P[c, a], P[c, b], P[c, c], P[c, d], P[c, e], P[c, f],
        P[d, a], P[d, b], P[d, c], P[d, d], P[d, e], P[d, f],
        P[e, a], P[e, b], P[e, c], P[e, d], P[e, e], P[e, f],
        P[f, a], P[f, b], P[f, c], P[f, d], P[f, e], P[f, f])


@jit
def _turned(P: Array, R: Matrix3, i: int, j: int) -> float:
    """Return element (i, j) of R^T P R for the block of the velocity."""
    total = 0.0
    for k in range(3):
        for m in range(3):
            total += R[k][i] * P[VELOCITY + k, VELOCITY + m] * R[m][j]
    return total


@jit
def twist_covariance(
    P: Array, x: Nominal, sensors: Sensors, shaken: Vec3, v: MotionValues,
) -> tuple[float, ...]:
    """
    Return the (36,) covariance of velocity and angular velocity, body axes, m/s and rad/s.

    The error of the body velocity is R^T xi; that of the rate is the bias's and a sample's noise.

    Parameters
    ----------
    P, x
        Of the filter.
    sensors
        With the noise that the gyro shows.
    shaken : (3,) m^2/s^2
        Variance of the velocity by what is left of the vibration, body axes.
    v
        Least noise of the gyro, and what is lost without it.

    """
    R, b, gyro = to_matrix(x.q), GYRO_BIAS, sensors.gyro
    unknown = v.lost_rate_growth * gyro.age
    least, seen = v.rate_noise * v.rate_noise, gyro.noise
    xx, yy = _turned(P, R, 0, 0) + shaken[0], _turned(P, R, 1, 1) + shaken[1]
    zz = _turned(P, R, 2, 2) + shaken[2]
    xy, xz, yz = _turned(P, R, 0, 1), _turned(P, R, 0, 2), _turned(P, R, 1, 2)
    r = (
        P[b, b] + unknown * unknown + max(seen[0], least),
        P[b + 1, b + 1] + unknown * unknown + max(seen[1], least),
        P[b + 2, b + 2] + unknown * unknown + max(seen[2], least))
    rxy, rxz, ryz = P[b, b + 1], P[b, b + 2], P[b + 1, b + 2]
    return (
        xx, xy, xz, 0.0, 0.0, 0.0, xy, yy, yz, 0.0, 0.0, 0.0, xz, yz, zz, 0.0, 0.0, 0.0,
        0.0, 0.0, 0.0, r[0], rxy, rxz, 0.0, 0.0, 0.0, rxy, r[1], ryz,
        0.0, 0.0, 0.0, rxz, ryz, r[2])
