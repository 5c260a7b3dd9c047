"""
Measurement model of the sonar in the joint filter, corrected for tilt.

z = h / c + offset, with h = -p_z and c = cos(phi) cos(theta).

By the error state: d z = -dp_z / c - h / c^2 (delta_x R_yz - delta_y R_xz) + d offset.
"""

from __future__ import annotations

from mambo_model.compiled import jit
from mambo_model.motion.quaternion import to_matrix

from .state import Array, ATTITUDE, Nominal, RANGE_OFFSET

Z_POSITION = 2


@jit
def predict(x: Nominal) -> float:
    """Return the expected slant range, m; the vehicle is tilted by less than 90 degrees."""
    return -x.p[2] / to_matrix(x.q)[2][2] + x.range_offset


@jit
def jacobian(x: Nominal, h: Array) -> None:
    """Store the derivative of :func:`predict` by the error state in ``h``, (SIZE,)."""
    R = to_matrix(x.q)
    c = R[2][2]
    h[:] = 0.0
    h[Z_POSITION] = -1.0 / c
    h[ATTITUDE] = x.p[2] / (c * c) * R[1][2]
    h[ATTITUDE + 1] = -x.p[2] / (c * c) * R[0][2]
    h[RANGE_OFFSET] = 1.0
