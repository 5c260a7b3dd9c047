r"""
Pulses of the motor commands that samples further apart than the grid do not show.

Between two samples commands are taken along a straight line. A pulse that lasts shorter than the
time h between samples, as where a reference has a kink, then counts up to h over its length
times, or is missed. The motors never did what the line says: the fit of the thrust explains it by
a longer lag, a larger vertical drag and another exponent. Pulses are found in the commands alone,
so leaving them out favours no result.

A command c that is resolved lies near the cubic through two samples on either side. The distance

.. math:: d_k = \tfrac{1}{6} |c_{k-2} - 4 c_{k-1} + 6 c_k - 4 c_{k+1} + c_{k+2}|

of a pulse in one sample is its height A; that of a sine is
:math:`\tfrac{2}{3} A (1 - \cos\omega h)^2` at most, 0.1 A for 3 Hz at samples every 0.05 s. It is
taken of the sum of the commands and of their differences about each axis. A pulse is a distance
above ``PULSE`` and ``STRAY``. A pulse between two samples that none of them shows stays in.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..identify.regression import IdentifyError
from .recorded import LEAST_FLIGHT, MIX, Recorded, STEP

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

STRAY = 6.0     # of the robust deviation of the distances: noise is beyond in 2 of 10^9 samples
PULSE = 3.0     # of the robust deviation of the commands: a kink of a reference makes 4 to 140
SETTLE = 0.3    # s after a pulse: exp(-4) of the thrust is left at a lag of 0.07 s, a slow motor's


def samples_apart(flight: Recorded) -> int:
    """Return the usual time between samples of the commands or the IMU, in steps of the grid."""
    return round(flight.pace / STEP) if np.isfinite(flight.pace) else 1


def pulsed(flight: Recorded) -> Bools:
    """
    Return the rows in the air, (n,), in which a pulse acts that the samples do not show.

    None where samples are as close as the steps of the grid.
    """
    apart, count = samples_apart(flight), flight.air.stop - flight.air.start
    out = np.zeros(count, bool)
    if apart < 2:
        return out
    commands = flight.command[flight.air] @ np.vstack([np.ones(4), MIX]).T
    inner = slice(2 * apart, count - 2 * apart)
    kernel = np.zeros(4 * apart + 1)
    kernel[::apart] = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6.0
    for x in commands.T:
        distance = np.zeros(count)
        distance[inner] = np.abs(np.convolve(x, kernel, 'valid'))
        usual = PULSE * np.median(np.abs(x - np.median(x)))
        noise = STRAY * np.median(distance[inner])
        out |= distance > 1.4826 * max(usual, noise)
    after = apart + round(SETTLE / STEP)
    for row in np.flatnonzero(out):
        out[max(row - apart, 0):row + after] = True
    return out


def refuse_pulsed(flight: Recorded) -> None:
    """Raise IdentifyError if pulses leave less than ``LEAST_FLIGHT`` s of a flight."""
    out = pulsed(flight)
    left = (len(out) - out.sum()) * STEP
    if out.any() and left < LEAST_FLIGHT:
        raise IdentifyError(
            f'{flight.name}: commands change within the {samples_apart(flight) * STEP:.2g} s '
            f'between samples nearly all the time: {left:.1f} s without it are left, '
            f'{LEAST_FLIGHT:g} s are needed; record motor_pwm and IMU at 100 Hz')


def pulse_notes(flight: Recorded) -> list[str]:
    """Return a note if parts of a flight are left out for pulses of its commands."""
    out = pulsed(flight)
    if not out.any():
        return []
    return [f'{flight.name}: commands change within the {samples_apart(flight) * STEP:.2g} s '
            f'between samples: {out.sum() * STEP:.1f} s of {len(out) * STEP:.1f} s are left out '
            'of drag, thrust and lag; record motor_pwm and IMU at 100 Hz']
