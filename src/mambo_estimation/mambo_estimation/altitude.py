r"""
Altitude filter: height, vertical velocity, accelerometer bias and barometer offset.

Between measurements the vertical part of the specific force is integrated,

.. math:: \dot h = w, \quad \dot w = -(R (s - b) + g e_3)_z, \quad
          \dot b_z = -b_z / \tau + noise, \quad \dot o = noise

with the height h = -rho_z above the floor, w upward, s the measured specific force (body axes,
C19) and b_z the bias of the accelerometer along body z. The sonar measures h, the barometer
h + o. The thesis names this filter in sec. 5.1; its equations are not printed there.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple

from mambo_model.arithmetic.exponential import exp
from mambo_model.compiled import jit
from mambo_model.schema import quantity
from mambo_model.values import Parameters, values_type

from .blocks import Vec2
from .fit import faded, updated
from .gate import ACCEPT, accept, DISTRUST, Gate, judge, RECOVER, refuse_invalid, Trial
from .measurements import barometer, sonar
from .measurements.barometer import BarometerValues
from .measurements.sonar import SonarValues


@dataclass(frozen=True)
class AltitudeParams(Parameters):
    """Noise and priors of the altitude filter."""

    accel_noise: float = quantity(
        0.2, 'm/s^2/sqrt(Hz)', 1e-6, 10.0,
        'density of the vertical specific force in Rolling Spider flights; at rest 0.0015')
    held_accel_noise: float = quantity(
        1.0, 'm/s^2/sqrt(Hz)', 1e-6, 100.0,
        'density while a sample is missing: 3 m/s^2 wrong for 0.1 s')
    accel_bias_std: float = quantity(
        0.1, 'm/s^2', 1e-4, 5.0, 'bias along body z after the alignment: judgement')
    accel_bias_time: float = quantity(100.0, 's', 1.0, 1e5, 'its correlation time: judgement')
    initial_accel_bias_std: float = quantity(
        0.4, 'm/s^2', 1e-4, 5.0,
        'the same where the alignment failed: calibration values of 11 Rolling Spider flights')
    initial_height_std: float = quantity(
        0.05, 'm', 1e-4, 10.0, 'the flight starts on the floor, height 0')
    initial_velocity_std: float = quantity(
        0.5, 'm/s', 1e-4, 10.0, 'at start where the alignment failed, and after a reset')
    accel_bias_limit: float = quantity(
        1.2, 'm/s^2', 1e-3, 10.0, 'no bias is larger: 3 initial_accel_bias_std')
    floor_depth: float = quantity(
        0.1, 'm', 0.0, 1e4, 'no height is farther below the floor: judgement')


AltitudeValues = values_type(AltitudeParams)


class Covariance(NamedTuple):
    """Upper triangle of the covariance of (h, w, b, o): symmetric by construction."""

    hh: float  # m^2
    hw: float  # m^2/s
    hb: float  # m^2/s^2
    ho: float  # m^2
    ww: float  # m^2/s^2
    wb: float  # m^2/s^3
    wo: float  # m^2/s
    bb: float  # m^2/s^4
    bo: float  # m^2/s^2
    oo: float  # m^2


class Altitude(NamedTuple):
    """Memory of the altitude filter."""

    height: float          # m, above the floor
    velocity: float        # m/s, upward
    accel_bias: float      # m/s^2, body z (FRD)
    offset: float          # m, height by pressure minus height
    has_offset: bool       # false until the first pressure
    P: Covariance          # covariance of (h, w, b, o)
    fit: float             # -, squared innovations of the sonar over what is expected of them


class Result(NamedTuple):
    """Result of one measurement update."""

    innovation: float      # m, innovation of the height; NaN: sample not valid or not comparable
    ratio: float           # -, squared innovation over variance times squared gate
    used: bool             # the sample corrected the filter


FIT_WEIGHT = 0.04  # of one range: 1 s
LEAST_FIT = 0.01   # a tenth of every deviation
NOT_COMPARED = Result(math.nan, math.nan, False)
NEAR = Result(math.nan, math.nan, True)


@jit
def start(velocity_variance: float, accel_bias_std: float, v: AltitudeValues) -> Altitude:
    """Return the filter on the floor, velocity and bias zero with m^2/s^2 and m/s^2."""
    P = Covariance(
        v.initial_height_std * v.initial_height_std, 0.0, 0.0, 0.0, velocity_variance, 0.0, 0.0,
        accel_bias_std * accel_bias_std, 0.0, 0.0)
    return Altitude(0.0, 0.0, 0.0, 0.0, False, P, 1.0)


@jit
def predict(
    a: Altitude, acceleration: float, tilt_cos: float, dt: float, held: bool,
    offset_walk: float, v: AltitudeValues,
) -> Altitude:
    r"""
    Integrate the vertical acceleration over dt.

    With :math:`c = R_{33}`, :math:`k = e^{-\Delta/\tau}`, the density S of the noise of the
    acceleration and the walk :math:`\sigma_o` of the offset the covariance of
    :math:`x = (h, w, b_z, o)` becomes :math:`F P F^T + Q`, written out below:

    .. math:: F = \begin{pmatrix} 1 & \Delta & c \Delta^2/2 & 0 \\ 0 & 1 & c \Delta & 0 \\
              0 & 0 & k & 0 \\ 0 & 0 & 0 & 1 \end{pmatrix}, \quad
              Q = \begin{pmatrix} S^2 \Delta^3/3 & S^2 \Delta^2/2 & 0 & 0 \\
              S^2 \Delta^2/2 & S^2 \Delta & 0 & 0 \\ 0 & 0 & (1 - k^2) \sigma_b^2 & 0 \\
              0 & 0 & 0 & \sigma_o^2 \Delta \end{pmatrix}

    Parameters
    ----------
    a
        Memory.
    acceleration : m/s^2
        Upward, bias taken off, mean over the step.
    tilt_cos : -
        Element (3, 3) of R: how the bias along body z enters.
    dt : s
    held : bool
        The acceleration is not measured but held: its noise is much larger.
    offset_walk : m/sqrt(s)
        Of the barometer.
    v
        Noise.

    """
    P = a.P
    half, turn = 0.5 * dt * dt * tilt_cos, dt * tilt_cos
    keep = exp(-dt / v.accel_bias_time)
    density = v.held_accel_noise if held else v.accel_noise
    q = density * density * dt
    hb, wb = P.hb + dt * P.wb + half * P.bb, P.wb + turn * P.bb
    hw, ww = P.hw + dt * P.ww + half * P.wb, P.ww + turn * P.wb
    hh = P.hh + dt * P.hw + half * P.hb + dt * hw + half * hb
    P = Covariance(
        hh + q * dt * dt / 3.0, hw + turn * hb + 0.5 * q * dt, keep * hb,
        P.ho + dt * P.wo + half * P.bo, ww + turn * wb + q, keep * wb, P.wo + turn * P.bo,
        keep * keep * P.bb + (1.0 - keep * keep) * v.accel_bias_std * v.accel_bias_std,
        keep * P.bo, P.oo + offset_walk * offset_walk * dt)
    return Altitude(
        a.height + dt * a.velocity + 0.5 * dt * dt * acceleration,
        a.velocity + dt * acceleration, keep * a.accel_bias, a.offset, a.has_offset, P,
        1.0 if held else a.fit)


@jit
def _correct(
    a: Altitude, column: tuple[float, float, float, float], innovation: float, variance: float,
) -> Altitude:
    r"""
    Update with one scalar measurement :math:`z = H x` of variance R.

    .. math:: S = H P H^T + R, \quad K = P H^T S^{-1}, \quad
              x \leftarrow x + K (z - H x), \quad P \leftarrow P - K S K^T

    with H = (1, 0, 0, 0) for the sonar, (1, 0, 0, 1) for the barometer and (0, 1, 0, 0) for rest
    on the floor. ``column`` is P H^T (the covariance of the state with the measured quantity) and
    ``variance`` is S. P - column column^T / variance keeps the triangle it is stored as.
    """
    P = a.P
    h, w, b, o = column
    k_h, k_w, k_b, k_o = h / variance, w / variance, b / variance, o / variance
    P = Covariance(
        P.hh - k_h * h, P.hw - k_h * w, P.hb - k_h * b, P.ho - k_h * o, P.ww - k_w * w,
        P.wb - k_w * b, P.wo - k_w * o, P.bb - k_b * b, P.bo - k_b * o, P.oo - k_o * o)
    return Altitude(
        a.height + k_h * innovation, a.velocity + k_w * innovation,
        a.accel_bias + k_b * innovation, a.offset + k_o * innovation, a.has_offset, P, a.fit)


@jit
def _with_fit(a: Altitude, fit: float) -> Altitude:
    return Altitude(a.height, a.velocity, a.accel_bias, a.offset, a.has_offset, a.P, fit)


@jit
def published_variances(a: Altitude, aid_age: float) -> Vec2:
    """
    Return the variances of height and vertical velocity, scaled to the sonar's innovations.

    The filter's own variances hold for the roughest flights of its parameters; see :mod:`.fit`.

    Parameters
    ----------
    a
        Memory.
    aid_age : s
        Since a range was used.

    Returns
    -------
    variances : (2,) m^2, m^2/s^2

    """
    fit = faded(a.fit, LEAST_FIT, aid_age)
    return (fit * a.P.hh, fit * a.P.ww)


@jit
def widen(a: Altitude, ww: float, oo: float) -> Altitude:
    """Add variances in m^2/s^2 and m^2 to velocity and offset."""
    P = a.P
    P = Covariance(P.hh, P.hw, P.hb, P.ho, P.ww + ww, P.wb, P.wo, P.bb, P.bo, P.oo + oo)
    return Altitude(a.height, a.velocity, a.accel_bias, a.offset, a.has_offset, P, a.fit)


@jit
def _inflate_covariance(
    a: Altitude, squared_error: float, time: float, v: AltitudeValues,
) -> Altitude:
    """
    Keep height, velocity and bias; inflate the covariance by ``squared_error`` of the height, m^2.

    Assume the height error built up over ``time``, s, and raise the velocity variance to match.
    """
    bias = v.initial_accel_bias_std * v.initial_accel_bias_std
    velocity = max(a.P.ww, v.initial_velocity_std * v.initial_velocity_std)
    longer = max(time, 0.1)
    velocity += squared_error / (longer * longer)
    height = a.P.hh + squared_error
    P = Covariance(height, 0.0, 0.0, 0.0, velocity, 0.0, 0.0, bias, 0.0, a.P.oo + height)
    return Altitude(a.height, a.velocity, a.accel_bias, a.offset, a.has_offset, P, a.fit)


@jit
def bounded(a: Altitude, v: AltitudeValues) -> Altitude:
    """
    Return the filter limited to possible values: not below the floor, and a plausible bias.

    An estimate at the lowest height does not descend. The covariance is unchanged, so that the
    gates can still open.
    """
    height, velocity = a.height, a.velocity
    if height < -v.floor_depth:
        height, velocity = -v.floor_depth, max(velocity, 0.0)
    bias = min(max(a.accel_bias, -v.accel_bias_limit), v.accel_bias_limit)
    return Altitude(height, velocity, bias, a.offset, a.has_offset, a.P, a.fit)


@jit
def _trial(value: float, compared: float, variance: float, ratio: float) -> Trial:
    """Return the gate's trial of a scalar sample, with the value compared with other samples."""
    return Trial((value, value), (compared, compared), 2.0 * variance, ratio)


