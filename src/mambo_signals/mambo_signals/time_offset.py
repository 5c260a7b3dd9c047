"""
Alignment of two recordings of one flight in time and space, and detection of the flight.

Time: :func:`time_offset` resamples both signals to a common grid and computes the normalised
cross-correlation over all lags without the gaps (Padfield 2012, Masked Object Registration in the
Fourier Domain, eq. 6-11). It is invariant to a constant bias and a factor of either signal. A
Gauss-Newton fit of offset, bias and factor then resolves fractions of a sample.
:func:`pose_offset` does this with height, ground speed and yaw rate, which do not depend on the
position and orientation of the two frames.

Space: :func:`registration` computes the least-squares yaw and translation in closed form (the
planar case of Horn 1987). :func:`equalised` makes two paths equal at one instant after take-off,
as in section 5.4.

Times are in seconds, positions in metres, z up. ``offset`` is added to the second clock to get
the first: ``a(t + offset) = b(t)``.
"""

from __future__ import annotations

from collections.abc import Mapping
import math
from typing import NamedTuple, Protocol

from mambo_bags.mcap_reader import BagError
from mambo_bags.reader import Bag
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from .derivative import local_fit, POSITION
from .resample import describe_gap, inside_gaps, runs

Floats = NDArray[np.float64]
GRID = (1e-3, 0.02)  # [s] finest and coarsest step of the common grid
MOST = 2_000_000  # points of that grid; with the coarsest step they last 11 hours
GAP = 5.0  # [-] periods that are bridged: a sonar misses several echoes in a row
LEAST_QUALITY = 0.6  # [-] smallest correlation of two signals of the same motion
WORST = 0.05  # [s] largest standard error of an offset
RIVAL = 1.3  # [-] unexplained variance of the second best lag over that of the best, at least
UNEXPLAINED = 1e-3  # [-] share of the variance added to both in that comparison
SETTLED_OFFSET = 1e-6  # [s] change of the offset at which the fit has converged
LEAST_RISE = 0.1  # [m] smallest height of a flight
LEAST_SWING = 0.1  # [m], [m/s], [rad/s] smallest range of a signal used for the alignment
RANGE_LATE = 0.03  # [s] possible delay of a range by measurement, sampling and transmission
AGREE = 0.15  # [s] allowed difference of signals: filters lag by up to 0.1 s, ranges by 0.05 s
SETTLED = 0.02  # [m] height below which a vehicle counts as standing on the ground
EVEN, SMOOTH = 0.05, 0.2  # [s] step and window of smoothed positions
REST = 0.5  # [s] for which a vehicle stands before it takes off
STILL = 1e-3
"""Most that the position of a standing vehicle changes in ``REST`` [m]. In twelve tracked flights
that is up to 0.4 mm at the begin, on the floor, and 3.4 mm or more in all parts in the air."""
WORST_YAW = math.radians(2.0)
"""Largest standard error of a yaw by two paths [rad]. Of 16 pairs of simulated flights that hover
for 5 or 20 s it is 4 to 170 deg, and the yaw wrong by up to 144 deg, as a path of few independent
parts says little of its own error; of flights along a circle of 0.5 m for 12 s it is 0.5 deg."""
CLIPPED = 0.05  # [m] distance above a sonar's shortest range in which its noise is clipped


class AlignError(BagError):
    """Two signals do not determine the alignment; the message says why in one line."""


class NotExcited(AlignError):
    """A signal varies too little to determine a time offset."""


class UncertainError(AlignError):
    """Two signals are alike at an offset, whose standard error is too large."""


class Poses(Protocol):
    """Recorded poses: messages of a bag, or :class:`mambo_signals.motion.Motion`."""

    @property
    def t(self) -> Floats:
        """Return the stamps, (n,) s."""

    @property
    def position(self) -> Floats:
        """Return the positions, (n, 3) m."""

    @property
    def orientation(self) -> Floats:
        """Return the quaternions x y z w, (n, 4)."""


