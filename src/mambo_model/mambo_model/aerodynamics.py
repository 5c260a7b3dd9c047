"""
Aerodynamic forces: parts of the drag (3.4)-(3.10), lumped drag (3.11)-(3.13), ground effect.

V_h = (nu_1, nu_2, 0) is the horizontal velocity of the vehicle in body axes. The parts are forces
on one rotor with its own thrust T and speed Omega; the lumped form is the force on all four. By
(3.11) and (3.12) the T of (3.13) is the thrust of one rotor, f/4 (the default of the vehicle). The
other readings are kept for comparison. The aerodynamic torque of (3.3d) is zero.
"""

from __future__ import annotations

import math

from .compiled import jit
from .motion.quaternion import Quat, rotate_inverse
from .motion.vector import add, norm, sub, Vec3
from .vehicle.parameters import (
    DRAG_ACCELERATION, DRAG_FORCE, DRAG_PER_ROTOR, DRAG_TOTAL, OptionValues, VehicleValues)
from .vehicle.vehicle_options import DragValues, PROFILE_BLADE_ELEMENT, PROFILE_LINEAR, RotorValues

NEAREST = 0.5  # radii above the floor: Cheeseman and Bennett's law does not hold below


@jit
def blade_flapping(thrust: float, nu: Vec3, omega: Vec3, speed: float, p: DragValues) -> Vec3:
    r"""
    Return the force of one rotor whose disc is tilted by flapping (3.4), (3,) N, body FRD.

    .. math:: D_\beta = T (A_{flap} V_h + B_{flap} \omega / \Omega), \quad
              A_{flap} = -\mathrm{diag}(A_{1c}, A_{1c}, 0)

    The sign of A_flap is that of (3.11)-(3.13). B_flap = b (e1 e2^T - e2 e1^T): the disc stays
    behind a turning hub, so nose up pulls forward and right wing down pulls left. Coupling of
    forward and sideward flapping is neglected, as in (3.11).

    Parameters
    ----------
    thrust : N
        Of the rotor.
    nu, omega : (3,) m/s, rad/s, body FRD
        Of the vehicle.
    speed : rad/s
        Of the rotor; one that stands does not flap.
    p
        A_1c ``flapping_velocity`` in s/m, b ``flapping_rate``.

    """
    if not speed > 0.0:
        return (0.0, 0.0, 0.0)
    a, b = p.flapping_velocity, p.flapping_rate / speed
    return (
        thrust * (-a * nu[0] + b * omega[1]), thrust * (-a * nu[1] - b * omega[0]), 0.0)


@jit
def induced_drag(thrust: float, nu: Vec3, k_I: float) -> Vec3:
    """
    Return -T K_I V_h (3.5) of one rotor with stiff blades, (3,) N, body FRD.

    Parameters
    ----------
    thrust : N
        Of the rotor.
    nu : (3,) m/s, body FRD
    k_I : s/m

    """
    return (-thrust * k_I * nu[0], -thrust * k_I * nu[1], 0.0)


@jit
def translational_drag_low(thrust: float, nu: Vec3, k_T1: float) -> Vec3:
    """
    Return -T K_T1 V_h (3.6) of one rotor that bends the stream at low speed, (3,) N, body FRD.

    Parameters
    ----------
    thrust : N
        Of the rotor.
    nu : (3,) m/s, body FRD
    k_T1 : s/m

    """
    return (-thrust * k_T1 * nu[0], -thrust * k_T1 * nu[1], 0.0)


@jit
def translational_drag_high(thrust: float, nu: Vec3, inflow: float, k_T2: float) -> Vec3:
    """
    Return -T K_T2 (v_s + v_i)^4 V_h (3.7) of one rotor at high speed, (3,) N, body FRD.

    Parameters
    ----------
    thrust : N
        Of the rotor.
    nu : (3,) m/s, body FRD
    inflow : m/s
        v_s + v_i, stream and induced velocity down through the rotor.
    k_T2 : s^5/m^5

    """
    squared = inflow * inflow
    k = -thrust * k_T2 * squared * squared
    return (k * nu[0], k * nu[1], 0.0)