@jit
def update_sonar(
    a: Altitude, gate: Gate, slant_range: float, tilt_cos: float, tilt_variance: float,
    v: SonarValues, va: AltitudeValues,
) -> tuple[Altitude, Gate, Result]:
    """
    Correct with a range of the sonar.

    A reading below the shortest range corrects only where the predicted height is not between
    the floor and that range, and then to the nearer of the two. Refused heights that agree with
    each other (their innovations need not, if the filter has a wrong velocity) are accepted after
    the recovery time: the covariance is reset to its initial value and that of the height inflated
    by the innovation. The next sample then corrects the height, by no more than the covariance of
    this moment allows.

    Parameters
    ----------
    a, gate
        Memory.
    slant_range : m
        Finite.
    tilt_cos : -
        Element (3, 3) of R.
    tilt_variance : rad^2
        Of the attitude about a horizontal axis.
    v, va
        Sonar model and initial covariance.

    """
    if not sonar.is_valid(slant_range, tilt_cos, v):
        return a, refuse_invalid(gate), NOT_COMPARED
    measured, noise = sonar.measured_height(slant_range, tilt_cos, tilt_variance, v)
    if gate.net_refusals < DISTRUST:
        noise += gate.scatter
    if sonar.is_near(slant_range, v):
        measured = sonar.nearest_height(a.height, tilt_cos, v)
        if measured == a.height:
            return a, accept(gate), NEAR
    innovation = measured - a.height
    squared = innovation * innovation
    variance = a.P.hh + noise
    ratio = squared / (v.gate * v.gate * variance)
    near = v.agreement / v.gate
    gate, verdict = judge(
        gate, _trial(slant_range, measured, near * near, ratio), v.gate, v.recovery_time)
    if verdict == RECOVER:
        a = _inflate_covariance(a, squared, v.recovery_time, va)
    if verdict != ACCEPT:
        return a, gate, Result(innovation, ratio, False)
    P = a.P
    a = _correct(a, (P.hh, P.hw, P.hb, P.ho), innovation, variance)
    fit = updated(a.fit, squared / variance, v.gate, FIT_WEIGHT)
    return _with_fit(a, fit), gate, Result(innovation, ratio, True)


