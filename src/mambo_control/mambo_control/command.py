"""The command of a controller: PWM of the motors, and signals of the law for recording."""

from __future__ import annotations

import math
from typing import NamedTuple

from mambo_model.compiled import jit
from mambo_model.motion.flatness import Reference
from mambo_model.motion.quaternion import angle, conjugate, multiply, Quat, rotate
from mambo_model.motion.rigid_body import State
from mambo_model.motion.vector import sub, Vec3
from mambo_model.vehicle.motor_mixer import allocate, limit_pwm, pwm_from_thrust
from mambo_model.vehicle.parameters import VehicleValues

from .safety import REASON_NONE

Four = tuple[float, float, float, float]
Cut = tuple[bool, bool, bool, bool]


class Command(NamedTuple):
    """
    Answer to one estimate.

    While the motors are stopped the law is not evaluated: thrusts and torque are 0, errors,
    virtual input and desired attitude are NaN.
    """

    pwm: Four  # 0: stopped, else within the limits of the motors; never NaN
    shutdown: bool  # the motors are to stop at once, for a reason
    reason: int  # one of safety.REASON_*
    motor_thrust: Four  # N, wanted, before the limits
    saturated: Cut  # the motor's PWM was cut
    thrust: float  # N, (3.20), before the limits
    torque: Vec3  # N m, body FRD, (3.29), before the limits
    position_error: Vec3  # m, inertial NED, reference minus estimate
    velocity_error: Vec3  # m/s, inertial NED, reference minus estimate
    integral: Vec3  # m, inertial NED, P_e used in this step
    integral_rate: Vec3  # m/s, inertial NED, p_e used in this step
    virtual_input: Vec3  # m/s^2, inertial NED, u of (3.18a)
    attitude_desired: Quat  # q_r q_d: desired body to inertial
    attitude_error: float  # rad, angle of q_e (3.25)
    angular_velocity_error: Vec3  # rad/s, body FRD, (3.26)


@jit
def no_thrust(reason: int, integral: Vec3, integral_rate: Vec3) -> Command:
    """Return the command that stops the motors of any controller; the last two as they are."""
    nan3 = (math.nan, math.nan, math.nan)
    zero4 = (0.0, 0.0, 0.0, 0.0)
    return Command(
        zero4, reason != REASON_NONE, reason, zero4, (False, False, False, False), 0.0,
        (0.0, 0.0, 0.0), nan3, nan3, integral, integral_rate, nan3,
        (math.nan, math.nan, math.nan, math.nan), math.nan, nan3)


@jit
def motors(f: float, tau: Vec3, vv: VehicleValues) -> tuple[Four, Four, Cut]:
    """
    Return what the motors are told for a thrust f in N and a torque tau in N m, body FRD.

    Returns
    -------
    thrust : (4,) N, wanted
    pwm : (4,) within the limits of the motors
    saturated : (4,) whether the PWM was cut

    """
    T = allocate(f, tau, vv)
    x = (pwm_from_thrust(T[0], vv), pwm_from_thrust(T[1], vv),
         pwm_from_thrust(T[2], vv), pwm_from_thrust(T[3], vv))
    pwm = (limit_pwm(x[0], vv), limit_pwm(x[1], vv), limit_pwm(x[2], vv), limit_pwm(x[3], vv))
    return T, pwm, (pwm[0] != x[0], pwm[1] != x[1], pwm[2] != x[2], pwm[3] != x[3])


@jit
def thrust_and_torque(
    f: float, tau: Vec3, state: State, ref: Reference, vv: VehicleValues,
) -> Command:
    """
    Return the command of a controller that computes a thrust and a torque.

    Parameters
    ----------
    f : N
        Total thrust, along -z of the body.
    tau : (3,) N m, body FRD
    state, ref
        Estimate and reference, whose difference the command shows.
    vv
        Believed vehicle.

    Returns
    -------
    command
        What such a controller does not have is NaN.

    """
    nan3 = (math.nan, math.nan, math.nan)
    thrust, pwm, saturated = motors(f, tau, vv)
    return Command(
        pwm, False, REASON_NONE, thrust, saturated, f, tau, sub(ref.rho, state.rho),
        sub(ref.v, rotate(state.q, state.nu)), nan3, nan3, nan3, ref.q,
        angle(multiply(conjugate(ref.q), state.q)), sub(state.omega, ref.omega))
