"""
What rounding to a resolution does to a noise, and when it hides it.

Where a noise spreads over several steps, the error of rounding is white and uniform, of the
variance step^2 / 12 (Sheppard's correction). B. Widrow and I. Kollar, Quantization Noise (2008),
chapter 4, for how far it is not.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..allan import Interval, interval_of_deviation
from .statistics import Array

WINDOW = 0.1  # s: over longer times a bias walks, which is no noise that spreads the readings
HALF = 0.5    # steps: deviation of readings half-way between two steps, without any noise
SIZES = np.linspace(0.0, 1.5, 601)  # steps, of a noise; the error is below 1e-18 at the last
LEFT = np.exp(-2.0 * (np.pi * SIZES)**2) * (1.0 / np.pi**2 + 4.0 * SIZES**2)
"""Largest error of step^2 / 12 for the variance of a noise, steps^2: first harmonic."""


class Rounding(NamedTuple):
    """What rounding adds to the variance of a noise, and how far that may be wrong."""

    variance: float  # unit^2 of the signal
    error: float     # the same


NONE = Rounding(0.0, 0.0)


def fast_deviation(x: Array, rate: float) -> Interval:
    """Return the standard deviation of samples, (n,) at ``rate`` Hz, within ``WINDOW`` s."""
    m = max(round(WINDOW * rate), 2)
    n = len(x) // m
    parts = x[:n * m].reshape(n, m)
    value = float(np.sqrt(parts.var(axis=1, ddof=1).mean()))
    return interval_of_deviation(value, n * (m - 1))


def rounding(x: Array, rate: float, step: float) -> Rounding | None:
    """
    Return what rounding adds to the noise of a signal; None if it may be all there is.

    Readings half-way between two steps have a deviation of half a step without any noise.

    Parameters
    ----------
    x : (n,)
        Signal, at least 4 samples.
    rate : Hz
        Of the samples.
    step
        Resolution, in the unit of the signal; 0 if there is none.

    """
    if not step:
        return NONE
    low = fast_deviation(x, rate).low / step
    if low <= HALF:
        return None
    least = np.interp(low * low - 1.0 / 12.0, SIZES**2 + LEFT, SIZES)
    return Rounding(step**2 / 12.0, float(np.interp(least, SIZES, LEFT)) * step**2)


def without(found: Interval, by: Rounding, share: float = 1.0) -> Interval:
    """
    Return a deviation without what rounding adds; its interval holds the error of that.

    Parameters
    ----------
    found
        Deviation of the readings.
    by
        What rounding adds to the variance of a sample.
    share
        Of that variance in the one of ``found``: 1 / n in a mean over n samples.

    """
    low, value, high = (
        float(np.sqrt(max(v * v - share * (by.variance + error), 0.0)))
        for v, error in ((found.low, by.error), (found.value, 0.0), (found.high, -by.error)))
    return Interval(value, low, high)
