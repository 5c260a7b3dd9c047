"""
Inertial measurement unit: which samples may be integrated.

The gyro reads the body rate plus a bias; the accelerometer reads the specific force
``(F_D - f e_3) / m`` in body axes plus a bias (C19), which excludes gravity. Both drive the
filters' predictions, so there is no innovation to gate: each sample is checked by itself.
"""

from __future__ import annotations

from dataclasses import dataclass

from mambo_model.compiled import jit
from mambo_model.motion.vector import Vec3
from mambo_model.schema import quantity
from mambo_model.values import Parameters, values_type


@dataclass(frozen=True)
class ImuParams(Parameters):
    """Limits of the inertial sensors."""

    gyro_range: float = quantity(
        35.0, 'rad/s', 1.0, 1e3, 'no reading beyond: range of common sensors, 2000 deg/s')
    accel_range: float = quantity(
        160.0, 'm/s^2', 20.0, 1e4, 'no reading beyond: range of common sensors, 16 g')
    stuck_samples: int = quantity(
        20, '-', 0, 100000,
        'in flight, so many equal rates or forces mean a dead sensor; 0: never')
    max_interval: float = quantity(
        0.02, 's', 1e-3, 10.0, 'after a longer one samples are missing: noise as if held')
    max_gap: float = quantity(
        1.0, 's', 0.01, 100.0, 'a longer interval is integrated only so far, and counted')
    gyro_roughness: float = quantity(
        10.0, 'rad/s', 0.1, 1e3,
        'a larger rms change from sample to sample is no motion: the motors can turn the Mambo by '
        '2.5 rad/s in 5 ms')
    accel_roughness: float = quantity(
        30.0, 'm/s^2', 1.0, 1e4,
        'likewise: 2 to 8 by vibration, 25 by a hard landing, 55 with random readings')


ImuValues = values_type(ImuParams)


@jit
def is_within(x: Vec3, limit: float) -> bool:
    """Return whether a sample is in range: every number at most ``limit``; NaN is refused."""
    return abs(x[0]) <= limit and abs(x[1]) <= limit and abs(x[2]) <= limit


@jit
def is_equal(a: Vec3, b: Vec3) -> bool:
    """Return whether two readings are equal, number by number."""
    return a[0] == b[0] and a[1] == b[1] and a[2] == b[2]


@jit
def is_stuck(equal: int, gyro: Vec3, v: ImuValues) -> bool:
    """
    Return whether a gyro that repeats its rate counts as dead.

    A rate of exactly zero does not: a simulated sensor without noise reads it in hover.

    Parameters
    ----------
    equal
        Rates in a row that equalled the one before, this one included.
    gyro : (3,) rad/s, body FRD
    v
        Number at which the gyro counts as dead.

    """
    turning = gyro[0] != 0.0 or gyro[1] != 0.0 or gyro[2] != 0.0
    return turning and equal >= v.stuck_samples > 0
