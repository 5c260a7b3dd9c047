r"""
Incremental nonlinear dynamic inversion, of the thrust and of the torque.

E. J. J. Smeur, Q. Chu, G. C. H. E. de Croon, "Adaptive incremental nonlinear dynamic inversion for
attitude control of micro air vehicles", Journal of Guidance, Control, and Dynamics 39 (2016), for
the torque and the filters; E. J. J. Smeur, G. C. H. E. de Croon, Q. Chu, "Cascaded incremental
nonlinear dynamic inversion for MAV disturbance rejection", Control Engineering Practice 73 (2018),
for the thrust; S. Sun, A. Romero, P. Foehn, E. Kaufmann, D. Scaramuzza, "A comparative study of
nonlinear MPC and differential-flatness-based control for quadrotor agile flight", IEEE
Transactions on Robotics 38 (2022), for the torque beside a flatness-based outer loop.

What was measured and what was commanded over the last period pass the same filter H, and the new
command adds to the old one what the acceleration lacks:

.. math::
    \tau &= H \tau_{k-1} + J (\alpha_c - H \dot\omega), \quad
    t = H t_{k-1} + (a_c - H \dot v) \\
    H &= \omega_n^2 / (s^2 + 2 \zeta \omega_n s + \omega_n^2)

with t the thrust over mass along :math:`-b_3`. What was commanded passes the lag of the motors
too, as far as the vehicle that the controller believes in has one: :math:`\tau_{k-1}` and
:math:`t_{k-1}` are what the motors then did on average. Accelerations are differences of the
estimated velocity and rate over the period. As H is linear, one filter of the difference,
:math:`d = H(\dot v - g e_3 - t_{k-1})`, is enough: it is the acceleration that the model does not
explain (drag, wind, a wrong mass), and the law is that of :mod:`.geometric` with d known.

.. math::
    a_c &= \ddot x_r - k_x e_x - k_v e_v, \quad n = g e_3 + d - a_c = -t

With a mass that is believed too large by a factor m, d has :math:`(m^{-1} - 1) t` along the thrust
of the body as it is, so that the desired attitude follows the true one: a second loop around that
of the attitude, of the bandwidth of H. The loop of the attitude slows down with the lag T of the
motors, and H must be slower than both: :math:`\omega_n \le c/T` of the force.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from mambo_model.arithmetic.exponential import exp
from mambo_model.compiled import jit
from mambo_model.motion.flatness import Reference, torque
from mambo_model.motion.quaternion import IDENTITY, Quat, rotate, rotate_inverse
from mambo_model.motion.rigid_body import State
from mambo_model.motion.vector import add, cross, dot, mul, norm, scale, sub, Vec3
from mambo_model.schema import quantity
from mambo_model.values import values_type
from mambo_model.vehicle.motor_mixer import mix, thrust_from_pwm
from mambo_model.vehicle.parameters import VehicleValues

from ..command import Command, Four, no_thrust
from .flight import (
    attitude_acceleration, attitude_of, error_of, FlightLimits, flying, thrust_wanted)
from .lowpass import lowpass

__all__ = [
    'applied', 'IndiParams', 'IndiValues', 'initial', 'Memory', 'observe', 'step', 'stopped']

_ZERO = (0.0, 0.0, 0.0)
LAG_MARGIN = 0.5  # c: bears 50 ms of lag with 20 % too much mass believed; 0.6 does not (measured)


@dataclass(frozen=True)
class IndiParams(FlightLimits):
    """Gains of the outer loops, filters of the increments, and limits of a flight."""

    k_x: float = quantity(16.0, '1/s^2', 0.01, 400.0, 'judgement: as the geometric law')
    k_v: float = quantity(5.6, '1/s', 0.01, 100.0, 'judgement: as the geometric law')
    reach: float = quantity(
        0.4, 'm', 0.01, 1000.0, 'longest position error that counts: 6.4 m/s^2 (judgement)')
    k_R: float = quantity(
        300.0, '1/s^2', 0.1, 5000.0, 'judgement: with a lag of the motors of 30 ms, unknown')
    k_omega: float = quantity(30.0, '1/s', 0.1, 300.0, 'judgement: as k_R')
    rate_filter: float = quantity(
        3.0, 'rad/s', 0.1, 500.0, 'omega_n of the angular acceleration: Smeur 2016 has 50, where '
        'the lag of the motors is known; here it may be 30 ms and is not (judgement)')
    velocity_filter: float = quantity(
        30.0, 'rad/s', 0.1, 500.0, 'omega_n of the acceleration, likewise (judgement)')
    damping: float = quantity(
        0.7, '1', 0.1, 0.99, 'zeta of both filters; Smeur 2016 has 0.55 (judgement)')
    force_limit: float = quantity(
        6.0, 'm/s^2', 0.0, 100.0, 'longest d: half of the weight and 1 m/s^2 (judgement)')
    torque_limit: float = quantity(
        50.0, 'rad/s^2', 0.0, 1000.0, 'the same of the torque over the inertia, against winding '
        'up on the floor (judgement)')


IndiValues = values_type(IndiParams)


class Memory(NamedTuple):
    """The last estimate, what the motors did since, and the two filters."""

    steps: int  # answered since the start
    v: Vec3  # (3,) m/s, inertial NED, of the last estimate
    q: Quat  # (4,) of the last estimate
    omega: Vec3  # (3,) rad/s, body, of the last estimate
    thrust: float  # N, mean of the motors since then, within their limits, by the believed map
    torque: Vec3  # (3,) N m, body, likewise
    d: Vec3  # (3,) m/s^2, inertial NED, filtered
    d_dot: Vec3  # (3,) m/s^3
    e: Vec3  # (3,) rad/s^2, body, filtered: angular acceleration that the torque does not explain
    e_dot: Vec3  # (3,) rad/s^3
    thrust_now: float  # N, that a believed lag of the motors has come to
    torque_now: Vec3  # (3,) N m, body, likewise


@jit
def initial(gains: IndiValues) -> Memory:
    """Return the memory at start, with any gains: nothing seen, nothing unexplained."""
    return Memory(
        0, _ZERO, IDENTITY, _ZERO, 0.0, _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, 0.0, _ZERO)


@jit
def stopped(memory: Memory, reason: int) -> Command:
    """Return the command that stops the motors; a shutdown unless reason is REASON_NONE."""
    return no_thrust(reason, memory.d, memory.d_dot)


@jit
def _within(x: Vec3, limit: float) -> Vec3:
    """Return a vector cut to a length."""
    length = norm(x)
    return scale(limit / length, x) if length > limit else x


@jit
def observe(
    memory: Memory, v: Vec3, state: State, dt: float, gains: IndiValues, vv: VehicleValues,
) -> tuple[Vec3, Vec3, Vec3, Vec3]:
    """
    Compare the last period with what the motors did in it, and filter the difference.

    Parameters
    ----------
    memory
        Of the step before.
    v : (3,) m/s, inertial NED
        Velocity of the estimate.
    state
        Estimate.
    dt : s
        Length of the period.
    gains
        Filters and limits.
    vv
        Believed vehicle.

    Returns
    -------
    d, d_dot : (3,) m/s^2, m/s^3, inertial NED
    e, e_dot : (3,) rad/s^2, rad/s^3, body

    """
    if memory.steps == 0:
        return memory.d, memory.d_dot, memory.e, memory.e_dot
    down = (0.0, 0.0, 1.0)
    b3 = scale(0.5, add(rotate(memory.q, down), rotate(state.q, down)))
    explained = sub((0.0, 0.0, vv.gravity), scale(memory.thrust / vv.mass, b3))
    force = sub(scale(1.0 / dt, sub(v, memory.v)), explained)
    omega = scale(0.5, add(memory.omega, state.omega))
    moment = add(memory.torque, cross(mul(vv.inertia, omega), omega))
    alpha = (moment[0] / vv.inertia[0], moment[1] / vv.inertia[1], moment[2] / vv.inertia[2])
    rest = sub(scale(1.0 / dt, sub(state.omega, memory.omega)), alpha)
    bandwidth = gains.velocity_filter
    if vv.motor_time_constant > 0.0:
        bandwidth = min(bandwidth, LAG_MARGIN / vv.motor_time_constant)
    d, d_dot = lowpass(
        memory.d, memory.d_dot, _within(force, gains.force_limit), bandwidth, gains.damping, dt)
    e, e_dot = lowpass(
        memory.e, memory.e_dot, _within(rest, gains.torque_limit), gains.rate_filter,
        gains.damping, dt)
    return d, d_dot, e, e_dot


@jit
def applied(pwm: Four, vv: VehicleValues) -> tuple[float, Vec3]:
    """Return the thrust in N and the torque in N m of four PWM, by the believed map."""
    return mix((thrust_from_pwm(pwm[0], vv), thrust_from_pwm(pwm[1], vv),
                thrust_from_pwm(pwm[2], vv), thrust_from_pwm(pwm[3], vv)), vv)


@jit
def _lag(dt: float, time_constant: float) -> tuple[float, float]:
    """Return the share of a change that the motors lack after dt s, and on average over them."""
    if time_constant > 0.0:
        left = exp(-dt / time_constant)
        return left, (1.0 - left) * time_constant / dt
    return 0.0, 0.0


@jit
def follow(
    memory: Memory, state: State, ref: Reference, v: Vec3, jet: tuple[Vec3, Vec3, Vec3],
    unexplained: tuple[Vec3, Vec3, Vec3, Vec3], dt: float, gains: IndiValues, vv: VehicleValues,
) -> tuple[Memory, Command]:
    """
    Return the memory and the command for a thrust that is wanted.

    Parameters
    ----------
    memory
        Of the step before.
    state, ref
        Estimate and reference.
    v : (3,) m/s, inertial NED
        Velocity of the estimate.
    jet : (3,) m/s^2, m/s^3, m/s^4, inertial NED
        Thrust over mass, reversed, and its derivatives.
    unexplained
        Result of :func:`observe`.
    dt : s
        Length of the period that begins.
    gains
        Of the attitude: ``k_R`` and ``k_omega`` are used.
    vv
        Believed vehicle.

    """
    n, n_dot, n_ddot = jet
    d, d_dot, e, e_dot = unexplained
    q_d, omega_d, omega_d_dot = attitude_of(n, n_dot, n_ddot, ref)
    q_e = error_of(state.q, q_d)
    alpha = sub(attitude_acceleration(
        q_e, state.omega, omega_d, omega_d_dot, gains.k_R, gains.k_omega), e)
    wanted = add(sub(n, (0.0, 0.0, vv.gravity)), ref.a)
    command = flying(
        vv.mass * dot(n, rotate(state.q, (0.0, 0.0, 1.0))), torque(state.omega, alpha, vv.inertia),
        state, ref, wanted, d, d_dot, q_d, sub(state.omega, rotate_inverse(q_e, omega_d)), vv)
    thrust, moment = applied(command.pwm, vv)
    at_end, on_average = _lag(dt, vv.motor_time_constant)
    behind, off = memory.thrust_now - thrust, sub(memory.torque_now, moment)
    if memory.steps == 0:  # until the motors lift the vehicle the floor does
        behind, off = 0.0, _ZERO
    return Memory(
        memory.steps + 1, v, state.q, state.omega, thrust + on_average * behind,
        add(moment, scale(on_average, off)), d, d_dot, e, e_dot, thrust + at_end * behind,
        add(moment, scale(at_end, off))), command


@jit
def step(
    memory: Memory, state: State, ref: Reference, dt: float, gains: IndiValues,
    vv: VehicleValues,
) -> tuple[Memory, Command]:
    """
    Answer one estimate in flight; arguments and result as of :func:`cascaded.step`.

    The last period was as long as ``dt``. In the command ``integral`` and ``integral_rate`` show d
    and its derivative.
    """
    v = rotate(state.q, state.nu)
    d, d_dot, e, e_dot = observe(memory, v, state, dt, gains, vv)
    n, n_dot, n_ddot = thrust_wanted(
        state, ref, gains.k_x, gains.k_v, gains.reach, d, d_dot, vv)
    return follow(memory, state, ref, v, (n, n_dot, n_ddot), (d, d_dot, e, e_dot), dt, gains, vv)