class Offset(NamedTuple):
    """
    Time offset of two signals.

    Attributes
    ----------
    offset
        s, to be added to the second clock.
    sigma
        s, standard error of the offset; it accounts for residuals correlated in time.
    quality
        Correlation of the two signals at the offset, 0 to 1.
    bias, factor
        ``a = factor * b + bias``: bias in the unit of a, factor in unit of a per unit of b.
    overlap
        s, time for which both signals have values.

    """

    offset: float
    sigma: float
    quality: float
    bias: float
    factor: float
    overlap: float


class Grid(NamedTuple):
    """A signal on an even grid; where ``there`` is False, the values bridge a gap."""

    start: float
    step: float
    values: Floats
    there: NDArray[np.bool_]


def _checked(times: ArrayLike, values: ArrayLike, name: str) -> tuple[Floats, Floats]:
    """Return the finite samples, with times that increase."""
    t, v = np.asarray(times, float), np.asarray(values, float)
    if t.ndim != 1 or t.shape != v.shape:
        raise AlignError(f'{name} signal: {t.shape} times and {v.shape} values, not n of each')
    good = np.isfinite(t) & np.isfinite(v)
    t, v = t[good], v[good]
    if len(t) < 8:
        raise AlignError(f'{name} signal has {len(t)} finite samples; 8 are needed to align it')
    if (np.diff(t) < 0.0).any():
        raise AlignError(f'{name} signal: its times run backwards at {_backwards(t):.3f} s')
    keep = np.append(True, np.diff(t) > 0.0)
    return t[keep], v[keep]


def _backwards(t: Floats) -> float:
    return float(t[1:][np.diff(t) < 0.0][0])


def _on_grid(t: Floats, v: Floats, step: float, smooth: float) -> Grid:
    """Interpolate to an even grid, mark gaps, and smooth with a Gaussian of ``smooth`` s."""
    count = int((t[-1] - t[0]) / step) + 1
    times = t[0] + step * np.arange(count)
    values = gaussian_filter1d(np.interp(times, t, v), smooth / step, mode='nearest')
    return Grid(float(t[0]), step, values, ~inside_gaps(t, times, GAP))


def masked_correlation(a: Grid, b: Grid, least: float) -> tuple[Floats, Floats]:
    """
    Return lags in grid steps, and the correlation at each lag over the common samples.

    Both grids have the same step. Lag k aligns sample j of b with sample j + k of a. The
    correlation is NaN for lags with fewer than ``least`` common samples.
    """
    n, m = len(a.values), len(b.values)
    size = next_fast_len(n + m - 1, real=True)

    def spectrum(x: Floats) -> NDArray[np.complex128]:
        return rfft(x, size)

    middle_a, middle_b = a.values[a.there].mean(), b.values[b.there].mean()
    va, vb = (a.values - middle_a) * a.there, (b.values - middle_b) * b.there
    fa, fb = [spectrum(x) for x in (a.there, va, va * va)], [
        np.conj(spectrum(x)) for x in (b.there, vb, vb * vb)]

    def cross(i: int, j: int) -> Floats:
        full = irfft(fa[i] * fb[j], size)
        return np.concatenate([full[size - m + 1:], full[:n]])

    count = np.rint(cross(0, 0))
    safe = np.maximum(count, 1.0)
    sum_a, sum_b = cross(1, 0), cross(0, 1)
    spread_a = cross(2, 0) - sum_a * sum_a / safe
    spread_b = cross(0, 2) - sum_b * sum_b / safe
    floor_a, floor_b = 1e-6 * (va * va).sum(), 1e-6 * (vb * vb).sum()
    usable = (count >= least) & (spread_a > floor_a) & (spread_b > floor_b)
    shared = cross(1, 1) - sum_a * sum_b / safe
    with np.errstate(invalid='ignore', divide='ignore'):
        r = np.where(usable, shared / np.sqrt(spread_a * spread_b), np.nan)
    return np.arange(1 - m, n), r


