r"""
The power law of a bench with a systematic error beside it: a zero of the scale, or a drift.

Where readings scatter little, a small systematic error moves the exponent out of its interval.
Beside T = a X^b two more laws are therefore fitted, each with one more unknown,

.. math:: T = a X^b + z, \qquad T = a X^b e^{c u}, \quad 0 \le u \le 1,

with a zero z of the scale, and a thrust that drifts by the share :math:`e^c - 1` between the
first reading and the last, as with a battery that sags. Both are fitted to the means at each
command, as many as there are commands: what a rotor does beside a power law counts as scatter
then.

Where commands come back after other ones, as in sweeps up and down, the readings at one command
show a drift by themselves, whatever the law (:func:`repeated_drift`). It does not count as their
scatter.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from .regression import LEVEL, Value

Floats = NDArray[np.float64]

ROUNDS = 20   # of a weighted fit
TURNS = 3     # of a drift and the errors beside it; a fourth moved none by 1 % of its interval
SURE = 1e-3   # of the t test of a term
APART = 1e-3  # of the time of all readings: below, the means at the commands are at one time
LARGEST_DRIFT = 0.05  # [-] of the thrust over a bench, that an interval must bear without a note:
                      # a cell of lithium loses 17 % of it from 4.2 to 3.7 V, as (4.5) has b = 1.5
LEAST_REPEATED = 12  # readings, beyond one at each command: their errors are known then
CLEARLY = 4.0  # of the log-likelihood, for an error that does not grow; by chance in 0.2 %
PRECISE = {'maxiter': 4000, 'maxfev': 4000, 'xatol': 1e-7, 'fatol': 1e-7}


class Term(NamedTuple):
    """A systematic error that a bench shows."""

    words: str       # what it is, with its size
    size: float      # N of a zero, share of a drift
    cure: str        # what to do
    b: Value         # the exponent with it
    variance: float  # of the deviations of the means that are left, over their errors


class Drift(NamedTuple):
    """A drift of the thrust: from the first reading to the last it changes by exp(rate)."""

    rate: float
    half: float  # half width of its interval

    @property
    def interval(self) -> tuple[float, float]:
        """Return the ends of the interval of the rate."""
        return self.rate - self.half, self.rate + self.half

    def removed(self, T: Floats) -> Floats:
        """Return thrusts, (n,) N, in the order of the readings, as at the first of them."""
        return T * np.exp(-self.rate * np.linspace(0.0, 1.0, len(T)))


def scatter(rest: Floats, T: Floats, share: Floats) -> tuple[float, float] | None:
    """
    Return the errors of readings, if one of them clearly does not grow with the thrust.

    Deviations are normal with the variance ``s_1^2 + (s_0 / T)^2``; the likelihood is compared
    with that of ``s_0 = 0``.

    Parameters
    ----------
    rest : (n,)
        Deviations over the thrust.
    T : (n,) N
    share : (n,)
        Degrees of freedom that each counts for.

    Returns
    -------
    s_0 : N
    s_1 : 1

    """
    usual = float(share @ rest ** 2 / share.sum())
    if not usual > 0.0:
        return None

    def surprise(theta: Floats) -> float:
        """Return minus the logarithm of the likelihood of log s_0 and log s_1."""
        variance = np.exp(2.0 * theta[1]) + np.exp(2.0 * theta[0]) / T ** 2
        return float(0.5 * share @ (np.log(variance) + rest ** 2 / variance))
    alone = 0.5 * share.sum() * (np.log(usual) + 1.0)
    top = 0.5 * np.log(usual)
    found = min((optimize.minimize(surprise, (top + np.log(part * one), top + np.log(1.1 - part)),
                                   method='Nelder-Mead', options=PRECISE)
                 for part in (0.1, 0.5, 1.0) for one in (T.min(), np.median(T))),
                key=lambda one: one.fun)
    if not alone - found.fun > CLEARLY:
        return None
    return float(np.exp(found.x[0])), float(np.exp(found.x[1]))


def repeated_errors(X: Floats, T: Floats) -> tuple[float, float] | None:
    """Return :func:`scatter` of readings about the mean at their command; None: too few."""
    _, level, counts = np.unique(X, return_inverse=True, return_counts=True)
    if len(X) - len(counts) < LEAST_REPEATED:
        return None
    mean, share = (np.bincount(level, T) / counts)[level], 1.0 - 1.0 / counts[level]
    again = share > 0.0
    return scatter((T[again] / mean[again] - 1.0) / np.sqrt(share[again]), mean[again],
                    share[again])


def _comes_back(X: Floats) -> bool:
    """Return whether a command is measured again after another one."""
    return bool(np.count_nonzero(np.diff(X)) >= len(np.unique(X)))


def repeated_drift(X: Floats, T: Floats) -> Drift | None:
    """
    Return the drift that readings at the same command show; None: none is clear.

    A t test of the slope of thrust over its mean at the command, beside the time. The weights are
    by the errors of readings without the drift, so both are found in turns.

    Parameters
    ----------
    X, T : (n,), (n,) N
        Readings, in the order in which they were taken, at even times.

    """
    _, level, counts = np.unique(X, return_inverse=True, return_counts=True)
    freedom = len(X) - len(counts) - 1
    if freedom < LEAST_REPEATED - 1 or not _comes_back(X):
        return None
    time = np.linspace(0.0, 1.0, len(X))
    beside = time - (np.bincount(level, time) / counts)[level]
    found = Drift(0.0, 0.0)
    for _ in range(TURNS):
        steady = found.removed(T)
        mean = (np.bincount(level, steady) / counts)[level]
        s_0, s_1 = repeated_errors(X, steady) or (0.0, 1.0)
        weight = 1.0 / (s_1 ** 2 + (s_0 / mean) ** 2)
        rest = steady / mean - 1.0
        size = float(weight @ beside ** 2)
        more = float(weight @ (beside * rest)) / size
        variance = float(weight @ (rest - more * beside) ** 2) / freedom / size
        found = Drift(found.rate + more, float(
            stats.t.ppf(0.5 + 0.5 * LEVEL, freedom) * np.sqrt(variance)))
    clear = float(stats.t.ppf(1.0 - 0.5 * SURE, freedom) * np.sqrt(variance))
    return found if abs(found.rate) > clear else None


def weighted(
    A: Floats, T: Floats, start: Floats, s_0: float, s_1: float, counts: Floats | float = 1.0,
    zero: bool = False,
) -> tuple[Floats, Floats, float]:
    """
    Return the parameters of the largest likelihood for readings whose errors are known.

    Parameters
    ----------
    A : (n, k)
        Columns of the logarithm of the law.
    T : (n,) N
    start : (k,)
    s_0 : N
        Error whatever the thrust.
    s_1 : 1
        Error of the thrust, besides.
    counts
        Readings that each thrust is the mean of.
    zero
        Whether a constant z N is added to the law.

    Returns
    -------
    theta : (k,), or (k + 1,) with z
    covariance
        Of theta, by what is left.
    variance
        Of what is left, over the errors.

    """
    k = len(start)
    theta = np.append(start, 0.0) if zero else np.asarray(start, float)
    for _ in range(ROUNDS):
        law = np.exp(A @ theta[:k])
        sigma = np.hypot(s_1 * law, s_0) / np.sqrt(counts)
        slope, rest = A * law[:, None], T - law
        if zero:
            slope, rest = np.column_stack([slope, np.ones(len(T))]), rest - theta[k]
        slope, rest = slope / sigma[:, None], rest / sigma
        theta = theta + np.linalg.lstsq(slope, rest)[0]
    variance = float(rest @ rest) / (len(T) - len(theta))
    return theta, variance * np.linalg.inv(slope.T @ slope), variance


def _term(
    A: Floats, T: Floats, start: Floats, s_0: float, s_1: float, counts: Floats, zero: bool,
) -> Term | None:
    """Return a zero of the scale, or the drift of the last column of A; None: not clearly."""
    try:
        with np.errstate(all='ignore'):  # of a search that leads nowhere
            theta, covariance, variance = weighted(A, T, start, s_0, s_1, counts, zero)
    except np.linalg.LinAlgError:
        return None
    sd, freedom = np.sqrt(np.diag(covariance)), len(T) - len(theta)
    if not np.isfinite([*theta, *sd]).all() or not stats.t.sf(
            abs(theta[2]) / sd[2], freedom) < 0.5 * SURE:
        return None
    half = float(sd[1] * stats.t.ppf(0.5 + 0.5 * LEVEL, freedom))
    b = Value(float(theta[1]), float(theta[1]) - half, float(theta[1]) + half, '1')
    if zero:
        return Term(f'a zero of the scale that is wrong by {1000.0 * theta[2]:+.2g} mN',
                    float(theta[2]), 'read the scale with the motor at rest, before and after',
                    b, variance)
    share = float(np.expm1(theta[2]))
    return Term(f'a thrust that drifts by {100.0 * share:+.2g} % from the first reading to the '
                'last', share, 'measure up and down at a steady supply', b, variance)


def systematic(X: Floats, T: Floats, start: Floats, s_0: float, s_1: float) -> list[Term]:
    """
    Return the systematic errors with which the power law fits clearly better, the best one first.

    A t test of each, on means; several may explain the same readings.

    Parameters
    ----------
    X, T : (n,), (n,) N
        Readings, in the order in which they were taken.
    start : (2,)
        ln a and b without such an error.
    s_0, s_1 : N, 1
        Errors of the readings, as of :func:`weighted`.

    """
    levels, level, counts = np.unique(X, return_inverse=True, return_counts=True)
    m = len(levels)
    if m < 4 or len(X) - m < LEAST_REPEATED:
        return []
    mean, time = (np.bincount(level, x) / counts for x in (T, np.arange(len(X)) / len(X)))
    law = np.column_stack([np.ones(m), np.log(levels)])
    found = [_term(law, mean, start, s_0, s_1, counts, True)]
    if not _comes_back(X) and np.std(time - law @ np.linalg.lstsq(law, time)[0]) > APART:
        found.append(_term(np.column_stack([law, time]), mean, np.append(start, 0.0), s_0, s_1,
                           counts, False))
    return sorted((one for one in found if one), key=lambda one: one.variance)


def described(terms: list[Term]) -> str:
    """Return systematic errors in words; empty without one."""
    if not terms:
        return ''
    each = ', or with '.join(
        f'{one.words} (b = {one.b.value:.4g}, {one.b.low:.4g} to {one.b.high:.4g})'
        for one in terms)
    return (f'the power law fits clearly better with {each}: the interval of b holds only '
            f'without {"them" if len(terms) > 1 else "it"}; '
            f'{", and ".join(one.cure for one in terms)}')


def one_way(X: Floats, half: float) -> str:
    """
    Return in words that a drift would be in the exponent, unseen; empty: it would not.

    If every command was measured at one time only and the commands rise or fall, time and command
    go together.

    Parameters
    ----------
    X : (n,)
        Commands, in the order in which they were taken.
    half : 1
        Half width of the interval of the exponent.

    """
    if _comes_back(X):
        return ''
    log_X = np.log(X) - np.log(X).mean()
    moved = float(log_X @ np.linspace(0.0, 1.0, len(X)) / (log_X @ log_X))  # b, per drift of 1
    if not half < LARGEST_DRIFT * abs(moved):
        return ''
    return ('in the order of the file no command is measured again after another one, and they '
            f'{"rise" if moved > 0.0 else "fall"}: a supply or scale that drifts by 1 % from the '
            f'first reading to the last moves b by {0.01 * abs(moved):.2g}, which these readings '
            f'hardly show; its interval, +-{half:.2g}, holds without a drift only: measure up and '
            'down at a steady supply')
