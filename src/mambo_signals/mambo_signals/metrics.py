"""Error statistics of vector signals."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .resample import Floats, Ints


class Statistics(NamedTuple):
    """
    Statistics of n error vectors with k components.

    Attributes
    ----------
    count
        n, the number of errors whose components are all finite.
    rms, maximum
        (k,) RMS and largest magnitude of each component.
    rms_total, maximum_total
        RMS and maximum of the Euclidean norm; ``rms_total`` is the root of the sum of squares of
        ``rms``.

    """

    count: int
    rms: tuple[float, ...]
    maximum: tuple[float, ...]
    rms_total: float
    maximum_total: float


def statistics(errors: Floats) -> Statistics:
    """
    Return the statistics of errors, (n, k) any unit; NaN if there is no valid error.

    Errors with a component that is not finite are left out.
    """
    errors = np.asarray(errors, float)
    good = errors[np.isfinite(errors).all(axis=1)]
    if not len(good):
        unknown = (float('nan'),) * errors.shape[1]
        return Statistics(0, unknown, unknown, float('nan'), float('nan'))
    squares = good * good
    norm = squares.sum(axis=1)
    return Statistics(
        len(good), tuple(np.sqrt(squares.mean(axis=0)).tolist()),
        tuple(np.abs(good).max(axis=0).tolist()), float(np.sqrt(norm.mean())),
        float(np.sqrt(norm.max())))


def common_stamps(a: Ints, b: Ints) -> tuple[Ints, Ints]:
    """Return the indices of the common stamps in two arrays of stamps."""
    _, in_a, in_b = np.intersect1d(a, b, return_indices=True)
    return in_a, in_b


def count_missing(stamps: Ints, period: float) -> int:
    """
    Return the number of samples missing between the first and the last stamp.

    Parameters
    ----------
    stamps : (n,) ns
        In any order; repeated stamps count once.
    period : ns
        Sampling period; each gap is rounded to a whole number of periods.

    """
    gaps = np.diff(np.unique(stamps))
    return int(np.maximum(np.rint(gaps / period) - 1.0, 0.0).sum())


def envelope(t: Floats, values: Floats, points: int) -> tuple[Floats, Floats]:
    """
    Reduce a signal for a plot, keeping the minimum and maximum of each block of samples.

    Parameters
    ----------
    t, values : (n,)
        NaN: no value; a block of NaN keeps a NaN.
    points
        Approximate number of points to keep; a shorter signal is returned unchanged.

    """
    size = -(-len(t) // (points // 2))
    if size <= 2:
        return t, values
    whole = len(t) // size * size
    blocks = values[:whole].reshape(-1, size)
    low = np.where(np.isnan(blocks), np.inf, blocks).argmin(axis=1)
    high = np.where(np.isnan(blocks), -np.inf, blocks).argmax(axis=1)
    chosen = np.sort(np.stack([low, high]), axis=0) + np.arange(len(blocks)) * size
    index = np.concatenate([chosen.T.reshape(-1), np.arange(whole, len(t))])
    return t[index], values[index]


def running_rms(stamps: Ints, errors: Floats) -> Floats:
    """
    Return the RMS of the error norm from the first sample up to each sample, (n,).

    Parameters
    ----------
    stamps : (n,) ns
        In order; each error is weighted with the time to the next one, so that parts with a
        higher sampling rate do not count more.
    errors : (n, k)
        NaN: not counted; the previous result is held, and after the last valid error it is NaN.

    """
    squares = (np.asarray(errors, float) ** 2).sum(axis=1)
    good = np.isfinite(squares)
    durations = np.diff(stamps, append=stamps[-1:]).astype(float)
    if len(durations) > 1:
        durations[-1] = durations[-2]
    weight = np.where(good, np.maximum(durations, 1.0), 0.0)
    summed, weights = np.cumsum(np.where(good, squares, 0.0) * weight), np.cumsum(weight)
    weights[len(good) - int(np.argmax(good[::-1])):] = 0.0  # NaN after the last valid error
    return np.sqrt(np.divide(
        summed, weights, out=np.full(len(weights), np.nan), where=weights > 0.0))


def drift(errors: Floats) -> Floats:
    """Return the last error whose components are all finite, (k,); NaN if there is none."""
    errors = np.asarray(errors, float)
    good = np.flatnonzero(np.isfinite(errors).all(axis=1))
    return errors[good[-1]] if len(good) else np.full(errors.shape[1], np.nan)


def independent(a: Floats, b: Floats) -> float:
    """
    Return how many independent pairs tell as much of a correlation as two series, (n,), do.

    n over 1 + 2 sum of the products of both autocorrelations (Bartlett 1935, Some Aspects of the
    Time-Correlation Problem in Regard to Tests of Significance), with weights that fall to 0 at
    n, and at most n.
    """
    a, b = a - a.mean(), b - b.mean()
    n, power = len(a), float(a @ a) * float(b @ b)
    if power <= 0.0:
        return 0.0
    both = [float(a[k:] @ a[:-k]) * float(b[k:] @ b[:-k]) for k in range(1, n // 2)]
    weights = 1.0 - np.arange(1, len(both) + 1) / n
    return n / max(1.0 + 2.0 * float(weights @ both) / power, 1.0)


def _variances(a: Floats, b: Floats, weight: Floats) -> Floats:
    """
    Return the variance of ``a - b[k:]`` for every k, over the elements with weight 1 (not 0).

    Correlations give all of them much faster than a loop. ``a`` must be 0 where the weight is 0,
    and both signals should have a mean near 0 to limit rounding errors.
    """
    count = weight.sum()
    squares = (a * a).sum() - 2.0 * np.correlate(b, a) + np.correlate(b * b, weight)
    return squares / count - ((a.sum() - np.correlate(b, weight)) / count) ** 2


def _misfits(a: Floats, b: Floats, lags: int) -> tuple[Floats, float] | None:
    """
    Return how well ``b`` explains the middle of ``a``, for each delay of ``a`` behind it.

    Returns
    -------
    variances of the difference for delays of -lags to lags samples, and the variance of ``a``;
    None without motion or with too few samples.

    """
    middle = a[lags:len(a) - lags]
    whole, good = np.isfinite(middle), np.isfinite(b)
    windows = np.lib.stride_tricks.sliding_window_view(good, len(middle))
    whole &= True if good.all() else windows.all(axis=0)
    if whole.sum() < 2 * lags or np.ptp(middle[whole]) == 0.0:
        return None
    return _variances(
        np.where(whole, middle - middle[whole].mean(), 0.0),
        np.where(good, b - b[good].mean(), 0.0), whole.astype(float))[::-1], float(
            np.var(middle[whole]))


_SHIFT = 0.1  # s
_RISE = 0.5  # part of the variance: 1 and more in flights on a circle, 0.15 where a hover drifts


def delay(a: Floats, b: Floats, period: float, longest: float = 1.0) -> float:
    """
    Return the delay of one signal behind another [s]; positive if ``a`` is later.

    It is the shift that minimises the variance of the difference, refined between samples by a
    parabola through the minimum and its two neighbours. Each signal is shifted against the middle
    of the other, and the two variances are added. A jump at an end of one middle would otherwise
    bend the parabola. The delay of a signal behind itself is therefore 0, and that of ``b`` behind
    ``a`` is the negative one.

    Parameters
    ----------
    a, b : (n,)
        Signals at the same instants.
    period : s
        Time between samples.
    longest : s
        Largest delay in the search, in either direction.

    Returns
    -------
    NaN if the signals do not determine it: they are shorter than four times the longest delay,
    there is no motion, the other signal explains less than 0.9 of the variance, the minimum
    is at the end of the search, or a shift of ``_SHIFT`` from it increases the variance of the
    difference by less than ``_RISE``: a slow drift of the difference would decide.

    """
    lags = round(longest / period)
    if len(a) < 4 * lags or not (np.isfinite(a).any() and np.isfinite(b).any()):
        return float('nan')
    one, other = _misfits(a, b, lags), _misfits(b, a, lags)
    if one is None or other is None:
        return float('nan')
    variances, variance = one[0] + other[0][::-1], one[1] + other[1]
    best = int(variances.argmin())
    if best in (0, len(variances) - 1) or variances[best] > 0.1 * variance:
        return float('nan')
    near = round(_SHIFT / period)
    around = variances[max(best - near, 0)], variances[min(best + near, 2 * lags)]
    if sum(around) < 2.0 * (1.0 + _RISE) * variances[best]:
        return float('nan')
    before, here, after = variances[best - 1:best + 2]
    bend = before - 2.0 * here + after
    return (best - lags + (0.5 * (before - after) / bend if bend > 0.0 else 0.0)) * period
