"""Functions shared by the controllers from the literature: flight limits, attitude of a thrust."""

from __future__ import annotations

from dataclasses import dataclass
import math

from mambo_model.aerodynamics import lumped_drag
from mambo_model.arithmetic.trigonometry import atan2, sin, sin_cos
from mambo_model.compiled import jit
from mambo_model.motion.flatness import minimal_rotation, Reference
from mambo_model.motion.quaternion import angle, conjugate, multiply, Quat, rotate, rotate_inverse
from mambo_model.motion.rigid_body import State
from mambo_model.motion.vector import add, cross, direction, dot, norm, scale, sub, Vec3
from mambo_model.schema import quantity
from mambo_model.values import derived, Parameters
from mambo_model.vehicle.parameters import VehicleValues

from ..command import Command, motors
from ..safety import REASON_NONE

_ZERO = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class FlightLimits(Parameters):
    """Limits of tilt and height beyond which the motors are shut down."""

    tilt_limit: float = quantity(
        math.radians(60.0), 'rad', 0.0, math.pi, 'shutdown beyond; pi: never (judgement)')
    height_min: float = quantity(-1.0, 'm', -1000.0, 0.0, 'shutdown below (judgement)')
    height_max: float = quantity(10.0, 'm', 0.1, 1000.0, 'shutdown above (judgement)')

    @derived('-', 'tilt_limit')
    def tilt_sine_squared(self) -> float:
        """Squared sine of half the tilt limit."""
        s = sin(self.tilt_limit / 2)
        return s * s


@jit
def thrust_wanted(
    state: State, ref: Reference, k_x: float, k_v: float, reach: float, d: Vec3,
    d_dot: Vec3, vv: VehicleValues,
) -> tuple[Vec3, Vec3, Vec3]:
    r"""
    Return the thrust that tracks the position, and its derivatives along the flight.

    .. math:: n = g e_3 + d - \ddot x_r + k_x e_x + k_v e_v

    The derivatives are exact for a vehicle that obeys (3.1) with the believed parameters and the
    acceleration d, whose second derivative is left out; they depend on no torque.

    Parameters
    ----------
    state, ref
        Estimate and reference; e_x and e_v are the first minus the second.
    k_x, k_v : 1/s^2, 1/s
    reach : m
        Longest e_x that counts, so that a step asks for no tilt beyond the limits.
    d, d_dot : (3,) m/s^2, m/s^3, inertial NED
        Acceleration that is neither gravity nor thrust, as far as it is known.
    vv
        Believed vehicle.

    Returns
    -------
    n, n_dot, n_ddot : (3,) m/s^2, m/s^3, m/s^4, inertial NED
        Thrust over mass, reversed; the thrust that is applied is its part along b3.

    """
    e_x, e_v = sub(state.rho, ref.rho), sub(rotate(state.q, state.nu), ref.v)
    away = norm(e_x)
    if away > reach:
        e_x, k_x_dot = scale(reach / away, e_x), 0.0
    else:
        k_x_dot = k_x
    free = add((0.0, 0.0, vv.gravity), d)
    n = add(sub(free, ref.a), add(scale(k_x, e_x), scale(k_v, e_v)))
    b3 = rotate(state.q, (0.0, 0.0, 1.0))
    b3_dot = rotate(state.q, (state.omega[1], -state.omega[0], 0.0))
    pull = dot(n, b3)
    e_a = sub(sub(free, scale(pull, b3)), ref.a)
    n_dot = add(sub(d_dot, ref.j), add(scale(k_x_dot, e_v), scale(k_v, e_a)))
    pull_dot = dot(n_dot, b3) + dot(n, b3_dot)
    e_j = sub(sub(d_dot, add(scale(pull_dot, b3), scale(pull, b3_dot))), ref.j)
    n_ddot = sub(add(scale(k_x_dot, e_a), scale(k_v, e_j)), ref.s)
    return n, n_dot, n_ddot


