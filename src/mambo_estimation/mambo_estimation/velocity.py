r"""
Velocity filter: horizontal position, velocity and accelerometer bias, with the drift covariance.

Between flow samples the specific force (body axes, C19), turned to inertial axes, is integrated,

.. math:: \dot p = v, \quad \dot v = (R (s - b) + g e_3)_{xy}, \quad
          \dot b_{xy} = -b_{xy} / \tau + noise

and optical flow measures the body velocity (5.2), corrected: C8 says that it must be turned to
inertial axes together with nu_3, which comes from the altitude filter. Position is integrated
velocity, nothing else. The bias b_xy also contains the remaining tilt error (times g), which the
velocity cannot distinguish from it.

Consider parameters. The error that matters in the thesis is not noise: it is a factor Q that is
wrong by a constant and by a part that grows with height, and a yaw that nothing observes. Each is
an unknown of zero mean that the filter does not estimate; how the estimate depends on it, a
sensitivity, is propagated exactly through prediction and gain, and adds to the covariance. The
published covariance therefore grows by the same mechanism (equations.md, Drift) that makes a
vertical circle drift, and does not grow on level circles.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple

from mambo_model.arithmetic.exponential import exp
from mambo_model.compiled import jit
from mambo_model.motion.vector import Vec3
from mambo_model.schema import quantity
from mambo_model.values import Parameters, values_type

from .blocks import (
    add2, apply2, diagonal2, inverse2, Matrix2, Matrix3, mul2, mul2_t, outer2, scale2, sub2,
    symmetric2, transpose2, Vec2, ZERO2)
from .gate import ACCEPT, Gate, judge, RECOVER, Trial
from .measurements import optical_flow
from .measurements.optical_flow import FlowValues


@dataclass(frozen=True)
class VelocityParams(Parameters):
    """Noise and priors of the velocity filter."""

    accel_noise: float = quantity(
        0.02, 'm/s^2/sqrt(Hz)', 1e-6, 10.0,
        'density of the horizontal specific force: 0.0015 at rest, 0.01 in flight below 10 Hz in '
        'Rolling Spider logs')
    held_accel_noise: float = quantity(
        1.0, 'm/s^2/sqrt(Hz)', 1e-6, 100.0,
        'density while a sample is missing: 3 m/s^2 wrong for 0.1 s')
    scale_noise: float = quantity(
        0.02, '1/sqrt(Hz)', 0.0, 1.0,
        'density of the relative error of a velocity by flow that lasts longer than a sample: '
        'from height and tilt on the double-speed circle, rounded up')
    accel_bias_std: float = quantity(
        0.1, 'm/s^2', 1e-4, 5.0,
        'bias along body x and y after the alignment, and 0.6 deg of tilt error: judgement')
    accel_bias_time: float = quantity(30.0, 's', 1.0, 1e5, 'its correlation time: judgement')
    initial_accel_bias_std: float = quantity(
        0.3, 'm/s^2', 1e-4, 5.0,
        'the same where the alignment failed: calibration values of 11 Rolling Spider flights')
    initial_position_std: float = quantity(
        1e-3, 'm', 1e-6, 100.0, 'zero by definition; a covariance should be regular')
    initial_velocity_std: float = quantity(
        0.5, 'm/s', 1e-4, 10.0, 'at start where the alignment failed, and after a reset')


VelocityValues = values_type(VelocityParams)


class Covariance(NamedTuple):
    """Blocks (2, 2) of the covariance of (p, v, b); the three on the diagonal are symmetric."""

    pp: Matrix2  # m^2
    pv: Matrix2  # m^2/s
    pb: Matrix2  # m^2/s^2
    vv: Matrix2  # m^2/s^2
    vb: Matrix2  # m^2/s^3
    bb: Matrix2  # m^2/s^4


class Sensitivity(NamedTuple):
    """Derivative of the estimate by one consider parameter, in units of its deviation."""

    p: Vec2  # m
    v: Vec2  # m/s
    b: Vec2  # m/s^2


class Velocity(NamedTuple):
    """Memory of the velocity filter."""

    position: Vec2      # (2,) m, inertial NED
    velocity: Vec2      # (2,) m/s, inertial NED
    accel_bias: Vec2    # (2,) m/s^2, body x and y
    P: Covariance       # covariance of (p, v, b)
    scale: Sensitivity  # by the constant part of the error of Q, in scale_std
    slope: Sensitivity  # by the part that grows with height, in slope_std
    yaw: Sensitivity    # by the error of yaw, in its deviation at the time


class Result(NamedTuple):
    """Result of one flow update."""

    innovation: Vec2    # (2,) m/s, body FRD x and y
    ratio: float        # -, squared innovation over its covariance times squared gate
    used: bool          # the sample corrected the filter


NOT_COMPARED = Result((math.nan, math.nan), math.nan, False)
MIN_TILT_COS = 0.3  # bounds the effect of a tilt error on nu_3 beyond 72 degrees
INSENSITIVE = Sensitivity((0.0, 0.0), (0.0, 0.0), (0.0, 0.0))


@jit
def start(velocity_variance: float, accel_bias_std: float, v: VelocityValues) -> Velocity:
    """Return the filter at its own origin, velocity and bias zero with m^2/s^2 and m/s^2."""
    bias, position = accel_bias_std * accel_bias_std, v.initial_position_std
    P = Covariance(
        diagonal2(position * position), ZERO2, ZERO2, diagonal2(velocity_variance), ZERO2,
        diagonal2(bias))
    return Velocity((0.0, 0.0), (0.0, 0.0), (0.0, 0.0), P, INSENSITIVE, INSENSITIVE, INSENSITIVE)


@jit
def _predict_covariance(
    P: Covariance, velocity: Vec2, B: Matrix2, dt: float, held: bool, v: VelocityValues,
) -> Covariance:
    r"""
    Return F P F^T + Q of x = (p, v, b), with d acceleration / d bias = -B.

    .. math:: F = \begin{pmatrix} I & \Delta I & -\Delta^2 B/2 \\ 0 & I & -\Delta B \\
              0 & 0 & k I \end{pmatrix}, \quad
              Q = \begin{pmatrix} S^2 \Delta^3/3\, I + \sigma_s^2 \Delta\, v v^T &
              S^2 \Delta^2/2\, I & 0 \\ S^2 \Delta^2/2\, I & S^2 \Delta\, I & 0 \\
              0 & 0 & (1 - k^2) \sigma_b^2 I \end{pmatrix}

    in blocks of (2, 2), :math:`k = e^{-\Delta/\tau}`. Q holds noise of the acceleration (density
    S), of the bias, and of the velocity's scale (density :math:`\sigma_s`).
    """
    keep = exp(-dt / v.accel_bias_time)
    density = v.held_accel_noise if held else v.accel_noise
    q = density * density * dt
    G, H = scale2(dt, B), scale2(0.5 * dt * dt, B)
    vp, bp, bv = transpose2(P.pv), transpose2(P.pb), transpose2(P.vb)
    v_v = sub2(P.vv, mul2(G, bv))
    v_b = sub2(P.vb, mul2(G, P.bb))
    p_p = sub2(add2(P.pp, scale2(dt, vp)), mul2(H, bp))
    p_v = sub2(add2(P.pv, scale2(dt, P.vv)), mul2(H, bv))
    p_b = sub2(add2(P.pb, scale2(dt, P.vb)), mul2(H, P.bb))
    fresh = (1.0 - keep * keep) * v.accel_bias_std * v.accel_bias_std
    pp = sub2(add2(p_p, scale2(dt, p_v)), mul2_t(p_b, H))
    pp = add2(pp, scale2(v.scale_noise * v.scale_noise * dt, outer2(velocity, velocity)))
    return Covariance(
        symmetric2(add2(pp, diagonal2(q * dt * dt / 3.0))),
        add2(sub2(p_v, mul2_t(p_b, G)), diagonal2(0.5 * q * dt)), scale2(keep, p_b),
        symmetric2(add2(sub2(v_v, mul2_t(v_b, G)), diagonal2(q))), scale2(keep, v_b),
        add2(scale2(keep * keep, P.bb), diagonal2(fresh)))


@jit
def _predict_sensitivity(
    s: Sensitivity, B: Matrix2, force: Vec2, dt: float, keep: float,
) -> Sensitivity:
    """Return F s plus ``force``, the derivative of the acceleration by the parameter."""
    pull = apply2(B, s.b)
    a = (force[0] - pull[0], force[1] - pull[1])
    half = 0.5 * dt * dt
    return Sensitivity(
        (s.p[0] + dt * s.v[0] + half * a[0], s.p[1] + dt * s.v[1] + half * a[1]),
        (s.v[0] + dt * a[0], s.v[1] + dt * a[1]), (keep * s.b[0], keep * s.b[1]))


@jit
def predict(
    f: Velocity, acceleration: Vec2, R: Matrix3, yaw_std: float, dt: float, held: bool,
    v: VelocityValues,
) -> Velocity:
    """
    Integrate the horizontal acceleration over dt.

    Parameters
    ----------
    f
        Memory.
    acceleration : (2,) m/s^2, inertial NED
        Bias taken off, mean over the step.
    R : (3, 3)
        Body to inertial.
    yaw_std : rad
        Deviation of the yaw error now.
    dt : s
    held : bool
        The acceleration is not measured but held: its noise is much larger.
    v
        Noise.

    """
    B = ((R[0][0], R[0][1]), (R[1][0], R[1][1]))
    keep = exp(-dt / v.accel_bias_time)
    x, y = acceleration
    half = 0.5 * dt * dt
    position = (f.position[0] + dt * f.velocity[0] + half * x,
                f.position[1] + dt * f.velocity[1] + half * y)
    return Velocity(
        position, (f.velocity[0] + dt * x, f.velocity[1] + dt * y),
        (keep * f.accel_bias[0], keep * f.accel_bias[1]),
        _predict_covariance(f.P, f.velocity, B, dt, held, v),
        _predict_sensitivity(f.scale, B, (0.0, 0.0), dt, keep),
        _predict_sensitivity(f.slope, B, (0.0, 0.0), dt, keep),
        _predict_sensitivity(f.yaw, B, (yaw_std * y, -yaw_std * x), dt, keep))


class Gain(NamedTuple):
    """Kalman gain of a measured body velocity, blocks (2, 2)."""

    p: Matrix2  # s
    v: Matrix2  # -
    b: Matrix2  # 1/s


@jit
def _correct(
    f: Velocity, M: Matrix2, innovation: Vec2, S: Matrix2, scale: Vec2, slope: Vec2, yaw: Vec2,
) -> Velocity:
    r"""
    Update with a measurement M v of the velocity, of covariance R.

    .. math:: H = (0, M, 0), \quad S = M P_{vv} M^T + R, \quad K = P H^T S^{-1}, \quad
              x \leftarrow x + K (z - H x), \quad P \leftarrow P - K S K^T

    For flow :math:`R = \sigma^2 I + (P_{hh}/h^2)\, \nu \nu^T`. A sensitivity s to a consider
    parameter u follows the same gain, :math:`s \leftarrow s + K (\partial z/\partial u - H s)`,
    and the covariance that is published is :math:`P + \sum s s^T`.

    Parameters
    ----------
    f
        Memory.
    M : (2, 2)
        Derivative of the measurement by the velocity.
    innovation : (2,) m/s
    S : (2, 2) m^2/s^2
        Its covariance, consider parameters left out.
    scale, slope, yaw : (2,) m/s
        Derivative of the innovation by each consider parameter.

    """
    P = f.P
    p_z, v_z, b_z = mul2_t(P.pv, M), mul2_t(P.vv, M), mul2_t(transpose2(P.vb), M)
    inverse = inverse2(S)
    K = Gain(mul2(p_z, inverse), mul2(v_z, inverse), mul2(b_z, inverse))
    P = Covariance(
        symmetric2(sub2(P.pp, mul2_t(K.p, p_z))), sub2(P.pv, mul2_t(K.p, v_z)),
        sub2(P.pb, mul2_t(K.p, b_z)), symmetric2(sub2(P.vv, mul2_t(K.v, v_z))),
        sub2(P.vb, mul2_t(K.v, b_z)), symmetric2(sub2(P.bb, mul2_t(K.b, b_z))))
    p, v, b = apply2(K.p, innovation), apply2(K.v, innovation), apply2(K.b, innovation)
    return Velocity(
        (f.position[0] + p[0], f.position[1] + p[1]),
        (f.velocity[0] + v[0], f.velocity[1] + v[1]),
        (f.accel_bias[0] + b[0], f.accel_bias[1] + b[1]), P,
        _correct_sensitivity(f.scale, K, scale), _correct_sensitivity(f.slope, K, slope),
        _correct_sensitivity(f.yaw, K, yaw))


@jit
def _correct_sensitivity(s: Sensitivity, K: Gain, innovation: Vec2) -> Sensitivity:
    """Return the sensitivity after the update with the sensitivity of the innovation."""
    p, v, b = apply2(K.p, innovation), apply2(K.v, innovation), apply2(K.b, innovation)
    return Sensitivity(
        (s.p[0] + p[0], s.p[1] + p[1]), (s.v[0] + v[0], s.v[1] + v[1]),
        (s.b[0] + b[0], s.b[1] + b[1]))


@jit
def _seen(direct: Vec2, M: Matrix2, s: Sensitivity) -> Vec2:
    """Return the derivative of an innovation: of the measurement less of its prediction."""
    predicted = apply2(M, s.v)
    return (direct[0] - predicted[0], direct[1] - predicted[1])


@jit
def update_flow(
    f: Velocity, gate: Gate, flow: Vec2, nu: Vec2, std: float, height: float,
    height_variance: float, v_z: float, R: Matrix3, yaw_std: float, v: FlowValues,
    vv: VelocityValues,
) -> tuple[Velocity, Gate, Result]:
    """
    Correct with a body velocity by optical flow, (5.2) with C8.

    The gain ignores the consider parameters; gate and covariance include them. After refusals for
    the recovery time the velocity covariance is reset to its initial value and inflated by the
    innovation, and that of the position by the accumulated error. The next sample then corrects
    the filter, by no more than the covariance of this moment allows.

    Parameters
    ----------
    f, gate
        Memory.
    flow : (2,) rad/s, body FRD
        The raw sample.
    nu : (2,) m/s, body FRD
        The corresponding velocity.
    std : m/s
        Deviation of each component of nu from noise.
    height, height_variance : m, m^2
        From the altitude filter: an error of the height scales nu.
    v_z : m/s, inertial NED
        Downward velocity, from the altitude filter.
    R : (3, 3)
        Body to inertial.
    yaw_std : rad
        Deviation of the yaw error now.
    v, vv
        Flow model and initial covariance.

    """
    expected, M = optical_flow.predict((f.velocity[0], f.velocity[1], v_z), R)
    innovation = (nu[0] - expected[0], nu[1] - expected[1])
    by_height = height_variance / (height * height) if v.height_scaling else 0.0
    S = add2(mul2_t(mul2(M, f.P.vv), M),
             add2(diagonal2(std * std), scale2(by_height, outer2(nu, nu))))
    lever = v.slope_std * (height - v.reference_height)
    scale = _seen((v.scale_std * nu[0], v.scale_std * nu[1]), M, f.scale)
    slope = _seen((lever * nu[0], lever * nu[1]), M, f.slope)
    turned = apply2(M, (yaw_std * f.velocity[1], -yaw_std * f.velocity[0]))
    yaw = _seen(turned, M, f.yaw)
    total = add2(
        add2(S, outer2(scale, scale)), add2(outer2(slope, slope), outer2(yaw, yaw)))
    weighted = apply2(inverse2(total), innovation)
    squared = innovation[0] * weighted[0] + innovation[1] * weighted[1]
    ratio = squared / (v.gate * v.gate)
    age = gate.age
    trial = Trial(flow, innovation, total[0][0] + total[1][1], ratio)
    gate, verdict = judge(gate, trial, v.gate, v.recovery_time)
    if verdict == RECOVER:
        f = _inflate_covariance(f, innovation, age, vv)
    if verdict != ACCEPT:
        return f, gate, Result(innovation, ratio, False)
    return (_correct(f, M, innovation, symmetric2(S), scale, slope, yaw), gate,
            Result(innovation, ratio, True))


@jit
def widen(f: Velocity, variance: float) -> Velocity:
    """Add a variance in m^2/s^2 to the velocity."""
    P = f.P
    vv = add2(P.vv, diagonal2(variance))
    return Velocity(
        f.position, f.velocity, f.accel_bias, Covariance(P.pp, P.pv, P.pb, vv, P.vb, P.bb),
        f.scale, f.slope, f.yaw)


@jit
def _inflate_covariance(f: Velocity, innovation: Vec2, age: float, v: VelocityValues) -> Velocity:
    """
    Keep the values; inflate the covariance by an error of the velocity.

    The error is ``innovation``, m/s, and has lasted for ``age``, s.
    """
    squared = innovation[0] * innovation[0] + innovation[1] * innovation[1]
    bias = v.initial_accel_bias_std * v.initial_accel_bias_std
    spread = squared + v.initial_velocity_std * v.initial_velocity_std
    P = Covariance(
        add2(f.P.pp, diagonal2(squared * age * age)), ZERO2, ZERO2,
        add2(f.P.vv, diagonal2(spread)), ZERO2, diagonal2(bias))
    return Velocity(f.position, f.velocity, f.accel_bias, P, f.scale, f.slope, f.yaw)


@jit
def hold_still(f: Velocity, variance: float) -> Velocity:
    """Correct with a velocity of zero, of this variance in m^2/s^2: on the floor."""
    M = diagonal2(1.0)
    S = symmetric2(add2(f.P.vv, diagonal2(variance)))
    still = (0.0, 0.0)
    return _correct(
        f, M, (-f.velocity[0], -f.velocity[1]), S, _seen(still, M, f.scale),
        _seen(still, M, f.slope), _seen(still, M, f.yaw))


@jit
def position_covariance(f: Velocity) -> Matrix2:
    """Return the covariance of the horizontal position, (2, 2) m^2, inertial NED."""
    return add2(
        add2(f.P.pp, outer2(f.scale.p, f.scale.p)),
        add2(outer2(f.slope.p, f.slope.p), outer2(f.yaw.p, f.yaw.p)))


@jit
def body_velocity_covariance(
    f: Velocity, v_z_variance: float, R: Matrix3, rotation: Matrix3,
) -> Matrix3:
    """
    Return the covariance of the velocity in body axes, (3, 3) m^2/s^2.

    Flow measures in body axes: of the velocity's dependence on yaw most is undone by turning it
    back, so the yaw error itself enters here with its sensitivity. nu_3 alone follows from the
    vertical velocity, in inertial axes, so the tilt error enters it.

    Parameters
    ----------
    f
        Memory.
    v_z_variance : m^2/s^2
        Of the vertical velocity.
    R : (3, 3)
        Body to inertial.
    rotation : (3, 3) rad^2
        Covariance of the attitude error about inertial axes.

    """
    yaw_std, (v_x, v_y) = math.sqrt(rotation[2][2]), f.velocity
    yaw = (f.yaw.v[0] - yaw_std * v_y, f.yaw.v[1] + yaw_std * v_x)
    C = add2(add2(f.P.vv, outer2(f.scale.v, f.scale.v)),
             add2(outer2(f.slope.v, f.slope.v), outer2(yaw, yaw)))
    x = _turn(C, v_z_variance, R, 0)
    y = _turn(C, v_z_variance, R, 1)
    z = _turn(C, v_z_variance, R, 2)
    tilt = (rotation[0][0] * v_y * v_y - 2.0 * rotation[0][1] * v_x * v_y
            + rotation[1][1] * v_x * v_x) / max(R[2][2] * R[2][2], MIN_TILT_COS * MIN_TILT_COS)
    return (x, (x[1], y[1], y[2]), (x[2], y[2], z[2] + tilt))


@jit
def _turn(C: Matrix2, c_zz: float, R: Matrix3, i: int) -> Vec3:
    """Return row i of R^T diag(C, c_zz) R."""
    x = R[0][i] * C[0][0] + R[1][i] * C[1][0]
    y = R[0][i] * C[0][1] + R[1][i] * C[1][1]
    z = R[2][i] * c_zz
    return (
        x * R[0][0] + y * R[1][0] + z * R[2][0], x * R[0][1] + y * R[1][1] + z * R[2][1],
        x * R[0][2] + y * R[1][2] + z * R[2][2])
