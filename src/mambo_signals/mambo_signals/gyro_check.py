"""
Whether a gyro and a tracked attitude show the same turning: unit, axes and clock.

Both are smoothed by the same parabola over ``WINDOW`` (:mod:`.derivative`): the gyro's integral
and that of the attitude. In that band a Vicon or Optitrack shows body rates to 0.03 rad/s, and
those of a drone in flight are 0.05 to 0.5 rad/s. Seven flights of a Crazyflie under Vicon
(NanoBench) have correlations of 0.65 to 0.97 and rates of 0.6 to 1.04 times the tracked ones.
"""

from __future__ import annotations

from itertools import permutations, product
from typing import NamedTuple

import numpy as np

from .derivative import body_rates, local_fit, POSITION as WINDOW
from .resample import Floats, interpolate
from .time_offset import AlignError

AXES = ('roll', 'pitch', 'yaw')
UNIT = 5.0          # [-] of rates of one unit: deg/s are 57 times rad/s
FACTOR = 1.5        # [-] of the gain: a gyro's is right to 3 %, a wrong range is a factor of 2
TURNING = 0.05      # rad/s, standard deviation of a rate that shows more than its noise
LEAST = 0.3         # correlation, half of the least that was seen
SEARCH = 1.0        # s, lateness that is looked for: more than a period of most turning
STEP = 0.01         # s, of the search: below it nothing depends on the clock
LEAST_SAMPLES = 50  # of both, to compare them
LEAST_TIME = 2.0    # s that they cover: nine windows. 1.1 s showed other axes by chance
GAP = 0.1           # s, over which samples are connected
ALIKE = 0.6         # correlation of three axes together; of real flights 0.75 to 0.99
SURE = 0.8          # correlation of an axis that tells its unit, of two that tell an angle
OTHER = (0.7, 0.3)  # mean correlation of the axes of another order, and how much it exceeds theirs
ASKEW = 0.21        # rad about z between the axes of both; 0.16 at most in 102 real flights
RIVAL = 1.3         # [-] unexplained variance without lateness over that with it, at least
NEAR, NEAR_STEP = 0.06, 0.02  # s, lateness at which two rates still count as at the same time
SHOWN = 0.6  # correlation that noise must allow: by chance nine windows of noise have 0.4
PART = 0.5
"""Part of the correlation that noise allows, below which two do not turn alike. It is 0.87 to
0.98 in 12 real flights with their own capture, 0.01 to 0.17 in nine real pairs of two flights."""
CONFIRMED = 0.8  # the part from which they do


class Turning(NamedTuple):
    """
    Rates of a gyro beside those of a tracked attitude.

    Attributes
    ----------
    late : s
        Of the attitude, in steps of ``STEP``; 0 if another does not explain clearly more.
    correlation : (3,)
        At that lateness.
    tracked, gyro : (3,) rad/s
        Standard deviations.
    cross : (3, 3)
        Correlation of each axis of the gyro, by row, with each tracked one.

    """

    late: float
    correlation: Floats
    tracked: Floats
    gyro: Floats
    cross: Floats


class Together(NamedTuple):
    """
    Rates of a gyro and of a tracked attitude, of all three axes together.

    Attributes
    ----------
    correlation
        At most ``NEAR`` apart in time.
    possible
        What it would be if both had the larger turning in common, 0 to 1: less than 1 by noise.
    sigma
        Standard error of a correlation of 0: one over the root of the independent samples, one
        for each axis and window.

    """

    correlation: float
    possible: float
    sigma: float

    @property
    def differ(self) -> bool:
        """Return whether they show two motions."""
        return self.possible >= SHOWN and (
            self.correlation + 2.0 * self.sigma < PART * self.possible)

    @property
    def confirmed(self) -> bool:
        """Return whether they show one motion."""
        return self.possible >= SHOWN and self.correlation >= CONFIRMED * self.possible


def together(t: Floats, gyro: Floats, times: Floats, q: Floats) -> Together | None:
    """
    Return how alike a gyro and a tracked attitude turn on one clock; None if they do not overlap.

    How much of each is turning and not noise is the correlation of rates by every other sample
    with those by the rest (the reliability of halves, Spearman 1910, without his correction for
    their length, which is on the safe side).

    Parameters as of :func:`compare`.
    """
    t, gyro, times, q = _usable(t, gyro, times, q)
    if (both := _smooth_rates(t, gyro, times, q)) is None:
        return None
    at, rates = both[:2]
    found = [pair for late in np.arange(-NEAR, NEAR + 0.5 * NEAR_STEP, NEAR_STEP)
             if (pair := _overlap(float(late), *both)) is not None]
    if not found:
        return None
    x, y = max(found, key=lambda pair: _alike(*pair))
    tracked, turned = (float(np.sum(each.var(axis=0))) for each in (x, y))
    halves = [np.full_like(rates, np.nan) for _ in range(2)]
    for k, half in enumerate(halves):
        there, found_there = body_rates(times[k::2], q[k::2], at, WINDOW)
        half[np.searchsorted(at, there)] = found_there
    signal = max(tracked * _reliable(*halves),
                 turned * _reliable(*(_smooth(t[k::2], gyro[k::2], t) for k in range(2))))
    possible = np.sqrt(min(1.0, signal / max(tracked, 1e-12))
                       * min(1.0, signal / max(turned, 1e-12)))
    lasted = np.minimum(np.diff(at), GAP).sum() * len(x) / len(at)
    return Together(_alike(x, y), float(possible), float(np.sqrt(WINDOW / (3.0 * lasted))))


