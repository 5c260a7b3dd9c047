r"""
Specific force while the accelerometer cannot be used.

In controlled flight a force returns to that of hover with the time constant T = `held_time`,

    a = e + (a_last - e) exp(-t / T),    e_xy = b_xy + k_xy s nu_xy,  e_z = b_z + s,  s = -g / c

with c = cos(phi) cos(theta), the drag coefficients k of (3.13) and the biases b of the filter. A
last sample that was repeated is too old, one of random readings says nothing: then a = e.

A sensor that repeats itself or reads random numbers is found only after some samples, which were
integrated as if they were right. The velocity is then wrong by their integral.
"""

from __future__ import annotations

from mambo_model.arithmetic.exponential import exp
from mambo_model.compiled import jit
from mambo_model.motion.quaternion import rotate_inverse, to_matrix
from mambo_model.motion.vector import add, scale, sub, Vec3

from .. import health
from ..health import Sensor
from .joint_parameters import JointValues
from .state import Nominal

STEEPEST = 0.5   # cosine of the largest tilt at which the thrust is taken to carry the weight


@jit
def expected(
    x: Nominal, last: Vec3, s: Sensor, accel: Vec3, stuck: bool, dt: float, v: JointValues,
) -> Vec3:
    """
    Return what the accelerometer would read, (3,) m/s^2, body FRD.

    Parameters
    ----------
    x
        State.
    last : (3,) m/s^2, body FRD
        What was integrated in the step before.
    s
        Memory of the accelerometer.
    accel : (3,) m/s^2, body FRD
        Sample that cannot be used.
    stuck
        Whether it is one of too many equal ones.
    dt : s
    v
        Time constant, gravity, and whether the accelerometer reads drag.

    """
    wild = health.roughness(s, accel, dt) > v.imu.accel_roughness * v.imu.accel_roughness
    kept = 0.0 if stuck or wild else exp(-dt / v.motion.held_time)
    thrust = -v.gravity / max(to_matrix(x.q)[2][2], STEEPEST)
    drag = scale(thrust if v.drag.enabled else 0.0, rotate_inverse(x.q, x.v))
    there = add(x.accel_bias, (x.drag[0] * drag[0], x.drag[1] * drag[1], thrust))
    return add(there, scale(kept, sub(last, there)))


@jit
def trusted(s: Sensor, accel: Vec3, stuck: bool, dt: float, v: JointValues) -> float:
    """
    Return the variance of each velocity by wrong samples that were believed, m^2/s^2.

    It is zero but for the step at which a fault is found. Repeated samples were wrong by the noise
    of a held force for as long as they were counted. Random ones have half the variance of their
    differences, over three axes, for the time over which that is averaged.

    Parameters
    ----------
    s
        Memory of the accelerometer.
    accel : (3,) m/s^2, body FRD
        Sample that cannot be used.
    stuck
        Whether it is one of too many equal ones.
    dt : s
    v
        Noise and number of equal samples.

    """
    if s.fault != health.GOOD or not health.is_finite(accel):
        return 0.0
    if stuck:
        held = v.motion.held_accel_noise
        return held * held * v.imu.stuck_samples * dt
    return health.roughness(s, accel, dt) / 6.0 * dt * health.ROUGH_TIME
