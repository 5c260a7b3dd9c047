"""
Desired thrust direction and the attitude that follows from it, (3.21)-(3.24) and Appendix A.

The direction f_d is a unit vector in the frame R of the reference. A direction opposite to the
reference's own thrust is singular; it cannot occur while the reference acceleration stays below g
minus the bound of the virtual input (4.26 m/s^2 with the gains of section 3.4).
"""

from __future__ import annotations

from mambo_model.compiled import jit
from mambo_model.motion.flatness import minimal_rotation, Reference
from mambo_model.motion.quaternion import Quat, rotate_inverse
from mambo_model.motion.vector import cross, direction, sub, Vec3

from .gains import GainValues, NO_ACCELERATION, NO_RATES

_ZERO = (0.0, 0.0, 0.0)


@jit
def desired_direction(
    n: Vec3, n_dot: Vec3, n_ddot: Vec3, ref: Reference,
) -> tuple[Vec3, Vec3, Vec3]:
    """
    Turn the demanded thrust into the frame of the reference and normalise it, (3.21).

    Parameters
    ----------
    n, n_dot, n_ddot : (3,) m/s^2, m/s^3, m/s^4, inertial NED
        (f_r b3 + m u)/m and its time derivatives.
    ref
        Its attitude and rates carry the frame R.

    Returns
    -------
    f_d, f_d_dot, f_d_ddot : (3,) 1, 1/s, 1/s^2, frame R

    """
    w = ref.omega
    x, turned = rotate_inverse(ref.q, n), rotate_inverse(ref.q, n_dot)
    x_dot = sub(turned, cross(w, x))
    x_ddot = sub(sub(sub(rotate_inverse(ref.q, n_ddot), cross(w, turned)),
                     cross(ref.omega_dot, x)), cross(w, x_dot))
    _, f_d, f_d_dot, f_d_ddot = direction(x, x_dot, x_ddot)
    return f_d, f_d_dot, f_d_ddot


@jit
def desired_attitude(
    f_d: Vec3, f_d_dot: Vec3, f_d_ddot: Vec3, gains: GainValues,
) -> tuple[Quat, Vec3, Vec3]:
    """
    Return the least rotation that turns e3 onto f_d (3.23), and its rates (3.24).

    Parameters
    ----------
    f_d, f_d_dot, f_d_ddot : (3,) 1, 1/s, 1/s^2, frame R
        Desired thrust direction.
    gains
        Its ``derivatives`` leaves out the acceleration, or rate and acceleration.

    Returns
    -------
    q_d : (4,)
        Desired frame D to R: ``rotate(q_d, e3) = f_d``.
    omega_d, omega_d_dot : (3,) rad/s, rad/s^2, of D relative to R, in D

    """
    q_d, omega_d, omega_d_dot = minimal_rotation(f_d, f_d_dot, f_d_ddot)
    if gains.derivatives == NO_ACCELERATION:
        return q_d, omega_d, _ZERO
    if gains.derivatives == NO_RATES:
        return q_d, _ZERO, _ZERO
    return q_d, omega_d, omega_d_dot
