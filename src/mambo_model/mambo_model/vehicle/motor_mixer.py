"""
Motor map and mixer: PWM to thrust and back (4.5)-(4.7), thrusts to force and torque (3.2), (4.4).

The module also has the fading of thrust, and the speed and angular momentum of the rotors.

Motors 1 to 4 are front left, front right, rear right, rear left; 1 and 3 turn clockwise seen from
above. The inverse of (3.2) takes [f, roll, pitch, yaw]; (4.4) as printed has other columns.
"""

from __future__ import annotations

import math

from ..arithmetic.exponential import exp, power
from ..compiled import jit
from ..motion.vector import Vec3
from .parameters import THRUST_LINEAR, VehicleValues
from .vehicle_options import FadeValues, RotorValues

Four = tuple[float, float, float, float]


@jit
def thrust_from_pwm(pwm: float, vv: VehicleValues) -> float:
    """Return the thrust of one motor in N by (4.5) or the linear map; 0 for pwm <= 0."""
    if pwm <= 0.0:
        return 0.0
    if vv.thrust_map == THRUST_LINEAR:
        return pwm / vv.linear_gain
    return vv.power_a * power(pwm, vv.power_b)


@jit
def pwm_from_thrust(thrust: float, vv: VehicleValues) -> float:
    """
    Return the PWM of one motor for a thrust in N by (4.7) or the linear map; 0 for thrust <= 0.

    The result is not limited: see :func:`limit_pwm`.
    """
    if thrust <= 0.0:
        return 0.0
    if vv.thrust_map == THRUST_LINEAR:
        return thrust * vv.linear_gain
    return power(thrust / vv.power_a, 1.0 / vv.power_b)


@jit
def limit_pwm(pwm: float, vv: VehicleValues) -> float:
    """Return pwm limited to [pwm_min, pwm_max]; NaN stays NaN."""
    if pwm < vv.pwm_min:
        return vv.pwm_min
    if pwm > vv.pwm_max:
        return vv.pwm_max
    return pwm


@jit
def mix(thrust: Four, vv: VehicleValues) -> tuple[float, Vec3]:
    """
    Return total thrust along -b3 in N and torque in N m, body FRD, of four thrusts in N (3.2).

    A rotor at (x, y) with thrust T gives the torque (-y T, x T).
    """
    t1, t2, t3, t4 = thrust
    return t1 + t2 + t3 + t4, (
        vv.arm * (t1 - t2 - t3 + t4),
        vv.arm * (t1 + t2 - t3 - t4),
        vv.yaw_ratio * (-t1 + t2 - t3 + t4))


@jit
def allocate(f: float, tau: Vec3, vv: VehicleValues) -> Four:
    """
    Return the four motor thrusts in N that give f in N and tau in N m, body FRD.

    This is the inverse of (3.2), (4.4) with its columns in the order of (3.2). Thrusts can be
    negative.
    """
    quarter = 0.25 * f
    roll = 0.25 * tau[0] / vv.arm
    pitch = 0.25 * tau[1] / vv.arm
    yaw = 0.25 * tau[2] / vv.yaw_ratio
    return (
        quarter + roll + pitch - yaw,
        quarter - roll + pitch + yaw,
        quarter - roll - pitch - yaw,
        quarter + roll - pitch + yaw)


@jit
def faded(lost: float, pwm: float, dt: float, p: FadeValues) -> float:
    """
    Return the share of its thrust that a motor has lost after dt s, in [0, 1).

    Above the command ``p.pwm`` it tends to ``p.loss``, below to 0, both with the same time
    constant (thesis sec. 4.4.2). A command of NaN counts as below.

    Parameters
    ----------
    lost
        Share lost at the start.
    pwm : PWM
        Command, constant over dt.
    dt : s
    p
        Threshold, final loss, time constant.

    """
    end = p.loss if pwm > p.pwm else 0.0
    return end + (lost - end) * exp(-dt / p.time_constant)


@jit
def rotor_speed(thrust: float, rotor: RotorValues) -> float:
    """Return the speed of one rotor far from the floor, rad/s: T = k Omega^2 with T in N."""
    return math.sqrt(max(thrust, 0.0) / rotor.speed_coefficient)


@jit
def rotor_momentum(thrust: Four, rotor: RotorValues) -> float:
    """
    Return the angular momentum of the four rotors about b3, in N m s, from thrusts (4,) N.

    Seen from above, 1 and 3 turn clockwise, which is positive about the downward b3.
    """
    return rotor.inertia * (
        rotor_speed(thrust[0], rotor) - rotor_speed(thrust[1], rotor)
        + rotor_speed(thrust[2], rotor) - rotor_speed(thrust[3], rotor))
