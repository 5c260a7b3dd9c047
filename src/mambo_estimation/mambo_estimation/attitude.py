r"""
Attitude filter: multiplicative Kalman filter of the attitude error and the gyro bias.

Between gravity updates the gyro is integrated. The error is a rotation about inertial axes,
``q_true = exp(delta) q``, so that with :math:`\delta b` the bias error

.. math:: \dot\delta = -R\,\delta b + noise

and the covariance of delta is the rotation block of the published pose as it stands.

Gravity. In flight the accelerometer does not measure gravity but thrust and drag, and a tilted
vehicle reads no horizontal component. Using the direction of the specific force as the vertical
would pull the tilt to zero while the vehicle flies a circle. The acceleration is known instead,
:math:`\dot v = R s + g e_3`: over a window of length T the mean specific force, turned to
inertial axes, must explain the velocity gained in it, which the optical flow measures,

.. math:: r = \frac{v(T) - v(0)}{T} - \frac1T \int_0^T (R s + g e_3)\,dt = -g\,\delta \times e_3

in the two horizontal directions, delta being its mean, whatever forces act and at any
acceleration (the velocity is turned by the same R: its error cancels that of s but for gravity,
and the heading drops out).
Without flow the velocity gained is taken as zero with a wide uncertainty, widened further by the
excess of the specific force over g and by the rate; at rest it is zero.

Holds (2.14) in its exact form for a constant rate; the thesis only names this filter (sec. 5.1).
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple

from mambo_model.compiled import jit
from mambo_model.motion.quaternion import exp_map, multiply, normalise, Quat, to_matrix
from mambo_model.motion.vector import add, dot, norm, scale, sub, Vec3
from mambo_model.schema import quantity
from mambo_model.values import Parameters, values_type

from .blocks import (
    diagonal3, less_outer3, Matrix3, mul3, scale3, sub3, symmetric3, transpose3, Vec2, ZERO3)
from .fit import faded, updated


@dataclass(frozen=True)
class AttitudeParams(Parameters):
    """Noise and priors of the attitude filter."""

    gyro_noise: float = quantity(
        3e-4, 'rad/sqrt(s)', 1e-7, 1.0,
        'density: 5e-5 in Rolling Spider logs at rest (0.0007 rad/s at 200 Hz), 7e-4 in flight')
    held_gyro_noise: float = quantity(
        0.3, 'rad/sqrt(s)', 1e-7, 10.0,
        'density while a sample is missing: 1 rad/s wrong for 0.1 s')
    gyro_bias_walk: float = quantity(
        1e-5, 'rad/s/sqrt(s)', 0.0, 1.0, 'drift of the gyro bias: judgement')
    initial_tilt_std: float = quantity(
        0.1, 'rad', 1e-4, 1.5, 'tilt at start where the alignment failed')
    initial_yaw_std: float = quantity(
        1e-3, 'rad', 1e-6, 3.2, 'yaw is zero at start by definition')
    initial_gyro_bias_std: float = quantity(
        0.03, 'rad/s', 1e-6, 1.0,
        'bias where the alignment failed: 0.017 in calibration of 12 Rolling Spider flights')
    rate_noise: float = quantity(
        7e-4, 'rad/s', 1e-6, 10.0,
        'of one sample at rest, the least in the covariance of the body rate: Rolling Spider logs')
    lost_rate_growth: float = quantity(
        20.0, 'rad/s^2', 0.0, 1e4,
        'how fast the body rate becomes unknown without a gyro: a fifth of what the motors can do')
    window: float = quantity(1.0, 's', 0.05, 60.0, 'length of a gravity window: judgement')
    window_velocity_noise: float = quantity(
        0.1, 'm/s', 0.0, 10.0,
        'errors of a velocity by flow beyond its noise: height, delay, rotation; judgement')
    window_accel_noise: float = quantity(
        0.03, 'm/s^2', 1e-6, 10.0, 'noise of the mean specific force of a window: judgement')
    unaided_acceleration: float = quantity(
        2.0, 'm/s^2', 1e-3, 100.0,
        'horizontal acceleration, mean over a window, that may go unseen without flow')
    unaided_rate_factor: float = quantity(
        5.0, 'm/s', 0.0, 1e3, 'the same per rad/s of body rate: a turning vehicle accelerates')
    gate: float = quantity(
        3.0, 'sigma', 1.0, 100.0, 'a larger innovation counts as if it were just so large')


AttitudeValues = values_type(AttitudeParams)


class Window(NamedTuple):
    """The current gravity window."""

    time: float       # s, since its start
    gained: Vec3      # (3,) m/s, inertial NED, integral of R s + g e_3
    turned: float     # rad^2/s, integral of the squared body rate
    aided: bool       # true: started with a velocity by flow
    start: Vec2       # (2,) m/s, inertial NED, that velocity
    variance: float   # m^2/s^2, of each of its components


class Attitude(NamedTuple):
    """Memory of the attitude filter."""

    q: Quat           # (4,) w x y z, body to inertial
    bias: Vec3        # (3,) rad/s, body FRD, of the gyro
    P_rr: Matrix3     # (3, 3) rad^2, of delta about inertial axes
    P_rb: Matrix3     # (3, 3) rad^2/s, of delta and bias error
    P_bb: Matrix3     # (3, 3) rad^2/s^2, of the bias error
    # rad, deviation of the tilt that is unobservable because of an accelerometer bias
    hidden: float
    window: Window    # gravity window under way
    fit: float        # -, squared innovations of tilt over what the filter expects of them


FIT_WEIGHT = 0.2  # of one window
LEAST_FIT = 0.1   # of a few windows, which may agree by chance
NO_WINDOW = Window(0.0, (0.0, 0.0, 0.0), 0.0, False, (0.0, 0.0), 0.0)


@jit
def start(
    q: Quat, bias: Vec3, tilt_variance: float, bias_variance: float, hidden: float,
    v: AttitudeValues,
) -> Attitude:
    """
    Return the filter at its start.

    Parameters
    ----------
    q : (4,) w x y z
    bias : (3,) rad/s, body FRD
    tilt_variance, bias_variance : rad^2, rad^2/s^2
        About each horizontal axis and of each axis.
    hidden : rad
        Deviation of the tilt, about each horizontal axis, that cannot be seen: an accelerometer
        bias b looks like a tilt of b / g to the alignment and to every gravity window.
    v
        Prior of the yaw.

    """
    yaw = v.initial_yaw_std * v.initial_yaw_std
    return Attitude(
        q, bias, diagonal3(tilt_variance, tilt_variance, yaw), ZERO3,
        diagonal3(bias_variance, bias_variance, bias_variance), hidden, NO_WINDOW, 1.0)


@jit
def predict(
    a: Attitude, rate: Vec3, dt: float, held: bool, v: AttitudeValues,
) -> Attitude:
    r"""
    Integrate the gyro over dt, (2.14) solved exactly for a constant rate.

    The covariance of :math:`(\delta, \delta b)` becomes :math:`F P F^T + Q`, in blocks of (3, 3),
    with the densities :math:`\sigma_\omega` of the rate and :math:`\sigma_b` of the bias:

    .. math:: F = \begin{pmatrix} I & -\Delta R \\ 0 & I \end{pmatrix}, \quad
              Q = \begin{pmatrix} \sigma_\omega^2 \Delta\, I & 0 \\
              0 & \sigma_b^2 \Delta\, I \end{pmatrix}

    Parameters
    ----------
    a
        Memory.
    rate : (3,) rad/s, body FRD
        Measured, bias included, mean over the interval.
    dt : s
    held : bool
        The rate is not measured but held: its noise is much larger.
    v
        Noise.

    """
    R = to_matrix(a.q)
    q = normalise(multiply(a.q, exp_map(scale(dt, sub(rate, a.bias)))))
    density = v.held_gyro_noise if held else v.gyro_noise
    noise, walk = density * density * dt, v.gyro_bias_walk * v.gyro_bias_walk * dt
    turn = scale3(dt, R)
    to_bias = mul3(turn, a.P_bb)
    P_rb = sub3(a.P_rb, to_bias)
    half = sub3(a.P_rr, mul3(turn, transpose3(a.P_rb)))
    P_rr = sub3(half, mul3(P_rb, transpose3(turn)))
    P_rr = symmetric3(sub3(P_rr, diagonal3(-noise, -noise, -noise)))
    P_bb = sub3(a.P_bb, diagonal3(-walk, -walk, -walk))
    fit = 1.0 if held else a.fit
    return Attitude(q, a.bias, P_rr, P_rb, P_bb, a.hidden, a.window, fit)


@jit
def accumulate(
    window: Window, acceleration: Vec3, omega: Vec3, dt: float,
) -> Window:
    """
    Add one step to the gravity window.

    Parameters
    ----------
    window
        Under way.
    acceleration : (3,) m/s^2, inertial NED
        R s + g e_3, s as calibrated at start, mean over the step.
    omega : (3,) rad/s, body FRD
        Without bias.
    dt : s

    """
    return Window(
        window.time + dt, add(window.gained, scale(dt, acceleration)),
        window.turned + dt * dot(omega, omega), window.aided, window.start, window.variance)


@jit
def restart(velocity: Vec2, variance: float) -> Window:
    """Return a window that starts now with a velocity by flow, (2,) m/s inertial NED, m^2/s^2."""
    return Window(0.0, (0.0, 0.0, 0.0), 0.0, True, velocity, variance)


@jit
def _tilt(residual_x: float, residual_y: float, gravity: float) -> Vec2:
    """Return the tilt errors about north and east that leave a residual -g delta x e_3."""
    return (residual_y / gravity, -residual_x / gravity)


@jit
def aided_tilt(
    window: Window, velocity: Vec2, variance: float, scale_std: float, gravity: float,
    v: AttitudeValues,
) -> tuple[Vec2, float]:
    """
    Return the mean tilt error that a window between two velocities by flow shows.

    The noise of a velocity enters two windows with opposite signs. It is treated as independent,
    which is conservative.

    Parameters
    ----------
    window
        Started with a velocity, time > 0.
    velocity : (2,) m/s, inertial NED
        At its end.
    variance : m^2/s^2
        Of each of its components.
    scale_std : -
        Uncertain scale of the flow, which scales the velocity gained.
    gravity : m/s^2
    v
        Noise of the mean specific force.

    Returns
    -------
    innovation : (2,) rad, inertial axes x and y
        First two elements of delta.
    variance : rad^2
        Of each.

    """
    x, y = velocity[0] - window.start[0], velocity[1] - window.start[1]
    T = window.time
    gained = window.variance + variance + scale_std * scale_std * (x * x + y * y)
    spread = gained / (T * T) + v.window_accel_noise * v.window_accel_noise
    return (_tilt((x - window.gained[0]) / T, (y - window.gained[1]) / T, gravity),
            spread / (gravity * gravity))


@jit
def unaided_tilt(
    window: Window, resting: bool, gravity: float, v: AttitudeValues,
) -> tuple[Vec2, float]:
    """
    Return the mean tilt error that a window shows if it has gained no velocity.

    Parameters
    ----------
    window
        Under way, time > 0.
    resting : bool
        On the floor, where the gained velocity is zero. In the air its uncertainty grows with the
        excess of the specific force over gravity and with the body rate.
    gravity : m/s^2
    v
        Uncertainties.

    Returns
    -------
    innovation : (2,) rad, inertial axes x and y
        First two elements of delta.
    variance : rad^2
        Of each.

    """
    mean = scale(1.0 / window.time, window.gained)
    spread = v.window_accel_noise * v.window_accel_noise
    if not resting:
        excess = norm((mean[0], mean[1], mean[2] - gravity)) - gravity
        turned = window.turned / window.time
        spread += (
            v.unaided_acceleration * v.unaided_acceleration + excess * excess
            + v.unaided_rate_factor * v.unaided_rate_factor * turned)
    return _tilt(-mean[0], -mean[1], gravity), spread / (gravity * gravity)


class _Column(NamedTuple):
    """Covariance of delta and of the bias error with one measured quantity."""

    r: Vec3  # (3,) with delta
    b: Vec3  # (3,) with the bias error


@jit
def _column(a: Attitude, i: int, lever: Vec3) -> _Column:
    """Return P H^T of a measured element i of delta plus ``lever`` times the bias error."""
    P = a.P_rb
    return _Column(
        add(a.P_rr[i], (dot(P[0], lever), dot(P[1], lever), dot(P[2], lever))),
        add(P[i], (dot(a.P_bb[0], lever), dot(a.P_bb[1], lever), dot(a.P_bb[2], lever))))


@jit
def update_tilt(
    a: Attitude, innovation: Vec2, variance: float, length: float, gate: float,
) -> Attitude:
    r"""
    Correct attitude and gyro bias with the mean tilt error of a window that ends now.

    An error of the bias has turned the tilt during the window: its mean is the tilt now plus half
    the window times R times that error. With E the first two rows of the identity, L the length
    of the window and r the variance of a component,

    .. math:: H = (E,\; \tfrac{L}{2} E R), \quad R_z = r I, \quad S = H P H^T + R_z, \quad
              K = P H^T S^{-1}, \quad P \leftarrow P - K S K^T

    applied one component after the other, the second decorrelated from the first.

    The gate limits instead of refusing: the variance of an innovation beyond it is increased until
    the innovation lies on the gate. An outlier cannot move the tilt far, and the filter cannot
    lock itself out.

    Yaw and the gyro bias about body z are not corrected (Schmidt filter: their covariance is
    unchanged, their cross-covariance is updated). Gravity observes them only through small
    correlations, which flow errors on a steadily turning path imitate.

    Parameters
    ----------
    a
        Memory.
    innovation : (2,) rad, inertial axes x and y
        First two elements of delta, mean over the window.
    variance : rad^2
        Of each.
    length : s
        Of the window.
    gate : sigma

    """
    R = to_matrix(a.q)
    lever_0, lever_1 = scale(0.5 * length, R[0]), scale(0.5 * length, R[1])
    c_0, c_1 = _column(a, 0, lever_0), _column(a, 1, lever_1)
    s_00 = c_0.r[0] + dot(lever_0, c_0.b) + variance
    s_01 = c_0.r[1] + dot(lever_1, c_0.b)
    # The second component, decorrelated from the first.
    part = s_01 / s_00
    s_11 = c_1.r[1] + dot(lever_1, c_1.b) + variance - part * s_01
    r_1, b_1 = sub(c_1.r, scale(part, c_0.r)), sub(c_1.b, scale(part, c_0.b))
    first, second = innovation[0], innovation[1] - part * innovation[0]
    squared = first * first / s_00 + second * second / s_11
    bend = max(1.0, squared / (gate * gate))
    fit = updated(a.fit, 0.5 * squared, gate, FIT_WEIGHT)
    s_00, s_11 = bend * s_00, bend * s_11
    turn = add(scale(first / s_00, c_0.r), scale(second / s_11, r_1))
    shift = add(scale(first / s_00, c_0.b), scale(second / s_11, b_1))
    q = normalise(multiply(exp_map((turn[0], turn[1], 0.0)), a.q))
    P_rr = less_outer3(less_outer3(a.P_rr, c_0.r, c_0.r, s_00), r_1, r_1, s_11)
    P_rb = less_outer3(less_outer3(a.P_rb, c_0.r, c_0.b, s_00), r_1, b_1, s_11)
    P_bb = less_outer3(less_outer3(a.P_bb, c_0.b, c_0.b, s_00), b_1, b_1, s_11)
    return Attitude(
        q, (a.bias[0] + shift[0], a.bias[1] + shift[1], a.bias[2]),
        symmetric3(_keep_last(P_rr, a.P_rr)), _keep_last(P_rb, a.P_rb),
        symmetric3(_keep_last(P_bb, a.P_bb)), a.hidden, a.window, fit)


@jit
def _keep_last(A: Matrix3, old: Matrix3) -> Matrix3:
    """Return A with the element (3, 3) of old."""
    return (A[0], A[1], (A[2][0], A[2][1], old[2][2]))


@jit
def with_window(a: Attitude, window: Window) -> Attitude:
    """Return the memory with another gravity window."""
    return Attitude(a.q, a.bias, a.P_rr, a.P_rb, a.P_bb, a.hidden, window, a.fit)


@jit
def published_covariance(a: Attitude, aid_age: float) -> Matrix3:
    """
    Return the covariance of delta, scaled to the innovations, (3, 3) rad^2, inertial axes.

    The filter's own covariance holds for the roughest flights of its parameters. The part of the
    tilt that gravity windows measure is scaled by ``fit`` while windows still arrive; the gain
    does not use the scaled one. Unobservable tilt and yaw are not scaled.

    Parameters
    ----------
    a
        Memory.
    aid_age : s
        Since flow was used.

    """
    fit = faded(a.fit, LEAST_FIT, aid_age)
    half, hidden, P = math.sqrt(fit), a.hidden * a.hidden, a.P_rr
    return (
        (fit * P[0][0] + hidden, fit * P[0][1], half * P[0][2]),
        (fit * P[1][0], fit * P[1][1] + hidden, half * P[1][2]),
        (half * P[2][0], half * P[2][1], P[2][2]))


@jit
def yaw_std(a: Attitude) -> float:
    """Return the deviation of the yaw in rad, which nothing observes."""
    return math.sqrt(a.P_rr[2][2])


@jit
def tilt_variance(a: Attitude) -> float:
    """Return the larger variance of the attitude about the two horizontal axes, rad^2."""
    return max(a.P_rr[0][0], a.P_rr[1][1]) + a.hidden * a.hidden