def _peak(lags: Floats, r: Floats, step: float, shift: float,
          limits: tuple[float, float] | None) -> int:
    """Return the index of the best lag; raise AlignError if it is ambiguous or at a limit."""
    offsets = lags * step + shift
    inside = np.isfinite(r)
    if limits is not None:
        inside &= (offsets >= limits[0]) & (offsets <= limits[1])
    if not inside.any():
        raise AlignError('the signals never overlap enough, or one of them is constant')
    r = np.where(inside, r, -1.0)
    best = int(np.argmax(r))
    if r[best] < LEAST_QUALITY:
        raise AlignError(
            f'no offset aligns the signals: the best, {offsets[best]:.3f} s, gives a '
            f'correlation of {r[best]:.2f} (at least {LEAST_QUALITY} is needed)')
    if not (0 < best < len(r) - 1 and inside[best - 1] and inside[best + 1]):
        raise AlignError(
            f'the best offset, {offsets[best]:.3f} s, is at the end of the search: '
            'widen its limits, or the recordings are not of one motion')
    low = r < 0.5 * r[best]  # the peak of the best lag ends where the correlation has halved
    left = best - int(np.argmax(low[best::-1])) if low[:best].any() else 0
    right = best + int(np.argmax(low[best:])) if low[best:].any() else len(r)
    rest = np.concatenate([np.arange(left), np.arange(right, len(r))])
    if len(rest):
        rival = int(rest[np.argmax(r[rest])])
        unexplained = 1.0 - r[[rival, best]] ** 2 + UNEXPLAINED
        if unexplained[0] < RIVAL * unexplained[1] and r[rival] > 0.0:
            raise AlignError(
                f'the signals repeat: offsets of {offsets[best]:.3f} s and {offsets[rival]:.3f} s '
                f'fit equally well (correlation {r[best]:.3f} and {r[rival]:.3f}); give limits')
    return best


