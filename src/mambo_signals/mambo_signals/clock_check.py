"""
Whether one offset between two clocks holds for a whole flight, by the motion in parts of it.

An offset that is found from the whole of two recordings fits most of them. Where a clock jumps,
the rest is moved by the jump, and nothing of that shows in the offset. So the turn rates
and climb rates of both recordings are compared in windows: some that show one offset clearly, and
some that show another one and the first not at all, are a contradiction
(:func:`contradiction`). No window of 12 real flights shows another offset than the found one.

A clock that runs at a wrong rate may leave no window with an offset, or one. So the times of one
recording are stretched by rates near 1, each with the offset that fits it best
(:func:`wrong_rate`). On five real flights of a Crazyflie the mean correlation of climb rate and
turn rates while the motors run is 0.87 to 0.96 at its largest, within 0.5 % of the right rate, and
0.31 to 0.89 at a rate that is wrong by 2 to 7 %. A smaller change of the offset within the
flight is found in windows, too, and widens its standard error or is refused (:func:`change`).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import math
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation, binary_erosion, gaussian_filter1d

from .metrics import independent
from .resample import inside_gaps
from .time_offset import (
    AlignError, Grid, LEAST_QUALITY, LEAST_SWING, masked_correlation, RIVAL, time_offset,
    UNEXPLAINED)

Floats = NDArray[np.float64]
Pairs = Mapping[str, tuple[Floats, Floats, Floats, Floats]]
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
WINDOWS, SHORTEST = 6, 4.0
"""Windows, at most, in which the offset is found again, and their least length [s]."""
CLOSE = 0.5
"""Largest difference of the offset of a window that is looked for [s]."""
CHANGE = 0.05
"""Change of the offset within a flight that is refused [s]. Crystals differ by 50 ppm: 0.03 s in
ten minutes, longer than these batteries last."""
SURE = 4.0
"""Change over its standard error that counts: those of windows of a few seconds are rough."""
DISTINCT, LEAST_WINDOWS = 8.0, 4
"""Change over the scatter of windows about a line or two levels that is refused, and how many
windows tell a scatter. Those of a flight that hardly turns scatter more than their errors say."""
RATES = 1.0 + 0.0025 * np.arange(-80, 101)
"""Rates that are tried [-]. In the part below, one beside the right one moves the ends by 0.08 s
at most, half of how long a turn of a multirotor lasts."""
PART = 60.0
"""Longest part of a recording that is stretched [s], that with the most motion: there a rate
between two of them is still seen, and long recordings cost little more than short ones."""
RATE_STEP, RATE_SMOOTH = 0.02, 0.05  # s, of the signals that are stretched
RATE_EDGE = 2.0 * CLIMB[1]  # s beside gaps and ends: a smoothed climb falls off there
FINEST = 0.004
"""Difference of the best rate from 1 that is not told [-]: one step and the rest of rounding."""

EVIDENCE = 16.0
"""Twice the logarithm of the likelihood ratio of a rate and 1, at least: 4 standard errors. Some
75 rates are tried that differ in a flight of 30 s: chance alone gives that once in 200. Two real
logs with gaps, of 0.1 and 4 s of the gyro, have up to 3.5; rates that are wrong by 1 to 20 % in
nine real logs 57 or more."""


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


def while_flying(
    turns: Pairs, heights: tuple[Floats, Floats, Floats, Floats] | None, begin: float, end: float,
) -> dict[str, tuple[Floats, Floats, Floats, Floats]]:
    """
    Return turn rates and the climb rate, rad/s and m/s, those of the flight from begin to end.

    Parameters
    ----------
    turns
        {name: times [s] and rate of the flight, the same of the motion capture}, rad/s.
    heights
        The same of the height, m; None: there is none.
    begin, end : s
        When the motors run.

    """
    out = dict(turns)
    if heights is not None:
        ta, a, tb, b = heights
        out['climb rate'] = (*climb(ta, a), *climb(tb, b))
    for name, (t, values, *other) in out.items():
        there = (t >= begin) & (t <= end)
        out[name] = (t[there], values[there], *other)
    return out


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


def contradiction(pairs: Pairs, offset: float) -> str:
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


def window_offsets(pairs: Pairs, offset: float, late: Mapping[str, float]) -> Floats:
    """
    Return the offset in parts of a flight.

    Parameters
    ----------
    pairs
        {name: times [s] and values of the flight, the same of the motion capture}; values in m,
        m/s or rad/s, signals that are equally late.
    offset : s
        Of the whole flight, to add to the clock of the motion capture.
    late : s
        Possible delays by name; default: 0.

    Returns
    -------
    (k, 3) s
        Middle of a window on the motion capture's clock, offset there (the median of the signals,
        one of which may have met a wrong peak), its standard error; only windows with an offset.

    """
    if not pairs:
        return np.empty((0, 3))
    begin = max(max(tb[0], ta[0] - offset) for ta, _, tb, _ in pairs.values())
    end = min(min(tb[-1], ta[-1] - offset) for ta, _, tb, _ in pairs.values())
    count = min(WINDOWS, int((end - begin) / SHORTEST))
    edges, out = np.linspace(begin, end, max(count, 0) + 1), []
    for low, high in zip(edges, edges[1:]):
        row = []
        for name, (ta, a, tb, b) in pairs.items():
            inside = (tb >= low) & (tb <= high)
            if _swing(_bend(*_known(tb[inside], b[inside]))) < LEAST_SWING:
                continue  # a ramp fits every offset, each with another bias
            try:
                one = time_offset(ta, a, tb[inside], b[inside], swing=LEAST_SWING,
                                  limits=(offset - CLOSE, offset + CLOSE))
            except AlignError:
                continue
            row.append((one.offset, math.hypot(one.sigma, late.get(name, 0.0))))
        if row:
            out.append((0.5 * (low + high), *np.median(row, axis=0)))
    return np.array(out).reshape(-1, 3)


def change(pairs: Pairs, offset: float, late: Mapping[str, float]) -> float:
    """
    Return the standard deviation of the offset within the flight, s; 0 if it does not change.

    Parameters as of :func:`window_offsets`.

    Raises
    ------
    AlignError
        If it changes by more than ``CHANGE``, evenly or at once.

    """
    windows = window_offsets(pairs, offset, late)
    if len(windows) < 2:
        return 0.0
    t, found, sigma = windows.T
    low, high = int(found.argmin()), int(found.argmax())
    if found[high] - found[low] < SURE * math.hypot(sigma[low], sigma[high]):
        return 0.0
    if len(t) >= LEAST_WINDOWS:
        refuse_slope(t, found)
        refuse_jump(t, found)
    return float(found.std())


def refuse_slope(t: Floats, offset: Floats) -> None:
    """Raise AlignError if offsets, (n,) s at times (n,) s, change evenly."""
    slope, start = np.polyfit(t, offset, 1)
    rest = math.sqrt(float(np.sum((offset - start - slope * t) ** 2)) / (len(t) - 2))
    if abs(slope) * float(np.ptp(t)) > max(CHANGE, DISTINCT * rest):
        raise AlignError(_describe_rate(1.0 + slope))


def _describe_rate(rate: float) -> str:
    """Return what a clock is whose times have to be stretched by a rate, -."""
    wrong = 100.0 * (1.0 / rate - 1.0)
    return (f'the clock of the motion capture runs {abs(wrong):.2g} % too '
            f'{"slow" if wrong < 0.0 else "fast"} for the flight: import it with the right frame '
            'rate')


def refuse_jump(t: Floats, offset: Floats) -> None:
    """Raise AlignError if offsets, (n,) s at times (n,) s, have two levels."""
    for k in range(1, len(t)):
        for after in (k, k + 1):  # the jump may be within a window
            first, second = offset[:k], offset[after:]
            if len(second) == 0:
                continue
            rest = np.concatenate([first - first.mean(), second - second.mean()])
            noise = math.sqrt(float(np.sum(rest ** 2)) / max(len(rest) - 2, 1))
            if abs(first.mean() - second.mean()) > max(CHANGE, DISTINCT * noise):
                raise AlignError(
                    f'the clocks jump: the offset is {first.mean():+.3f} s until t = '
                    f'{t[k - 1]:.1f} s of the motion capture and {second.mean():+.3f} s from '
                    f'{t[after]:.1f} s on: cut the recordings between')


def wrong_rate(pairs: Pairs) -> str:
    """
    Return in words by how much the clock of a motion capture runs too fast or slow; empty: not.

    Parameters as of :func:`best_rate`.
    """
    rate = best_rate(pairs)
    return _describe_rate(rate) if rate != 1.0 else ''


def best_rate(pairs: Pairs, clearly: float = RIVAL, least: int = 1) -> float:
    """
    Return by what the times of the second recording are multiplied to fit the first, -.

    It is 1 unless another of ``RATES`` fits clearly better, by more than chance among the
    independent samples of the signals (``EVIDENCE``), and no half of the
    recording worse, as it does where the clock jumps.

    Parameters
    ----------
    pairs
        {name: times [s] and values of the first, the same of the second}; rates in rad/s or m/s.
        No offset is needed.
    clearly
        Least ratio of the variance that is not explained without to that with the rate.
    least
        Least number of signals that are alike in both at some rate.

    """
    flown, seen = _on_grids(pairs)
    seen = _busiest(seen)
    fit, own = _scan(flown, seen)
    shown = {name: seen[name] for name in seen if own[name] >= LEAST_QUALITY}
    if len(shown) < least:
        return 1.0
    if len(shown) < len(seen):  # a signal that is mostly noise hides what the others show
        fit, _ = _scan(flown, shown)
    best, now = float(fit.max()), float(fit[RATES == 1.0][0])
    rate = float(RATES[fit.argmax()])
    span = min(max(len(one.values) for one in grids.values()) for grids in (flown, shown))
    if best < LEAST_QUALITY or abs(rate - 1.0) <= max(FINEST, CHANGE / (span * RATE_STEP)) or (
            1.0 - now ** 2 < clearly * (1.0 - best ** 2)):
        return 1.0
    if _evidence(flown, shown, rate) < EVIDENCE:
        return 1.0
    for half in _halves(shown):
        there, here = (_correlations(flown, half, each).mean(axis=0).max() for each in (rate, 1.0))
        if here >= max(LEAST_QUALITY, there + UNEXPLAINED):
            return 1.0
    return rate


def _on_grids(pairs: Pairs) -> tuple[dict[str, Grid], dict[str, Grid]]:
    """Return the signals that move, of each recording on one even grid."""
    moving = {name: one for name, one in (
        (name, (*_known(*pair[:2]), *_known(*pair[2:]))) for name, pair in pairs.items())
        if min(_swing(one[1]), _swing(one[3])) >= LEAST_SWING}
    out: tuple[dict[str, Grid], dict[str, Grid]] = ({}, {})
    for grids, k in zip(out, (0, 2)):
        begin = min((one[k][0] for one in moving.values()), default=0.0)
        end = max((one[k][-1] for one in moving.values()), default=0.0)
        at = np.arange(begin, end, RATE_STEP)
        for name, one in moving.items():
            there = binary_erosion(~inside_gaps(one[k], at, GAP), iterations=round(
                RATE_EDGE / RATE_STEP))
            if there.any():
                grids[name] = Grid(begin, RATE_STEP, gaussian_filter1d(np.interp(
                    at, one[k], one[k + 1]), RATE_SMOOTH / RATE_STEP), there)
    return out[0], {name: grid for name, grid in out[1].items() if name in out[0]}


def _busiest(seen: dict[str, Grid]) -> dict[str, Grid]:
    """Return the part of ``PART`` s with the most motion, in standard deviations."""
    size = round(PART / RATE_STEP)
    if max((len(one.values) for one in seen.values()), default=0) <= size:
        return seen
    moved = [np.where(one.there, one.values - one.values[one.there].mean(), 0.0)
             for one in seen.values()]
    power = np.cumsum(sum(x * x / (x @ x) for x in moved if x.any()))
    begin = int(np.argmax(power[size:] - power[:-size])) + 1
    return _cut(seen, begin, begin + size)


def _halves(seen: dict[str, Grid]) -> list[dict[str, Grid]]:
    count = max(len(one.values) for one in seen.values())
    return [_cut(seen, 0, count // 2), _cut(seen, count // 2, count)]


def _cut(seen: dict[str, Grid], begin: int, end: int) -> dict[str, Grid]:
    return {name: Grid(one.start + begin * one.step, one.step, one.values[begin:end],
                       one.there[begin:end]) for name, one in seen.items()}


def _scan(
    flown: dict[str, Grid], seen: dict[str, Grid],
) -> tuple[Floats, dict[str, float]]:
    """Return the best mean correlation at each of ``RATES``, and the best of each signal."""
    fit, own = np.zeros(len(RATES)), np.zeros(len(seen))
    for k, rate in enumerate(RATES):
        r = _correlations(flown, seen, rate)
        if r.size:
            fit[k], own = r.mean(axis=0).max(), np.maximum(own, r.max(axis=1))
    return fit, dict(zip(seen, own.tolist()))


def _stretched(one: Grid, rate: float) -> Grid:
    """Return a signal whose times are multiplied by a rate."""
    at = np.arange(0.0, len(one.values) - 1.0, 1.0 / rate)
    return Grid(one.start, one.step, np.interp(at, np.arange(len(one.values)), one.values),
                one.there[np.round(at).astype(int)])


def _correlations(flown: dict[str, Grid], seen: dict[str, Grid], rate: float) -> Floats:
    """Return the correlation of each signal, stretched by a rate, at all offsets, (n, lags)."""
    out = []
    for name, one in seen.items():
        stretched = _stretched(one, rate)
        least = max(0.5 * min(stretched.there.sum(), flown[name].there.sum()), 2.0)
        out.append(np.nan_to_num(masked_correlation(flown[name], stretched, least)[1]))
    return np.array(out)


def _evidence(flown: dict[str, Grid], seen: dict[str, Grid], rate: float) -> float:
    """
    Return twice the logarithm of the likelihood ratio of a rate and of 1, each at its best offset.

    Of each signal it is the logarithm of the ratio of the variances that are not explained, times
    the number of independent samples of what the rate does not explain, less the three of bias,
    factor and offset.
    """
    fits, out = {each: _correlations(flown, seen, each) for each in (rate, 1.0)}, 0.0
    best = {each: int(r.mean(axis=0).argmax()) for each, r in fits.items()}
    for k, (name, one) in enumerate(seen.items()):
        left = {each: 1.0 - max(float(r[k, best[each]]), 0.0) ** 2 + UNEXPLAINED
                for each, r in fits.items()}
        stretched = _stretched(one, rate)
        a, b = _common(flown[name], stretched, best[rate] + 1 - len(stretched.values))
        rest = a - np.polyval(np.polyfit(b, a, 1), b) if np.ptp(b) > 0.0 else b
        count = independent(rest, rest)
        out += max(count - 3.0, 0.0) * math.log(left[1.0] / left[rate])
    return out


def _common(a: Grid, b: Grid, lag: int) -> tuple[Floats, Floats]:
    """Return the samples of a and b that are both there, sample j of b beside j + lag of a."""
    first, last = max(lag, 0), min(len(a.values), len(b.values) + lag)
    there = a.there[first:last] & b.there[first - lag:last - lag]
    return a.values[first:last][there], b.values[first - lag:last - lag][there]


def _known(times: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Return the finite samples in the order of time."""
    good = np.isfinite(values) & np.isfinite(times)
    order = np.argsort(times[good], kind='stable')
    return times[good][order], values[good][order]


def _bend(times: Floats, values: Floats) -> Floats:
    """Return what is left of values, (n,) at times in s, without their straight line."""
    if len(values) < 3:
        return values[:0]
    at = times - times.mean()
    return values - values.mean() - at * (at @ values) / (at @ at)


def _swing(values: Floats) -> float:
    """Return the range of 99 % of the values; 0 of fewer than two."""
    return float(np.ptp(np.percentile(values, [0.5, 99.5]))) if len(values) > 1 else 0.0
