"""Believed drag as an acceleration, for the virtual input (thesis chapter 7)."""

from __future__ import annotations

from mambo_model.aerodynamics import lumped_drag
from mambo_model.compiled import jit
from mambo_model.motion.flatness import body_velocity, Reference
from mambo_model.motion.quaternion import rotate, rotate_inverse
from mambo_model.motion.rigid_body import State
from mambo_model.motion.vector import add, cross, dot, norm, scale, sub, Vec3
from mambo_model.vehicle.parameters import VehicleValues

from .gains import GainValues


@jit
def drag_acceleration(state: State, f: float, vv: VehicleValues) -> Vec3:
    """
    Return F_D/m of the present motion by (3.13), (3,) m/s^2, inertial NED.

    Parameters
    ----------
    state
        Estimate: attitude and body velocity.
    f : N
        Total thrust, which the readings of (3.13) may scale with.
    vv
        Believed vehicle.

    """
    return scale(1.0 / vv.mass, rotate(state.q, lumped_drag(state.nu, f, vv)))


@jit
def _by_thrust(nu: Vec3, f_dot: float, vv: VehicleValues) -> Vec3:
    """Return the part of the drag's rate that a change of thrust causes; drag is affine in f."""
    return sub(lumped_drag(nu, f_dot, vv), lumped_drag(nu, 0.0, vv))


@jit
def reference_drag_rates(ref: Reference, vv: VehicleValues) -> tuple[Vec3, Vec3]:
    """
    Return the first two time derivatives of the drag acceleration of the reference motion.

    They stand for those of the flown motion, which would need the angular acceleration that
    the controller is about to command. The thrust of the reference is taken for the believed
    mass, whatever mass the reference was made with.

    Parameters
    ----------
    ref
        All its derivatives are used.
    vv
        Believed vehicle.

    Returns
    -------
    first, second : (3,) m/s^3, m/s^4, inertial NED

    """
    a_R, w, w_dot = rotate_inverse(ref.q, ref.a), ref.omega, ref.omega_dot
    nu = body_velocity(ref)
    nu_dot = sub(a_R, cross(w, nu))
    nu_ddot = sub(sub(sub(rotate_inverse(ref.q, ref.j), cross(w, a_R)), cross(w_dot, nu)),
                  cross(w, nu_dot))
    b3 = rotate(ref.q, (0.0, 0.0, 1.0))
    b3_dot = rotate(ref.q, (w[1], -w[0], 0.0))
    f = vv.mass * norm(sub((0.0, 0.0, vv.gravity), ref.a))
    f_dot = -vv.mass * dot(b3, ref.j)
    f_ddot = -vv.mass * (dot(b3_dot, ref.j) + dot(b3, ref.s))
    drag = lumped_drag(nu, f, vv)
    drag_dot = add(lumped_drag(nu_dot, f, vv), _by_thrust(nu, f_dot, vv))
    drag_ddot = add(add(lumped_drag(nu_ddot, f, vv), scale(2.0, _by_thrust(nu_dot, f_dot, vv))),
                    _by_thrust(nu, f_ddot, vv))
    turning = cross(w, drag)
    first = add(drag_dot, turning)
    second = add(add(drag_ddot, scale(2.0, cross(w, drag_dot))),
                 add(cross(w_dot, drag), cross(w, turning)))
    return (scale(1.0 / vv.mass, rotate(ref.q, first)),
            scale(1.0 / vv.mass, rotate(ref.q, second)))


@jit
def drag_jet(
    state: State, ref: Reference, f: float, gains: GainValues, vv: VehicleValues,
) -> tuple[Vec3, Vec3, Vec3]:
    """
    Return what the virtual input has to add for the drag, and its first two derivatives.

    Parameters
    ----------
    state, ref
        The value is that of the estimated motion, the derivatives those of the reference motion.
    f : N
        Total thrust demanded without drag; it differs from the final one by the square of drag
        over weight.
    gains
        All three are zero unless its ``drag_feedforward`` is set.
    vv
        Believed vehicle.

    Returns
    -------
    drag, drag_dot, drag_ddot : (3,) m/s^2, m/s^3, m/s^4, inertial NED

    """
    if not gains.drag_feedforward:
        return (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    first, second = reference_drag_rates(ref, vv)
    return drag_acceleration(state, f, vv), first, second
