"""
Rows of the comparison of two estimators, with the interval of their ratio.

Both estimators have an error in each of n flights. A row shows the root mean squares over the
flights, and the typical ratio of the errors: the exponential of the mean of ln(b / a), flight by
flight. Its 95 % interval follows from the scatter of the logarithms (Student's t with n - 1
degrees of freedom), so that what is equally hard for both estimators does not widen it, and one
bad flight does not decide. In place of flights, parts of one recording may be compared likewise.

A single number has no interval. A difference below the bound, the deviation that chance gives even
the best estimator, decides nothing; of a larger one, or without a bound, the smaller error is
better.
"""

from __future__ import annotations

from collections.abc import Iterable
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

Array = NDArray[np.float64]
CONFIDENCE = 0.95
LEAST = 1e-12     # share of the largest square that counts as none
BETTER, UNDECIDED, WORSE = 'joint', 'undecided', 'kalman'  # verdict: which estimator is better
ALL_FLIGHTS = 'all flights'


class Ratio(NamedTuple):
    """How much larger the error of the joint filter typically is, as a share of that of kalman."""

    value: float
    low: float      # 95 % interval; NaN: of a single number there is none
    high: float


class Row(NamedTuple):
    """
    One quantity of one case.

    Attributes
    ----------
    case, quantity
        What was flown; what was measured, with its unit.
    bound
        Posterior Cramer-Rao bound, root mean square; NaN: none.
    kalman, joint : (n,)
        Squared errors of each flight, or part of a recording, unit of the quantity squared.
    others
        Root mean squares of other estimators, by name.

    """

    case: str
    quantity: str
    bound: float
    kalman: Array
    joint: Array
    others: dict[str, float]

    @property
    def ratio(self) -> Ratio:
        """How much larger the error of the joint filter typically is."""
        return ratio(self.kalman, self.joint)

    @property
    def larger(self) -> bool:
        """Whether the root mean square of the joint filter is larger, in three digits."""
        return float(f'{rms(self.joint):.3g}') > float(f'{rms(self.kalman):.3g}')

    @property
    def verdict(self) -> str:
        """Which estimator is better: BETTER, WORSE, or UNDECIDED where chance explains it."""
        low, high = self.ratio[1:]
        if math.isnan(low):
            off = rms(self.joint) - rms(self.kalman)
            chance = abs(off) <= self.bound
            low, high = (-1.0, 1.0) if chance else (off, off)
        if f'{rms(self.joint):.3g}' == f'{rms(self.kalman):.3g}':
            return UNDECIDED  # equal in every digit that is printed
        if low > 0.0:
            return WORSE
        return BETTER if high < 0.0 else UNDECIDED


def rms(squares: Array) -> float:
    """Return the root of the mean of squared errors."""
    return math.sqrt(float(np.mean(squares)))


def ratio(kalman: Array, joint: Array) -> Ratio:
    """
    Return the typical ratio of two errors over the same flights, less 1, with its interval.

    Parameters
    ----------
    kalman, joint : (n,)
        Squared errors, in the same order of the flights.

    """
    least = LEAST * max(float(kalman.max()), float(joint.max()), LEAST)  # no logarithm of zero
    logs, count = 0.5 * np.log((joint + least) / (kalman + least)), len(joint)
    mean, half = float(logs.mean()), math.nan
    if count > 1:
        half = float(student.ppf(0.5 + 0.5 * CONFIDENCE, count - 1) * logs.std(ddof=1)
                     / math.sqrt(count))
    low, high = (math.expm1(min(mean + side * half, 50.0)) for side in (-1.0, 1.0))
    return Ratio(math.expm1(mean), low, high)


def pooled(rows: Iterable[Row]) -> list[Row]:
    """
    Return one row for each quantity, over all recordings of a vehicle.

    They are not repetitions of one flight, but each is replayed by both estimators, so that the
    differences can be compared with their scatter.
    """
    found: dict[str, list[Row]] = {}
    for row in rows:
        found.setdefault(row.quantity, []).append(row)
    return [
        Row(ALL_FLIGHTS, quantity, rms(np.array([row.bound ** 2 for row in some])),
            *(np.array([getattr(row, name).mean() for row in some])
              for name in ('kalman', 'joint')), dict.fromkeys(some[0].others, math.nan))
        for quantity, some in found.items() if len(some) > 1]
