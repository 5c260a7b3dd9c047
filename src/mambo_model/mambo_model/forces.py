"""
Forces on a vehicle with options: thrust, drag by parts, ground effect and rotor inertia.

The module contains (3.2) and (3.13) and the effects that they neglect. Motors 1 to 4 are front
left, front right, rear right, rear left; 1 and 3 turn clockwise seen from above, which is
positive about b3.
"""

from __future__ import annotations

from typing import NamedTuple

from .aerodynamics import ground_effect, lumped_drag, parasitic_drag, rotor_drag, through_air
from .compiled import jit
from .motion.quaternion import Quat, rotate_inverse
from .motion.rigid_body import add_scaled, controlled, derivative, finished, State
from .motion.vector import add, Vec3
from .vehicle.motor_mixer import Four, mix, rotor_momentum, rotor_speed
from .vehicle.parameters import OptionValues, VehicleValues

PARTS = (6.0, 3.0, 3.0, 6.0)  # of a Runge-Kutta step, for which its four rates count
STAGES = (0.5, 0.5, 1.0, 0.0)  # where in the step the next rate is taken, the last one nowhere


class Rotors(NamedTuple):
    """Thrusts and angular momentum of the rotors over one integration step."""

    thrust: Four            # (4,) N, motors 1 to 4, mean, as if far from the floor
    momentum: float         # N m s, angular momentum about b3 of all four, mean
    momentum_rate: float    # N m, its mean derivative


class Forces(NamedTuple):
    """Thrust, torque and drag, the inputs of (3.3)."""

    f: float    # N, along -b3
    tau: Vec3   # (3,) N m, body FRD
    F_D: Vec3   # (3,) N, body FRD


@jit
def rotors_in_step(
    mean: Four, before: Four, after: Four, h: float, options: OptionValues,
) -> Rotors:
    """
    Return thrusts and angular momentum over a step of h seconds, from thrusts in N, (4,) each.

    The mean derivative of the angular momentum is its exact change over the step, divided by h.
    """
    rotor = options.rotor
    if not rotor.torques:
        return Rotors(mean, 0.0, 0.0)
    change = rotor_momentum(after, rotor) - rotor_momentum(before, rotor)
    return Rotors(mean, rotor_momentum(mean, rotor), change / h)


@jit
def lift(thrust: Four, rho: Vec3, q: Quat, arm: float, options: OptionValues) -> Four:
    """
    Return the thrusts with ground effect, evaluated at the height of each rotor, (4,) N.

    Parameters
    ----------
    thrust : (4,) N
        Thrusts without ground effect.
    rho : (3,) m, inertial NED
        Position of the vehicle; on the floor rho_z = 0.
    q
        Attitude; upside down there is no ground effect.
    arm : m
        Distance of the rotors from the body x and y axes.
    options
        Options of the vehicle.

    """
    down, R = rotate_inverse(q, (0.0, 0.0, 1.0)), options.rotor.radius
    if down[2] <= 0.0:
        return thrust
    z = options.ground_effect.rotor_height * down[2] - rho[2]
    x, y = arm * down[0], arm * down[1]
    return (
        thrust[0] * ground_effect(z - x + y, R), thrust[1] * ground_effect(z - x - y, R),
        thrust[2] * ground_effect(z + x - y, R), thrust[3] * ground_effect(z + x + y, R))


@jit
def drag(
    nu: Vec3, omega: Vec3, thrust: Four, lifts: Four, vv: VehicleValues, options: OptionValues,
) -> Vec3:
    """
    Return the sum of all drag parts that are switched on, (3,) N, body FRD.

    Parameters
    ----------
    nu, omega : (3,) m/s, rad/s, body FRD
        Velocity relative to the air and angular velocity of the vehicle.
    thrust, lifts : (4,) N
        Thrusts without ground effect, which determine the rotor speeds, and with it.
    vv, options
        The vehicle.

    """
    out = lumped_drag(nu, lifts[0] + lifts[1] + lifts[2] + lifts[3], vv)
    for j in range(4):
        speed = rotor_speed(thrust[j], options.rotor)
        out = add(out, rotor_drag(lifts[j], speed, nu, omega, options))
    if options.drag.parasitic:
        out = add(out, parasitic_drag(nu, options.drag.parasitic_coefficient))
    return out


@jit
def forces(
    body: State, rotors: Rotors, vv: VehicleValues, options: OptionValues, floor: bool,
    wind: Vec3 | None = None,
) -> Forces:
    r"""
    Return thrust, torque and drag on a vehicle.

    The gyroscopic torque of the rotors and the torque that accelerates them are added to (3.2):

    .. math:: -\omega \times h e_3 - \dot h e_3, \quad h = J_r \sum s_j \Omega_j

    Without thrust, R (J omega + h e3) is therefore constant. Ground effect is taken at equal
    power: it raises the thrusts but not their yaw torques.

    Parameters
    ----------
    body
        State of the vehicle.
    rotors
        Thrusts and angular momentum of the rotors.
    vv, options
        The vehicle.
    floor
        Whether there is a floor at rho_z = 0.
    wind : (3,) m/s, inertial NED
        Velocity of the air; None: still air.

    """
    lifts = rotors.thrust
    f, tau = mix(lifts, vv)
    if floor and options.ground_effect.enabled:
        lifts = lift(rotors.thrust, body.rho, body.q, vv.arm, options)
        f, (roll, pitch, _) = mix(lifts, vv)
        tau = (roll, pitch, tau[2])
    nu = through_air(body.nu, body.q, wind)
    F_D = drag(nu, body.omega, rotors.thrust, lifts, vv, options)
    h, omega = rotors.momentum, body.omega
    spin = (-omega[1] * h, omega[0] * h, -rotors.momentum_rate)
    return Forces(f, add(tau, spin), F_D)


@jit
def rk4_step(
    state: State, rotors: Rotors, h: float, vv: VehicleValues, options: OptionValues, floor: bool,
    norm_gain: float | None = None, wind: Vec3 | None = None,
) -> State:
    """
    Advance (3.3) by h seconds as ``rigid_body.rk4_step`` does, with every force of this module.

    Parameters
    ----------
    state
        State at the start of the step.
    rotors
        Thrusts and angular momentum, constant over the step.
    h : s
        Length of the step.
    vv, options
        The vehicle.
    floor
        Whether there is a floor at rho_z = 0.
    norm_gain, wind
        As for ``rigid_body.rk4_step``.

    """
    end = at = state
    for i in range(4):
        f, tau, F_D = forces(at, rotors, vv, options, floor, wind)
        rate = derivative(at, f, tau, F_D, (0.0, 0.0, 0.0), vv)
        rate = controlled(rate, at.q, norm_gain)
        end = add_scaled(end, rate, h / PARTS[i])
        at = add_scaled(state, rate, STAGES[i] * h)
    return finished(end, norm_gain)
