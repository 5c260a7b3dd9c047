"""
Initial state and covariance of the joint filter, with and without an alignment.

At rest the accelerometer reads b - g R^T e_3. The reading is used as a measurement of both, with
the slope of the floor and the size of a bias as priors. Tilt and bias, which cannot be separated,
stay correlated: a later correction of the tilt also corrects the bias.

A vehicle may also have been set down on a slope or be held. Both cases explain the reading, with
probabilities 1 - p and p. State and covariance are the mean and the covariance of the mixture,

    x = (1 - p) x_level + p x_tilted,    P = sum of p_i (P_i + d_i d_i^T),    d_i = x_i - x

so that a reading that both explain equally well leaves the tilt as unknown as it is.
"""

from __future__ import annotations

import math

from mambo_model.compiled import jit
from mambo_model.motion.quaternion import conjugate, IDENTITY, multiply, Quat, to_matrix
from mambo_model.motion.vector import hypot, Vec3
import numpy as np

from .. import alignment
from ..alignment import Alignment
from .joint_parameters import JointValues
from .state import (
    ACCEL_BIAS, Array, ATTITUDE, correct, covariance_with, DRAG, GYRO_BIAS, LATENCY, LEAK,
    Nominal, POSITION, RANGE_OFFSET, SCALE, SIZE, SLOPE, VELOCITY)

STILL = 1e-3  # m/s: deviation of the velocity of a vehicle that stands on the floor


@jit
def _set(P: Array, first: int, count: int, std: float) -> None:
    """Set some variances, in place."""
    for i in range(first, first + count):
        P[i, i] = std * std


@jit
def _nominal(q: Quat, gyro_bias: Vec3, accel_bias: Vec3, v: JointValues) -> Nominal:
    """Return the state at the start: on the floor, at the origin, at rest."""
    f = v.optical_flow
    return Nominal(
        (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), q, gyro_bias, accel_bias, f.scale, f.slope,
        (v.drag.coefficient, v.drag.coefficient), f.latency, f.rotation_leak, 0.0, 0.0)


@jit
def _sensors(v: JointValues) -> Array:
    """Return the covariance with the priors of sensors, drag and yaw."""
    P, f = np.zeros((SIZE, SIZE)), v.optical_flow
    _set(P, ATTITUDE + 2, 1, v.motion.initial_yaw_std)
    _set(P, SCALE, 1, f.scale_std)
    _set(P, SLOPE, 1, f.slope_std)
    _set(P, DRAG, 2, v.drag.coefficient_std)
    _set(P, LATENCY, 1, f.latency_std)
    _set(P, LEAK, 1, f.rotation_leak_std)
    _set(P, RANGE_OFFSET, 1, v.sonar.offset_std)
    return P


@jit
def unaligned(rest: Alignment, v: JointValues) -> tuple[Nominal, Array]:
    """
    Return state and covariance with wide defaults and the biases of the parameters.

    A vehicle that has moved since its first sample may have left the floor meanwhile.
    """
    P, m = _sensors(v), v.motion
    _set(P, POSITION, 2, m.initial_height_std)
    height = hypot(m.initial_height_std, m.initial_velocity_std * rest.waited)
    _set(P, POSITION + 2, 1, height)
    _set(P, VELOCITY, 3, m.initial_velocity_std)
    _set(P, ATTITUDE, 2, m.initial_tilt_std)
    _set(P, GYRO_BIAS, 3, m.initial_gyro_bias_std)
    _set(P, ACCEL_BIAS, 3, v.alignment.accel_bias_std)
    return _nominal(IDENTITY, v.alignment.gyro_bias, rest.accel_bias, v), P


@jit
def aligned(rest: Alignment, v: JointValues) -> tuple[Nominal, Array]:
    """
    Return state and covariance of a vehicle that has been at rest.

    Parameters
    ----------
    rest
        Means of gyro and accelerometer, and scatter.
    v
        Priors.

    """
    a, tilted = v.alignment, alignment.tilted_probability(rest.accel, v.gravity, v.alignment)
    reading = alignment.reading_std(v.gravity, a)
    share = a.accel_bias_std / reading
    share *= share
    q, bias = alignment.split(rest.accel, v.gravity, (1.0 - tilted) * share)
    x = _nominal(q, rest.gyro, bias, v)
    steep = max(v.motion.initial_tilt_std, alignment.STEEPER * reading / v.gravity)
    return x, ((1.0 - tilted) * _about(x, rest, share, a.floor_slope_std, v)
               + tilted * _about(x, rest, 0.0, steep, v))


@jit
def _about(x: Nominal, rest: Alignment, share: float, slope: float, v: JointValues) -> Array:
    """
    Return the second moment about x of a vehicle that stands on a slope.

    Parameters
    ----------
    x
        State.
    rest
        Means of gyro and accelerometer, and scatter.
    share : -
        Of the horizontal force that is then expected to be bias.
    slope : rad
        Deviation of the slope.
    v
        Priors.

    """
    P = _sensors(v)
    _set(P, POSITION, 3, v.motion.initial_height_std)
    _set(P, VELOCITY, 3, STILL)
    _set(P, ATTITUDE, 2, slope)
    _set(P, GYRO_BIAS, 3, math.sqrt(alignment.gyro_bias_variance(rest, v.alignment)))
    _set(P, ACCEL_BIAS, 3, v.alignment.accel_bias_std)
    q, bias = alignment.split(rest.accel, v.gravity, share)
    _use_rest(P, q, rest.noise.accel / (3.0 * rest.count), v.gravity)
    d, turn = np.zeros(SIZE), multiply(q, conjugate(x.q))
    for i in range(3):
        d[ATTITUDE + i], d[ACCEL_BIAS + i] = 2.0 * turn[1 + i], bias[i] - x.accel_bias[i]
    for i in range(SIZE):  # np.outer takes seconds to compile
        for j in range(SIZE):
            P[i, j] += d[i] * d[j]
    return P


@jit
def _use_rest(P: Array, q: Quat, noise: float, gravity: float) -> None:
    """
    Correct the covariance with the mean specific force at rest, in place.

    d (b - g R^T e_3) = db + g R^T (delta x e_3); the state has been set to what this says.
    """
    R = to_matrix(q)
    h, column, nowhere = np.zeros(SIZE), np.zeros(SIZE), np.zeros(SIZE)
    for i in range(3):
        h[:] = 0.0
        h[ACCEL_BIAS + i] = 1.0
        h[ATTITUDE] = -gravity * R[1][i]
        h[ATTITUDE + 1] = gravity * R[0][i]
        correct(P, column, 0.0, covariance_with(P, h, column) + noise, nowhere)
