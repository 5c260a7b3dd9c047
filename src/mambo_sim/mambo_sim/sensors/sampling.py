"""Shared by the sensors: sampling times on the 5 ms grid, resolution, limits and tilt."""

from __future__ import annotations

import math

from mambo_model.compiled import jit
from mambo_model.motion.quaternion import Quat

STEP_NS = 5_000_000  # ns, one tick: the control step at which every sensor is read
STEP = STEP_NS * 1e-9  # s


def period_ns(rate: float) -> int:
    """Return the sampling period in ns of a rate in Hz; at most 200 Hz is one sample a tick."""
    return round(1e9 / rate)


@jit
def due(tick: int, period: int) -> bool:
    """
    Return whether a sample falls to a tick.

    Samples are taken at whole multiples of the period and delivered at the first tick at or
    after: the first at tick 0, intervals differ by one tick at most, the mean rate is exact.

    Parameters
    ----------
    tick : 5 ms
        Number of the control step, from 0.
    period : ns
        At least ``STEP_NS``.

    """
    now = tick * STEP_NS
    return now // period != (now - STEP_NS) // period


@jit
def due_in_bursts(tick: int, period: int, burst: int, pause: int) -> bool:
    """
    Return whether a sample falls to a tick, as :func:`due`, of a sensor that pauses.

    Parameters
    ----------
    tick : 5 ms
        Number of the control step, from 0.
    period : ns
        Between the samples of a burst, at least ``STEP_NS``.
    burst
        Samples in a burst.
    pause : ns
        From the last sample of a burst to the first of the next, at least the period; equal to
        it: no pause, the same ticks as :func:`due`.

    """
    now = tick * STEP_NS
    before = now - STEP_NS
    cycle = (burst - 1) * period + pause
    count = now // cycle * burst + min(now % cycle // period, burst - 1)
    return count != before // cycle * burst + min(before % cycle // period, burst - 1)


@jit
def quantise(x: float, resolution: float) -> float:
    """Return x rounded to a multiple of the resolution, same unit; 0 leaves x as it is."""
    if resolution > 0.0:
        return math.floor(x / resolution + 0.5) * resolution
    return x


@jit
def clamp(x: float, low: float, high: float) -> float:
    """Return x cut to [low, high]; NaN stays NaN."""
    if x < low:
        return low
    if x > high:
        return high
    return x


@jit
def tilt_cosine(q: Quat) -> float:
    """Return cos(phi) cos(theta) of unit q (2.5): the cosine between b3 and e3."""
    return 1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2])
