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
WITH_THEM = ('motor_pwm', 'battery', 'onboard/reference')
"""Topics that end so only together with one of those: a command may be a ramp."""
LEAST = 20  # values that no sensor gives on a straight line, and lines before it
LONGER = 1.5  # [-] times the longest other line, which interpolation makes
ROUNDING = 1e-6  # [-] of the range of values, beside what their last digit says
JITTER = 0.1  # [-] of the steps between times, which may be rounded or those of an arrival
FACTORS = (1.0, np.pi / 180.0, 9.80665)  # of the units of written numbers, to SI
DIGITS = 9  # decimals of those numbers, at most
_WHOLE = 1e-4  # [-] by which a multiple of the last digit may miss a whole number


def begin(t: Floats, values: Floats) -> int | None:
    """
    Return the index of the last value that was measured, if those behind it are extrapolated.

    A line along which most columns are level, as of a sensor that rests, does not count, nor does
    one behind less than ``LEAST`` others: values without noise are those of a simulation. A line
    may miss by the last digit of its numbers.

    Parameters
    ----------
    t : (n,) s, ascending
    values : (n, k)
        Of one topic.

    """
    if len(t) <= LEAST:
        return None
    table = _Table(t, values)
    length = table.reach(len(t), -1, LEAST)
    first = len(t) - length
    if not length or not first or not table.moves(first, len(t)) or (
            table.lines_before(first) < LEAST):
        return None
    # a line of this length has a whole block of half of it
    least = int(np.ceil(length / LONGER))
    half = max(least // 2, 3)
    for start in range(0, first - half + 1, half):
        if table.is_line(start, start + half):
            after = start + table.reach(start, 1, half)
            before = after - table.reach(after, -1, half)
            if after - before >= least and table.moves(before, after):
                return None
    return first


def begin_since(t: Floats, values: Floats, since: float) -> int | None:
    """
    Return the same for a table of which another topic was extrapolated since a time, s.

    Any line from there to the end counts, also a level one, and one that is no longer than others.
    """
    if len(t) <= LEAST:
        return None
    last = int(np.searchsorted(t, since, 'right')) - 1
    length = _Table(t, values).reach(len(t), -1, LEAST)
    first = max(len(t) - length, last, 0)
    return first if length and len(t) - 1 - first >= LEAST else None


class _Table:
    """
    Values of a topic over time, and which of their rows are on a straight line.

    Parameters
    ----------
    t : (n,) s, ascending
    values : (n, k)

    """

    def __init__(self, t: Floats, values: Floats) -> None:
        self.t, self.values, self.rows = t, values, np.arange(float(len(t)))
        self.least = ROUNDING * np.ptp(values, axis=0)
        self.allowed = np.maximum(self.least, [last_digit(column) for column in values.T])
        self.jitter = JITTER * float(np.median(np.diff(t)))

    def is_line(self, first: int, stop: int) -> bool:
        """Return whether some rows are on a line in every column, over time or one by one."""
        y = self.values[first:stop] - self.values[first:stop].mean(axis=0)
        for clock, jitter in ((self.t, self.jitter), (self.rows, JITTER)):
            x = clock[first:stop] - clock[first:stop].mean()
            slope = x @ y / (x @ x)
            miss = np.abs(y - x[:, None] * slope).max(axis=0)
            if (miss <= self.allowed + jitter * np.abs(slope)).all():
                return True
        return False

    def reach(self, edge: int, way: int, least: int) -> int:
        """Return how many rows from one on (1), or before it (-1), are a line; 0: below least."""
        longest = len(self.t) - edge if way > 0 else edge

        def along(count: int) -> bool:
            """Return whether so many rows are on a line."""
            return self.is_line(*sorted((edge, edge + way * count)))
        if longest < least or not along(least):
            return 0
        low = least
        while low < longest and along(min(2 * low, longest)):
            low = min(2 * low, longest)
        high = min(2 * low, longest + 1)  # no line, or more than there are
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if along(middle) else (low, middle)
        return low

    def moves(self, first: int, stop: int) -> bool:
        """Return whether most columns are not level along some rows."""
        ends = self.values[first] != self.values[stop - 1]
        return bool(ends.sum() > 0.5 * len(ends))

    def lines_before(self, stop: int) -> int:
        """Return how many lines, not counting rounding as one, end by a row."""
        step = np.diff(self.t[:stop + 1])
        slope = np.diff(self.values[:stop + 1], axis=0) / step[:, None]
        bent = np.abs(np.diff(slope, axis=0)) > self.least / np.median(step)
        return int(bent.any(axis=1).sum()) + 1


def last_digit(values: Floats) -> float:
    """
    Return the step of numbers, (n,), that were rounded when they were written; 0 if none shows.

    Numbers of single precision have a last digit, too.
    """
    if (values == values.astype(np.float32)).all():
        return float(np.spacing(np.float32(np.abs(values).max())))
    for digits in range(DIGITS + 1):  # of any unit: 1e-4 g are also multiples of 1e-9 m/s^2
        for factor in FACTORS:
            multiples = values / factor * 10.0 ** digits
            if (np.abs(multiples - np.round(multiples)) < _WHOLE).all():
                return factor * 10.0 ** -digits
    return 0.0
