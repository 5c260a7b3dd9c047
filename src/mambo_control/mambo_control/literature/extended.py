r"""
The cascade of the thesis, extended: drag and mass estimated in flight, an exact integral action.

(3.15)-(3.29) of v.d. Eijnden with three additions.

1. The drag feed-forward of chapter 7 on all axes: (3.13) with a coefficient along :math:`b_3`.
2. Its coefficients and the mass are estimated in flight (:mod:`.drag_estimate`).
3. The integral action of (3.18c) leaves an error under a constant disturbance (EQUATIONS, C17):
   its equilibrium is :math:`P_e = \sigma(\bar\rho_e)`. Here the filter is driven by the error
   itself,

.. math::
    \dot P_e = p_e, \quad \dot p_e = -K_p p_e + K_P \sigma(\bar\rho_e - P_e), \quad
    u = -\dot p_e - k_p \sigma(\bar\rho_e) - K_\nu \sigma(\bar\nu_e)

so that :math:`\dot{\bar\rho}_e = \bar\nu_e` and :math:`\dot{\bar\nu}_e = -k_p \sigma(\bar\rho_e)
- K_\nu \sigma(\bar\nu_e)` stay as in (3.30), and the only equilibrium has
:math:`\rho_e = \bar\rho_e - P_e = 0` for any constant disturbance below :math:`k_p`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from mambo_model.compiled import jit
from mambo_model.motion.flatness import Reference
from mambo_model.motion.quaternion import angle, IDENTITY, multiply, rotate
from mambo_model.motion.rigid_body import State
from mambo_model.motion.vector import add, dot, norm, scale, sub, Vec3
from mambo_model.schema import flag, quantity
from mambo_model.values import values_type
from mambo_model.vehicle.motor_mixer import thrust_from_pwm
from mambo_model.vehicle.parameters import VehicleValues

from ..attitude_law import attitude_error, rate_error, torque
from ..command import Command, motors, no_thrust
from ..drag_feedforward import drag_jet
from ..gains import CascadedParams
from ..safety import REASON_NONE
from ..saturation import sigma, sigma_ddot, sigma_dot
from ..thrust_direction import desired_attitude, desired_direction
from ..virtual_thrust import errors
from .drag_estimate import believed, corrected, DragEstimate, refined

__all__ = ['advance', 'demand', 'ExtendedParams', 'ExtendedValues', 'initial', 'Memory', 'step',
           'stopped']

_ZERO = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class ExtendedParams(CascadedParams):
    """Gains of the cascade with drag feed-forward, and of what estimates drag and mass."""

    drag_feedforward: bool = flag(True, 'chapter 7: drag in the virtual input')
    estimate: bool = flag(True, 'chapter 7: drag and mass estimated in flight; false: as believed')
    estimate_above: float = quantity(
        0.3, 'm', 0.0, 10.0, 'height above which, as the floor carries below (judgement)')
    estimate_time: float = quantity(
        3.0, 's', 0.1, 1000.0, 'memory of the estimated drag and mass (judgement)')
    estimate_noise: float = quantity(
        0.5, '1', 1e-3, 10.0, 'standard deviation of the measured specific force over that of the '
        'thrust: differences of an estimated velocity at 200 Hz (judgement)')
    integral_limit: float = quantity(
        2.0, 'm', 0.0, 100.0, 'longest P_e; 1.6 m stand for a disturbance of 0.85 k_p (judgement)')


ExtendedValues = values_type(ExtendedParams)


class Memory(NamedTuple):
    """Integral action, the last period, and what it taught of the vehicle."""

    P: Vec3  # (3,) m, inertial NED: P_e
    p: Vec3  # (3,) m/s, inertial NED: p_e
    steps: int  # answered since the start
    last: State  # the last estimate
    thrust: float  # N, of the motors since, by the believed map
    vehicle: DragEstimate


class Demand(NamedTuple):
    """Thrust that the outer loop asks for, with its derivatives; inertial NED."""

    p_dot: Vec3  # m/s^2
    U: Vec3  # m/s^2, R_r u without drag feed-forward
    n: Vec3  # m/s^2, thrust over mass, reversed, feed-forward included
    n_dot: Vec3  # m/s^3
    n_ddot: Vec3  # m/s^4


@jit
def initial(gains: ExtendedValues) -> Memory:
    """Return the memory at start, with any gains: no integral action, nothing learnt."""
    return Memory(
        _ZERO, _ZERO, 0, State(_ZERO, _ZERO, IDENTITY, _ZERO), 0.0,
        DragEstimate(1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0))


@jit
def stopped(memory: Memory, reason: int) -> Command:
    """Return the command that stops the motors; a shutdown unless reason is REASON_NONE."""
    return no_thrust(reason, memory.P, memory.p)


@jit
def demand(
    state: State, ref: Reference, P: Vec3, p: Vec3, gains: ExtendedValues, vv: VehicleValues,
) -> Demand:
    """
    Evaluate the outer loop and differentiate the demanded thrust twice along the flight.

    Parameters
    ----------
    state, ref
        Estimate and reference.
    P, p : (3,) m, m/s, inertial NED
        Integral action.
    gains
        Position gains and the drag switch.
    vv
        Vehicle, as believed or as estimated.

    """
    off, off_dot = errors(state, ref)
    e, e_dot = add(off, P), add(off_dot, p)
    p_dot = sub(scale(gains.K_P, sigma(off)), scale(gains.K_p, p))
    U = sub(scale(-1.0, p_dot), add(scale(gains.k_p, sigma(e)), scale(gains.K_nu, sigma(e_dot))))
    n = add(sub((0.0, 0.0, vv.gravity), ref.a), U)
    drag, drag_dot, drag_ddot = drag_jet(state, ref, vv.mass * norm(n), gains, vv)
    n = add(n, drag)
    length = norm(n)

    b3 = rotate(state.q, (0.0, 0.0, 1.0))
    b3_dot = rotate(state.q, (state.omega[1], -state.omega[0], 0.0))
    acceleration = add(sub((0.0, 0.0, vv.gravity), scale(length, b3)), drag)
    off_ddot = sub(ref.a, acceleration)
    e_ddot = add(off_ddot, p_dot)
    p_ddot = sub(scale(gains.K_P, sigma_dot(off, off_dot)), scale(gains.K_p, p_dot))
    U_dot = sub(scale(-1.0, p_ddot), add(
        scale(gains.k_p, sigma_dot(e, e_dot)), scale(gains.K_nu, sigma_dot(e_dot, e_ddot))))
    n_dot = add(sub(U_dot, ref.j), drag_dot)

    length_dot = dot(n, n_dot) / length
    jerk = sub(drag_dot, add(scale(length_dot, b3), scale(length, b3_dot)))
    e_dddot = add(sub(ref.j, jerk), p_ddot)
    p_dddot = sub(
        scale(gains.K_P, sigma_ddot(off, off_dot, off_ddot)), scale(gains.K_p, p_ddot))
    U_ddot = sub(scale(-1.0, p_dddot), add(
        scale(gains.k_p, sigma_ddot(e, e_dot, e_ddot)),
        scale(gains.K_nu, sigma_ddot(e_dot, e_ddot, e_dddot))))
    return Demand(p_dot, U, n, n_dot, add(sub(U_ddot, ref.s), drag_ddot))


@jit
def advance(
    P: Vec3, p: Vec3, off: Vec3, dt: float, gains: ExtendedValues,
) -> tuple[Vec3, Vec3]:
    """
    Integrate the integral action over one period, the position error held.

    Its input does not depend on P_e, so p_e relaxes to K_P sigma(rho_e)/K_p and the trapezoidal
    rule gives P_e.

    Parameters
    ----------
    P, p : (3,) m, m/s, inertial NED
        At the start of the period.
    off : (3,) m, inertial NED
        Position error rho_e.
    dt : s
        Length of the period.
    gains
        K_P, K_p and the limit of P_e.

    """
    end = scale(gains.K_P / gains.K_p, sigma(off))
    after = add(end, scale(1.0 / (1.0 + gains.K_p * dt), sub(p, end)))
    moved = add(P, scale(0.5 * dt, add(p, after)))
    length = norm(moved)
    if length > gains.integral_limit:
        return scale(gains.integral_limit / length, moved), _ZERO
    return moved, after


@jit
def _learn(
    memory: Memory, state: State, dt: float, gains: ExtendedValues, vv: VehicleValues,
) -> DragEstimate:
    """Return what is known of the vehicle after the last period."""
    if memory.steps == 0:
        return believed(vv)
    if not gains.estimate or -state.rho[2] < gains.estimate_above or not memory.thrust > 0.0:
        return memory.vehicle
    variance = gains.estimate_noise * gains.estimate_noise
    share = dt / gains.estimate_time
    return refined(
        memory.vehicle, memory.last, state, dt, memory.thrust, variance,
        variance * share * share, vv)


@jit
def step(
    memory: Memory, state: State, ref: Reference, dt: float, gains: ExtendedValues,
    vv: VehicleValues,
) -> tuple[Memory, Command]:
    """
    Answer one estimate in flight; arguments and result as of :func:`cascaded.step`.

    The last period was as long as ``dt``.
    """
    known = _learn(memory, state, dt, gains, vv)
    vehicle = corrected(known, vv) if gains.estimate else vv
    wanted = demand(state, ref, memory.P, memory.p, gains, vehicle)
    f_d, f_d_dot, f_d_ddot = desired_direction(wanted.n, wanted.n_dot, wanted.n_ddot, ref)
    q_d, omega_d, omega_d_dot = desired_attitude(f_d, f_d_dot, f_d_ddot, gains)
    q_e = attitude_error(state.q, ref.q, q_d)
    omega_e = rate_error(state, ref, q_e, omega_d)
    tau = torque(state, ref, q_d, omega_d, omega_d_dot, q_e, omega_e, gains, vehicle)
    f = vehicle.mass * norm(wanted.n)
    T, pwm, saturated = motors(f, tau, vehicle)
    off, off_dot = errors(state, ref)
    command = Command(
        pwm, False, REASON_NONE, T, saturated, f, tau, off, off_dot, memory.P, memory.p, wanted.U,
        multiply(ref.q, q_d), angle(q_e), omega_e)
    thrust = (thrust_from_pwm(pwm[0], vv) + thrust_from_pwm(pwm[1], vv)
              + thrust_from_pwm(pwm[2], vv) + thrust_from_pwm(pwm[3], vv))
    P, p = advance(memory.P, memory.p, off, dt, gains)
    return Memory(P, p, memory.steps + 1, state, thrust, known), command
