"""
Measurement model of the barometer in the joint filter: height by pressure, z = -p_z + offset.

The relation of pressure and height is that of ``measurements.barometer``.
"""

from __future__ import annotations

from mambo_model.compiled import jit

from .state import Array, Nominal, PRESSURE_OFFSET

Z_POSITION = 2


@jit
def predict(x: Nominal) -> float:
    """Return the expected height by pressure, m."""
    return x.pressure_offset - x.p[2]


@jit
def jacobian(h: Array) -> None:
    """Store the derivative of :func:`predict` by the error state in ``h``, (SIZE,)."""
    h[:] = 0.0
    h[Z_POSITION] = -1.0
    h[PRESSURE_OFFSET] = 1.0


@jit
def start(P: Array, variance: float) -> None:
    """
    Give the offset the covariance of a first sample that sets it, in place.

    offset = z - h, so that its error is that of the position plus the noise of the sample.
    """
    for j in range(len(P)):
        P[PRESSURE_OFFSET, j] = P[Z_POSITION, j]
    for j in range(len(P)):
        P[j, PRESSURE_OFFSET] = P[PRESSURE_OFFSET, j]
    P[PRESSURE_OFFSET, PRESSURE_OFFSET] = P[Z_POSITION, Z_POSITION] + variance