def _alike(x: Floats, y: Floats) -> float:
    """Return the correlation of rates, (n, 3) each, of all axes together."""
    x, y = x - x.mean(axis=0), y - y.mean(axis=0)
    return float(np.sum(x * y) / max(np.sqrt(np.sum(x * x) * np.sum(y * y)), 1e-12))


def _reliable(x: Floats, y: Floats) -> float:
    """Return which share of the variance of rates is in both halves, (n, 3) with NaN; 0 to 1."""
    both = np.isfinite(x).all(axis=1) & np.isfinite(y).all(axis=1)
    return max(_alike(x[both], y[both]), 0.0) if both.sum() >= LEAST_SAMPLES else 0.0


def compare(t: Floats, gyro: Floats, times: Floats, q: Floats,
            search: float = SEARCH) -> Turning | None:
    """
    Return how a gyro and a tracked attitude turn; None if they do not overlap.

    Parameters
    ----------
    t : (n,) s
    gyro : (n, 3) rad/s, body FLU
    times : (m,) s, ascending
        Of the attitudes.
    q : (m, 4)
        Tracked attitude, x y z w, body FLU to inertial.
    search : s
        Largest lateness that is tried.

    """
    if (both := _smooth_rates(*_usable(t, gyro, times, q))) is None:
        return None
    found = [one for late in STEP * np.arange(-round(search / STEP), round(search / STEP) + 1)
             if (one := _beside(float(late), *both))]
    if not found:
        return None
    best = max(found, key=lambda one: float(one.tracked @ one.correlation))
    now = min(found, key=lambda one: abs(one.late))
    left, without = (float(np.sum(one.tracked ** 2 * (1.0 - one.correlation ** 2)))
                     for one in (best, now))
    return best if (best.tracked > TURNING).any() and without > RIVAL * left else now


