"""
Checks of the samples of a step, before any filter compares them with its state.

Shared by the filters; holds no equation of the thesis.
"""

from __future__ import annotations


from mambo_model.compiled import jit
from mambo_model.motion.vector import add, Vec3

from . import imu
from .. import health
from ..blocks import Vec2
from ..health import Five, Sensors
from .imu import ImuValues


@jit
def stuck_sensors(
    s: Sensors, flying: bool, equal: int, gyro: Vec3, accel: Vec3, sonar: float, flow: Vec2,
    pressure: float, v,
) -> Five:
    """
    Return for each sensor whether it is stuck, repeating its value for too long.

    Only in flight: on the floor and without noise all values may be constant, which is assumed if
    the gyro is constant.

    Parameters
    ----------
    s
        Memory of the sensors.
    flying
        Whether the vehicle is aligned and has moved.
    equal
        Rates in a row that equalled the one before, this one included.
    gyro, accel, sonar, flow, pressure
        As of the filters' step.
    v
        Values of a filter: ``imu``, ``sonar``, ``optical_flow`` and ``barometer``.

    """
    if not flying:
        return (False, False, False, False, False)
    turning = imu.is_stuck(equal, gyro, v.imu)
    alive = equal < v.imu.stuck_samples and v.imu.stuck_samples > 0
    forces = health.repeats(s.accel, accel) if alive else 0
    ranges = health.repeats(s.sonar, (sonar, sonar, sonar)) if alive else 0
    flows = health.repeats(s.flow, (flow[0], flow[1], flow[1])) if alive else 0
    pressures = health.repeats(s.barometer, (pressure, pressure, pressure)) if alive else 0
    moving = flow[0] != 0.0 or flow[1] != 0.0
    return (
        turning, forces >= v.imu.stuck_samples > 0,
        ranges >= v.sonar.stuck_samples > 0 and sonar >= v.sonar.min_range,
        flows >= v.optical_flow.stuck_samples > 0 and moving,
        pressures >= v.barometer.stuck_samples > 0)


@jit
def usable_inertial(
    s: Sensors, dt: float, gyro: Vec3, accel: Vec3, stuck: Five, p: ImuValues,
) -> tuple[bool, bool]:
    """Return for gyro and accelerometer whether their samples may be integrated."""
    return (
        imu.is_within(gyro, p.gyro_range) and not stuck[0]
        and health.roughness(s.gyro, gyro, dt) <= p.gyro_roughness * p.gyro_roughness,
        imu.is_within(accel, p.accel_range) and not stuck[1]
        and health.roughness(s.accel, accel, dt) <= p.accel_roughness * p.accel_roughness)


@jit
def bridged(
    s: Sensors, dt: float, gyro: Vec3, accel: Vec3, usable: tuple[bool, bool],
    last: tuple[Vec3, Vec3], bias: tuple[Vec3, Vec3], gravity: float, p: ImuValues,
) -> tuple[Vec3, Vec3]:
    """
    Return the values that are integrated instead of an unusable inertial sample.

    These are the previous sample. If the sensor reads random values, the previous sample is random
    too, and zero rate and the specific force of hover are used.
    """
    if not usable[0]:
        wild = health.roughness(s.gyro, gyro, dt) > p.gyro_roughness * p.gyro_roughness
        gyro = bias[0] if wild else last[0]
    if not usable[1]:
        wild = health.roughness(s.accel, accel, dt) > p.accel_roughness * p.accel_roughness
        accel = add(bias[1], (0.0, 0.0, -gravity)) if wild else last[1]
    return gyro, accel