@jit
def profile_drag(
    nu: Vec3, speed: float, inflow: float, rotor: RotorValues, p: DragValues, density: float,
) -> Vec3:
    r"""
    Return the profile drag (3.8) of the two blades of one rotor, (3,) N, body FRD.

    .. math:: D_p = -\int_0^R \rho c \left( (c_{d0} + c_{d\alpha} \theta) \Omega r
              - \tfrac12 c_{d\alpha} (v_s + v_i) \right) V_h \, dr

    This is the mean over a revolution for blades with drag coefficient c_d0 + c_d_alpha alpha at
    an incidence alpha = theta - (v_s + v_i)/(Omega r). The printed equation has one r more, which
    makes it a torque, omega for the rotor speed, and neither theta nor the factor of the inflow.
    The drag never acts along V_h: where the inflow would make it negative, it is zero.

    Parameters
    ----------
    nu : (3,) m/s, body FRD
    speed : rad/s
        Omega of the rotor.
    inflow : m/s
        v_s + v_i, down through the rotor.
    rotor, p
        R, c, theta; c_d0 and c_d_alpha.
    density : kg/m^3
        Of the air.

    """
    R = rotor.radius
    zero_lift = 0.5 * (p.profile_zero + p.profile_slope * rotor.pitch) * speed * R * R
    k = -density * rotor.chord * max(0.0, zero_lift - 0.5 * p.profile_slope * inflow * R)
    return (k * nu[0], k * nu[1], 0.0)


@jit
def profile_drag_linear(thrust: float, nu: Vec3, k_p: float) -> Vec3:
    """
    Return -T K_p V_h (3.9), the profile drag of one rotor, (3,) N, body FRD.

    Parameters
    ----------
    thrust : N
        Of the rotor.
    nu : (3,) m/s, body FRD
    k_p : s/m

    """
    return (-thrust * k_p * nu[0], -thrust * k_p * nu[1], 0.0)


@jit
def parasitic_drag(nu: Vec3, K_par: Vec3) -> Vec3:
    """
    Return -|nu| K_par nu (3.10), the drag of the frame, (3,) N, body FRD.

    The printed equation has a factor T, but the drag of the frame does not depend on the thrust.

    Parameters
    ----------
    nu : (3,) m/s, body FRD
        Velocity relative to the air.
    K_par : (3,) kg/m
        Half the air density times the drag area along each axis.

    """
    k = -norm(nu)
    return (k * K_par[0] * nu[0], k * K_par[1] * nu[1], k * K_par[2] * nu[2])


@jit
def induced_velocity(
    thrust: float, horizontal: float, stream: float, radius: float, density: float,
) -> float:
    r"""
    Return the velocity v_i that a rotor gives the air, down through its disc, in m/s.

    .. math:: v_i \sqrt{V_h^2 + (v_s + v_i)^2} = T / (2 \rho \pi R^2)

    Glauert's momentum theory, H. Glauert, ARC R&M 1111 (1926). It does not hold in a descent
    faster than the induced velocity of hover: v_s is cut there.

    Parameters
    ----------
    thrust : N
        Of the rotor; 0 or less moves no air.
    horizontal : m/s
        Length of V_h.
    stream : m/s
        v_s, velocity of the air down through the rotor by the motion of the vehicle: -nu_3.
    radius : m
    density : kg/m^3

    """
    if not thrust > 0.0:
        return 0.0
    hover = math.sqrt(thrust / (2.0 * density * math.pi)) / radius
    mu, s = horizontal / hover, max(stream / hover, -1.0)
    x = max(1.0 - s, 1.0)
    for _ in range(10):  # Newton from above the root: falls on it without overshooting
        through = math.sqrt(mu * mu + (s + x) * (s + x))
        x -= (x * through - 1.0) / (through + x * (s + x) / through)
    return hover * x


@jit
def translational_drag(thrust: float, nu: Vec3, options: OptionValues) -> Vec3:
    """
    Return the translational drag of one rotor, (3,) N, body FRD: (3.6) up to w, (3.7) above.

    If k_T2 is 0, (3.7) is scaled to join (3.6) at w for any thrust. It is zero where no air flows
    down through the rotor.

    Parameters
    ----------
    thrust : N
        Of the rotor.
    nu : (3,) m/s, body FRD
    options
        k_T1, k_T2, w; rotor and air for the induced velocity.

    """
    p, horizontal, stream = options.drag, math.sqrt(nu[0] * nu[0] + nu[1] * nu[1]), -nu[2]
    if horizontal <= p.slow_limit:
        return translational_drag_low(thrust, nu, p.translational_coefficient)
    R, density = options.rotor.radius, options.air_density
    inflow = stream + induced_velocity(thrust, horizontal, stream, R, density)
    if p.translational_fast > 0.0:
        return translational_drag_high(thrust, nu, inflow, p.translational_fast)
    at_limit = stream + induced_velocity(thrust, p.slow_limit, stream, R, density)
    share = inflow / at_limit if at_limit > inflow > 0.0 else 0.0
    return translational_drag_high(thrust, nu, share, p.translational_coefficient)


