"""Measurement updates of the joint filter: plausibility, correction and recovery."""

from __future__ import annotations

import math
from typing import NamedTuple

from mambo_model.compiled import jit
from mambo_model.motion.quaternion import to_matrix
from mambo_model.motion.vector import Vec3
import numpy as np

from . import drag, flow, pressure, slant_range
from ..blocks import Vec2
from ..gate import ACCEPT, accept, DISTRUST, Gate, judge, RECOVER, refuse_invalid, Trial
from ..measurements import barometer as pressure_model
from ..measurements import sonar as range_model
from .answer import NOT_COMPARED, Result
from .joint_parameters import JointValues
from .state import (
    ACCEL_BIAS, Array, correct, covariance_with, DRAG, forget, inject, LATENCY, LEAK, Nominal,
    PRESSURE_OFFSET, SCALE, SIZE, VELOCITY)

Z_POSITION, Z_VELOCITY, Z_BIAS = 2, VELOCITY + 2, ACCEL_BIAS + 2
NEAR = Result((math.nan, math.nan), math.nan, True)
FLOOR = 0.05     # m, how well the height is known of a vehicle that has landed: judgement
WEIGHT = 0.01    # of one sample in the variance that is found of a sensor
QUIETEST = 0.25  # lower limit of an estimated variance, as a share of the parameter


class Noise(NamedTuple):
    """Variances of one sample, estimated from the innovations."""

    sonar: float   # m^2
    flow: float    # rad^2/s^2, each axis
    barometer: float   # m^2, of a height by pressure


@jit
def _found(old: float, squared: float, explained: float, least: float) -> float:
    """
    Return the variance of a sensor with one innovation more.

    Parameters
    ----------
    old
        Before.
    squared
        Innovation squared.
    explained
        h P h^T: the part that the filter's covariance explains.
    least
        Square of the parameter.

    """
    return max(old + WEIGHT * (squared - explained - old), QUIETEST * least)


@jit
def use_range(
    x: Nominal, P: Array, gate: Gate, sample: float, noise: Noise, v: JointValues,
) -> tuple[Nominal, Gate, Noise, Result]:
    """
    Correct with a range of the sonar, m; the covariance in place.

    A reading below the shortest range corrects only where the predicted height is not between
    the floor and that range, and then to the nearer of the two. Refused ranges that agree with
    each other are accepted after the recovery time: the variances of height and vertical velocity
    are inflated by the innovation and decorrelated from all else, so that the horizontal position
    does not jump.
    """
    cosine = to_matrix(x.q)[2][2]
    if not range_model.is_valid(sample, cosine, v.sonar):
        return x, refuse_invalid(gate), noise, NOT_COMPARED
    h, column, d = np.empty(SIZE), np.empty(SIZE), np.zeros(SIZE)
    slant_range.jacobian(x, h)
    near = range_model.is_near(sample, v.sonar)
    measured = sample
    if near:
        height = range_model.nearest_height(-x.p[2], cosine, v.sonar)
        if height == -x.p[2]:
            return x, accept(gate), noise, NEAR
        measured = height / cosine + x.range_offset
    innovation = measured - slant_range.predict(x)
    explained = covariance_with(P, h, column)
    variance = explained + noise.sonar
    if gate.net_refusals < DISTRUST:
        variance += gate.scatter
    squared = innovation * innovation
    ratio = squared / (v.sonar.gate * v.sonar.gate * variance)
    width = v.sonar.agreement / v.sonar.gate
    gate, verdict = judge(
        gate, Trial((sample, sample), (measured * cosine, measured * cosine),
                    2.0 * width * width, ratio), v.sonar.gate, v.sonar.recovery_time)
    result = Result((innovation, innovation), ratio, verdict == ACCEPT)
    if verdict == RECOVER:
        _lose_height(P, squared, v)
    if verdict != ACCEPT:
        return x, gate, noise, result
    correct(P, column, innovation, variance, d)
    if not near:
        least = v.sonar.noise * v.sonar.noise
        noise = Noise(
            _found(noise.sonar, squared, explained, least), noise.flow, noise.barometer)
    return inject(x, d), gate, noise, result


@jit
def _lose_height(P: Array, squared: float, v: JointValues) -> None:
    """Inflate and decorrelate height and climb by an innovation squared, m^2, in place."""
    speed = v.motion.initial_velocity_std
    time = max(v.sonar.recovery_time, 0.1)
    forget(P, Z_POSITION, P[Z_POSITION, Z_POSITION] + squared)
    forget(P, Z_VELOCITY, P[Z_VELOCITY, Z_VELOCITY] + speed * speed + squared / (time * time))
    forget(P, Z_BIAS, v.alignment.accel_bias_std * v.alignment.accel_bias_std)


