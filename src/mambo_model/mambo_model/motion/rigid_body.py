"""Rigid-body dynamics (3.3), equal to (3.1) without drag, and their integration."""

from __future__ import annotations

from typing import NamedTuple

from ..aerodynamics import lumped_drag, through_air
from ..compiled import jit
from ..vehicle.parameters import VehicleValues
from .quaternion import (
    derivative as quaternion_derivative, norm_control, normalise, Quat, rotate, rotate_inverse)
from .vector import add, cross, mul, scale, sub, Vec3

LIFTED = 0.01  # m, height above the floor from which a vehicle has taken off (judgement)
NORM_LIMIT = 1.39  # h k up to which (2.16) is stable under the classical Runge-Kutta method


class State(NamedTuple):
    """State of the vehicle, or the time derivative of one (every unit divided by s)."""

    rho: Vec3    # (3,) m, inertial NED, position
    nu: Vec3     # (3,) m/s, body FRD, velocity
    q: Quat      # (4,) w x y z, body to inertial, unit
    omega: Vec3  # (3,) rad/s, body FRD, angular velocity


@jit
def derivative(
    state: State, f: float, tau: Vec3, F_D: Vec3, tau_D: Vec3, vv: VehicleValues,
) -> State:
    r"""
    Return the time derivative of the state (3.3a)-(3.3d).

    .. math:: \dot\rho = q \odot \nu, \quad
              \dot\nu = -\omega \times \nu + g q^* \odot e_3 - \frac{f}{m} e_3 + \frac{F_D}{m}
    .. math:: \dot q = \tfrac12 q \otimes \omega, \quad
              J \dot\omega = (J \omega) \times \omega + \tau + \tau_D

    Parameters
    ----------
    state
        State at which to evaluate.
    f : N
        Total thrust along -b3.
    tau, tau_D : (3,) N m, body FRD
        Torque of the rotors and aerodynamic torque.
    F_D : (3,) N, body FRD
        Aerodynamic force without thrust.
    vv
        Vehicle: mass, inertia, gravity.

    """
    weight = rotate_inverse(state.q, (0.0, 0.0, vv.gravity))
    force = (F_D[0], F_D[1], F_D[2] - f)
    nu_dot = add(sub(weight, cross(state.omega, state.nu)), scale(1.0 / vv.mass, force))
    J = vv.inertia
    torque = add(cross(mul(J, state.omega), state.omega), add(tau, tau_D))
    return State(
        rotate(state.q, state.nu), nu_dot, quaternion_derivative(state.q, state.omega),
        (torque[0] / J[0], torque[1] / J[1], torque[2] / J[2]))


@jit
def add_scaled(state: State, rate: State, h: float) -> State:
    """Return state + h * rate, element by element; q is not normalised."""
    q, q_dot = state.q, rate.q
    return State(
        add(state.rho, scale(h, rate.rho)), add(state.nu, scale(h, rate.nu)),
        (q[0] + h * q_dot[0], q[1] + h * q_dot[1], q[2] + h * q_dot[2], q[3] + h * q_dot[3]),
        add(state.omega, scale(h, rate.omega)))


@jit
def controlled(rate: State, q: Quat, norm_gain: float | None) -> State:
    """Return a derivative whose q_dot has the control of the norm (2.16), with a gain in 1/s."""
    if norm_gain is None:
        return rate
    a, b = rate.q, norm_control(q, norm_gain)
    return State(
        rate.rho, rate.nu, (a[0] + b[0], a[1] + b[1], a[2] + b[2], a[3] + b[3]), rate.omega)


@jit
def finished(state: State, norm_gain: float | None) -> State:
    """Return the state at the end of a step, normalised unless the norm is controlled."""
    if norm_gain is None:
        return State(state.rho, state.nu, normalise(state.q), state.omega)
    return state


@jit
def _stage(
    state: State, f: float, tau: Vec3, vv: VehicleValues, norm_gain: float | None,
    wind: Vec3 | None,
) -> State:
    """Return the derivative at a state, including its drag."""
    drag = lumped_drag(through_air(state.nu, state.q, wind), f, vv)
    return controlled(
        derivative(state, f, tau, drag, (0.0, 0.0, 0.0), vv), state.q, norm_gain)


@jit
def rk4_step(
    state: State, f: float, tau: Vec3, h: float, vv: VehicleValues,
    norm_gain: float | None = None, wind: Vec3 | None = None,
) -> State:
    """
    Advance (3.3) by h seconds with the classical Runge-Kutta method at constant thrust and torque.

    Drag is evaluated at every stage. Global error O(h^4).

    Parameters
    ----------
    state
        State at the start of the step.
    f, tau : N, (3,) N m body FRD
        Total thrust along -b3 and torque.
    h : s
        Length of the step.
    vv
        The vehicle.
    norm_gain : 1/s
        Gain k of (2.16), stable for h k up to :data:`NORM_LIMIT`; 0 lets the norm drift. None:
        q is normalised after the step instead.
    wind : (3,) m/s, inertial NED
        Velocity of the air; None: still air.

    """
    k1 = _stage(state, f, tau, vv, norm_gain, wind)
    k2 = _stage(add_scaled(state, k1, 0.5 * h), f, tau, vv, norm_gain, wind)
    k3 = _stage(add_scaled(state, k2, 0.5 * h), f, tau, vv, norm_gain, wind)
    k4 = _stage(add_scaled(state, k3, h), f, tau, vv, norm_gain, wind)
    end = add_scaled(state, k1, h / 6.0)
    end = add_scaled(end, k2, h / 3.0)
    end = add_scaled(end, k3, h / 3.0)
    end = add_scaled(end, k4, h / 6.0)
    return finished(end, norm_gain)
