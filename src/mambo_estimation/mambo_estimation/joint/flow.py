r"""
Measurement model of the optical flow in the joint filter, at the time of exposure.

With h = -p_z, c = cos(phi) cos(theta) and w the body rate, all at t - latency,

    z = nu_xy / (Z Q(h)) + leak (w_y, -w_x),   nu = R^T v,   Z = h / c,   Q(h) = Q + Q' (h - h_0)

which is (5.2) with C8 and C5, inverted. The state at that time is the present state integrated
backwards through the inertial samples since then. Its errors follow from the present errors, to
second order in the latency T, with S = sum R dt and V = sum [v x] R dt over those samples:

    delta' = delta + S db_g
    xi'    = xi - [g e_3 x] (T delta + T/2 S db_g) + S db_a + V db_g
    dp_z'  = dp_z - T (xi + delta x v)_z

Noise of the inertial samples in between is added to that of the measurement.
"""

from __future__ import annotations

from typing import NamedTuple

from mambo_model.compiled import jit
from mambo_model.motion.quaternion import rotate_inverse, to_matrix
from mambo_model.motion.vector import add, scale, sub, Vec3
import numpy as np

from ..blocks import Matrix3, Vec2
from .joint_parameters import FlowValues
from .propagation import move, turned_rate
from .state import (
    ACCEL_BIAS, Array, ATTITUDE, GYRO_BIAS, LATENCY, LEAK, Nominal, SCALE, SLOPE, VELOCITY)

RING = 64           # stored inertial samples: 0.32 s at 200 Hz
Z_POSITION = 2


class Past(NamedTuple):
    """State at the exposure of a sample, and the transition of the present errors to it."""

    x: Nominal
    gyro: Vec3        # (3,) rad/s, body FRD, bias included
    accel: Vec3       # (3,) m/s^2, body FRD, bias included
    age: float        # s, T
    S: Array          # (3, 3) s
    V: Array          # (3, 3) m


@jit
def remember(ring: Array, at: int, gyro: Vec3, accel: Vec3, dt: float) -> int:
    """Store the means of one step in the ring, in place; return where the next one goes."""
    row = ring[at]
    row[0], row[1], row[2] = gyro
    row[3], row[4], row[5] = accel
    row[6] = dt
    return (at + 1) % RING


@jit
def look_back(x: Nominal, ring: Array, at: int, gravity: float) -> Past:
    """
    Return the state ``x.latency`` seconds ago.

    Parameters
    ----------
    x
        Now.
    ring : (RING, 7)
        Gyro, force and dt of the last steps; dt is zero where there was none.
    at
        Where the next step goes.
    gravity : m/s^2

    """
    S, V = np.zeros((3, 3)), np.zeros((3, 3))
    left, k = max(x.latency, 0.0), at
    row = ring[(at - 1) % RING]
    gyro, accel = (row[0], row[1], row[2]), (row[3], row[4], row[5])
    age, past = 0.0, x
    for _ in range(RING):
        k = (k - 1) % RING
        row = ring[k]
        if left <= 0.0 or row[6] <= 0.0:
            break
        dt = min(left, row[6])
        gyro, accel = (row[0], row[1], row[2]), (row[3], row[4], row[5])
        R, before = to_matrix(past.q), past.v
        past = move(past, gyro, accel, -dt, gravity)
        W = turned_rate(scale(0.5, add(before, past.v)), R)
        for i in range(3):
            for j in range(3):
                S[i, j] += dt * R[i][j]
                V[i, j] += dt * W[i][j]
        age += dt
        left -= dt
    return Past(past, gyro, accel, age, S, V)


@jit
def factor_at(height: float, x: Nominal, v: FlowValues) -> tuple[float, float]:
    """Return Q at a height in m, and the lever of its slope: the distance to h_0, m."""
    lever = min(max(height, v.factor_min_height), v.factor_max_height) - v.reference_height
    return max(x.scale + x.slope * lever, 0.1), lever