def _long_run_variance(scores: Floats, least_lag: int) -> float:
    """
    Return the variance of the sum of correlated scores (Newey and West 1987).

    The number of lags follows Andrews 1991 (eq. 6.2, 6.4, with an AR(1) model of the scores) and
    is at least the span of the smoothing.
    """
    n = len(scores)
    x = scores - scores.mean()
    power = float(x @ x)
    if power <= 0.0:
        return 0.0
    rho = min(max(float(x[1:] @ x[:-1]) / power, 0.0), 0.99)
    lag = 1.1447 * (4.0 * rho * rho / (1.0 - rho * rho) ** 2 * n) ** (1.0 / 3.0)
    lag = int(min(max(lag, least_lag, 1), n // 4))
    total = power
    for k in range(1, lag + 1):
        total += 2.0 * (1.0 - k / (lag + 1.0)) * float(x[k:] @ x[:-k])
    return max(total, power / n)


def _refined(a: Grid, b: Grid, lag: float, smooth: float) -> Offset:
    """Fit offset, bias and factor to the samples of a by the Gauss-Newton method."""
    times_a = a.start + a.step * np.arange(len(a.values))
    times_b = b.start + b.step * np.arange(len(b.values))
    curve = CubicSpline(times_b, b.values)
    slope = curve.derivative()
    offset = a.start - b.start + lag
    for _ in range(20):
        at = times_a - offset
        place = (at - b.start) / b.step
        before = np.clip(np.floor(place).astype(int), 0, len(b.values) - 2)
        use = (place >= 0.0) & (place <= len(b.values) - 1) & a.there
        use &= b.there[before] & b.there[before + 1]
        x, y = curve(at[use]), a.values[use]
        design = np.column_stack([np.ones(len(x)), x])
        (bias, factor), *_ = np.linalg.lstsq(design, y, rcond=None)
        residual = y - design @ (bias, factor)
        moved = -factor * slope(at[use])  # derivative of the model by the offset
        moved = moved - design @ np.linalg.lstsq(design, moved, rcond=None)[0]
        power = float(moved @ moved)
        if power <= 0.0:
            raise AlignError('the signals are constant where they overlap')
        change = float(moved @ residual) / power
        offset += float(np.clip(change, -2.0 * a.step, 2.0 * a.step))
        if abs(change) < SETTLED_OFFSET:
            break
    else:
        raise AlignError('the offset does not converge: the signals are too noisy to align')
    least_lag = round(4.0 * smooth / a.step)
    sigma = math.sqrt(_long_run_variance(moved * residual, least_lag)) / power
    spread = float(((y - y.mean()) ** 2).sum())
    quality = math.sqrt(max(1.0 - float(residual @ residual) / spread, 0.0))
    return Offset(float(offset), sigma, quality, float(bias), float(factor),
                  float(use.sum() * a.step))


def time_offset(
    times_a: ArrayLike, a: ArrayLike, times_b: ArrayLike, b: ArrayLike, *,
    limits: tuple[float, float] | None = None, overlap: float = 0.5, worst: float = WORST,
    swing: float = 0.0,
) -> Offset:
    """
    Return the offset between the clocks of two recordings of the same quantity.

    Parameters
    ----------
    times_a, a : (n,) s, any unit
        First recording; samples that are not finite count as missing. Of a sensor that repeats
        its last value, give only the new values.
    times_b, b : (m,) s, any unit
        Second recording, which may have another rate.
    limits : s
        Smallest and largest offset; default: all that leave enough overlap.
    overlap
        Share of the shorter recording that must overlap, 0 to 1.
    worst : s
        Largest standard error accepted.
    swing
        Smallest range of both signals (99 % of their values), in their unit.

    Returns
    -------
    Offset

    Raises
    ------
    AlignError
        If the signals do not determine it: too few samples, no motion, no correlation, several
        offsets that fit equally well, the best one at a limit, or a standard error above
        ``worst``; or if a recording is longer than ``MOST`` of the coarsest steps.
    NotExcited
        If the range of one of them is below ``swing``.

    """
    ta, va = _checked(times_a, a, 'first')
    tb, vb = _checked(times_b, b, 'second')
    least = min(float(np.ptp(np.percentile(v, [0.5, 99.5]))) for v in (va, vb))
    if least < swing:
        raise NotExcited(f'it changes by {least:.3f}; {swing:g} are needed')
    periods = [float(np.median(np.diff(t))) for t in (ta, tb)]
    spans = [float(t[-1] - t[0]) for t in (ta, tb)]
    if max(spans) > MOST * GRID[1]:
        t, name = (ta, 'first') if spans[0] >= spans[1] else (tb, 'second')
        raise AlignError(f'the {name} signal lasts {max(spans):.0f} s, {describe_gap(t)}')
    step = float(np.clip(max(min(periods), max(spans) / MOST), *GRID))
    smooth = max(step, *periods)
    grid_a, grid_b = _on_grid(ta, va, step, smooth), _on_grid(tb, vb, step, smooth)
    least = max(overlap * min(grid_a.there.sum(), grid_b.there.sum()), 8.0)
    lags, r = masked_correlation(grid_a, grid_b, least)
    best = _peak(lags, r, step, grid_a.start - grid_b.start, limits)
    found = _refined(grid_a, grid_b, float(lags[best]) * step, smooth)
    if found.factor <= 0.0 or found.quality < LEAST_QUALITY:
        raise AlignError('the signals are not correlated at any offset')
    refuse_uncertain(found.offset, found.sigma, worst)
    return found


def refuse_uncertain(offset: float, sigma: float, worst: float = WORST) -> None:
    """Raise UncertainError if the standard error of an offset, s, is above the worst accepted."""
    if not sigma <= worst:
        raise UncertainError(
            f'the offset of {offset:.3f} s has a standard error of {sigma:.3f} s, '
            f'above {worst:g} s: the signals do not determine it')


def offsets(
    pairs: Mapping[str, tuple[Floats, Floats, Floats, Floats]],
    limits: tuple[float, float] | None = None,
) -> tuple[dict[str, Offset], dict[str, AlignError]]:
    """
    Return the offset for each quantity, and the error for each that gives none; both by name.

    Parameters
    ----------
    pairs
        {name: times [s] and values of the first recording, times [s] and values of the second};
        values in m, m/s or rad/s. Their range must be at least ``LEAST_SWING``.
    limits : s
        As for :func:`time_offset`.

    """
    found, reasons = {}, {}
    for name, pair in pairs.items():
        try:
            found[name] = time_offset(*pair, limits=limits, swing=LEAST_SWING)
        except AlignError as error:
            reasons[name] = error
    return found, reasons


def most_precise(
    found: Mapping[str, Offset], late: Mapping[str, float] | None = None,
) -> tuple[str, Offset]:
    """
    Return the most precise offset of two clocks, if those of the other signals agree with it.

    Parameters
    ----------
    found
        Offsets by signal, one or more.
    late : s
        Possible delays by signal. The standard error of an offset does not include them; they
        are added as the root of the sum of squares.

    Returns
    -------
    The name of the signal with the smallest standard error, and its offset. If signals with the
    same delay scatter more than their standard errors predict, ``sigma`` is increased by that
    ratio (Birge 1932).

    Raises
    ------
    AlignError
        If the offset of a signal differs by more than ``AGREE``.

    """
    late = late or {}
    sigma = {name: math.hypot(one.sigma, late.get(name, 0.0)) for name, one in found.items()}
    best = min(sigma, key=lambda name: sigma[name])
    difference = {name: one.offset - found[best].offset for name, one in found.items()}
    far = [name for name, distance in difference.items() if abs(distance) > AGREE]
    if far:
        values = ', '.join(f'{name} {found[name].offset:+.3f} s' for name in (best, *far))
        raise AlignError(f'the signals give different clock offsets ({values})')
    similar = [difference[name] / found[name].sigma for name in found
               if name != best and late.get(name) == late.get(best) and found[name].sigma > 0.0]
    scatter = math.sqrt(sum(x * x for x in similar) / len(similar)) if similar else 1.0
    return best, found[best]._replace(sigma=sigma[best] * max(scatter, 1.0))


def pose_signals(poses: Poses) -> dict[str, tuple[Floats, Floats]]:
    """
    Return signals of recorded poses that do not depend on the placement of their frame.

    Parameters
    ----------
    poses
        Poses with ``t``, ``position`` and ``orientation``, z up.

    Returns
    -------
    ``height`` [m] (up to a constant), ``speed`` over ground [m/s] and ``yaw_rate`` [rad/s], each
    as (times [s], values); the last two have no values near gaps.

    """
    position, q = poses.position, poses.orientation
    t, first = np.unique(poses.t, return_index=True)
    position, q = position[first], q[first]
    here = np.isfinite(position).all(axis=1)
    _, velocity = local_fit(t[here], position[here, :2], t[here], POSITION)
    signals = {'height': (t[here], position[here, 2]),
               'speed': (t[here], np.hypot(velocity[:, 0], velocity[:, 1]))}
    sound = np.isfinite(q).all(axis=1) & (np.abs((q * q).sum(axis=1) - 1.0) < 0.1)
    if sound.sum() >= 8:
        yaw = np.unwrap(Rotation.from_quat(q[sound]).as_euler('ZYX')[:, 0])
        signals['yaw_rate'] = (
            t[sound], local_fit(t[sound], yaw[:, None], t[sound], POSITION)[1][:, 0])
    return signals


def pose_offset(
    a: Poses, b: Poses, limits: tuple[float, float] | None = None,
) -> tuple[Offset, dict[str, Offset | str]]:
    """
    Return the offset between the clocks of two recordings of poses.

    Parameters
    ----------
    a, b
        Poses with ``t``, ``position`` and ``orientation``, z up, in any two frames.
    limits : s
        As for :func:`time_offset`.

    Returns
    -------
    The offset with the smallest standard error, and for each signal its offset or the reason why
    it gives none.

    Raises
    ------
    AlignError
        If no signal determines the offset, or if the signals disagree.
    NotExcited
        If the vehicle does not move enough in one of the recordings.

    """
    signals_a, signals_b = pose_signals(a), pose_signals(b)
    found, reasons = offsets({
        name: (*signals_a[name], *signals_b[name])
        for name in signals_a if name in signals_b}, limits)
    if not found:
        kind = NotExcited if all(
            isinstance(reason, NotExcited) for reason in reasons.values()) else AlignError
        raise kind('; '.join(f'{name}: {reason}' for name, reason in sorted(reasons.items())))
    return most_precise(found)[1], {**found, **{name: str(why) for name, why in reasons.items()}}


class Registration(NamedTuple):
    """
    Pose of the second frame in the first.

    Attributes
    ----------
    yaw
        rad, about z, counter-clockwise seen from above.
    translation : (3,) m
    rms
        m, RMS residual.
    sigma_yaw
        rad, standard error; it accounts for errors correlated in time. NaN if the yaw was given.

    """

    yaw: float
    translation: Floats
    rms: float
    sigma_yaw: float

    def apply(self, positions: ArrayLike) -> Floats:
        """Transform positions of the second frame, (n, 3) m, to the first."""
        return Rotation.from_euler('z', self.yaw).apply(positions) + self.translation


def _registration(a: Floats, b: Floats, yaw: float, sigma: float) -> Registration:
    turn = Rotation.from_euler('z', yaw)
    translation = a.mean(axis=0) - turn.apply(b.mean(axis=0))
    residual = a - turn.apply(b) - translation
    rms = float(np.sqrt((residual * residual).sum(axis=1).mean()))
    return Registration(yaw, translation, rms, sigma)


def registration(a: ArrayLike, b: ArrayLike, worst: float = WORST_YAW) -> Registration:
    """
    Return the least-squares yaw and translation that map positions b to positions a.

    Parameters
    ----------
    a, b : (n, 3) m
        Positions at the same instants, z up, in the order of time; rows that are not finite are
        left out.
    worst : rad
        Largest standard error of the yaw.

    Raises
    ------
    AlignError
        If there are fewer than two common positions, if the correlation of the paths is below
        ``LEAST_QUALITY``, or if the standard error of the yaw exceeds ``worst``.

    """
    a, b = np.asarray(a, float), np.asarray(b, float)
    good = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    if good.sum() < 2:
        raise AlignError(f'{int(good.sum())} common positions; a registration needs two')
    a, b = a[good], b[good]
    pa, pb = a[:, :2] - a[:, :2].mean(axis=0), b[:, :2] - b[:, :2].mean(axis=0)
    along = float((pa * pb).sum())
    across = float((pb[:, 0] * pa[:, 1] - pb[:, 1] * pa[:, 0]).sum())
    spread = float((pb * pb).sum())
    yaw = math.atan2(across, along)
    turned = pb @ Rotation.from_euler('z', yaw).as_matrix()[:2, :2].T
    independent = float(((pa - turned) ** 2).sum()) / max(2 * len(a) - 3, 1) * spread
    scores = turned[:, 0] * pa[:, 1] - turned[:, 1] * pa[:, 0]  # they add up to 0
    power = math.hypot(along, across)
    variance = max(independent, _long_run_variance(scores, 1))
    sigma = math.sqrt(variance) / power if power > 0.0 else math.inf
    correlation = power / math.sqrt(spread * float((pa * pa).sum()) or math.inf)
    if correlation < LEAST_QUALITY or sigma > worst:
        raise AlignError(
            'the paths are too small or too different to determine a yaw; give the yaw, or '
            'equalise at an instant')
    return _registration(a, b, yaw, sigma)


def equalised(
    times: ArrayLike, a: ArrayLike, b: ArrayLike, when: float, *, yaw: float = 0.0,
    window: float = 0.1,
) -> Registration:
    """
    Make two paths equal at one instant, as the thesis does after take-off (section 5.4).

    Parameters
    ----------
    times : (n,) s
        Times of both paths.
    a, b : (n, 3) m
        Positions, z up; rows that are not finite are left out.
    when : s
        Instant; about 6 s after take-off in the thesis.
    yaw : rad
        Known yaw of the second frame in the first.
    window : s
        Width over which the difference is averaged.

    Raises
    ------
    AlignError
        If there are no common positions within the window.

    """
    t, a, b = (np.asarray(x, float) for x in (times, a, b))
    near = np.abs(t - when) <= 0.5 * window
    near &= np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    if not near.any():
        raise AlignError(f'no common positions within {0.5 * window:g} s of {when:.3f} s')
    return _registration(a[near], b[near], yaw, math.nan)


class Flight(NamedTuple):
    """Times of take-off and landing, s; None if the recording does not contain them."""

    takeoff: float | None
    landing: float | None
    source: str  # the signal in which they were detected

    def within(self, begin: float, end: float) -> tuple[float, float]:
        """Return take-off and landing; the begin or end of the recording if one is missing."""
        return (begin if self.takeoff is None else self.takeoff,
                end if self.landing is None else self.landing)


def _ends(t: Floats, high: NDArray[np.bool_], hold: float) -> tuple[int, int]:
    """Return the first and last sample of the runs of ``high`` that last at least ``hold`` s."""
    long = [(i, j - 1) for i, j in runs(high).tolist() if t[j - 1] - t[i] >= hold]
    if not long:
        raise AlignError('the vehicle never leaves the ground')
    return long[0][0], long[-1][1]


def flight_by_height(times: ArrayLike, height: ArrayLike, hold: float = 0.3) -> Flight:
    """
    Detect take-off and landing in a height signal.

    The vehicle is in the air where the height exceeds half of its range for at least ``hold`` s.
    From there the flight is extended in both directions to the point where the height comes
    within ``SETTLED`` (or a tenth of the range) of the ground on that side. The ground level is
    where the vehicle stands for at least ``hold`` s, and may differ between the two sides.

    Parameters
    ----------
    times : (n,) s
    height : (n,) m
        Height above any zero, z up; missing values are not finite.
    hold : s

    Raises
    ------
    AlignError
        If the vehicle never leaves the ground.

    """
    t, z = _checked(times, height, 'height')
    ground, top = np.percentile(z, [2.0, 98.0])
    rise = float(top - ground)
    if rise < LEAST_RISE:
        raise AlignError(f'the vehicle never leaves the ground: it rises by {rise:.3f} m')
    first, last = _ends(t, z > ground + 0.5 * rise, hold)

    def standing(part: slice) -> Floats:
        times, level = t[part], z[part]
        low = level <= level.min() + min(0.05, 0.2 * rise) if len(level) else level > 0.0
        if not low.any() or np.ptp(times[low]) < hold:
            return times[:0]
        return times[level <= np.median(level[low]) + min(SETTLED, 0.1 * rise)]

    before, after = standing(slice(0, first)), standing(slice(last + 1, None))
    return Flight(float(before[-1]) if len(before) else None,
                  float(after[0]) if len(after) else None, 'height')


def flight_by_position(times: ArrayLike, position: ArrayLike) -> Flight:
    """
    Detect take-off and landing in a path; see :func:`flight_by_height`.

    A height alone does not tell a vehicle that hovers and climbs from one that stands and takes
    off. Before its take-off a vehicle stands: within ``LEAST_RISE`` of the height zero, where an
    odometry begins, or still for ``REST``, within ``STILL``. Otherwise the recording begins in
    the air, and has no take-off.

    Parameters
    ----------
    times : (n,) s
    position : (n, 3) m
        z up; missing values are not finite.

    Raises
    ------
    AlignError
        If the vehicle never leaves the ground.

    """
    t, p = np.asarray(times, float), np.asarray(position, float)
    found = flight_by_height(t, p[:, 2])
    known = np.isfinite(p).all(axis=1)
    t, p = t[known], p[known]
    if found.takeoff is None or _stands(t, p, found.takeoff):
        return found
    return found._replace(takeoff=None)


def _stands(t: Floats, position: Floats, takeoff: float) -> bool:
    """Return whether a vehicle at positions, (n, 3) m, stands before a take-off [s]."""
    last = position[(t <= takeoff) & (t >= takeoff - REST), 2]
    if len(last) and abs(float(np.median(last))) <= LEAST_RISE:
        return True
    t, first = np.unique(t, return_index=True)
    smooth, _ = local_fit(t, position[first], np.arange(t[0], takeoff, EVEN), SMOOTH)
    count = round(REST / EVEN) + 1
    if len(smooth) < count:
        return False
    spans = np.ptp(sliding_window_view(smooth, count, axis=0), axis=2)
    return bool((spans < STILL).all(axis=1).any())


def flight_by_thrust(times: ArrayLike, thrust: ArrayLike, hold: float = 0.3) -> Flight:
    """
    Detect take-off and landing in a thrust or mean motor command, any unit, 0 when stopped.

    The vehicle is in the air where the signal exceeds 0.7 of the hover level; idling motors stay
    below it. The hover level is the median of all values above half of the 98th percentile. See
    :func:`flight_by_height`.
    """
    t, f = _checked(times, thrust, 'thrust')
    strong = f[f > 0.5 * np.percentile(f, 98.0)]
    if not len(strong) or np.median(strong) <= 0.0:
        raise AlignError('the motors never run')
    high = f > 0.7 * float(np.median(strong))
    first, last = _ends(t, high, hold)
    return Flight(float(t[first]) if first > 0 else None,
                  float(t[last]) if last < len(t) - 1 else None, 'thrust')


def flight_by_acceleration(
    times: ArrayLike, acceleration: ArrayLike, hold: float = 0.3,
) -> Flight:
    """
    Detect take-off and landing by the vibration of the motors in the accelerometer.

    Parameters
    ----------
    times : (n,) s
    acceleration : (n,) or (n, k) m/s^2
        Specific force.
    hold : s

    Raises
    ------
    AlignError
        If the recording has no part that is much calmer than the rest.

    """
    values = np.asarray(acceleration, float)
    values = values[:, None] if values.ndim == 1 else values
    good = np.isfinite(values).all(axis=1)
    t, _ = _checked(np.asarray(times, float)[good], values[good, 0], 'acceleration')
    if len(t) != good.sum():
        raise AlignError('acceleration signal: its times repeat')
    width = max(0.1 / float(np.median(np.diff(t))), 1.0)
    values = values[good]
    mean = gaussian_filter1d(values, width, axis=0)
    shake = np.sqrt(gaussian_filter1d(((values - mean) ** 2).sum(axis=1), width))
    calm, loud = np.percentile(shake, [5.0, 90.0])
    if loud < 5.0 * calm or loud < 0.05:
        raise AlignError('the acceleration does not separate rest from flight: it has no calm '
                         'part, or the motors never run')
    first, last = _ends(t, shake > math.sqrt(max(calm, 1e-3 * loud) * loud), hold)
    return Flight(float(t[first]) if first > 0 else None,
                  float(t[last]) if last < len(t) - 1 else None, 'acceleration')


def sonar_ranges(bag: Bag) -> tuple[Floats, Floats]:
    """Return times [s] and ranges [m] of the sonar, (n,) each; NaN where a range is invalid."""
    messages = bag['sonar/range']
    valid = (messages.range >= messages.min_range) & (messages.range <= messages.max_range)
    return messages.t, np.where(valid, messages.range, np.nan)


def unclipped_ranges(bag: Bag) -> tuple[Floats, Floats]:
    """
    Return :func:`sonar_ranges`, with NaN also where the floor may be below the shortest range.

    There a sonar reads its shortest range at any height. Compared with a tracked height, such
    readings look like a take-off that is up to 0.2 s late.
    """
    t, ranges = sonar_ranges(bag)
    shortest = bag['sonar/range'].min_range
    return t, np.where(ranges > shortest + CLIPPED, ranges, np.nan)


def find_flight(bag: Bag) -> Flight:
    """
    Detect take-off and landing of a bag in the best signal that it has.

    The order is: path of ``ground_truth/odom``, ``optitrack/pose``, ``estimate/odom``,
    ``onboard/odom`` or ``sonar/range``; mean of ``motor_pwm``; ``imu/data_raw``.

    Returns
    -------
    Times in the clock of the stamps, s; ``source`` names the topic.

    Raises
    ------
    AlignError
        If no signal shows a flight; the message gives the reason for each.

    """
    def path(topic: str) -> Flight:
        return flight_by_position(bag[topic].t, bag[topic].position)

    ways = {
        'ground_truth/odom': path, 'optitrack/pose': path, 'estimate/odom': path,
        'onboard/odom': path, 'sonar/range': lambda topic: flight_by_height(*sonar_ranges(bag)),
        'motor_pwm': lambda topic: flight_by_thrust(bag[topic].t, bag[topic].pwm.mean(axis=1)),
        'imu/data_raw': lambda topic: flight_by_acceleration(
            bag[topic].t, bag[topic].acceleration)}
    reasons = []
    for topic, find in ways.items():
        if topic in bag:
            try:
                return find(topic)._replace(source=topic)
            except AlignError as error:
                reasons.append(f'{topic}: {error}')
    raise AlignError(f'{bag.path}: no flight found; ' + (
        '; '.join(reasons) or 'it has no topic with height, thrust or acceleration'))