@jit
def rotor_drag(
    thrust: float, speed: float, nu: Vec3, omega: Vec3, options: OptionValues,
) -> Vec3:
    """
    Return the sum of the parts of (3.12) that are switched on, for one rotor, (3,) N, body FRD.

    Parameters
    ----------
    thrust, speed : N, rad/s
        Of the rotor.
    nu, omega : (3,) m/s, rad/s, body FRD
        Of the vehicle.
    options
        Of the vehicle.

    """
    p, out = options.drag, (0.0, 0.0, 0.0)
    if p.blade_flapping:
        out = add(out, blade_flapping(thrust, nu, omega, speed, p))
    if p.induced:
        out = add(out, induced_drag(thrust, nu, p.induced_coefficient))
    if p.translational:
        out = add(out, translational_drag(thrust, nu, options))
    if p.profile == PROFILE_LINEAR:
        out = add(out, profile_drag_linear(thrust, nu, p.profile_coefficient))
    elif p.profile == PROFILE_BLADE_ELEMENT:
        horizontal, density = math.sqrt(nu[0] * nu[0] + nu[1] * nu[1]), options.air_density
        inflow = -nu[2] + induced_velocity(
            thrust, horizontal, -nu[2], options.rotor.radius, density)
        out = add(out, profile_drag(nu, speed, inflow, options.rotor, p, density))
    return out


@jit
def through_air(nu: Vec3, q: Quat, wind: Vec3 | None) -> Vec3:
    """
    Return the velocity relative to the air, (3,) m/s, body FRD: the one that meets drag.

    Parameters
    ----------
    nu : (3,) m/s, body FRD
    q
        Attitude.
    wind : (3,) m/s, inertial NED
        Velocity of the air; None: it is still.

    """
    if wind is None:
        return nu
    return sub(nu, rotate_inverse(q, wind))


@jit
def lumped_drag(nu: Vec3, f: float, vv: VehicleValues) -> Vec3:
    """
    Return the drag force F_D = -T K_c V (3.13), (3,) N, body FRD.

    Parameters
    ----------
    nu : (3,) m/s, body FRD
        Velocity; K_c = diag(k_c, k_c, k_z); the printed equation has no k_z.
    f : N
        Total thrust of the four rotors.
    vv
        Vehicle; ``drag_reading`` selects T: f/4, f, 1 (k_c in kg/s) or the mass (k_c in 1/s).
        k_z is ``vertical_drag_coefficient``, 0 by default.

    """
    if vv.drag_reading == DRAG_PER_ROTOR:
        t = 0.25 * f
    elif vv.drag_reading == DRAG_TOTAL:
        t = f
    elif vv.drag_reading == DRAG_FORCE:
        t = 1.0
    elif vv.drag_reading == DRAG_ACCELERATION:
        t = vv.mass
    else:
        t = 0.0
    k = -t * vv.drag_coefficient
    if vv.vertical_drag_coefficient > 0.0:
        return (k * nu[0], k * nu[1], -t * vv.vertical_drag_coefficient * nu[2])
    return (k * nu[0], k * nu[1], 0.0)


@jit
def ground_effect(height: float, radius: float) -> float:
    """
    Return the thrust of a rotor near the floor over that far from it, at equal power, >= 1.

    It is 1/(1 - (R/(4 z))^2) in hover: I. C. Cheeseman, W. E. Bennett, ARC R&M 3021 (1955).

    Parameters
    ----------
    height : m
        Height z of the rotor above the floor; below half a radius the factor stays constant.
    radius : m
        R.

    """
    ratio = 0.25 * radius / max(height, NEAREST * radius)
    return 1.0 / (1.0 - ratio * ratio)