def _usable(
    t: Floats, gyro: Floats, times: Floats, q: Floats,
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the finite samples of a gyro, in the order of time, and the known attitudes."""
    t, first = np.unique(t, return_index=True)
    gyro = gyro[first]
    known = np.isfinite(gyro).all(axis=1)
    good = np.isfinite(q).all(axis=1) & (np.abs((q * q).sum(axis=1) - 1.0) < 0.1)
    return t[known], gyro[known], times[good], q[good]


def _smooth_rates(
    t: Floats, gyro: Floats, times: Floats, q: Floats,
) -> tuple[Floats, Floats, Floats, Floats] | None:
    """Return times and rates of an attitude and a gyro, smoothed alike; None: there are none."""
    at, rates = body_rates(times, q, window=WINDOW)
    if len(t) < 2 or not len(at):
        return None
    smooth = _smooth(t, gyro, t)
    kept = np.isfinite(smooth).all(axis=1)
    return at, rates, t[kept], smooth[kept]


def _smooth(t: Floats, gyro: Floats, at: Floats) -> Floats:
    """Return a gyro, (n, 3) rad/s at ascending times in s, smoothed as the tracked rates are."""
    half = 0.5 * (gyro[1:] + gyro[:-1]) * np.diff(t)[:, None]
    path = np.concatenate([np.zeros((1, 3)), np.cumsum(half, axis=0)])
    return local_fit(t, path, at, WINDOW)[1]


def _overlap(
    late: float, at: Floats, rates: Floats, t: Floats, gyro: Floats,
) -> tuple[Floats, Floats] | None:
    """Return rates, (k, 3), that are so late, s, and the gyro then; None: too few."""
    there = interpolate(at - late, t, gyro, GAP)
    both = np.isfinite(there).all(axis=1)
    apart = np.diff(at[both])
    if both.sum() < LEAST_SAMPLES or apart[apart < GAP].sum() < LEAST_TIME:
        return None
    return rates[both], there[both]


def _beside(late: float, at: Floats, rates: Floats, t: Floats, gyro: Floats) -> Turning | None:
    """Return how rates (m, 3) that are so late, s, agree with a gyro (n, 3)."""
    if (both := _overlap(late, at, rates, t, gyro)) is None:
        return None
    x, y = (each - each.mean(axis=0) for each in both)
    sx, sy = x.std(axis=0), y.std(axis=0)
    cross = y.T @ x / len(x) / np.maximum(np.outer(sy, sx), 1e-12)
    return Turning(late, np.diag(cross).copy(), sx, sy, cross)


def differs(r: float, ratio: float, factor: float) -> bool:
    """
    Return whether one signal is more than so many times another, or less.

    Noise of both makes the slope of one by the other too small. The gain is between that and the
    inverse of the slope of the other by the one.

    Parameters
    ----------
    r
        Correlation of both, above 0.
    ratio
        Of their standard deviations.
    factor
        Above 1.

    """
    return not (r * ratio < factor and ratio / r > 1.0 / factor)


def other_unit(found: Turning | None) -> float | None:
    """
    Return how many times a gyro turns as much as the tracked attitude, if it is in another unit.

    However slow the turning is: both must show the same, in all axes together. None for a gyro in
    the unit of the attitude, or if they do not show the same.
    """
    if found is None:
        return None
    gyro, tracked = (float(np.linalg.norm(x)) for x in (found.gyro, found.tracked))
    r = float(found.correlation @ (found.gyro * found.tracked)) / max(gyro * tracked, 1e-12)
    if r >= ALIKE and differs(r, gyro / tracked, UNIT):
        return r * gyro / tracked
    for r, tracked, gyro in zip(found.correlation, found.tracked, found.gyro):
        ratio = gyro / max(tracked, 1e-12)
        if r >= SURE and max(tracked, gyro) >= TURNING and differs(r, ratio, UNIT):
            return float(r * ratio)
    return None


def other_axes(found: Turning | None) -> str:
    """
    Return in words in which order and sign the axes of a gyro show the tracked turning.

    Empty where they show it as they are, or not. However slow the turning is: in 22 of 24 pairs
    of 12 real flights, with capture or onboard attitude, the axes have mean correlations of 0.75
    to 0.99 and no other order a higher one; in the other two no order has 0.5.
    """
    if found is None:
        return ''
    mean = {(order, signs): float(np.mean([
        sign * row[axis] for sign, row, axis in zip(signs, found.cross, order)]))
        for order in permutations(range(3)) for signs in product((1, -1), repeat=3)}
    order, signs = best = max(mean, key=lambda one: mean[one])
    if mean[best] < OTHER[0] or mean[best] < mean[(0, 1, 2), (1, 1, 1)] + OTHER[1]:
        return ''
    return 'the gyro shows roll, pitch, yaw as ' + ', '.join(
        f'{"-" * (signs[row] < 0)}{AXES[row]}' for row in map(order.index, range(3)))


def askew(found: Turning | None) -> float:
    """
    Return the angle about z from the axes of a gyro to those of the tracked body, rad.

    0 if both do not show the same turning about the horizontal axes.
    """
    if found is None:
        return 0.0
    gyro, tracked = found.gyro[:2], found.tracked[:2]
    cross = found.cross[:2, :2] * np.outer(gyro, tracked)
    along, across = cross[0, 0] + cross[1, 1], cross[1, 0] - cross[0, 1]
    size = float(np.linalg.norm(gyro) * np.linalg.norm(tracked))
    if max(tracked) < TURNING or np.hypot(along, across) < SURE * size:
        return 0.0
    return float(np.arctan2(across, along))


def turned_body(found: Turning | None) -> str:
    """Return in words that the tracked body is turned about z against the gyro; empty: no."""
    if abs(angle := askew(found)) <= ASKEW:
        return ''
    return (f'the tracked body is turned by {np.degrees(angle):.0f} deg about z against the gyro: '
            'check how its rigid body was made')


def refuse(found: Turning | None) -> None:
    """
    Refuse a gyro that contradicts the tracked attitude.

    Raises
    ------
    AlignError
        Naming the axis: another unit, a dead or wrong axis, or another motion.

    """
    if found is None:
        return
    for axis, r, tracked, gyro in zip(AXES, *found[1:4]):
        if max(tracked, gyro) < TURNING:
            continue
        ratio = gyro / max(tracked, 1e-12)
        text = (f'{axis} rate: the gyro turns by {gyro:.3g} rad/s, the tracked attitude by '
                f'{tracked:.3g} rad/s (standard deviations)')
        if not 1.0 / UNIT < ratio < UNIT:
            raise AlignError(
                f'{text}: one of them is not in SI units, an axis is dead, or the order of the '
                'quaternion is not x y z w: import it with the right ones')
        if tracked > TURNING and r < LEAST:
            raise AlignError(
                f'{axis} rate: gyro and tracked attitude turn differently (correlation {r:.2f}): '
                'check the axes of both (FLU) and the order of the quaternion (x y z w)')
        if tracked > TURNING and differs(r, ratio, FACTOR):
            raise AlignError(f'{text}: more than {FACTOR:g} times apart: check unit and range of '
                             'the gyro')
    if said := other_axes(found):
        raise AlignError(f'{said} of the tracked attitude: check the axes of both (FLU)')
    gain = other_unit(found)
    if gain is not None:
        raise AlignError(
            f'the gyro shows the turning of the tracked attitude {gain:.3g} times: one of them is '
            'not in SI units: import it with the right ones')
