r"""
A pose of the motion capture as the joint filter predicts it, at the time of its exposure.

With T the age of the exposure, p' and q' position and attitude of then,

    y_p = z_p - p',    y_q = log(z_q (x) q'*)

The state of then is that of now taken back through the inertial samples since. Its errors follow
from those of now, to second order in T, with S and V as of :mod:`..joint.flow` and D = p - p':

    dp'    = dp - T xi + [D x] delta + T^2/2 [g e_3 x] delta - T/2 S db_a
             + (1/2 [D x] S - T/2 V) db_g
    delta' = delta + S db_g

The six numbers are used one after the other, which gives the same state and covariance, and the
same y^T S^-1 y for the gate, as all at once, because the noise of each is its own.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from mambo_model.compiled import jit
from mambo_model.motion.quaternion import angle, conjugate, multiply, Quat
from mambo_model.motion.vector import scale, sub, Vec3
import numpy as np

from ..joint.flow import look_back, Past
from ..joint.state import (
    ACCEL_BIAS, Array, ATTITUDE, correct, covariance_with, GYRO_BIAS, Nominal, POSITION, SIZE,
    VELOCITY)
from .pose_parameters import PoseValues

ROWS = 6


class Compared(NamedTuple):
    """A pose compared with the state."""

    position: float  # -, squared error of the position over its covariance
    attitude: float  # -, likewise of the attitude, the position being known


@jit
def state_at(x: Nominal, ring: Array, at: int, age: float, gravity: float) -> Past:
    """
    Return the state of some time ago.

    Parameters
    ----------
    x
        Now.
    ring, at
        Of the joint filter.
    age : s
        How long ago; the result says how far back the ring reaches.
    gravity : m/s^2

    """
    shifted = Nominal(
        x.p, x.v, x.q, x.gyro_bias, x.accel_bias, x.scale, x.slope, x.drag, age, x.leak,
        x.range_offset, x.pressure_offset)
    return look_back(shifted, ring, at, gravity)


@jit
def turn_between(measured: Quat, believed: Quat) -> Vec3:
    """Return the rotation vector from one attitude to another, (3,) rad, inertial axes."""
    q = multiply(measured, conjugate(believed))
    sine = math.sqrt(q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    if sine < 1e-9:
        return scale(2.0 if q[0] >= 0.0 else -2.0, (q[1], q[2], q[3]))
    return scale((1.0 if q[0] >= 0.0 else -1.0) * angle(q) / sine, (q[1], q[2], q[3]))


@jit
def innovation(past: Past, rho: Vec3, q: Quat) -> tuple[Vec3, Vec3]:
    """Return measured minus expected pose, (3,) m and (3,) rad, inertial axes."""
    return sub(rho, past.x.p), turn_between(q, past.x.q)


@jit
def jacobian(past: Past, now: Vec3, gravity: float, H: Array) -> None:
    """
    Store the derivative of the expected pose by the error state of now in ``H``, (6, SIZE).

    Parameters
    ----------
    past
        When the pose was exposed.
    now : (3,) m, inertial NED
        Position now.
    gravity : m/s^2

    """
    T, S, V, D = past.age, past.S, past.V, sub(now, past.x.p)
    fall = 0.5 * T * T * gravity
    H[:] = 0.0
    for i in range(3):
        H[i, POSITION + i] = 1.0
        H[i, VELOCITY + i] = -T
        H[3 + i, ATTITUDE + i] = 1.0
        for j in range(3):
            H[i, ACCEL_BIAS + j] = -0.5 * T * S[i, j]
            H[3 + i, GYRO_BIAS + j] = S[i, j]
        k, m = (i + 1) % 3, (i + 2) % 3  # row i of [D x]: -D_m at k, D_k at m
        H[i, ATTITUDE + k] = -D[m]
        H[i, ATTITUDE + m] = D[k]
        for j in range(3):
            H[i, GYRO_BIAS + j] = 0.5 * (D[k] * S[m, j] - D[m] * S[k, j] - T * V[i, j])
    H[0, ATTITUDE + 1] -= fall
    H[1, ATTITUDE] += fall


@jit
def compare(
    P: Array, H: Array, errors: tuple[Vec3, Vec3], noise: tuple[float, float], d: Array,
) -> Compared:
    """
    Use a pose on a covariance and return how well it fits; ``P`` and ``d`` change in place.

    Parameters
    ----------
    P : (SIZE, SIZE)
    H : (6, SIZE)
    errors
        Of :func:`innovation`.
    noise : m^2, rad^2
        Variances of the pose, each axis.
    d : (SIZE,)
        Error state found, zero before.

    """
    column, totals = np.empty(SIZE), np.zeros(2)
    for kind in range(2):
        for i in range(3):
            h, y = H[3 * kind + i], errors[kind][i]
            variance = covariance_with(P, h, column) + noise[kind]
            for j in range(SIZE):
                y -= h[j] * d[j]
            totals[kind] += y * y / variance
            correct(P, column, y, variance, d)
    return Compared(totals[0], totals[1])


@jit
def noise_of(past: Past, accel_density: float, p: PoseValues) -> tuple[float, float]:
    """Return the variances of a pose, m^2 and rad^2; the age adds that of the inertial samples."""
    age = past.age
    return (p.position_noise * p.position_noise
            + age * age * age / 3.0 * accel_density * accel_density,
            p.attitude_noise * p.attitude_noise)
