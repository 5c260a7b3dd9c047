"""
Whether a tracked height and the range to the floor show the same: the axis that is up, the unit.

A range over steps, or beyond its reach, follows no height and says nothing. Nor does one near the
floor, where a sonar repeats its shortest range at any height: below ``min_range`` of the message,
or, as a table or a foreign bag does not know that, where the readings stand at the least one of
the recording while the height changes.
"""

from __future__ import annotations

from mambo_bags.reader import Bag, BagError
import numpy as np

from . import motion
from .gyro_check import differs
from .resample import Floats, interpolate, runs

LEAST_ROWS = 50     # of two signals that are compared
LEAST_CHANGE = 0.1  # m, standard deviation of a range or a path that can be compared
FOLLOWS = 0.95      # correlation of a range with the axis that is up; five real flights: 0.999
OTHER = 0.9  # correlation below which a range does not follow an axis; the others have up to 0.78
FACTOR = 1.25  # of the height by the range: five real flights 0.987 to 1.011, feet 3.3
WITHIN = 1.2  # [-] times the shortest range, which a range repeats on the floor
LEAST_SHARE = 1.0  # % of the readings, below the least one that counts: single ones may be damaged
NEAR = 1.1    # [-] times that: the readings whose median is the repeated one, with 5 mm of noise
FEW = 10      # readings at the largest range, at least, that stand there
EXACT = 0.01  # [-] of a repeated range, that its copies may differ: a step of 4 mm of 0.434 m
STANDS = 4.0  # [-] times the change of height that the scatter explains; 1 of one that follows
GAP = 0.1     # s, over which poses are connected
CHANGE = 0.5  # s, over which the change of two heights is compared
UNKNOWN = 0.2  # s between samples, in which an edge is not told from a climb
MOVES = 0.03  # m, RMS of the change of a height that can be followed; less is mostly noise
STEP, STEP_RATE = 0.04, 1.0
"""Change of a range from one sample to the next that is not of the height, an edge of the floor:
in m, and in m/s at most as fast."""
EDGE = 3  # such samples in a row, at most: an edge, or an echo that is wrong; a climb takes longer
ALIKE = 0.8
"""Correlation of the changes of two heights of one flight, at least. It is 0.99 to 1.00 of range
or own height in 12 real flights with their own capture, and of nine real pairs of two flights
0.43 to 0.71."""
GAIN = 1.5    # of these changes; a range of 0.7 m for each metre is wrong, but of this flight


def other_axis(ranges: Floats, position: Floats, what: str = 'the range') -> str | None:
    """
    Return in words which axis of a motion capture is up, if it is not z.

    A range that follows no axis, over steps or beyond its reach, says nothing.

    Parameters
    ----------
    ranges : (n,) m
    position : (n, 3) m
        At the same times.
    what
        Name of the ranges, or of other heights, in the line.

    """
    if len(ranges) < LEAST_ROWS or ranges.std() < LEAST_CHANGE:
        return None
    spread = position.std(axis=0)
    if not np.ptp(position[:, 2]) > 0.0:
        return (f'z of the motion capture is {position[0, 2]:.4g} m throughout, while {what} '
                f'changes by {np.ptp(ranges):.3g} m: it must have z up')
    r = (ranges - ranges.mean()) @ (position - position.mean(axis=0)) / (
        len(ranges) * ranges.std() * np.maximum(spread, 1e-12))
    if r[2] > OTHER:
        return None
    axis = int(np.abs(r).argmax())
    if abs(r[axis]) < FOLLOWS:
        return None
    return (f'{what} follows {"-" * bool(r[axis] < 0.0)}{"xyz"[axis]} of the motion capture '
            f'(correlation {abs(r[axis]):.2f}), z does not ({r[2]:.2f}): it must have z up')


def other_scale(
    ranges: Floats, height: Floats, what: str = 'the height of the motion capture',
) -> str | None:
    """
    Return in words that a height changes by much more than the range, or much less.

    Parameters
    ----------
    ranges, height : (n,) m
        At the same times.
    what
        Name of the height, in the line.

    """
    if len(ranges) < LEAST_ROWS or ranges.std() < LEAST_CHANGE or not np.ptp(height) > 0.0:
        return None
    r = float(np.corrcoef(ranges, height)[0, 1])
    ratio = float(height.std() / ranges.std())
    if r < FOLLOWS or not differs(r, ratio, FACTOR):
        return None
    return f'{what} changes {ratio:.3g} times as much as the range: one of them is not in m'


def changes(
    t: Floats, heights: Floats, times: Floats, tracked: Floats,
) -> tuple[float, float, float] | None:
    """
    Return how a height follows the tracked one; None where they have too little in common.

    The levels do not count, nor do edges of the floor, at which a range changes at once.

    Parameters
    ----------
    t, heights : (n,) s, m
        Range or own height; NaN where it is not known.
    times, tracked : (m,) s, m
        On the same clock.

    Returns
    -------
    Correlation of the changes over ``CHANGE``, about 0; their RMS of both, m.

    """
    t, first = np.unique(t, return_index=True)
    heights = np.asarray(heights, float)[first]
    known = np.isfinite(tracked)
    both = np.column_stack([
        heights, interpolate(t, times[known], tracked[known, None], GAP)])
    there = np.isfinite(both).all(axis=1)
    t, both = t[there], both[there]
    if len(t) < LEAST_ROWS:
        return None
    steps, apart = np.diff(both, axis=0), np.diff(t)
    edge = np.abs(steps[:, 0] - steps[:, 1]) > np.maximum(STEP, STEP_RATE * apart)
    for begin, end in runs(edge).tolist():
        if end - begin <= EDGE:
            steps[begin:end] = 0.0
    steps[apart > UNKNOWN] = 0.0
    path = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    begin = t[t + CHANGE <= t[-1]]
    a, b = (np.interp(begin + CHANGE, t, x) - x[:len(begin)] for x in path.T)
    sizes = [float(np.sqrt(np.mean(x * x))) if len(x) else 0.0 for x in (a, b)]
    r = float(np.mean(a * b)) / max(sizes[0] * sizes[1], 1e-12) if len(a) else 0.0
    return r, sizes[0], sizes[1]


