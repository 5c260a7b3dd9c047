r"""
Geometric tracking control on SE(3).

T. Lee, M. Leok, N. H. McClamroch, "Geometric tracking control of a quadrotor UAV on SE(3)", IEEE
Conference on Decision and Control, 2010, arXiv:1003.2005, sections III and IV. Its frames are
those of this package: NED and FRD, thrust along :math:`-b_3`.

.. math::
    e_x &= x - x_d, \quad e_v = v - v_d \\
    f &= (k_x e_x + k_v e_v + m g e_3 - m \ddot x_d) \cdot R e_3 \\
    b_{3d} &= (k_x e_x + k_v e_v + m g e_3 - m \ddot x_d) / |\cdot| \\
    e_R &= \tfrac12 (R_d^T R - R^T R_d)^\vee, \quad
    e_\Omega = \Omega - R^T R_d \Omega_d \\
    M &= -k_R e_R - k_\Omega e_\Omega + \Omega \times J \Omega
         - J (\hat\Omega R^T R_d \Omega_d - R^T R_d \dot\Omega_d)

The heading is that of the reference, :math:`\Omega_d` and its derivative are exact, and the gains
are divided by mass and inertia, so that they are those of any vehicle. The law knows no drag and
has no integral action.
"""

from __future__ import annotations

from dataclasses import dataclass
import math
from typing import NamedTuple

from mambo_model.compiled import jit
from mambo_model.motion.flatness import Reference, torque
from mambo_model.motion.quaternion import Quat, rotate, rotate_inverse
from mambo_model.motion.rigid_body import State
from mambo_model.motion.vector import add, dot, sub, Vec3
from mambo_model.schema import flag, quantity
from mambo_model.values import values_type
from mambo_model.vehicle.parameters import VehicleValues

from ..command import Command, no_thrust
from .flight import (
    attitude_acceleration, attitude_of, error_of, FlightLimits, flying, thrust_wanted)

__all__ = ['GeometricParams', 'GeometricValues', 'initial', 'law', 'Memory', 'step', 'stopped']

_ZERO = (0.0, 0.0, 0.0)
_PAPER = 'Lee, Leok, McClamroch 2010, numerical example'


@dataclass(frozen=True)
class GeometricParams(FlightLimits):
    """Gains of the law over mass and inertia, and limits of a flight."""

    k_x: float = quantity(16.0, '1/s^2', 0.01, 400.0, _PAPER + ': k_x = 16 m')
    k_v: float = quantity(5.6, '1/s', 0.01, 100.0, _PAPER + ': k_v = 5.6 m')
    k_R: float = quantity(
        430.0, '1/s^2', 0.1, 5000.0, 'judgement: poles at 20 1/s, damping 0.8; the vehicle of the '
        'paper has 107 with 60 times the mass')
    k_omega: float = quantity(33.0, '1/s', 0.1, 300.0, 'judgement: as k_R; the paper has 31')
    rates: bool = flag(
        True, 'the law has them: desired rate and angular acceleration; false: both zero')


GeometricValues = values_type(GeometricParams)


class Memory(NamedTuple):
    """The law remembers nothing; compiled code wants one number."""

    none: int


class Law(NamedTuple):
    """Every signal of the control law."""

    f: float  # N, total thrust
    tau: Vec3  # N m, body FRD
    n: Vec3  # m/s^2, inertial NED, demanded thrust over mass, reversed
    q_d: Quat  # desired body to inertial
    omega_d: Vec3  # rad/s, desired frame
    omega_d_dot: Vec3  # rad/s^2, desired frame
    omega_e: Vec3  # rad/s, body


@jit
def initial(gains: GeometricValues) -> Memory:
    """Return the memory at start, with any gains."""
    return Memory(0)


@jit
def stopped(memory: Memory, reason: int) -> Command:
    """Return the command that stops the motors; a shutdown unless reason is REASON_NONE."""
    return no_thrust(reason, _ZERO, _ZERO)


@jit
def law(state: State, ref: Reference, gains: GeometricValues, vv: VehicleValues) -> Law:
    """
    Evaluate the law at one instant.

    Parameters
    ----------
    state
        Estimate, inertial NED and body FRD.
    ref
        Feasible reference (3.14).
    gains
        From ``GeometricParams.values``.
    vv
        Believed vehicle.

    """
    n, n_dot, n_ddot = thrust_wanted(
        state, ref, gains.k_x, gains.k_v, math.inf, _ZERO, _ZERO, vv)
    q_d, omega_d, omega_d_dot = attitude_of(n, n_dot, n_ddot, ref)
    if not gains.rates:
        omega_d, omega_d_dot = _ZERO, _ZERO
    q_e = error_of(state.q, q_d)
    acceleration = attitude_acceleration(
        q_e, state.omega, omega_d, omega_d_dot, gains.k_R, gains.k_omega)
    return Law(
        vv.mass * dot(n, rotate(state.q, (0.0, 0.0, 1.0))),
        torque(state.omega, acceleration, vv.inertia), n, q_d, omega_d,
        omega_d_dot, sub(state.omega, rotate_inverse(q_e, omega_d)))


@jit
def step(
    memory: Memory, state: State, ref: Reference, dt: float, gains: GeometricValues,
    vv: VehicleValues,
) -> tuple[Memory, Command]:
    """Answer one estimate in flight; arguments and result as of :func:`cascaded.step`."""
    out = law(state, ref, gains, vv)
    wanted = add(sub(out.n, (0.0, 0.0, vv.gravity)), ref.a)
    return memory, flying(
        out.f, out.tau, state, ref, wanted, _ZERO, _ZERO, out.q_d, out.omega_e, vv)