@jit
def attitude_of(
    n: Vec3, n_dot: Vec3, n_ddot: Vec3, ref: Reference,
) -> tuple[Quat, Vec3, Vec3]:
    r"""
    Return the attitude that has its thrust along n and the heading of the reference.

    .. math:: b_3 = n/|n|, \quad b_2 = b_3 \times b_{1r} / |b_3 \times b_{1r}|, \quad
              b_1 = b_2 \times b_3

    with :math:`b_{1r}` the x axis of the reference, which turns with it. Where n is along the
    thrust of the reference the result is the attitude of the reference.

    Parameters
    ----------
    n, n_dot, n_ddot : (3,) m/s^2, m/s^3, m/s^4, inertial NED
        Thrust over mass, reversed (along b3), and its time derivatives; not along b_1r.
    ref
        Its attitude, rate and angular acceleration say the heading.

    Returns
    -------
    q : (4,)
        Desired body to inertial.
    omega, omega_dot : (3,) rad/s, rad/s^2, in the desired body axes

    """
    _, b3, b3_dot, b3_ddot = direction(n, n_dot, n_ddot)
    w = ref.omega
    turn = cross(w, (1.0, 0.0, 0.0))
    c = rotate(ref.q, (1.0, 0.0, 0.0))
    c_dot = rotate(ref.q, turn)
    c_ddot = rotate(ref.q, add(cross(ref.omega_dot, (1.0, 0.0, 0.0)), cross(w, turn)))
    y = cross(b3, c)
    y_dot = add(cross(b3_dot, c), cross(b3, c_dot))
    y_ddot = add(add(cross(b3_ddot, c), scale(2.0, cross(b3_dot, c_dot))), cross(b3, c_ddot))
    _, b2, b2_dot, b2_ddot = direction(y, y_dot, y_ddot)
    b1 = cross(b2, b3)
    w1, w2, w3 = -dot(b2, b3_dot), dot(b1, b3_dot), -dot(b1, b2_dot)
    omega_dot = (
        -dot(b2, b3_ddot) + w2 * w3, dot(b1, b3_ddot) - w1 * w3, -dot(b1, b2_ddot) + w1 * w2)
    level, _, _ = minimal_rotation(b3, _ZERO, _ZERO)
    ahead = rotate_inverse(level, b1)  # (cos, sin, 0) of the turn about b3
    half = 0.5 * atan2(ahead[1], ahead[0])
    sine, cosine = sin_cos(half)
    q = multiply(level, (cosine, 0.0, 0.0, sine))
    return q, (w1, w2, w3), omega_dot


@jit
def attitude_acceleration(
    q_e: Quat, omega: Vec3, omega_d: Vec3, omega_d_dot: Vec3, k_R: float, k_omega: float,
) -> Vec3:
    r"""
    Return the angular acceleration that tracks an attitude, (3,) rad/s^2, body.

    .. math:: \alpha = R_e^T \dot\omega_d - k_R e_R - k_\omega (\omega - R_e^T \omega_d)
              - \omega \times R_e^T \omega_d, \quad e_R = \tfrac12 (R_e - R_e^T)^\vee

    Parameters
    ----------
    q_e : (4,)
        Body to the desired frame.
    omega : (3,) rad/s, body
    omega_d, omega_d_dot : (3,) rad/s, rad/s^2, desired frame
    k_R, k_omega : 1/s^2, 1/s

    """
    error = scale(2.0 * q_e[0], (q_e[1], q_e[2], q_e[3]))
    carried = rotate_inverse(q_e, omega_d)
    feedback = add(scale(k_R, error), scale(k_omega, sub(omega, carried)))
    return sub(sub(rotate_inverse(q_e, omega_d_dot), feedback), cross(omega, carried))


@jit
def error_of(q: Quat, q_d: Quat) -> Quat:
    """Return q_d* q, (4,): body to the desired frame."""
    return multiply(conjugate(q_d), q)


@jit
def flying(
    f: float, tau: Vec3, state: State, ref: Reference, virtual_input: Vec3, integral: Vec3,
    integral_rate: Vec3, q_d: Quat, omega_e: Vec3, vv: VehicleValues,
) -> Command:
    """
    Return the command of a controller in flight.

    Parameters
    ----------
    f, tau : N, (3,) N m, body FRD
        Demanded thrust and torque.
    state, ref
        Estimate and reference, for the errors that are shown.
    virtual_input : (3,) m/s^2, inertial NED
        What the outer loop adds to the reference's acceleration, with the sign of (3.18a).
    integral, integral_rate : (3,)
        Shown as they are: what the controller has in place of P_e and p_e.
    q_d : (4,)
        Desired body to inertial.
    omega_e : (3,) rad/s, body
    vv
        Believed vehicle.

    """
    T, pwm, saturated = motors(f, tau, vv)
    return Command(
        pwm, False, REASON_NONE, T, saturated, f, tau, sub(ref.rho, state.rho),
        sub(ref.v, rotate(state.q, state.nu)), integral, integral_rate, virtual_input, q_d,
        angle(error_of(state.q, q_d)), omega_e)


@jit
def hover_drag(vv: VehicleValues) -> tuple[float, float]:
    """
    Return the drag of (3.13) at hover thrust per mass and velocity, in 1/s.

    Returns
    -------
    horizontal, vertical : 1/s
        Along b1 and b2, along b3.

    """
    f = vv.mass * vv.gravity
    across = lumped_drag((1.0, 0.0, 1.0), f, vv)
    return -across[0] / vv.mass, -across[2] / vv.mass
