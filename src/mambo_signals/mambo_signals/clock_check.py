"""
Whether one offset between two clocks holds for a whole flight, by the motion in parts of it.

An offset that is found from the whole of two recordings fits most of them. Where a clock jumps,
the rest is moved by the jump, and nothing of that shows in the offset. So the turn rates
and climb rates of both recordings are compared in windows: some that show one offset clearly, and
some that show another one and the first not at all, are a contradiction. No window of 12 real
flights shows another offset than the found one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, gaussian_filter1d

from .resample import inside_gaps

Floats = NDArray[np.float64]
STEP = 0.01      # s, of the grid
SMOOTH = 0.03    # s, standard deviation
WINDOW = 4.0     # s
REACH = 4.0      # s, by which windows are moved
NEAR = 0.06      # s, difference of an offset that does not count; filters and delays differ
GAP = 5.0        # periods that are bridged
EDGE = 0.2       # s beside a gap, where derivatives are not known
SWING = 0.2      # rad/s or m/s, least range of a rate in a window
CLEAR = 0.8      # correlation at an offset that a window shows, at least
NONE = 0.5       # correlation at the found one where it shows another, at most
CERTAIN = (0.95, 0.2)  # the same where one window is enough
VOTES = 2        # windows and axes that agree
CLIMB = (0.02, 0.15)   # s, step and smoothing of a climb rate


class Vote(NamedTuple):
    """What a signal shows in a window."""

    t: float      # s, middle of the window, on the first clock
    lag: float    # s, to be added to the offset; 0: the offset fits
    there: float  # correlation at that lag
    here: float   # correlation without it


def votes(
    times_a: Floats, a: Floats, times_b: Floats, b: Floats, offset: float,
) -> Iterator[Vote]:
    """
    Yield what the windows of a signal show, each that shows an offset clearly.

    Parameters
    ----------
    times_a, a, times_b, b : (n,) and (m,) s, rad/s or m/s
        The same rate in both recordings.
    offset : s
        To add to the second clock.

    """
    good_a, good_b = np.isfinite(a), np.isfinite(b)
    times_a, a, times_b, b = times_a[good_a], a[good_a], times_b[good_b], b[good_b]
    if not (len(times_a) and len(times_b)):
        return
    grid = np.arange(max(times_a.min(), times_b.min() + offset), min(
        times_a.max(), times_b.max() + offset), STEP)
    size, reach = round(WINDOW / STEP), round(REACH / STEP)
    if len(grid) < 2 * size:
        return
    first, second = _on(times_a, a, grid), _on(times_b + offset, b, grid)
    for begin in range(0, len(grid) - size + 1, size):
        seen = second[begin:begin + size]
        low, high = max(begin - reach, 0), min(begin + size + reach, len(grid))
        if not np.isfinite(seen).all() or np.ptp(seen) < SWING:
            continue
        r = _correlation(sliding_window_view(first[low:high], size), seen)
        lag = (np.arange(len(r)) + low - begin) * STEP
        near = np.abs(lag) <= NEAR
        if not np.isfinite(r[near]).all():
            continue
        best = int(np.nanargmax(r))
        here, t = float(r[near].max()), float(grid[begin] + 0.5 * WINDOW)
        if here >= CLEAR:
            yield Vote(t, 0.0, here, here)
        elif r[best] >= CLEAR and here < NONE and np.nanmedian(r) < NONE:  # no ramp, that fits all
            yield Vote(t, float(lag[best]), float(r[best]), here)


def climb(times: Floats, heights: Floats) -> tuple[Floats, Floats]:
    """Return the climb rate, m/s at times in s, of heights, (n,) m."""
    good = np.isfinite(heights)
    times, heights = times[good], heights[good]
    if len(times) < 2:
        return np.empty(0), np.empty(0)
    step, smooth = CLIMB
    grid = np.arange(times[0], times[-1], step)
    out = np.gradient(gaussian_filter1d(
        np.interp(grid, times, heights), smooth / step), step) if len(grid) > 1 else 0.0 * grid
    there = ~inside_gaps(times, grid, GAP)
    return grid[there], out[there]


def _on(times: Floats, values: Floats, grid: Floats) -> Floats:
    """Return a signal on a grid, smoothed, NaN in gaps."""
    order = np.argsort(times, kind='stable')  # a clock that was set back
    times, values = times[order], values[order]
    out = gaussian_filter1d(np.interp(grid, times, values), SMOOTH / STEP)
    out[binary_dilation(inside_gaps(times, grid, GAP), iterations=round(EDGE / STEP))] = np.nan
    return out


def _correlation(windows: Floats, seen: Floats) -> Floats:
    """Return the correlation of each window, (k, n), with a signal, (n,); NaN in gaps, at rest."""
    x = windows - windows.mean(axis=1, keepdims=True)
    y = seen - seen.mean()
    spread = np.sqrt((x * x).sum(axis=1) * (y * y).sum())
    known = np.isfinite(spread) & (np.ptp(windows, axis=1) > 0.5 * SWING)
    return np.where(known, (x @ y) / np.where(known, spread, 1.0), np.nan)


def contradiction(
    pairs: Mapping[str, tuple[Floats, Floats, Floats, Floats]], offset: float,
) -> str:
    """
    Return in words where a flight shows another offset than the one found; empty: nowhere.

    Parameters
    ----------
    pairs
        {name: times [s] and rate of the flight, the same of the motion capture}, as of
        :func:`votes`.
    offset : s
        To add to the clock of the motion capture.

    """
    found = [(name, vote) for name, pair in pairs.items() for vote in votes(*pair, offset)]
    for name, vote in found:
        same = [other for _, other in found if abs(other.lag - vote.lag) <= NEAR]
        certain = vote.there >= CERTAIN[0] and vote.here <= CERTAIN[1]
        if vote.lag and len(same) < len(found) and (certain or len(same) >= VOTES):
            return (f'the clocks jump, or run differently: about t = {vote.t:.1f} s the {name} '
                    f'fits an offset of {offset + vote.lag:+.3f} s (correlation {vote.there:.2f}) '
                    f'and not {offset:+.3f} s ({vote.here:.2f}): cut the recordings between')
    return ''