def unclamped(t: Floats, ranges: Floats, times: Floats, tracked: Floats) -> Floats:
    """
    Return ranges, (n,) m, with NaN where they stand at their least or largest value.

    A sonar repeats its shortest range near the floor, and its longest out of reach, while the
    tracked height changes. Parameters as of :func:`changes`.
    """
    known = np.isfinite(tracked)
    if known.sum() < 2:
        return ranges
    height = interpolate(t, times[known], tracked[known, None], GAP)[:, 0]
    there = np.isfinite(ranges) & np.isfinite(height)
    out = np.where(there, ranges, np.nan)
    if there.sum() < LEAST_ROWS:
        return out
    if found := repeated(ranges[there], height[there]):
        out[out <= WITHIN * found[0]] = np.nan
    stands = out >= (1.0 - EXACT) * np.nanmax(out) if np.isfinite(out).any() else ~there
    if stands.sum() >= FEW and np.ptp(height[stands]) > LEAST_CHANGE + np.ptp(out[stands]):
        out[stands] = np.nan
    return out


def not_followed(
    t: Floats, heights: Floats, times: Floats, tracked: Floats, names: tuple[str, str],
) -> str:
    """
    Return in words that a height does not follow the tracked one; empty: it does, or says nothing.

    Only a tracked height that changes can be followed: below a level flight the floor may be
    uneven.

    Parameters as of :func:`changes`, and the names of the height and of the capture.
    """
    if (found := changes(t, heights, times, tracked)) is None or found[2] < MOVES:
        return ''
    r, own, seen = found
    if r >= ALIKE and not differs(r, own / seen, GAIN):
        return ''
    what, other = names
    return (f'{what} does not follow the height of {other} (correlation of their changes over '
            f'{CHANGE:g} s {r:.2f}, RMS {own:.3f} and {seen:.3f} m)')


def of_bag(bag: Bag) -> list[str]:
    """
    Return what of the range contradicts the motion capture of a recording, one line at most.

    Nothing without both, or if their samples cannot be read: what needs them says so.
    """
    if 'optitrack/pose' not in bag or not len(bag['optitrack/pose']):
        return []
    try:
        found = beside(bag, motion.read(bag, 'optitrack/pose'))
    except BagError:
        return []
    if found is None:
        return []
    ranges, position = found
    said = other_axis(ranges, position) or other_scale(ranges, position[:, 2])
    return [said] if said else []


def beside(bag: Bag, tracked: motion.Motion) -> tuple[Floats, Floats] | None:
    """Return the ranges of a bag, (n,) m, and positions at their times, (n, 3) m; None without."""
    if 'sonar/range' not in bag or not len(bag['sonar/range']):
        return None
    sonar = bag['sonar/range']
    try:
        low, high, ranges = (
            np.asarray(sonar[name], float) for name in ('min_range', 'max_range', 'range'))
    except (BagError, KeyError):
        return None
    position = interpolate(sonar.t, tracked.t, tracked.position, GAP)
    known = (WITHIN * low < ranges) & (ranges < high) & np.isfinite(position).all(axis=1)
    return _off_floor(ranges[known], position[known])


def repeated(ranges: Floats, height: Floats) -> tuple[float, float] | None:
    """
    Return the range that is repeated near the floor, and up to which height; None: there is none.

    Parameters
    ----------
    ranges, height : (n,)
        At the same times, in order, finite; in any unit.

    Returns
    -------
    In the units of both. The height is where the line through the readings above ends.

    """
    if len(ranges) < LEAST_ROWS:
        return None
    least = float(np.percentile(ranges, LEAST_SHARE))
    usual = float(np.median(ranges[ranges <= NEAR * least]))
    above, stands = ranges > WITHIN * usual, ranges <= usual
    if above.sum() < 2 or not min(np.ptp(ranges[above]), np.ptp(height[above])) > 0.0:
        return None
    slope = float(height[above].std() / ranges[above].std())
    if np.corrcoef(ranges[above], height[above])[0, 1] < OTHER:
        return None
    top = float(height[above].mean() - slope * (ranges[above].mean() - usual))
    lowest, bottom = (float(np.percentile(x[stands], 5.0)) for x in (ranges, height))
    explained = slope * (usual - lowest + EXACT * usual)
    return (usual, top) if top - bottom > STANDS * explained else None


def _off_floor(ranges: Floats, position: Floats) -> tuple[Floats, Floats]:
    """
    Return ranges, (n,), and positions, (n, 3), without the readings that repeat near the floor.

    If the others show too little, as of a hover, they stay, at the height up to which they repeat:
    without them a wrong unit would not be told.
    """
    found = repeated(ranges, position[:, 2])
    if found is None:
        return ranges, position
    usual, top = found
    above = ranges > WITHIN * usual
    if above.sum() >= LEAST_ROWS and ranges[above].std() >= LEAST_CHANGE and (
            np.corrcoef(ranges[above], position[above, 2])[0, 1] >= FOLLOWS):
        return ranges[above], position[above]
    position = position.copy()
    position[~above, 2] = np.maximum(position[~above, 2], top)
    return ranges, position
