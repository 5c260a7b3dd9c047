"""
The cascaded controller (3.15)-(3.29) of v.d. Eijnden, from estimate and reference to motor PWM.

Used in the corrected form: q_e* in (3.29), one gain k_p, derivatives of f_d evaluated exactly.
The result is the same for q and -q, to the last bit. Mass, inertia, gravity, geometry, motor map
and drag are those the controller believes, and the reference's own thrust and torque are not used:
they follow from its acceleration and the believed vehicle.
"""

from __future__ import annotations

from typing import NamedTuple

from mambo_model.compiled import jit, jit_inside
from mambo_model.motion.flatness import Reference
from mambo_model.motion.quaternion import angle, multiply, Quat, rotate_inverse
from mambo_model.motion.rigid_body import State
from mambo_model.motion.vector import Vec3
from mambo_model.vehicle.parameters import VehicleValues

from .attitude_law import attitude_error, rate_error, torque
from .command import Command, motors, no_thrust
from .gains import CascadedParams, GainValues
from .safety import REASON_NONE
from .thrust_direction import desired_attitude, desired_direction
from .virtual_thrust import advance, demand, errors, Memory

__all__ = ['CascadedParams', 'initial', 'Law', 'law', 'Memory', 'step', 'stopped']


class Law(NamedTuple):
    """Every signal of the control law; R is the frame of the reference, D the desired one."""

    f: float  # N, total thrust (3.20)
    tau: Vec3  # N m, body FRD, torque (3.29)
    P_dot: Vec3  # m/s, inertial NED, (3.18b)
    p_dot: Vec3  # m/s^2, inertial NED, (3.18c)
    U: Vec3  # m/s^2, inertial NED, R_r u of (3.18a), without drag feed-forward
    f_d: Vec3  # 1, R, (3.21)
    f_d_dot: Vec3  # 1/s, R
    f_d_ddot: Vec3  # 1/s^2, R
    q_d: Quat  # D to R, (3.23)
    omega_d: Vec3  # rad/s, D, (3.24), zero if so chosen
    omega_d_dot: Vec3  # rad/s^2, D, zero if so chosen
    q_e: Quat  # body to D, (3.25)
    omega_e: Vec3  # rad/s, body, (3.26)
    rho_e: Vec3  # m, R, (3.15)
    nu_e: Vec3  # m/s, R, (3.15)
    position_error: Vec3  # m, inertial NED, R_r rho_e
    velocity_error: Vec3  # m/s, inertial NED, R_r nu_e


@jit
def initial(gains: GainValues) -> Memory:
    """Return the memory at start, with any gains: no integral action."""
    return Memory((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


@jit
def law(
    state: State, ref: Reference, memory: Memory, gains: GainValues, vv: VehicleValues,
) -> Law:
    """
    Evaluate (3.15)-(3.29) at one instant.

    Parameters
    ----------
    state
        Estimate, inertial NED and body FRD.
    ref
        Feasible reference (3.14).
    memory
        Integral action.
    gains
        From :meth:`CascadedParams.values`.
    vv
        Believed vehicle.

    """
    position_error, velocity_error = errors(state, ref)
    wanted = demand(state, ref, memory, position_error, velocity_error, gains, vv)
    f_d, f_d_dot, f_d_ddot = desired_direction(wanted.n, wanted.n_dot, wanted.n_ddot, ref)
    q_d, omega_d, omega_d_dot = desired_attitude(f_d, f_d_dot, f_d_ddot, gains)
    q_e = attitude_error(state.q, ref.q, q_d)
    omega_e = rate_error(state, ref, q_e, omega_d)
    tau = torque(state, ref, q_d, omega_d, omega_d_dot, q_e, omega_e, gains, vv)
    return Law(
        wanted.f, tau, wanted.P_dot, wanted.p_dot, wanted.U, f_d, f_d_dot, f_d_ddot, q_d,
        omega_d, omega_d_dot, q_e, omega_e, rotate_inverse(ref.q, position_error),
        rotate_inverse(ref.q, velocity_error), position_error, velocity_error)


@jit
def stopped(memory: Memory, reason: int) -> Command:
    """Return the command that stops the motors; a shutdown unless reason is REASON_NONE."""
    return no_thrust(reason, memory.P, memory.p)


@jit
def _flying(out: Law, memory: Memory, ref: Reference, vv: VehicleValues) -> Command:
    T, pwm, saturated = motors(out.f, out.tau, vv)
    return Command(
        pwm, False, REASON_NONE, T, saturated, out.f, out.tau, out.position_error,
        out.velocity_error, memory.P, memory.p, out.U, multiply(ref.q, out.q_d),
        angle(out.q_e), out.omega_e)


@jit_inside
def step(
    memory: Memory, state: State, ref: Reference, dt: float, gains: GainValues, vv: VehicleValues,
) -> tuple[Memory, Command]:
    """
    Answer one estimate in flight, and move the integral action to the next one.

    Each motor is cut to its PWM limits on its own, as in the thesis: no axis has priority over
    another, so that thrust and torque both fall short while a motor saturates.

    Parameters
    ----------
    memory
        Result of the previous call; :func:`initial` at start.
    state
        Estimate, inertial NED and body FRD.
    ref
        Reference for the time of the estimate.
    dt : s
        Time to the next call, the control period.
    gains
        From :meth:`CascadedParams.values`.
    vv
        Believed vehicle.

    Returns
    -------
    memory
        To be passed to the next call.
    command
        Valid for one period.

    """
    out = law(state, ref, memory, gains, vv)
    return advance(memory, out.position_error, dt, gains), _flying(out, memory, ref, vv)
