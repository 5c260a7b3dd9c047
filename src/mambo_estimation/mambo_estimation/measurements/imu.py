"""
Inertial measurement unit: which samples may be integrated.

The gyro reads the body rate plus a bias; the accelerometer reads the specific force
``(F_D - f e_3) / m`` in body axes plus a bias (C19), gravity not among it. Both drive the filters'
predictions, so there is no innovation to gate: a sample is judged by itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from mambo_model.compiled import jit
from mambo_model.schema import check, quantity, values
from mambo_model.vector import Vec3


class ImuValues(NamedTuple):
    """:class:`ImuParams` as compiled code reads them."""

    gyro_range: float
    accel_range: float
    stuck_samples: int
    max_interval: float
    max_gap: float


@dataclass(frozen=True)
class ImuParams:
    """What the filters believe of the inertial sensors."""

    gyro_range: float = quantity(
        35.0, 'rad/s', 1.0, 1e3, 'no reading beyond: range of common sensors, 2000 deg/s')
    accel_range: float = quantity(
        160.0, 'm/s^2', 20.0, 1e4, 'no reading beyond: range of common sensors, 16 g')
    stuck_samples: int = quantity(
        20, '-', 0, 100000, 'in flight, so many equal rates mean a dead sensor; 0: never')
    max_interval: float = quantity(
        0.02, 's', 1e-3, 10.0, 'after a longer one samples are missing: noise as if held')
    max_gap: float = quantity(
        1.0, 's', 0.01, 100.0, 'a longer interval is integrated only so far, and counted')

    def __post_init__(self) -> None:
        check(self)

    def values(self) -> ImuValues:
        """Return what compiled code reads."""
        return ImuValues(*values(self, ImuValues._fields))


@jit
def _within(x: Vec3, limit: float) -> bool:
    return abs(x[0]) <= limit and abs(x[1]) <= limit and abs(x[2]) <= limit


@jit
def is_valid(gyro: Vec3, accel: Vec3, v: ImuValues) -> bool:
    """
    Tell whether a sample may be integrated; NaN and infinity are refused.

    Parameters
    ----------
    gyro : (3,) rad/s, body FRD
    accel : (3,) m/s^2, body FRD
        Specific force.
    v
        Ranges.

    """
    return _within(gyro, v.gyro_range) and _within(accel, v.accel_range)


@jit
def is_equal(a: Vec3, b: Vec3) -> bool:
    """Tell whether two readings are the same number by number."""
    return a[0] == b[0] and a[1] == b[1] and a[2] == b[2]


@jit
def is_stuck(equal: int, gyro: Vec3, v: ImuValues) -> bool:
    """
    Tell whether a sensor that repeats its rate counts as dead.

    A rate of exactly zero does not: a simulated sensor without noise reads it in hover. The
    specific force is not looked at: without noise it is constant on a level circle.

    Parameters
    ----------
    equal
        Rates in a row that equalled the one before, this one included.
    gyro : (3,) rad/s, body FRD
    v
        How many are too many.

    """
    turning = gyro[0] != 0.0 or gyro[1] != 0.0 or gyro[2] != 0.0
    return turning and equal >= v.stuck_samples > 0
