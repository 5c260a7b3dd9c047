r"""
Outer loop (3.15)-(3.20): tracking errors, integral action, virtual thrust and its derivatives.

The thesis writes the loop in the frame of the reference. With scalar gains :math:`\sigma`
commutes with rotations, so it is evaluated here in the inertial frame, which is exactly
equivalent: :math:`e_\rho = R_r \bar\rho_e`, :math:`e_\nu = R_r \bar\nu_e`, :math:`U = R_r u`.
"""

from __future__ import annotations

from typing import NamedTuple

from mambo_model.compiled import jit
from mambo_model.motion.flatness import Reference
from mambo_model.motion.quaternion import rotate
from mambo_model.motion.rigid_body import State
from mambo_model.motion.vector import add, dot, norm, scale, sub, Vec3
from mambo_model.vehicle.parameters import VehicleValues

from .drag_feedforward import drag_jet
from .gains import GainValues
from .saturation import sigma, sigma_ddot, sigma_dot


class Memory(NamedTuple):
    """Integral action of (3.18b,c); zeros at start."""

    P: Vec3  # (3,) m, inertial NED: P_e
    p: Vec3  # (3,) m/s, inertial NED: p_e


class Demand(NamedTuple):
    """Virtual thrust that the outer loop demands, with its derivatives; inertial NED."""

    P_dot: Vec3  # m/s
    p_dot: Vec3  # m/s^2
    U: Vec3  # m/s^2, R_r u of (3.18a) without drag feed-forward
    n: Vec3  # m/s^2, (f_r b3 + m u)/m of (3.20), feed-forward included
    n_dot: Vec3  # m/s^3
    n_ddot: Vec3  # m/s^4
    f: float  # N, (3.20)


@jit
def errors(state: State, ref: Reference) -> tuple[Vec3, Vec3]:
    """
    Return reference minus state, in the inertial frame: R_r times (3.15).

    Returns
    -------
    position_error, velocity_error : (3,) m, m/s, inertial NED

    """
    return sub(ref.rho, state.rho), sub(ref.v, rotate(state.q, state.nu))


@jit
def integral_acceleration(P: Vec3, p: Vec3, sigma_rho: Vec3, gains: GainValues) -> Vec3:
    """Return p_e' of (3.18c); applied to derivatives of its arguments, those of p_e'."""
    return add(scale(-gains.K_p, p), scale(gains.K_P, sub(sigma_rho, P)))


@jit
def feedback(P: Vec3, p: Vec3, sigma_rho: Vec3, sigma_nu: Vec3, gains: GainValues) -> Vec3:
    """Return U of (3.18a); applied to derivatives of its arguments, those of U."""
    integral = add(scale(gains.K_P, P), scale(gains.K_p, p))
    proportional = add(scale(gains.K_P + gains.k_p, sigma_rho), scale(gains.K_nu, sigma_nu))
    return sub(integral, proportional)


@jit
def demand(
    state: State, ref: Reference, memory: Memory, position_error: Vec3, velocity_error: Vec3,
    gains: GainValues, vv: VehicleValues,
) -> Demand:
    """
    Evaluate (3.18)-(3.20) and differentiate the demanded thrust twice along the flight.

    The derivatives are exact for a vehicle that obeys (3.3) with the believed parameters: the
    acceleration follows from the thrust of this very step, and nothing depends on the torque, so
    there is no algebraic loop. An acceleration that the model does not know makes them wrong: a
    steady horizontal push of 1 m/s^2 lets f_d seem to turn and leaves an error of 0.11 m instead
    of 0.032 m. Drag is known with ``drag_feedforward`` only.

    Parameters
    ----------
    state
        Estimate; its attitude and rates enter the derivatives only.
    ref
        Acceleration, jerk and snap are used.
    memory
        Integral action.
    position_error, velocity_error : (3,) m, m/s, inertial NED
        From :func:`errors`.
    gains
        Position gains and the drag switch.
    vv
        Believed vehicle.

    """
    P, p = memory.P, memory.p
    e, e_dot = add(position_error, P), add(velocity_error, p)
    s_rho, s_nu = sigma(e), sigma(e_dot)
    p_dot = integral_acceleration(P, p, s_rho, gains)
    U = feedback(P, p, s_rho, s_nu, gains)
    n = add(sub((0.0, 0.0, vv.gravity), ref.a), U)
    drag, drag_dot, drag_ddot = drag_jet(state, ref, vv.mass * norm(n), gains, vv)
    n = add(n, drag)
    length = norm(n)

    b3 = rotate(state.q, (0.0, 0.0, 1.0))
    b3_dot = rotate(state.q, (state.omega[1], -state.omega[0], 0.0))
    acceleration = add(sub((0.0, 0.0, vv.gravity), scale(length, b3)), drag)
    e_ddot = add(sub(ref.a, acceleration), p_dot)
    s_rho_dot = sigma_dot(e, e_dot)
    p_ddot = integral_acceleration(p, p_dot, s_rho_dot, gains)
    U_dot = feedback(p, p_dot, s_rho_dot, sigma_dot(e_dot, e_ddot), gains)
    n_dot = add(sub(U_dot, ref.j), drag_dot)

    length_dot = dot(n, n_dot) / length
    jerk = sub(drag_dot, add(scale(length_dot, b3), scale(length, b3_dot)))
    e_dddot = add(sub(ref.j, jerk), p_ddot)
    U_ddot = feedback(p_dot, p_ddot, sigma_ddot(e, e_dot, e_ddot),
                      sigma_ddot(e_dot, e_ddot, e_dddot), gains)
    n_ddot = add(sub(U_ddot, ref.s), drag_ddot)
    return Demand(p, p_dot, U, n, n_dot, n_ddot, vv.mass * length)


@jit
def _memory_rate(memory: Memory, position_error: Vec3, gains: GainValues) -> Memory:
    """Return (3.18b,c) for a given position error."""
    s_rho = sigma(add(position_error, memory.P))
    return Memory(memory.p, integral_acceleration(memory.P, memory.p, s_rho, gains))


@jit
def _memory_moved(memory: Memory, rate: Memory, dt: float) -> Memory:
    return Memory(add(memory.P, scale(dt, rate.P)), add(memory.p, scale(dt, rate.p)))


@jit
def advance(memory: Memory, position_error: Vec3, dt: float, gains: GainValues) -> Memory:
    """
    Integrate (3.18b,c) over one period by classical RK4, the position error held.

    sigma_1 is re-evaluated at every stage, since its argument contains P_e itself. There is no
    anti-windup: the length of P_e cannot exceed about 1.04 m, whatever the error.

    Parameters
    ----------
    memory
        At the start of the period.
    position_error : (3,) m, inertial NED
        From :func:`errors`.
    dt : s
        Length of the period.
    gains
        K_P and K_p.

    """
    k1 = _memory_rate(memory, position_error, gains)
    k2 = _memory_rate(_memory_moved(memory, k1, 0.5 * dt), position_error, gains)
    k3 = _memory_rate(_memory_moved(memory, k2, 0.5 * dt), position_error, gains)
    k4 = _memory_rate(_memory_moved(memory, k3, dt), position_error, gains)
    P = add(add(k1.P, k4.P), scale(2.0, add(k2.P, k3.P)))
    p = add(add(k1.p, k4.p), scale(2.0, add(k2.p, k3.p)))
    return _memory_moved(memory, Memory(P, p), dt / 6.0)