@jit
def use_rest(x: Nominal, P: Array, v: JointValues) -> Nominal:
    """Correct with the rest on a floor after a flight: velocity 0; the covariance in place."""
    h, column, d = np.empty(SIZE), np.empty(SIZE), np.zeros(SIZE)
    still = v.alignment.rest_velocity_std * v.alignment.rest_velocity_std
    for i in range(3):
        h[:] = 0.0
        h[VELOCITY + i] = 1.0
        d[:] = 0.0
        explained = covariance_with(P, h, column)
        correct(P, column, -x.v[i], explained + still, d)
        x = inject(x, d)
    P[Z_POSITION, Z_POSITION] = max(P[Z_POSITION, Z_POSITION], FLOOR * FLOOR)
    return x


@jit
def use_pressure(
    x: Nominal, P: Array, gate: Gate, sample: float, noise: Noise, started: bool,
    v: JointValues,
) -> tuple[Nominal, Gate, Noise, Result]:
    """
    Correct with a pressure, Pa; the first one sets the offset, the covariance in place.

    After refusals for the recovery time the variance of the offset is inflated, because weather
    and rotor wash change the offset and not the height.
    """
    p = v.barometer
    if not pressure_model.is_valid(sample, p):
        return x, refuse_invalid(gate), noise, NOT_COMPARED
    measured, least = pressure_model.measured_height(sample), p.noise * p.noise
    if not started:
        pressure.start(P, least)
        return _with_offset(x, measured + x.p[2]), gate, noise, NOT_COMPARED
    h, column, d = np.empty(SIZE), np.empty(SIZE), np.zeros(SIZE)
    pressure.jacobian(h)
    innovation = measured - pressure.predict(x)
    explained = covariance_with(P, h, column)
    variance, squared = explained + noise.barometer, innovation * innovation
    ratio = squared / (p.gate * p.gate * variance)
    gate, verdict = judge(
        gate, Trial((sample, sample), (innovation, innovation), 2.0 * variance, ratio),
        p.gate, p.recovery_time)
    if verdict == RECOVER:
        P[PRESSURE_OFFSET, PRESSURE_OFFSET] += squared
    if verdict == ACCEPT:
        correct(P, column, innovation, variance, d)
        x = inject(x, d)
        noise = Noise(
            noise.sonar, noise.flow, _found(noise.barometer, squared, explained, least))
    return x, gate, noise, Result((innovation, innovation), ratio, verdict == ACCEPT)


@jit
def _with_offset(x: Nominal, offset: float) -> Nominal:
    return Nominal(
        x.p, x.v, x.q, x.gyro_bias, x.accel_bias, x.scale, x.slope, x.drag, x.latency, x.leak,
        x.range_offset, offset)


class Pair(NamedTuple):
    """A measurement of two numbers compared with the state."""

    S00: float
    S01: float
    S11: float
    squared: float    # -, y^T S^-1 y


@jit
def _compare(P: Array, H: Array, columns: Array, y: Vec2, variance: float) -> Pair:
    """Return S = H P H^T + R of two rows and y^T S^-1 y; store P H^T in ``columns``."""
    S00 = covariance_with(P, H[0], columns[0]) + variance
    S11 = covariance_with(P, H[1], columns[1]) + variance
    S01 = 0.0
    for j in range(SIZE):
        S01 += H[0, j] * columns[1, j]
    squared = (S11 * y[0] * y[0] - 2.0 * S01 * y[0] * y[1] + S00 * y[1] * y[1]) / (
        S00 * S11 - S01 * S01)
    return Pair(S00, S01, S11, squared)


@jit
def _correct_pair(
    x: Nominal, P: Array, columns: Array, y: Vec2, pair: Pair, calibrates: bool,
) -> Nominal:
    """
    Return the state corrected with two decorrelated numbers; P in place.

    Without calibration scale, slope, latency and leak are considered (Schmidt): they and their
    covariance stay, while all else is corrected knowing that they are uncertain.
    """
    d, share = np.zeros(SIZE), pair.S01 / pair.S00
    kept = P[SCALE:LEAK + 1, SCALE:LEAK + 1].copy()
    for j in range(SIZE):
        columns[1, j] -= share * columns[0, j]
    correct(P, columns[0], y[0], pair.S00, d)
    correct(P, columns[1], y[1] - share * y[0], pair.S11 - share * pair.S01, d)
    if not calibrates:
        for i in range(SCALE, LEAK + 1):  # an assigned slice takes seconds to compile
            d[i] = 0.0
            for j in range(SCALE, LEAK + 1):
                P[i, j] = kept[i - SCALE, j - SCALE]
    return inject(x, d)