@jit
def update_barometer(
    a: Altitude, gate: Gate, pressure: float, v: BarometerValues,
) -> tuple[Altitude, Gate, Result]:
    """
    Correct with a pressure; the first one sets the offset.

    After refusals for the recovery time the variance of the offset is inflated, because weather
    and rotor wash change the offset and not the height.

    Parameters
    ----------
    a, gate
        Memory.
    pressure : Pa
        Finite.
    v
        Barometer model.

    """
    if not barometer.is_valid(pressure, v):
        return a, refuse_invalid(gate), NOT_COMPARED
    measured, noise = barometer.measured_height(pressure), v.noise * v.noise
    if not a.has_offset:
        return _set_offset(a, measured, noise), gate, NOT_COMPARED
    innovation = measured - a.height - a.offset
    P = a.P
    variance = P.hh + 2.0 * P.ho + P.oo + noise
    ratio = innovation * innovation / (v.gate * v.gate * variance)
    gate, verdict = judge(
        gate, _trial(pressure, innovation, variance, ratio), v.gate, v.recovery_time)
    if verdict == RECOVER:
        a = widen(a, 0.0, innovation * innovation)
    if verdict != ACCEPT:
        return a, gate, Result(innovation, ratio, False)
    P = a.P
    column = (P.hh + P.ho, P.hw + P.wo, P.hb + P.bo, P.ho + P.oo)
    a = _correct(a, column, innovation, column[0] + column[3] + noise)
    return a, gate, Result(innovation, ratio, True)


@jit
def _set_offset(a: Altitude, measured: float, noise: float) -> Altitude:
    """Set the offset from a height by pressure in m with this variance in m^2."""
    P = a.P
    P = Covariance(P.hh, P.hw, P.hb, -P.hh, P.ww, P.wb, -P.hw, P.bb, -P.hb, P.hh + noise)
    return Altitude(a.height, a.velocity, a.accel_bias, measured - a.height, True, P, a.fit)


@jit
def hold_still(a: Altitude, variance: float) -> Altitude:
    """Correct with a vertical velocity of zero, of this variance in m^2/s^2: on the floor."""
    P = a.P
    return _correct(a, (P.hw, P.ww, P.wb, P.wo), -a.velocity, P.ww + variance)
