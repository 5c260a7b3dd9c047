"""
The end of a table that nothing measured: values on a straight line, continued from those before.

Where columns of several rates were brought to common times, those that ended earlier may have been
extrapolated. Of a hundred flights of NanoBench, whose columns were interpolated linearly, all end
so: gyro, accelerometer and estimate for 0.2 to 0.4 s, up to 30 s in thirteen, with rates up to
460 rad/s.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
NOISY = ('imu/data_raw', 'onboard/odom')
"""Topics of what is measured or estimated with noise. Poses of a simulated capture have none."""
WITH_THEM = ('motor_pwm', 'battery')
"""Topics that end so only together with one of those: a command may be a ramp."""
LEAST = 20  # values that no sensor gives on a straight line, and lines before it
LONGER = 1.5  # [-] times the longest other line, which interpolation makes
ROUNDING = 1e-6  # [-] of the range of values, in one step
CLOCK = 1e-4  # [-] of a slope: seconds since 1970 are rounded to 0.2 us, of steps of 10 ms


def begin(t: Floats, values: Floats) -> int | None:
    """
    Return the index of the last value that was measured, if those behind it are extrapolated.

    A line along which most columns are level, as of a sensor that rests, does not count, nor does
    one behind less than ``LEAST`` others: values without noise are those of a simulation.

    Parameters
    ----------
    t : (n,) s, ascending
    values : (n, k)
        Of one topic.

    """
    if len(t) <= LEAST:
        return None
    step = np.diff(t)
    slope = np.diff(values, axis=0) / step[:, None]
    allowed = ROUNDING * np.ptp(values, axis=0) / np.median(step)
    bent = (np.abs(np.diff(slope, axis=0)) > allowed + CLOCK * np.abs(slope[1:])).any(axis=1)
    edges = np.flatnonzero(np.concatenate([[True], bent, [True]]))  # the ends of straight lines
    first, last = edges[:-1], edges[1:]
    moves = (values[first] != values[last]).sum(axis=1) > 0.5 * values.shape[1]
    length = np.where(moves, last - first + 1, 0)
    others = LONGER * length[:-1].max(initial=0)
    if len(length) <= LEAST or length[-1] < LEAST or length[-1] <= others:
        return None
    return int(first[-1])
