"""
The only place that knows two conventions: NED/FRD inside, z-up/FLU on the wire (REP-103).

World and body both turn by half a turn about x, so vectors become (x, -y, -z) and attitudes
(w, x, -y, -z) in either direction. Only signs change: the result is exact to the bit, two flips
give back every bit, NaN stays where it is and a zero on y or z changes its sign (-0.0 equals 0.0).
Holds no equation of the thesis.
"""

from __future__ import annotations

from collections.abc import Sequence

from .motion.quaternion import Quat
from .motion.vector import Vec3


_KEPT = {size * size: tuple(
    (i % 3 == 0) == (j % 3 == 0) for i in range(size) for j in range(size)) for size in (3, 6)}
# by count: which numbers of a covariance keep their sign, those of x with x and of y, z with y, z


def flip_vector(v: Vec3) -> Vec3:
    """Return a vector, (3,) any unit, NED to z-up or FRD to FLU, and the same way back."""
    return (v[0], -v[1], -v[2])


def wire_quaternion(q: Quat) -> Quat:
    """Return x y z w of the FLU-to-z-up attitude from w x y z of the FRD-to-NED one."""
    return (q[1], -q[2], -q[3], q[0])


def body_quaternion(x: float, y: float, z: float, w: float) -> Quat:
    """Return w x y z of the FRD-to-NED attitude from x y z w of the FLU-to-z-up one."""
    return (w, x, -y, -z)


def flip_covariance(covariance: Sequence[float]) -> tuple[float, ...]:
    """
    Return a covariance of one vector, 9 numbers, or of two, 36 numbers, in the other convention.

    Parameters
    ----------
    covariance : (9,) or (36,) row by row
        Of vectors in NED or FRD axes, or in z-up or FLU axes: (position, rotation about the
        axes) or (velocity, angular velocity), each component flipped as by :func:`flip_vector`.

    Returns
    -------
    (9,) or (36,) row by row

    Raises
    ------
    ValueError
        If there are neither 9 nor 36 numbers.

    """
    if len(covariance) not in (9, 36):
        raise ValueError(
            f'covariance has {len(covariance)} numbers; it must have 9 (3x3) or 36 (6x6)')
    kept = _KEPT[len(covariance)]
    return tuple([
        1.0 * c if keep else -(1.0 * c) for keep, c in zip(kept, covariance, strict=True)])
