"""
Conversion between NED/FRD, used inside, and z-up/FLU, used in ROS messages (REP-103).

No other module knows both conventions. World and body axes both turn by half a turn about x, so
vectors become (x, -y, -z) and attitudes (w, x, -y, -z), in either direction. Only signs change:
the result is exact, two conversions restore every bit, NaN stays NaN, and a zero in y or z
changes its sign (-0.0 equals 0.0). This module holds no equation of the thesis.
"""

from __future__ import annotations

from collections.abc import Sequence

from .motion.quaternion import Quat
from .motion.vector import Vec3


_KEPT = {size * size: tuple(
    (i % 3 == 0) == (j % 3 == 0) for i in range(size) for j in range(size)) for size in (3, 6)}
# {size: which elements of a covariance keep their sign}: those of x with x, and of y, z with y, z


def flip_vector(v: Vec3) -> Vec3:
    """Convert a vector, (3,) of any unit, between NED and z-up or between FRD and FLU."""
    return (v[0], -v[1], -v[2])


def wire_quaternion(q: Quat) -> Quat:
    """Return the FLU-to-z-up attitude (x y z w) for an FRD-to-NED attitude (w x y z)."""
    return (q[1], -q[2], -q[3], q[0])


def body_quaternion(x: float, y: float, z: float, w: float) -> Quat:
    """Return the FRD-to-NED attitude (w x y z) for an FLU-to-z-up attitude (x y z w)."""
    return (w, x, -y, -z)


def flip_covariance(covariance: Sequence[float]) -> tuple[float, ...]:
    """
    Convert the covariance of one vector (9 numbers) or of two (36) to the other convention.

    Parameters
    ----------
    covariance : (9,) or (36,) row by row
        Covariance of one vector, or of two such as (position, rotation about the axes) or
        (velocity, angular velocity), in axes that :func:`flip_vector` converts.

    Returns
    -------
    (9,) or (36,) row by row

    Raises
    ------
    ValueError
        If the number of elements is neither 9 nor 36.

    """
    if len(covariance) not in (9, 36):
        raise ValueError(
            f'covariance has {len(covariance)} numbers; it must have 9 (3x3) or 36 (6x6)')
    kept = _KEPT[len(covariance)]
    return tuple([
        1.0 * c if keep else -(1.0 * c) for keep, c in zip(kept, covariance, strict=True)])