@jit
def predict(past: Past, v: FlowValues) -> Vec2:
    """Return the expected sample, (2,) rad/s; the height must not be zero."""
    x = past.x
    R = to_matrix(x.q)
    nu, height = rotate_inverse(x.q, x.v), -x.p[2]
    distance = height / R[2][2] * factor_at(height, x, v)[0]
    omega = sub(past.gyro, x.gyro_bias)
    return (nu[0] / distance + x.leak * omega[1], nu[1] / distance - x.leak * omega[0])


@jit
def jacobian(past: Past, now: Vec3, gravity: float, v: FlowValues, H: Array) -> float:
    """
    Store the derivative of :func:`predict` by the error state of now; return the distance, m.

    Parameters
    ----------
    past
        When the sample was taken.
    now : (3,) m/s, inertial NED
        Velocity now.
    gravity : m/s^2
    v
        Heights between which Q changes.
    H : (2, SIZE)
        Result.

    """
    x, age = past.x, past.age
    R, omega = to_matrix(x.q), sub(past.gyro, x.gyro_bias)
    nu, height, cosine = rotate_inverse(x.q, x.v), -x.p[2], to_matrix(x.q)[2][2]
    Q, lever = factor_at(height, x, v)
    slope = x.slope if v.factor_min_height < height < v.factor_max_height else 0.0
    distance = height / cosine * Q
    turn = (omega[1], -omega[0])
    # by drag and gravity: the vibration in a sample of the accelerometer would look like a motion
    thrust = past.accel[2] - x.accel_bias[2]
    nu_dot = (
        x.drag[0] * thrust * nu[0] + gravity * R[2][0] + omega[2] * nu[1] - omega[1] * nu[2],
        x.drag[1] * thrust * nu[1] + gravity * R[2][1] + omega[0] * nu[2] - omega[2] * nu[0])
    by_height = 1.0 / height + slope / Q
    by_time = x.v[2] * by_height + (R[2][0] * omega[1] - R[2][1] * omega[0]) / cosine
    H[:] = 0.0
    for i in range(2):
        z = nu[i] / distance
        xi = (R[0][i] / distance, R[1][i] / distance, R[2][i] / distance)
        down = z * by_height                              # by dp_z of then
        # by delta of then, through the tilt: d cos = delta_x R_yz - delta_y R_xz
        delta = (z / cosine * R[1][2], -z / cosine * R[0][2])
        row = H[i]
        row[Z_POSITION] = down
        for j in range(3):
            row[VELOCITY + j] = xi[j]
        row[VELOCITY + 2] -= age * down
        row[ATTITUDE] = delta[0] - age * (gravity * xi[1] + down * now[1])
        row[ATTITUDE + 1] = delta[1] + age * (gravity * xi[0] + down * now[0])
        _by_biases(row, past, xi, delta, gravity)
        row[SCALE] = -z / Q
        row[SLOPE] = -z / Q * lever
        row[LATENCY] = -(nu_dot[i] / distance + z * by_time)
        row[LEAK] = turn[i]
    H[0, GYRO_BIAS + 1] -= x.leak
    H[1, GYRO_BIAS] += x.leak
    return distance


@jit
def _by_biases(row: Array, past: Past, xi: Vec3, delta: Vec2, gravity: float) -> None:
    """Store the derivative by both biases, which act between then and now."""
    S, V, half = past.S, past.V, 0.5 * past.age * gravity
    for j in range(3):
        row[ACCEL_BIAS + j] = xi[0] * S[0, j] + xi[1] * S[1, j] + xi[2] * S[2, j]
        row[GYRO_BIAS + j] = (
            delta[0] * S[0, j] + delta[1] * S[1, j]
            + xi[0] * V[0, j] + xi[1] * V[1, j] + xi[2] * V[2, j]
            + half * (xi[0] * S[1, j] - xi[1] * S[0, j]))


@jit
def is_valid(flow: Vec2, past: Nominal, quality: int, v: FlowValues) -> bool:
    """Return whether a sample may be used at the estimated state of its exposure."""
    R: Matrix3 = to_matrix(past.q)
    return (
        abs(flow[0]) <= v.max_rate and abs(flow[1]) <= v.max_rate and -past.p[2] >= v.min_height
        and R[2][2] >= v.min_tilt_cos and quality >= v.min_quality)
