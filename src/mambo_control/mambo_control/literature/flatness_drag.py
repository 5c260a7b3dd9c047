r"""
Tracking with the feed-forward of differential flatness under rotor drag.

M. Faessler, A. Franchi, D. Scaramuzza, "Differential flatness of quadrotor dynamics subject to
rotor drag for accurate tracking of high-speed trajectories", IEEE Robotics and Automation Letters
3 (2018), arXiv:1712.02402, sections III and IV. In the frames of this package, NED and FRD:

.. math::
    \ddot x &= g e_3 - c b_3 - R D R^T v, \quad D = \mathrm{diag}(d, d, d_z) \\
    b_{3r} &\parallel w = g e_3 - a_r - d v_r, \quad
    \dot w = -j_r - d a_r, \quad \ddot w = -s_r - d j_r \\
    n &= g e_3 - R_r D R_r^T v_r - a_r + k_x e_x + k_v e_v, \quad c = n \cdot b_3 \\
    \omega_d &= \omega_r - k_q \, 2 q_{e,0} \, q_{e,1:3}, \quad
    \tau = J (k_\omega (\omega_d - \omega) + \dot\omega_r) + \omega \times J \omega

with q_e from the body to the attitude that n asks for. The paper has d_x and d_y; the vehicle of
this package has one k_c for both, which makes w the thrust axis itself and replaces the linear
equations of the paper for :math:`\omega_r` and :math:`\dot\omega_r` by derivatives of a direction.

The paper has no integral action, so that a mass 20 % wrong leaves a steady error of
:math:`0.2 g/k_x`, 0.12 m. With ``k_i`` above zero, :math:`\dot I = k_i e_x` is added to n: a
constant disturbance then leaves no error. The linear loop is stable for
:math:`k_i < k_x k_v` (Routh). I rests while the position error is beyond ``reach``.
D is (3.13) at hover thrust: the paper's drag does not grow with the thrust. The term of the paper
that lets thrust grow with the speed is left out, as (3.13) has none.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from mambo_model.compiled import jit, jit_inside
from mambo_model.motion.flatness import Reference, torque
from mambo_model.motion.quaternion import Quat, rotate
from mambo_model.motion.rigid_body import State
from mambo_model.motion.vector import add, direction, dot, norm, scale, sub, Vec3
from mambo_model.schema import quantity
from mambo_model.values import values_type
from mambo_model.vehicle.parameters import VehicleValues

from ..command import Command, no_thrust
from .flight import attitude_of, error_of, FlightLimits, flying, hover_drag

__all__ = [
    'FlatnessDragParams', 'FlatnessDragValues', 'initial', 'Memory', 'reference_with_drag',
    'step', 'stopped']

_ZERO = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class FlatnessDragParams(FlightLimits):
    """Gains of the law, and limits of a flight."""

    k_x: float = quantity(16.0, '1/s^2', 0.01, 400.0, 'judgement: as the geometric law')
    k_v: float = quantity(5.6, '1/s', 0.01, 100.0, 'judgement: as the geometric law')
    reach: float = quantity(
        0.4, 'm', 0.01, 1000.0, 'longest position error that counts: 6.4 m/s^2 (judgement)')
    k_i: float = quantity(
        0.0, '1/s^3', 0.0, 1000.0, 'integral action; 0: none, as the paper; below k_x k_v; 20 '
        'removes a constant error in 1 s (judgement)')
    integral_limit: float = quantity(
        4.0, 'm/s^2', 0.0, 9.0, 'longest I: a mass wrong by 40 % (judgement)')
    k_q: float = quantity(13.0, '1/s', 0.1, 100.0, 'judgement: with k_omega as the geometric law')
    k_omega: float = quantity(33.0, '1/s', 0.1, 300.0, 'judgement: as the geometric law')


FlatnessDragValues = values_type(FlatnessDragParams)


class Memory(NamedTuple):
    """What the law remembers."""

    integral: Vec3  # (3,) m/s^2, inertial NED: I


@jit
def initial(gains: FlatnessDragValues) -> Memory:
    """Return the memory at start, with any gains."""
    return Memory(_ZERO)


@jit
def stopped(memory: Memory, reason: int) -> Command:
    """Return the command that stops the motors; a shutdown unless reason is REASON_NONE."""
    return no_thrust(reason, memory.integral, _ZERO)


@jit
def reference_with_drag(
    ref: Reference, vv: VehicleValues,
) -> tuple[float, Quat, Vec3, Vec3, Vec3]:
    """
    Return what flying the reference takes with the believed drag at hover thrust.

    Parameters
    ----------
    ref
        Position and derivatives; its attitude says the heading.
    vv
        Believed vehicle.

    Returns
    -------
    c : m/s^2
        Thrust over mass.
    q : (4,)
        Body to inertial.
    omega, omega_dot : (3,) rad/s, rad/s^2, body
    drag : (3,) m/s^2, inertial NED
        R_r D R_r^T v_r.

    """
    d, d_z = hover_drag(vv)
    w = sub(sub((0.0, 0.0, vv.gravity), ref.a), scale(d, ref.v))
    w_dot = sub(scale(-1.0, ref.j), scale(d, ref.a))
    w_ddot = sub(scale(-1.0, ref.s), scale(d, ref.j))
    length, b3, _, _ = direction(w, w_dot, w_ddot)
    q, omega, omega_dot = attitude_of(w, w_dot, w_ddot, ref)
    along = (d_z - d) * dot(b3, ref.v)
    return length - along, q, omega, omega_dot, add(scale(d, ref.v), scale(along, b3))


@jit
def advance(integral: Vec3, e_x: Vec3, dt: float, gains: FlatnessDragValues) -> Vec3:
    """
    Return I after a period, (3,) m/s^2, inertial NED; an error beyond ``reach`` leaves it.

    Parameters
    ----------
    integral : (3,) m/s^2, inertial NED
        At the start of the period.
    e_x : (3,) m, inertial NED
        Position minus reference, held over the period.
    dt : s
        Length of the period.
    gains
        k_i, reach and the limit of I.

    """
    if norm(e_x) > gains.reach:
        return integral
    moved = add(integral, scale(gains.k_i * dt, e_x))
    return scale(min(1.0, gains.integral_limit / max(norm(moved), 1e-9)), moved)


@jit_inside
def step(
    memory: Memory, state: State, ref: Reference, dt: float, gains: FlatnessDragValues,
    vv: VehicleValues,
) -> tuple[Memory, Command]:
    """Answer one estimate in flight; arguments and result as of :func:`cascaded.step`."""
    _, _, omega_r, omega_r_dot, drag = reference_with_drag(ref, vv)
    e_x, e_v = sub(state.rho, ref.rho), sub(rotate(state.q, state.nu), ref.v)
    share = min(1.0, gains.reach / max(norm(e_x), 1e-9))
    feedback = add(scale(share * gains.k_x, e_x), scale(gains.k_v, e_v))
    wanted = sub(add(feedback, memory.integral), drag)
    n = add(sub((0.0, 0.0, vv.gravity), ref.a), wanted)
    q_d, _, _ = attitude_of(n, _ZERO, _ZERO, ref)
    q_e = error_of(state.q, q_d)
    omega_d = add(omega_r, scale(-2.0 * gains.k_q * q_e[0], (q_e[1], q_e[2], q_e[3])))
    omega_e = sub(state.omega, omega_d)
    tau = torque(state.omega, sub(omega_r_dot, scale(gains.k_omega, omega_e)), vv.inertia)
    f = vv.mass * dot(n, rotate(state.q, (0.0, 0.0, 1.0)))
    command = flying(f, tau, state, ref, wanted, memory.integral, _ZERO, q_d, omega_e, vv)
    return Memory(advance(memory.integral, e_x, dt, gains)), command
