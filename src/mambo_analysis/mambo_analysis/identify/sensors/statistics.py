"""Statistics of samples with their 95 % intervals."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.stats import beta, binom, t as student

from ..allan import Interval, LEVEL

Array = NDArray[np.float64]
STRETCHES = 10  # of the jackknife
FEW = 5         # levels, of which a line shows that they lie on one
OFTEN = 10      # readings of each level, from which on few levels are those of a resolution
FLOAT32 = 2.0**-24  # relative error of a rounded float32
MAD = 1.4826    # standard deviation over median absolute deviation, normal


def proportion(k: int, n: int) -> Interval:
    """Return k of n with the interval of Clopper and Pearson."""
    tail = (1.0 - LEVEL) / 2.0
    return Interval(
        k / n, float(beta.ppf(tail, k, n - k + 1)) if k else 0.0,
        float(beta.ppf(1.0 - tail, k + 1, n - k)) if k < n else 1.0)


def median(x: Array) -> Interval:
    """Return the median of samples with the interval between two order statistics."""
    ordered, n = np.sort(x), len(x)
    k = max(int(binom.ppf((1.0 - LEVEL) / 2.0, n, 0.5)) - 1, 0)
    return Interval(float(np.median(x)), float(ordered[k]), float(ordered[n - 1 - k]))


def jackknife(statistic: Callable[[NDArray[np.int64]], float], n: int) -> Interval:
    """
    Return a statistic with the interval of a jackknife over ``STRETCHES`` stretches.

    Parameters
    ----------
    statistic
        Of the indices kept, out of 0 ... n - 1.
    n
        Samples, in the order of time; neighbours may depend on each other.

    """
    whole = statistic(np.arange(n))
    number = np.arange(n) * STRETCHES // n
    parts = np.array([statistic(np.flatnonzero(number != k)) for k in range(STRETCHES)])
    spread = np.sqrt((STRETCHES - 1) * ((parts - parts.mean())**2).mean())
    reach = float(student.ppf(0.5 + LEVEL / 2.0, STRETCHES - 1) * spread)
    return Interval(whole, whole - reach, whole + reach)


def robust_sigma(x: Array) -> Interval:
    """
    Return the standard deviation of samples about zero by their median magnitude.

    Of rounded samples the median is one of few sizes, often the same whatever stretch is left out.
    The interval is then at least that of normal samples, whose median size has a relative standard
    error of 1.17 / sqrt(n), and half-way to the next smaller and the next larger size besides.
    """
    size = MAD * np.abs(x)
    found = jackknife(lambda keep: float(np.median(size[keep])), len(x))
    found = found._replace(low=max(found.low, 0.0))
    apart = 1e-4 * found.value  # float32 leaves equal sizes a little apart
    below, above = size[size < found.value - apart], size[size > found.value + apart]
    if len(x) - len(below) - len(above) < 2 + 0.01 * len(x) or not len(below) or not len(above):
        return found
    reach = 1.96 * 1.17 / np.sqrt(len(x)) * found.value
    down, up = 0.5 * (found.value - below.max()), 0.5 * (above.min() - found.value)
    return Interval(found.value, max(0.0, min(found.low, found.value - reach - down)),
                    max(found.high, found.value + reach + up))


def repeating(rows: Array) -> float:
    """Return the share of rows, (n, k) with n > 1, that equal the one before."""
    return float((np.diff(rows, axis=0) == 0.0).all(axis=1).mean())


def white_sigma(x: Array) -> Interval:
    """Return the white noise of a slow signal: robust deviation of its second differences."""
    return robust_sigma(np.diff(x, 2) / np.sqrt(6.0))


def _merged(values: Array) -> Array | None:
    """Return the levels of values, (n,): those that float32 leaves apart are one; or None."""
    ordered = np.unique(values)
    apart = 4.0 * FLOAT32 * float(np.abs(ordered).max())
    parts = np.split(ordered, np.flatnonzero(np.diff(ordered) > apart) + 1)
    if any(np.ptp(part) > apart for part in parts):
        return None  # the values lie anywhere
    return np.array([part.mean() for part in parts])


def resolution(x: Array, fewest: int = 2) -> Interval | None:
    """
    Return the resolution: all values are its multiples plus an offset; None if there is none.

    Values that differ by the error of float32 are one level. Fewer than ``FEW`` levels count where
    each is read ``OFTEN`` times in the mean: values that lie anywhere hardly ever occur twice.
    The interval is that of the slope; digits left out hardly show in few levels.

    Parameters
    ----------
    x : (n,)
        Values; those that are not finite are left out.
    fewest
        Levels, below which there is none.

    """
    values = x[np.isfinite(x)]
    if not len(values):
        return None
    merged = _merged(values)
    found = None if merged is None else _step(merged, len(values), fewest)
    return found or _step(np.unique(values), len(values), fewest)


def _step(levels: Array, n: int, fewest: int) -> Interval | None:
    """
    Return the step of at least ``fewest`` levels, (k,), of n values; None if there is none.

    Neighbouring levels give a first guess, a line through ever more of them the step.
    """
    gaps = np.diff(levels)
    if len(levels) < max(fewest, FEW if n < OFTEN * len(levels) else 2):
        return None
    step, reach = float(np.median(gaps[gaps < 1.5 * gaps.min()])), min(8, len(gaps))
    while True:
        part, offset = levels[:reach + 1] - levels[0], 0.0
        for _ in range(4):  # the offset found decides what lies half-way between two steps
            steps = np.round((part - offset) / step)
            if not steps.any():
                return None
            step, offset = np.linalg.lstsq(
                np.c_[steps, np.ones(len(part))], part, rcond=None)[0]
        error = np.sqrt(((part - offset - step * steps)**2).mean())
        free = len(part) / max(len(part) - 2, 1)  # two more are those of the line
        if error * np.sqrt(free) > 0.1 * step:  # 0.29 of a step if the values lie anywhere
            return None
        if reach >= len(gaps):
            break
        reach = min(2 * reach, len(gaps))
    spread = 1.96 * error / np.sqrt(((steps - steps.mean())**2).sum())
    return Interval(float(step), float(step - spread), float(step + spread))
