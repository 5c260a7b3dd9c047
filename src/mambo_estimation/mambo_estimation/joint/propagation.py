r"""
Propagation of the joint filter by one inertial sample: x+ = f(x, gyro, accel), P+ = F P F^T + Q.

With w = gyro - b_g and s = R (accel - b_a), means of two samples,

    p' = v,  v' = s + g e_3,  q' = q (x) (0, w) / 2

The error state of :mod:`.state` obeys, n_g and n_a being white noise in inertial axes,

    dp'    = xi - [v x] delta
    xi'    = [g e_3 x] delta - R db_a - [v x] R db_g - n_a - [v x] n_g
    delta' = -R db_g - n_g

and all other errors walk or stay. F = I + A dt is written out row by row: A has nine rows.
"""

from __future__ import annotations

import math

from mambo_model.arithmetic.exponential import expm1
from mambo_model.compiled import jit
from mambo_model.motion.quaternion import exp_map, multiply, normalise, rotate, to_matrix
from mambo_model.motion.vector import add, scale, sub, Vec3

from ..blocks import Matrix3
from .joint_parameters import JointValues
from .state import Array, Nominal, PRESSURE_OFFSET, SCALE, SIZE, VELOCITY

Z_VELOCITY = VELOCITY + 2


@jit
def move(x: Nominal, gyro: Vec3, accel: Vec3, dt: float, gravity: float) -> Nominal:
    """
    Return the nominal state dt seconds later; a negative dt goes back.

    Parameters
    ----------
    x
        Before.
    gyro : (3,) rad/s, body FRD
        Mean over the step, bias included.
    accel : (3,) m/s^2, body FRD
        Specific force, mean over the step, bias included.
    dt : s
    gravity : m/s^2

    """
    turn = scale(dt, sub(gyro, x.gyro_bias))
    half = multiply(x.q, exp_map(scale(0.5, turn)))
    force = rotate(half, sub(accel, x.accel_bias))
    a = (force[0], force[1], force[2] + gravity)
    return Nominal(
        add(x.p, scale(dt, add(x.v, scale(0.5 * dt, a)))), add(x.v, scale(dt, a)),
        normalise(multiply(x.q, exp_map(turn))), x.gyro_bias, x.accel_bias, x.scale, x.slope,
        x.drag, x.latency, x.leak, x.range_offset, x.pressure_offset)


@jit
def turned_rate(v: Vec3, R: Matrix3) -> Matrix3:
    """Return [v x] R, (3, 3) m/s: what a rate in body axes does to xi."""
    return (
        (v[1] * R[2][0] - v[2] * R[1][0], v[1] * R[2][1] - v[2] * R[1][1],
         v[1] * R[2][2] - v[2] * R[1][2]),
        (v[2] * R[0][0] - v[0] * R[2][0], v[2] * R[0][1] - v[0] * R[2][1],
         v[2] * R[0][2] - v[0] * R[2][2]),
        (v[0] * R[1][0] - v[1] * R[0][0], v[0] * R[1][1] - v[1] * R[0][1],
         v[0] * R[1][2] - v[1] * R[0][2]))


@jit
def spread(
    P: Array, v: Vec3, R: Matrix3, dt: float, gyro_density: float, accel_density: float,
    p: JointValues,
) -> None:
    """
    Propagate the covariance over dt in place.

    Parameters
    ----------
    P : (SIZE, SIZE)
    v, R
        Velocity and attitude at the middle of the step.
    dt : s
    gyro_density, accel_density : rad/sqrt(s), m/s^2/sqrt(Hz)
        Of the noise, much more where samples are missing.
    p
        Random walks of the biases.

    """
    g, W = p.gravity * dt, turned_rate(v, R)
    x, y, z = v[0] * dt, v[1] * dt, v[2] * dt
    for j in range(SIZE):  # F P: rows of position, velocity and attitude, in this order
        a, b, c = P[6, j], P[7, j], P[8, j]
        d, e, f = P[9, j], P[10, j], P[11, j]
        k, m, n = P[12, j], P[13, j], P[14, j]
        P[0, j] += dt * P[3, j] + z * b - y * c
        P[1, j] += dt * P[4, j] + x * c - z * a
        P[2, j] += dt * P[5, j] + y * a - x * b
        P[3, j] -= g * b + dt * (
            R[0][0] * k + R[0][1] * m + R[0][2] * n + W[0][0] * d + W[0][1] * e + W[0][2] * f)
        P[4, j] += g * a - dt * (
            R[1][0] * k + R[1][1] * m + R[1][2] * n + W[1][0] * d + W[1][1] * e + W[1][2] * f)
        P[5, j] -= dt * (
            R[2][0] * k + R[2][1] * m + R[2][2] * n + W[2][0] * d + W[2][1] * e + W[2][2] * f)
        P[6, j] -= dt * (R[0][0] * d + R[0][1] * e + R[0][2] * f)
        P[7, j] -= dt * (R[1][0] * d + R[1][1] * e + R[1][2] * f)
        P[8, j] -= dt * (R[2][0] * d + R[2][1] * e + R[2][2] * f)
    _transposed(P, g, W, R, v, dt)
    _add_noise(P, v, dt, gyro_density, accel_density, p)