@jit
def use_drag(x: Nominal, P: Array, window: drag.Window, v: JointValues) -> Nominal:
    """
    Return the state corrected with the mean specific force of a window; P in place.

    Drag is a product of coefficient and velocity. While neither is known the product of their
    errors, which no Jacobian holds, counts as noise.
    """
    H, columns = np.empty((2, SIZE)), np.empty((2, SIZE))
    y = drag.innovation(window, x)
    drag.jacobian(window, x, H)
    thrust = window.thrust / window.time
    unknown = P[DRAG, DRAG] * (P[VELOCITY, VELOCITY] + P[VELOCITY + 1, VELOCITY + 1])
    pair = _compare(P, H, columns, y, v.drag.noise * v.drag.noise + thrust * thrust * unknown)
    if pair.squared > v.drag.gate * v.drag.gate:
        return x
    return _correct_pair(x, P, columns, y, pair, True)


@jit
def use_flow(
    x: Nominal, P: Array, ring: Array, at: int, gate: Gate, sample: Vec2, quality: int,
    noise: Noise, shaken: Vec3, v: JointValues,
) -> tuple[Nominal, Gate, Noise, Result]:
    """
    Correct with a sample of the optical flow, (2,) rad/s, at its own time; P in place.

    Refused samples that agree with each other are accepted after the recovery time: the variance
    of the horizontal velocity is inflated by the innovation and decorrelated from all else, and
    that of the position is inflated by the accumulated error, so that it does not jump.
    ``shaken`` is the variance of the velocity by vibration, (3,) m^2/s^2.
    """
    p = v.optical_flow
    past = flow.look_back(x, ring, at, v.gravity)
    if not flow.is_valid(sample, past.x, quality, p):
        return x, refuse_invalid(gate), noise, NOT_COMPARED
    H, columns = np.empty((2, SIZE)), np.empty((2, SIZE))
    distance = flow.jacobian(past, x.v, v.gravity, p, H)
    expected, early = flow.predict(past, p), min(x.latency, 0.0)
    y = (sample[0] - expected[0] - H[0, LATENCY] * early,
         sample[1] - expected[1] - H[1, LATENCY] * early)
    push = v.motion.accel_noise / distance
    others = past.age * push * push + 0.5 * (shaken[0] + shaken[1]) / (distance * distance)
    variance = noise.flow + others
    pair = _compare(P, H, columns, y, variance)
    explained = 0.5 * (pair.S00 + pair.S11) - noise.flow
    ratio, age = pair.squared / (p.gate * p.gate), gate.age
    gate, verdict = judge(
        gate, Trial(sample, y, pair.S00 + pair.S11, ratio), p.gate, p.recovery_time)
    result = Result(y, ratio, verdict == ACCEPT)
    if verdict == RECOVER:
        _lose_velocity(P, (y[0] * y[0] + y[1] * y[1]) * distance * distance, age, v)
    if verdict != ACCEPT:
        return x, gate, noise, result
    x = _correct_pair(x, P, columns, y, pair, _calibrates(x, P, p.excitation))
    squared = 0.5 * (y[0] * y[0] + y[1] * y[1])
    return x, gate, Noise(
        noise.sonar, _found(noise.flow, squared, explained, p.noise * p.noise),
        noise.barometer), result


@jit
def _calibrates(x: Nominal, P: Array, excitation: float) -> bool:
    """
    Return whether the horizontal velocity exceeds its deviation by enough to calibrate the flow.

    A velocity that is mostly the filter's own noise is correlated with its innovations wherever
    the assumed noise is not exactly the true one, and would pull the scale away.
    """
    variance = P[VELOCITY, VELOCITY] + P[VELOCITY + 1, VELOCITY + 1]
    return x.v[0] * x.v[0] + x.v[1] * x.v[1] > excitation * excitation * variance


@jit
def _lose_velocity(P: Array, squared: float, age: float, v: JointValues) -> None:
    """Inflate the horizontal velocity by an error squared, m^2/s^2, that lasted age, s."""
    speed = v.motion.initial_velocity_std
    for i in range(2):
        forget(P, VELOCITY + i, P[VELOCITY + i, VELOCITY + i] + squared + speed * speed)
        P[i, i] += squared * age * age
