r"""
Nominal state, error state and covariance of the joint filter.

The nominal state is the estimate. P is the covariance of the error state, in this order:

    0  position      dp  = p_true - p                        m, inertial NED
    3  velocity      xi  = v_true - exp(delta) v             m/s, inertial NED
    6  attitude      q_true = exp(delta) q                   rad, inertial NED
    9  gyro bias     12 accelerometer bias                   body FRD
    15 Q at the reference height   16 dQ/dh                  -, 1/m
    17 drag along body x and y                               s/m
    19 latency of the flow         20 rotation left in it    s, -
    21 offset of the sonar         22 offset of the barometer  m

The error of the velocity is taken after the error of the attitude has been undone. So the error
of the body velocity is R^T xi, whatever the attitude, and a yaw error, which nothing observes,
enters no measurement and no velocity: the filter gains no false information about the yaw
(Barrau and Bonnabel, The invariant extended Kalman filter as a stable observer, 2017).
"""

from __future__ import annotations

import math
from typing import NamedTuple

from mambo_model.compiled import jit
from mambo_model.motion.quaternion import exp_map, multiply, normalise, Quat, rotate
from mambo_model.motion.vector import add, Vec3
import numpy as np
from numpy.typing import NDArray

from ..blocks import Vec2

Array = NDArray[np.float64]

POSITION, VELOCITY, ATTITUDE, GYRO_BIAS, ACCEL_BIAS = 0, 3, 6, 9, 12
SCALE, SLOPE, DRAG, LATENCY, LEAK, RANGE_OFFSET, PRESSURE_OFFSET = 15, 16, 17, 19, 20, 21, 22
SIZE = 23
YAW = ATTITUDE + 2
LARGEST_TURN = 0.5  # rad, of a correction of the yaw by one deviation: beyond it no turn is small


class Nominal(NamedTuple):
    """The nominal state."""

    p: Vec3                  # (3,) m, inertial NED
    v: Vec3                  # (3,) m/s, inertial NED
    q: Quat                  # (4,) w x y z, body to inertial
    gyro_bias: Vec3          # (3,) rad/s, body FRD
    accel_bias: Vec3         # (3,) m/s^2, body FRD
    scale: float             # -, Q at the reference height
    slope: float             # 1/m, dQ/dh
    drag: Vec2               # (2,) s/m, along body x and y, over the thrust's specific force
    latency: float           # s, of the optical flow
    leak: float              # -, share of the rotational flow in the signal
    range_offset: float      # m, range of the sonar minus distance
    pressure_offset: float   # m, height by pressure minus height


@jit
def inject(x: Nominal, d: Array) -> Nominal:
    """
    Return the nominal state corrected by an error state.

    Parameters
    ----------
    x
        Before.
    d : (SIZE,)
        Error state.

    """
    turn = exp_map((d[6], d[7], d[8]))
    return Nominal(
        (x.p[0] + d[0], x.p[1] + d[1], x.p[2] + d[2]),
        add(rotate(turn, x.v), (d[3], d[4], d[5])), normalise(multiply(turn, x.q)),
        (x.gyro_bias[0] + d[9], x.gyro_bias[1] + d[10], x.gyro_bias[2] + d[11]),
        (x.accel_bias[0] + d[12], x.accel_bias[1] + d[13], x.accel_bias[2] + d[14]),
        x.scale + d[SCALE], x.slope + d[SLOPE],
        (x.drag[0] + d[DRAG], x.drag[1] + d[DRAG + 1]), x.latency + d[LATENCY],
        x.leak + d[LEAK], x.range_offset + d[RANGE_OFFSET],
        x.pressure_offset + d[PRESSURE_OFFSET])


@jit
def covariance_with(P: Array, h: Array, out: Array) -> float:
    """
    Store P h^T in ``out``, (SIZE,), and return h P h^T.

    Parameters
    ----------
    P : (SIZE, SIZE)
        Covariance, symmetric.
    h : (SIZE,)
        Row of the measurement's Jacobian, mostly zeros.
    out : (SIZE,)
        Result.

    """
    out[:] = 0.0
    for j in range(SIZE):
        if h[j] != 0.0:
            for i in range(SIZE):
                out[i] += h[j] * P[j, i]
    total = 0.0
    for j in range(SIZE):
        total += h[j] * out[j]
    return total


@jit
def correct(P: Array, column: Array, innovation: float, variance: float, d: Array) -> None:
    """
    Update with one scalar measurement: K = P h^T / S, P - K S K^T, and d + K innovation.

    Parameters
    ----------
    P : (SIZE, SIZE)
        Covariance, changed in place; it stays symmetric to the bit.
    column : (SIZE,)
        P h^T.
    innovation, variance
        Of the measurement, and S = h P h^T + R.
    d : (SIZE,)
        Error state found so far, changed in place.

    """
    root = 1.0 / math.sqrt(variance)
    for j in range(SIZE):
        k = column[j] * root
        d[j] += k * root * innovation
        for i in range(SIZE):
            P[j, i] -= k * (column[i] * root)


@jit
def forget(P: Array, i: int, variance: float) -> None:
    """Make an error independent of all others, with this variance, in place."""
    for j in range(SIZE):
        P[i, j] = 0.0
        P[j, i] = 0.0
    P[i, i] = variance


@jit
def forget_heading(P: Array) -> None:
    """
    Part yaw and horizontal position from all other errors once corrections would be too large.

    Nothing observes yaw and position without poses. In an hour or so, though, the yaw error comes
    to depend on the other errors so much, by the bias of the gyro, that a small correction of
    these would turn the yaw by a large angle, and move the position with it. The linear model
    has no such turns. Their variances stay, and what each says about the other.

    Parameters
    ----------
    P : (SIZE, SIZE)
        Covariance, changed in place.

    """
    most = LARGEST_TURN * LARGEST_TURN
    if P[YAW, YAW] <= most:
        return
    explained = 0.0
    for j in range(SIZE):
        if j > 1 and j != YAW and P[j, j] > 0.0:
            explained = max(explained, P[YAW, j] * P[YAW, j] / P[j, j])
    if explained <= most:
        return
    for j in range(SIZE):
        if j > 1 and j != YAW:
            for i in (0, 1, YAW):
                P[i, j] = 0.0
                P[j, i] = 0.0
