"""
Interpolation of recorded signals at other instants, without values in gaps.

Two neighbouring samples are connected by a straight line unless they are more than
``GAP_PERIODS`` median periods apart. Then there is a gap, and values inside it are NaN. Two lost
frames of a motion capture at 100 Hz are bridged, with an error of at most 1.1 mm at 10 m/s^2
(a dt^2 / 8); a longer gap is not.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
GAP_PERIODS = 3.5  # [-] samples more median periods apart than this are not connected
MOST = 2_000_000  # periods of a signal that is resampled: 2.7 hours at 200 Hz


def median_period(stamps: Ints) -> float:
    """Return the median time between neighbouring stamps [ns]; NaN for fewer than two."""
    gaps = np.diff(stamps)
    if not (gaps > 0).all():
        gaps = np.diff(np.unique(stamps))
    return float(np.median(gaps)) if len(gaps) else float('nan')


def longest_step(stamps: Ints) -> int:
    """Return the largest time [ns] between connected samples; 0 for fewer than two samples."""
    period = median_period(stamps)
    return 0 if np.isnan(period) else round(GAP_PERIODS * period)


def describe_gap(t: Floats) -> str:
    """Return where times (n,) s jump most, and what to do about it, for a message."""
    i = int(np.diff(t).argmax())
    return (f'with a gap of {t[i + 1] - t[i]:.0f} s after {t[i]:.3f} s: a jump of the clock? cut '
            'the recording to the flight')


def gaps(times: Floats, periods: float = GAP_PERIODS) -> Bools:
    """
    Return which of the n - 1 steps between samples are gaps.

    Parameters
    ----------
    times : (n,) s, ascending
    periods
        A step of more than this many median periods is a gap.

    """
    steps = np.diff(times)
    return steps > periods * np.median(steps) if len(steps) else steps > 0.0


def inside_gaps(times: Floats, at: Floats, periods: float = GAP_PERIODS) -> Bools:
    """
    Return which instants lie inside a gap of the samples or beyond their ends.

    Parameters
    ----------
    times : (n,) s, ascending
        Times of the samples, two or more.
    at : (m,) s
    periods
        See :func:`gaps`.

    """
    after = np.clip(np.searchsorted(times, at, side='left'), 1, len(times) - 1)
    lost = gaps(times, periods)[after - 1] & (at > times[after - 1]) & (at < times[after])
    return lost | (at < times[0]) | (at > times[-1])


def runs(known: Bools) -> Ints:
    """Return the first sample of each run of True in a mask, (n,), and that after it, (k, 2)."""
    return np.flatnonzero(np.diff(np.concatenate([[0], known.astype(int), [0]]))).reshape(-1, 2)


def constant_runs(values: Floats) -> Ints:
    """Return the first row of each run of equal rows in (n, k), and that after it, (m, 2)."""
    new = (np.diff(values, axis=0) != 0.0).any(axis=1)
    edges = np.flatnonzero(np.concatenate([[True], new, [True]]))
    return np.column_stack([edges[:-1], edges[1:]])


def longest_run(known: Bools) -> slice:
    """Return the longest run of True in a mask, (n,); an empty slice if there is none."""
    found = runs(known)
    if not len(found):
        return slice(0, 0)
    first, end = found[np.argmax(found[:, 1] - found[:, 0])].tolist()
    return slice(first, end)


def interpolate(stamps: Ints, source_stamps: Ints, values: Floats, gap: int) -> Floats:
    """
    Interpolate a vector signal linearly.

    Parameters
    ----------
    stamps : (n,) ns
        Instants of the result. All times may also be in another unit.
    source_stamps : (m,) ns
    values : (m, k)
    gap : ns
        Samples further apart than this are not connected, see :func:`longest_step`.

    Returns
    -------
    (n, k); NaN outside the source, in its gaps and if it is empty.

    """
    values = np.asarray(values, float)
    out = np.full((len(stamps), values.shape[1]), np.nan)
    if not len(source_stamps):
        return out
    order = np.argsort(source_stamps, kind='stable')
    times, values = np.asarray(source_stamps)[order], values[order]
    after = np.searchsorted(times, stamps, side='left')
    inside = after < len(times)
    exact = inside & (times[np.minimum(after, len(times) - 1)] == stamps)
    out[exact] = values[after[exact]]
    between = np.flatnonzero(inside & ~exact & (after > 0))
    right = after[between]
    left = right - 1
    near = times[right] - times[left] <= gap
    between, left, right = between[near], left[near], right[near]
    share = (np.asarray(stamps)[between] - times[left]) / (times[right] - times[left])
    out[between] = values[left] + share[:, None] * (values[right] - values[left])
    return out


def columns_at(times: Floats, source: Floats, values: Floats) -> Floats:
    """
    Interpolate a vector signal linearly by times in seconds.

    Parameters
    ----------
    times : (n,) s
        Instants of the result.
    source : (m,) s, ascending
    values : (m, k)

    Returns
    -------
    (n, k); NaN outside the source and in its gaps.

    """
    out = np.column_stack([np.interp(times, source, column) for column in np.transpose(values)])
    out[inside_gaps(source, times)] = np.nan
    return out


def resampled(stamps: Ints, values: Floats, period: int, gap: int) -> tuple[Ints, Floats]:
    """
    Interpolate a signal at whole multiples of a period [ns], see :func:`interpolate`.

    One that lasts longer than ``MOST`` periods, as with a stamp of years ahead, has no rows.
    """
    empty = np.empty(0, np.int64), np.empty((0, np.shape(values)[1]))
    if not len(stamps):
        return empty
    first, last = -(-int(np.min(stamps)) // period), int(np.max(stamps)) // period
    if last - first > MOST:
        return empty
    grid = np.arange(first, last + 1) * period
    return grid, interpolate(grid, stamps, values, gap)


def continuous_quaternions(q: Floats) -> Floats:
    """
    Return unit quaternions without jumps of sign, so that neighbours can be interpolated.

    Parameters
    ----------
    q : (n, 4)
        Scalar first or last. Rows that are not unit quaternions become NaN.

    """
    norm = np.linalg.norm(q, axis=1, keepdims=True)
    q = np.divide(q, norm, out=np.full(q.shape, np.nan), where=np.abs(norm - 1.0) < 0.1)
    good = np.flatnonzero(np.isfinite(q).all(axis=1))
    if len(good) > 1:
        q[good[1:]] *= np.cumprod(np.where(
            (q[good[1:]] * q[good[:-1]]).sum(axis=1) < 0.0, -1.0, 1.0))[:, None]
    return q