@jit
def _transposed(P: Array, g: float, W: Matrix3, R: Matrix3, v: Vec3, dt: float) -> None:
    """Multiply F P by F^T from the right, in place; only the first nine rows are left to do."""
    x, y, z = v[0] * dt, v[1] * dt, v[2] * dt
    for i in range(9):
        a, b, c = P[i, 6], P[i, 7], P[i, 8]
        d, e, f = P[i, 9], P[i, 10], P[i, 11]
        k, m, n = P[i, 12], P[i, 13], P[i, 14]
        P[i, 0] += dt * P[i, 3] + z * b - y * c
        P[i, 1] += dt * P[i, 4] + x * c - z * a
        P[i, 2] += dt * P[i, 5] + y * a - x * b
        P[i, 3] -= g * b + dt * (
            R[0][0] * k + R[0][1] * m + R[0][2] * n + W[0][0] * d + W[0][1] * e + W[0][2] * f)
        P[i, 4] += g * a - dt * (
            R[1][0] * k + R[1][1] * m + R[1][2] * n + W[1][0] * d + W[1][1] * e + W[1][2] * f)
        P[i, 5] -= dt * (
            R[2][0] * k + R[2][1] * m + R[2][2] * n + W[2][0] * d + W[2][1] * e + W[2][2] * f)
        P[i, 6] -= dt * (R[0][0] * d + R[0][1] * e + R[0][2] * f)
        P[i, 7] -= dt * (R[1][0] * d + R[1][1] * e + R[1][2] * f)
        P[i, 8] -= dt * (R[2][0] * d + R[2][1] * e + R[2][2] * f)
    for i in range(9):
        for j in range(i):
            P[i, j] = P[j, i]
        for j in range(9, SIZE):
            P[j, i] = P[i, j]


@jit
def _add_noise(
    P: Array, v: Vec3, dt: float, gyro_density: float, accel_density: float, p: JointValues,
) -> None:
    """Add Q, in place: white noise of the inertial sensors, and the walks of what changes."""
    turn, push = gyro_density * gyro_density * dt, accel_density * accel_density * dt
    squared = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    cross = ((0.0, -v[2], v[1]), (v[2], 0.0, -v[0]), (-v[1], v[0], 0.0))
    for i in range(3):
        P[6 + i, 6 + i] += turn
        P[3 + i, 3 + i] += push + turn * squared
        for j in range(3):
            P[3 + i, 3 + j] -= turn * v[i] * v[j]
            P[3 + i, 6 + j] += turn * cross[i][j]
            P[6 + j, 3 + i] += turn * cross[i][j]
    wander(P, dt, p)


@jit
def wander(P: Array, dt: float, p: JointValues) -> None:
    """Add the walks of what changes also at rest, in place: biases, scale, offset by pressure."""
    for i in range(3):
        P[9 + i, 9 + i] += p.motion.gyro_bias_walk * p.motion.gyro_bias_walk * dt
        P[12 + i, 12 + i] += p.motion.accel_bias_walk * p.motion.accel_bias_walk * dt
    P[SCALE, SCALE] += p.optical_flow.scale_walk * p.optical_flow.scale_walk * dt
    P[PRESSURE_OFFSET, PRESSURE_OFFSET] += p.barometer.offset_walk * p.barometer.offset_walk * dt


@jit
def bridge(dt: float, time: float) -> float:
    """
    Return the weight of the samples at both ends of a gap in the mean over it.

    A rate that is an Ornstein-Uhlenbeck process with this time constant, known at both ends, has

        E integral = T tanh(dt / 2 T) (first + last)
        var        = 2 sigma^2 T (dt - 2 T tanh(dt / 2 T))

    over it. The weight of their mean is w = 2 T / dt tanh(dt / 2 T), and the density of the noise
    2 sigma^2 T (1 - w): none over a short gap, all of it over a long one.

    Parameters
    ----------
    dt : s
        Length, more than 0.
    time : s
        T.

    """
    less = expm1(-dt / time)  # tanh(x) = (1 - e^-2x) / (1 + e^-2x)
    return -2.0 * time / dt * less / (2.0 + less)


@jit
def _mixed(measured: float, held: float, share: float) -> float:
    """Return the density of a noise of which a share is that of a held sample."""
    if share == 0.0:
        return measured
    return math.sqrt(measured * measured + share * held * held)


@jit
def predict(
    x: Nominal, P: Array, gyro: Vec3, accel: Vec3, dt: float, held: tuple[float, float],
    p: JointValues,
) -> Nominal:
    """
    Propagate state and covariance over one step; the covariance in place.

    Parameters
    ----------
    x, P
        Before.
    gyro, accel : (3,) rad/s, m/s^2, body FRD
        Means over the step, biases included.
    dt : s
    held
        Shares of gyro and force that are not measured but held: their noise is much larger, most
        of all that of the thrust, which is nearly vertical.
    p
        Noise.

    """
    m = p.motion
    later = move(x, gyro, accel, dt, p.gravity)
    middle = scale(0.5, add(x.v, later.v))
    spread(
        P, middle, to_matrix(x.q), dt, _mixed(m.gyro_noise, m.held_gyro_noise, held[0]),
        _mixed(m.accel_noise, m.held_accel_noise, held[1]), p)
    P[Z_VELOCITY, Z_VELOCITY] += held[1] * m.held_thrust_noise * m.held_thrust_noise * dt
    return later
