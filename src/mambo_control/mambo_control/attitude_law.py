"""Inner loop (3.25)-(3.29): attitude error, rate error and torque."""

from __future__ import annotations

from mambo_model.compiled import jit
from mambo_model.motion.flatness import Reference, torque as rigid_torque
from mambo_model.motion.quaternion import conjugate, multiply, Quat, rotate, rotate_inverse
from mambo_model.motion.rigid_body import State
from mambo_model.motion.vector import add, cross, scale, sub, Vec3
from mambo_model.vehicle.parameters import VehicleValues

from .gains import GainValues


@jit
def alignment(q_e: Quat, k: Vec3) -> Vec3:
    r"""
    Return the attitude term of (3.29), (3,), body, with q_e* in place of the printed q_e.

    .. math:: \sum_i k_i \, e_i \times (q_e^* \odot e_i)

    With the printed q_e the term has the sign of positive feedback and the loop diverges;
    (3.30f) has the form used here.

    Parameters
    ----------
    q_e : (4,)
        Attitude error (3.25), unit.
    k : (3,)
        Weights k_1, k_2, k_3, distinct and positive.

    """
    _, x2, x3 = rotate_inverse(q_e, (1.0, 0.0, 0.0))
    y1, _, y3 = rotate_inverse(q_e, (0.0, 1.0, 0.0))
    z1, z2, _ = rotate_inverse(q_e, (0.0, 0.0, 1.0))
    return (k[1] * y3 - k[2] * z2, k[2] * z1 - k[0] * x3, k[0] * x2 - k[1] * y1)


@jit
def attitude_error(q: Quat, q_r: Quat, q_d: Quat) -> Quat:
    """Return q_e = q_d* q_r* q of (3.25), (4,): body to the desired frame D."""
    return multiply(conjugate(q_d), multiply(conjugate(q_r), q))


@jit
def rate_error(state: State, ref: Reference, q_e: Quat, omega_d: Vec3) -> Vec3:
    """Return omega_e of (3.26), (3,) rad/s, body."""
    A = multiply(conjugate(state.q), ref.q)
    return sub(sub(state.omega, rotate(A, ref.omega)), rotate_inverse(q_e, omega_d))


@jit
def torque(
    state: State, ref: Reference, q_d: Quat, omega_d: Vec3, omega_d_dot: Vec3, q_e: Quat,
    omega_e: Vec3, gains: GainValues, vv: VehicleValues,
) -> Vec3:
    """
    Return tau of (3.29), (3,) N m, body FRD, which gives the rate error the dynamics (3.30f).

    Parameters
    ----------
    state, ref
        Estimate and reference; attitude and rates are used.
    q_d, omega_d, omega_d_dot : (4,), (3,) rad/s, (3,) rad/s^2
        Desired attitude relative to the reference, its rate and acceleration in D.
    q_e, omega_e : (4,), (3,) rad/s, body
        Errors (3.25) and (3.26).
    gains
        K_omega and K_R are its ``k_omega`` and ``k_R`` times the believed inertia.
    vv
        Believed vehicle.

    """
    omega = state.omega
    A = multiply(conjugate(state.q), ref.q)
    feedback = sub(scale(gains.k_R, alignment(q_e, gains.k)), scale(gains.k_omega, omega_e))
    desired = sub(cross(omega_d, rotate_inverse(q_d, ref.omega)), omega_d_dot)
    turning = cross(omega_e, sub(omega, omega_e))
    acceleration = sub(sub(add(feedback, rotate(A, ref.omega_dot)),
                           rotate_inverse(q_e, desired)), turning)
    return rigid_torque(omega, acceleration, vv.inertia)
