"""
The default controller of the support package for Parrot minidrones: the thesis's baseline (4.3).

PD on altitude and yaw, PID on roll and pitch, torques in N m straight from angles. The reference
of roll and pitch is a function of the horizontal position error or, switched, the attitude
reference. Every derivative action damps the velocity or rate itself: no velocity, acceleration or
rate of the reference is used, hence the lag of Figure 4.4; no integral action on altitude, hence
the offset of Figure 4.3.

Structure and gains are taken from code that the package generates for the Mambo. Two parts are
left out: the open-loop thrust of the first second, for which the flight plan climbs instead, and
the fence at 10 m.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple

from mambo_model.arithmetic.trigonometry import sin, sin_cos
from mambo_model.compiled import jit, jit_inside
from mambo_model.motion.flatness import Reference
from mambo_model.motion.quaternion import angle, conjugate, from_euler, multiply, rotate, to_euler
from mambo_model.motion.rigid_body import State
from mambo_model.motion.vector import sub, Vec3
from mambo_model.schema import choice, quantity
from mambo_model.values import derived, Parameters, values_type
from mambo_model.vehicle.motor_mixer import thrust_from_pwm
from mambo_model.vehicle.parameters import VehicleValues

from .command import Command, motors, no_thrust
from .safety import REASON_NONE

__all__ = ['initial', 'Memory', 'step', 'stopped', 'ToolboxControllerParams', 'ToolboxGainValues']

REFERENCES = ('position', 'attitude')
POSITION, ATTITUDE = range(len(REFERENCES))  # as compiled code sees them
_NAN3 = (math.nan, math.nan, math.nan)
_PACKAGE = 'support package'


@dataclass(frozen=True)
class ToolboxControllerParams(Parameters):
    """Gains of the support package, what roll and pitch follow, and limits of a flight."""

    altitude_gain: float = quantity(0.8, 'N/m', 0.0, 20.0, _PACKAGE)
    altitude_damping: float = quantity(0.3, 'N s/m', 0.0, 20.0, _PACKAGE)
    thrust_share: float = quantity(
        0.92, '-', 0.01, 1.0, 'support package: of the full thrust, the rest is for the attitude')
    yaw_gain: float = quantity(0.004, 'N m/rad', 0.0, 1.0, _PACKAGE)
    yaw_damping: float = quantity(0.0012, 'N m s/rad', 0.0, 1.0, _PACKAGE)
    roll_gain: float = quantity(0.01, 'N m/rad', 0.0, 1.0, _PACKAGE)
    roll_damping: float = quantity(0.0028, 'N m s/rad', 0.0, 1.0, _PACKAGE)
    pitch_gain: float = quantity(0.013, 'N m/rad', 0.0, 1.0, _PACKAGE)
    pitch_damping: float = quantity(0.002, 'N m s/rad', 0.0, 1.0, _PACKAGE)
    integral_gain: float = quantity(
        0.01, 'N m/(rad s)', 0.0, 1.0, 'support package: roll and pitch')
    integral_leak: float = quantity(
        0.001, '1/s', 0.0, 10.0, 'support package: against wind-up, of the integral itself')
    integral_limit: float = quantity(2.0, 'rad s', 0.0, 100.0, _PACKAGE)
    reference: str = choice(
        'position', REFERENCES, 'what roll and pitch follow: the position error, or roll and '
        'pitch of the reference; the package takes the position where they are zero')
    position_gain: float = quantity(0.24, 'rad/m', 0.0, 5.0, _PACKAGE)
    position_damping: float = quantity(0.1, 'rad s/m', 0.0, 5.0, _PACKAGE)
    position_limit: float = quantity(
        3.0, 'm', 0.0, 100.0, 'support package: larger errors are cut')
    tilt_limit: float = quantity(
        math.radians(60.0), 'rad', 0.0, math.pi, 'shutdown beyond; pi: never (judgement)')
    height_min: float = quantity(-1.0, 'm', -1000.0, 0.0, 'shutdown below (judgement)')
    height_max: float = quantity(10.0, 'm', 0.1, 1000.0, 'shutdown above (judgement)')

    @derived('-', 'tilt_limit')
    def tilt_sine_squared(self) -> float:
        """Squared sine of half the tilt limit."""
        s = sin(self.tilt_limit / 2)
        return s * s


ToolboxGainValues = values_type(ToolboxControllerParams)


class Memory(NamedTuple):
    """Integral action on the attitude; zeros at start."""

    roll: float  # rad s
    pitch: float  # rad s


class Law(NamedTuple):
    """Every signal of the control law."""

    f: float  # N, total thrust
    tau: Vec3  # N m, body FRD
    wanted: Vec3  # rad, roll, pitch and yaw that are followed
    roll_error: float  # rad, wanted minus estimate
    pitch_error: float  # rad


@jit
def initial(gains: ToolboxGainValues) -> Memory:
    """Return the memory at start, with any gains: no integral action."""
    return Memory(0.0, 0.0)


@jit
def _cut(x: float, limit: float) -> float:
    """Return x cut to [-limit, limit]; NaN stays NaN."""
    if x > limit:
        return limit
    if x < -limit:
        return -limit
    return x


@jit
def _wanted_angles(
    state: State, ref: Reference, yaw: float, gains: ToolboxGainValues,
) -> Vec3:
    """
    Return roll, pitch and yaw to follow, (3,) rad.

    In position mode the error, seen from the yaw of the estimate and cut, asks for a tilt towards
    the target; the body velocity, not its error, is damped.
    """
    phi, theta, psi = to_euler(ref.q)
    if gains.reference == ATTITUDE:
        return (phi, theta, psi)
    x, y = ref.rho[0] - state.rho[0], ref.rho[1] - state.rho[1]
    s, c = sin_cos(yaw)
    ahead = _cut(c * x + s * y, gains.position_limit)
    right = _cut(c * y - s * x, gains.position_limit)
    return (
        gains.position_gain * right - gains.position_damping * state.nu[1],
        gains.position_damping * state.nu[0] - gains.position_gain * ahead,
        psi)


@jit
def _wrapped(x: float) -> float:
    """Return an angle in rad as one in [-pi, pi)."""
    return x - 2.0 * math.pi * math.floor((x + math.pi) / (2.0 * math.pi))


@jit
def law(
    state: State, ref: Reference, memory: Memory, gains: ToolboxGainValues, vv: VehicleValues,
) -> Law:
    """
    Evaluate the control law at one instant.

    Parameters
    ----------
    state
        Estimate, inertial NED and body FRD.
    ref
        Position and attitude are used, nothing else of it.
    memory
        Integral action.
    gains
        From :meth:`ToolboxControllerParams.values`.
    vv
        Believed vehicle: its weight is the thrust without error, its full thrust the limit.

    """
    phi, theta, psi = to_euler(state.q)
    wanted = _wanted_angles(state, ref, psi, gains)
    roll_error, pitch_error = wanted[0] - phi, wanted[1] - theta
    tau = (
        gains.roll_gain * roll_error + gains.integral_gain * memory.roll
        - gains.roll_damping * state.omega[0],
        gains.pitch_gain * pitch_error + gains.integral_gain * memory.pitch
        - gains.pitch_damping * state.omega[1],
        gains.yaw_gain * _wrapped(wanted[2] - psi) - gains.yaw_damping * state.omega[2])
    f = (vv.mass * vv.gravity + gains.altitude_gain * (state.rho[2] - ref.rho[2])
         + gains.altitude_damping * state.nu[2])
    full = 4.0 * thrust_from_pwm(vv.pwm_max, vv)
    return Law(_cut(f, gains.thrust_share * full), tau, wanted, roll_error, pitch_error)


@jit
def stopped(memory: Memory, reason: int) -> Command:
    """Return the command that stops the motors; a shutdown unless reason is REASON_NONE."""
    return no_thrust(reason, _NAN3, _NAN3)


@jit
def _advance(integral: float, error: float, dt: float, gains: ToolboxGainValues) -> float:
    """Return the integral action, rad s, after dt s with an error in rad."""
    return _cut(
        integral + dt * (error - gains.integral_leak * integral), gains.integral_limit)


@jit
def _flying(out: Law, state: State, ref: Reference, vv: VehicleValues) -> Command:
    thrust, pwm, saturated = motors(out.f, out.tau, vv)
    q = from_euler(out.wanted[0], out.wanted[1], out.wanted[2])
    return Command(
        pwm, False, REASON_NONE, thrust, saturated, out.f, out.tau, sub(ref.rho, state.rho),
        sub(ref.v, rotate(state.q, state.nu)), _NAN3, _NAN3, _NAN3, q,
        angle(multiply(conjugate(q), state.q)), state.omega)


@jit_inside
def step(
    memory: Memory, state: State, ref: Reference, dt: float, gains: ToolboxGainValues,
    vv: VehicleValues,
) -> tuple[Memory, Command]:
    """
    Answer one estimate in flight; arguments and result as of :func:`cascaded.step`.

    ``integral``, ``integral_rate`` and ``virtual_input`` of the command do not exist here and are
    NaN; ``angular_velocity_error`` is the rate itself, what is wanted being zero.
    """
    out = law(state, ref, memory, gains, vv)
    memory = Memory(
        _advance(memory.roll, out.roll_error, dt, gains),
        _advance(memory.pitch, out.pitch_error, dt, gains))
    return memory, _flying(out, state, ref, vv)
