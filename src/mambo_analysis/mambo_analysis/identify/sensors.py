"""
Rates, noise, limits, outliers and delay of every sensor: ``identify_sensors FILES...``.

Reads bags, Parrot minidrone logs (``RSdata*.mat``) and ``noisedata.mat``. Each value comes with a
95 % interval:

* proportions and medians by the binomial distribution (Clopper-Pearson, order statistics);
* standard deviations and Allan deviations by chi2 with their equivalent degrees of freedom;
* random walk by likelihood; everything else by a jackknife over ten stretches of the recording.

At rest means that over half a second no axis of the gyro varies by more than 0.01 rad/s and none
of the accelerometer by more than 0.2 m/s^2 (standard deviation): ten times the noise at rest of
the recordings known, a fifth of what propellers do.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
import functools
import json
from pathlib import Path
from typing import Any, NamedTuple

from mambo_bags.command import guard, Parser, write_json
from mambo_bags.mcap_reader import BagError
from mambo_model import palette
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import median_filter
from scipy.signal import butter, sosfiltfilt
from scipy.stats import beta, binom, t as student

from .allan import (
    allan, Allan, bias_instability, deviation_at_rest, Interval, LEVEL, random_walk, white_density)
from .recording import read_sensors, Recording, Stream

Array = NDArray[np.float64]
GRAVITY = 9.81         # m/s^2
AXES = 'xyz'
STRETCHES = 10         # of the jackknife
REST_WINDOW = 0.5      # s
REST_GYRO, REST_ACCEL = 0.01, 0.2  # rad/s, m/s^2
SHORTEST_REST = 2.0    # s
LOWEST = 0.5           # m, above which the sonar of these drones measures
NEIGHBOURS = 9         # sonar samples, 0.36 s, whose median an outlier leaves
OUTLIER = 0.25         # m: a climb of 0.5 m/s moves by less in those neighbours
PAUSE = 1.8            # median intervals, from which on an interval is a pause
LATENCY_BANDS = ((0.5, 1.0), (1.0, 2.0), (2.0, 4.0), (4.0, 8.0))  # Hz
LEAST_SHARE = 0.3  # R^2 of the best band below which there is no common motion
LAGS = np.arange(-0.05, 0.2501, 0.005)  # s
MAD = 1.4826           # standard deviation over median absolute deviation, normal


class Measured(NamedTuple):
    """One line of the table."""

    sensor: str
    quantity: str
    unit: str
    value: float
    low: float
    high: float
    samples: int
    note: str = ''


def proportion(k: int, n: int) -> Interval:
    """Return k of n with the interval of Clopper and Pearson."""
    tail = (1.0 - LEVEL) / 2.0
    return Interval(
        k / n, float(beta.ppf(tail, k, n - k + 1)) if k else 0.0,
        float(beta.ppf(1.0 - tail, k + 1, n - k)) if k < n else 1.0)


def median(x: Array) -> Interval:
    """Return the median of samples with the interval between two order statistics."""
    ordered, n = np.sort(x), len(x)
    k = max(int(binom.ppf((1.0 - LEVEL) / 2.0, n, 0.5)) - 1, 0)
    return Interval(float(np.median(x)), float(ordered[k]), float(ordered[n - 1 - k]))


def jackknife(statistic: Callable[[NDArray[np.int64]], float], n: int) -> Interval:
    """
    Return a statistic with the interval of a jackknife over ``STRETCHES`` stretches.

    Parameters
    ----------
    statistic
        Of the indices kept, out of 0 ... n - 1.
    n
        Samples, in the order of time; neighbours may depend on each other.

    """
    whole = statistic(np.arange(n))
    number = np.arange(n) * STRETCHES // n
    parts = np.array([statistic(np.flatnonzero(number != k)) for k in range(STRETCHES)])
    spread = np.sqrt((STRETCHES - 1) * ((parts - parts.mean())**2).mean())
    reach = float(student.ppf(0.5 + LEVEL / 2.0, STRETCHES - 1) * spread)
    return Interval(whole, whole - reach, whole + reach)


def robust_sigma(x: Array) -> Interval:
    """Return the standard deviation of samples about zero by their median size."""
    size = MAD * np.abs(x)
    return jackknife(lambda keep: float(np.median(size[keep])), len(x))


def white_sigma(x: Array) -> Interval:
    """Return the white noise of a slow signal: robust deviation of its second differences."""
    return robust_sigma(np.diff(x, 2) / np.sqrt(6.0))


def resolution(x: Array) -> Interval | None:
    """
    Return the step of which all values are whole multiples, up to an offset; None if none is.

    Neighbouring values give a first guess, a line through ever more of them the step. The
    interval is that of the slope.
    """
    levels = np.unique(x[np.isfinite(x)])
    gaps = np.diff(levels)
    if len(gaps) < 4:
        return None
    step, reach = float(np.median(gaps[gaps < 1.5 * gaps.min()])), min(8, len(gaps))
    while True:
        part, offset = levels[:reach + 1] - levels[0], 0.0
        for _ in range(4):  # the offset found decides what lies half-way between two steps
            steps = np.round((part - offset) / step)
            if not steps.any():
                return None
            step, offset = np.linalg.lstsq(
                np.c_[steps, np.ones(len(part))], part, rcond=None)[0]
        error = np.sqrt(((part - offset - step * steps)**2).mean())
        if error > 0.1 * step:  # 0.29 of a step if the values lie anywhere
            return None
        if reach >= len(gaps):
            break
        reach = min(2 * reach, len(gaps))
    spread = 1.96 * error / np.sqrt(((steps - steps.mean())**2).sum())
    return Interval(float(step), float(step - spread), float(step + spread))


def stretch_at_rest(recording: Recording) -> slice | None:
    """Return the longest stretch of IMU samples at rest; None if it is shorter than 2 s."""
    if recording.gyro is None or recording.accel is None or len(recording.gyro.t) < 3:
        return None
    rate = 1.0 / np.median(np.diff(recording.gyro.t))
    w = max(int(round(REST_WINDOW * rate)), 2)
    n = len(recording.gyro.t) // w
    if n == 0:
        return None
    quiet = np.ones(n, bool)
    for stream, limit in ((recording.gyro, REST_GYRO), (recording.accel, REST_ACCEL)):
        quiet &= (stream.values[:n * w].reshape(n, w, 3).std(axis=1) < limit).all(axis=1)
    edges = np.flatnonzero(np.diff(np.r_[False, quiet, False].astype(int)))
    if not len(edges):
        return None
    k = int(np.argmax(edges[1::2] - edges[::2]))
    first, last = int(edges[2 * k]), int(edges[2 * k + 1])
    if (last - first) * w / rate < SHORTEST_REST:
        return None
    return slice(first * w, last * w)


def heights(sonar: Stream, at: Array) -> Array:
    """Return the height by the sonar at times, (n,) m: the median of its neighbours."""
    heard = np.isfinite(sonar.values)
    if not heard.any():
        return np.full(len(at), np.nan)
    level = median_filter(sonar.values[heard], NEIGHBOURS, mode='nearest')
    return np.interp(at, sonar.t[heard], level)


def airborne(recording: Recording, at: Array) -> NDArray[np.bool_]:
    """Return at which times the vehicle flies: motors at mean 180 to 350, sonar above 0.5 m."""
    if recording.pwm is None or recording.sonar is None or len(recording.pwm.t) == 0:
        return np.zeros(len(at), bool)
    command = np.interp(at, recording.pwm.t, np.abs(recording.pwm.values).mean(axis=1))
    return (command > 180.0) & (command < 350.0) & (heights(recording.sonar, at) > LOWEST)


def _line(sensor: str, quantity: str, unit: str, found: Interval, n: int, note: str = ''
          ) -> Measured:
    return Measured(sensor, quantity, unit, *(float(v) for v in found), int(n), note)


def _timing(sensor: str, stream: Stream) -> list[Measured]:
    """Return rate and intervals of a sensor; pauses apart."""
    gaps = np.diff(stream.t)
    if len(gaps) < 2 * STRETCHES:
        return []
    usual = np.median(gaps)
    short = gaps[gaps < PAUSE * usual]
    lines = [
        _line(sensor, 'interval', 'ms', Interval(*(1e3 * v for v in median(gaps))), len(gaps),
              f'{1e3 * gaps.min():.4g} to {1e3 * gaps.max():.4g}'),
        _line(sensor, 'rate', 'Hz', jackknife(
            lambda keep: float(1.0 / short[keep].mean()), len(short)), len(short),
            'pauses left out')]
    return lines


def _at_rest(recording: Recording, rest: slice) -> tuple[list[Measured], dict[str, Allan]]:
    """Return the noise of the IMU at rest, and its Allan curves by signal."""
    lines, curves = [], {}
    for sensor, stream, unit in (
            ('gyro', recording.gyro, 'rad/s'), ('accel', recording.accel, 'm/s^2')):
        rate = 1.0 / float(np.median(np.diff(stream.t)))
        for axis in range(3):
            x, name = stream.values[rest, axis], f'{sensor} {AXES[axis]}'
            if not x.std() > 0.0:
                continue
            n = len(x)
            curve = curves[name] = allan(x, rate)
            lowest, reached = bias_instability(curve)
            walk = 'angle' if sensor == 'gyro' else 'velocity'
            lines += [
                _line(name, 'noise at rest', unit, deviation_at_rest(x), n),
                _line(name, f'{walk} random walk', f'{unit}/sqrt(Hz)', white_density(x, rate), n),
                _line(name, 'bias instability', unit, lowest, n,
                      '' if reached else 'at most: the curve still falls'),
                _line(name, 'bias random walk', f'{unit}/sqrt(s)', random_walk(x, rate), n)]
    return lines, curves


def _in_flight(recording: Recording) -> list[Measured]:
    """Return what propellers add: robust deviation above 15 Hz, in the air."""
    lines = []
    for sensor, stream, unit in (
            ('gyro', recording.gyro, 'rad/s'), ('accel', recording.accel, 'm/s^2')):
        rate = 1.0 / float(np.median(np.diff(stream.t)))
        air = airborne(recording, stream.t)
        if rate < 60.0 or air.sum() < rate:
            continue
        high = sosfiltfilt(butter(4, 15.0, 'high', fs=rate, output='sos'), stream.values, axis=0)
        for axis in range(3):
            lines.append(_line(f'{sensor} {AXES[axis]}', 'vibration in flight', unit,
                               robust_sigma(high[air, axis]), air.sum()))
    return lines


def _imu(recording: Recording) -> tuple[list[Measured], dict[str, Allan]]:
    """Return everything about gyro and accelerometer."""
    if recording.gyro is None or recording.accel is None or len(recording.gyro.t) < 40:
        return [], {}
    lines, curves = _timing('imu', recording.gyro), {}
    for sensor, stream, unit in (
            ('gyro', recording.gyro, 'rad/s'), ('accel', recording.accel, 'm/s^2')):
        found = [r for r in (resolution(stream.values[:, k]) for k in range(3)) if r]
        if found:
            best = min(found, key=lambda r: r.high - r.low)
            lines.append(_line(sensor, 'resolution', unit, best, len(stream.t)))
    rest = stretch_at_rest(recording)
    if rest is not None:
        more, curves = _at_rest(recording, rest)
        lines += more
    return lines + _in_flight(recording), curves


def outliers(values: Array) -> tuple[NDArray[np.bool_], Array]:
    """Return which sonar values leave the median of their neighbours, and these medians."""
    level = median_filter(values, NEIGHBOURS, mode='nearest')
    return np.abs(values - level) > OUTLIER, level


def _sonar(recording: Recording) -> list[Measured]:
    """Return limits, noise, outliers and missing echoes of the sonar."""
    stream = recording.sonar
    if stream is None or np.isfinite(stream.values).sum() < 2 * STRETCHES:
        return []
    lines = _timing('sonar', stream)
    heard = np.isfinite(stream.values)
    values, n = stream.values[heard], int(heard.sum())
    step = resolution(values)
    if step:
        lines.append(_line('sonar', 'resolution', 'm', step, n))
    for quantity, pick in (('smallest', values.min()), ('largest', values.max())):
        times = int((np.abs(values - pick) < 1e-6).sum())
        lines.append(Measured('sonar', quantity, 'm', float(pick), float(pick), float(pick), n,
                              f'{times} times'))
    stray, level = outliers(values)
    good = (level > LOWEST) & ~stray
    triples = np.flatnonzero(good[:-2] & good[1:-1] & good[2:])
    if len(triples) > 3 * STRETCHES:
        second = np.diff(values, 2)[triples]
        lines.append(_line('sonar', 'noise', 'm', robust_sigma(second / np.sqrt(6.0)),
                           len(triples), f'above {LOWEST} m, outliers left out'))
    lines.append(_line('sonar', 'outliers', '1', proportion(int(stray.sum()), n), n))
    late = stray & (values > level)
    if stray.any():
        lines.append(_line(
            'sonar', 'late of outliers', '1', proportion(int(late.sum()), int(stray.sum())),
            stray.sum()))
    if late.sum() >= 5:
        lines.append(_line('sonar', 'excess of late', '1', median(
            values[late] / level[late] - 1.0), late.sum(), 'over the range of the neighbours'))
    usual = float(np.median(np.diff(stream.t)))
    lost = _missing(recording, stream, usual)
    lines.append(_line('sonar', 'dropouts', '1', proportion(lost, n + lost), n + lost,
                       'reads 0; repeated values are not counted' if recording.held else ''))
    return lines


def _missing(recording: Recording, stream: Stream, usual: float) -> int:
    """Return how many values are missing: said to be so, or not there where one was due."""
    spans = np.diff(np.r_[stream.t, stream.t[-1] + usual])
    counts = np.round(spans / usual).astype(int)
    if recording.held:
        return int(np.maximum(counts, 1)[np.isnan(stream.values)].sum())
    return int(np.isnan(stream.values).sum() + np.maximum(counts - 1, 0).sum())


def _flow(recording: Recording) -> tuple[list[Measured], tuple[Array, Array] | None]:
    """Return rate, pauses, failures, noise and latency of the flow; and misfit over lag."""
    stream = recording.flow
    if stream is None or len(stream.t) < 4 * STRETCHES:
        return [], None
    lines = _timing('flow', stream)
    gaps = np.diff(stream.t)
    long = np.flatnonzero(gaps > PAUSE * np.median(gaps))
    if len(long) > 5:
        lines += [
            _line('flow', 'pause', 'ms', Interval(*(1e3 * v for v in median(gaps[long]))),
                  len(long)),
            _line('flow', 'values from pause to pause', '1', median(np.diff(long).astype(float)),
                  len(long) - 1)]
    failed = np.isnan(stream.values).any(axis=1)
    lines.append(_line('flow', 'failed', '1', proportion(int(failed.sum()), len(failed)),
                       len(failed)))
    air = airborne(recording, stream.t) & ~failed
    if air.sum() < 4 * STRETCHES:
        return lines, None
    for axis in range(2):
        lines.append(_line(f'flow {AXES[axis]}', 'noise', 'rad/s', white_sigma(
            stream.values[air, axis]), air.sum(), 'motion of the vehicle included'))
    found = flow_latency(recording)
    if found is None:
        return lines, None
    interval, share, misfit = found
    note = f'R^2 {share:.2f}'
    if share < LEAST_SHARE or not (LAGS[0] < interval.low and interval.high < LAGS[-1]):
        interval, note = Interval(np.nan, np.nan, np.nan), 'not to be told from this flight'
    lines.append(_line('flow', 'latency', 'ms', Interval(*(1e3 * v for v in interval)), air.sum(),
                       note))
    return lines, (1e3 * LAGS, misfit)


def inertial_velocity(recording: Recording) -> Array:
    """
    Return the velocity along body x and y that the IMU tells, (n, 2) m/s, slow parts removed.

    The rate of the body velocity is specific force plus gravity; roll and pitch are the
    integrated gyro. Biases lie below 0.1 Hz and are taken out.
    """
    step = float(np.median(np.diff(recording.gyro.t)))
    slow = butter(1, 0.1, 'high', fs=1.0 / step, output='sos')

    def integral(x: Array) -> Array:
        """Return the integral over time, without what is slower than 0.1 Hz."""
        return cumulative_trapezoid(sosfiltfilt(slow, x, axis=0), dx=step, axis=0, initial=0.0)

    angle = integral(recording.gyro.values)
    gravity = GRAVITY * np.stack([-angle[:, 1], angle[:, 0]], axis=1)
    return integral(recording.accel.values[:, :2] + gravity)


def _compared(recording: Recording) -> Array | None:
    """
    Return the products of flow and lagged inertial velocity, summed over stretches of flight.

    Returns
    -------
    (3, 2, bands, lags, stretches)
        Flow times inertial, inertial squared, flow squared; x and y. None if the flight is too
        short.

    """
    imu, stream = recording.gyro, recording.flow
    if imu is None or recording.accel is None or recording.sonar is None or len(imu.t) < 100:
        return None
    rate = 1.0 / float(np.median(np.diff(imu.t)))
    seen = np.isfinite(stream.values).all(axis=1)
    times = stream.t[seen]
    inside = (imu.t > times[0] + 0.5) & (imu.t < times[-1] - 0.5)
    use = np.flatnonzero(airborne(recording, imu.t) & inside)
    if len(use) < 3 * rate or rate < 4 * LATENCY_BANDS[-1][1]:
        return None
    speed = stream.values[seen] * heights(recording.sonar, times)[:, None]
    even = np.stack([np.interp(imu.t, times, speed[:, k]) for k in range(2)], axis=1)
    starts = np.arange(STRETCHES) * len(use) // STRETCHES
    sums = np.empty((3, 2, len(LATENCY_BANDS), len(LAGS), STRETCHES))
    whole = inertial_velocity(recording)
    for b, band in enumerate(LATENCY_BANDS):
        sos = butter(2, band, 'band', fs=rate, output='sos')
        optical, inertial = (sosfiltfilt(sos, x, axis=0) for x in (even, whole))
        for k, lag in enumerate(LAGS.tolist()):
            for axis in range(2):
                late = np.interp(imu.t[use] - lag, imu.t, inertial[:, axis])
                flow = optical[use, axis]
                products = np.stack([flow * late, late * late, flow * flow])
                sums[:, axis, b, k] = np.add.reduceat(products, starts, axis=1)
    return sums


def flow_latency(recording: Recording) -> tuple[Interval, float, Array] | None:
    """
    Return by how much flow comes after motion: the most likely lag between the two.

    Flow times height and inertial velocity are compared in ``LATENCY_BANDS``, a gain and a noise
    for each band and axis; each band counts by its width. Between the lags of the grid the
    likelihood is a parabola.

    Returns
    -------
    interval : s
        Positive: the flow is late.
    share
        Largest R^2 of a band and axis at that lag.
    misfit : (k,)
        Geometric mean of 1 - R^2 over ``LAGS``.

    """
    sums = _compared(recording)
    if sums is None:
        return None
    widths = np.array([high - low for low, high in LATENCY_BANDS])

    def rest(keep: NDArray[np.int64]) -> Array:
        """Return the share of the flow that the motion does not explain, in these stretches."""
        cross, left, right = sums[..., keep].sum(axis=-1)
        return 1.0 - np.maximum(cross, 0.0)**2 / (left * right)

    def misfit(keep: NDArray[np.int64]) -> Array:
        """Return the logarithm of the misfit at each lag."""
        weight = widths[None, :, None] / widths.sum() / 2.0
        return (weight * np.log(rest(keep))).sum(axis=(0, 1))

    everything = np.arange(STRETCHES)
    curve = misfit(everything)
    found = jackknife(lambda keep: _lowest(misfit(keep)), STRETCHES)
    share = float(1.0 - rest(everything)[..., int(np.argmin(curve))].min())
    return found, share, np.exp(curve)


def _lowest(curve: Array) -> float:
    """Return the lag of the lowest point of a curve over ``LAGS``, s."""
    k = int(np.clip(np.argmin(curve), 1, len(curve) - 2))
    bend = curve[k - 1] - 2.0 * curve[k] + curve[k + 1]
    shift = 0.5 * (curve[k - 1] - curve[k + 1]) / bend if bend > 0.0 else 0.0
    return float(LAGS[k] + np.clip(shift, -1.0, 1.0) * (LAGS[1] - LAGS[0]))


def _barometer(recording: Recording) -> list[Measured]:
    """Return rate, resolution and noise of the barometer."""
    stream = recording.barometer
    if stream is None or len(stream.t) < 4 * STRETCHES:
        return []
    lines, n = _timing('barometer', stream), len(stream.t)
    changes = np.abs(np.diff(stream.values))
    least = changes[changes > 0.0].min(initial=np.inf)
    if np.isfinite(least):
        lines.append(Measured('barometer', 'smallest change', 'Pa', *[float(least)] * 3, n - 1))
    lines.append(_line('barometer', 'noise from value to value', 'Pa',
                       white_sigma(stream.values), n, 'what is averaged before is not in it'))
    rest = stretch_at_rest(recording)
    if rest is not None:
        times = recording.gyro.t[rest]
        still = stream.values[(stream.t >= times[0]) & (stream.t <= times[-1])]
        if len(still) > 4 * STRETCHES:
            lines.append(_line('barometer', 'noise at rest', 'Pa', deviation_at_rest(still),
                               len(still)))
    return lines


def measure(recording: Recording) -> tuple[list[Measured], dict[str, Any]]:
    """
    Return everything that a recording tells of its sensors.

    Returns
    -------
    lines
        The table.
    curves
        What the figure shows: ``allan`` by signal, ``latency`` as (lags in ms, misfit) or None.

    Raises
    ------
    BagError
        If the recording is too short to tell anything.

    """
    inertial, curves = _imu(recording)
    flow, latency = _flow(recording)
    lines = inertial + _sonar(recording) + flow + _barometer(recording)
    if not lines:
        raise BagError(f'{recording.name}: too few samples to tell anything of a sensor')
    return lines, {'allan': curves, 'latency': latency}


def table(lines: list[Measured]) -> str:
    """Return the lines as text in columns."""
    rows = [('sensor', 'quantity', 'value', '95 % interval', 'unit', 'samples', '')]
    for line in lines:
        value, bounds = f'{line.value:.4g}', f'{line.low:.4g} to {line.high:.4g}'
        if not np.isfinite(line.value):
            value, bounds = '-', ''
        elif line.low == line.high:
            bounds = ''
        rows.append((line.sensor, line.quantity, value, bounds, line.unit, str(line.samples),
                     line.note))
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return '\n'.join(
        '  '.join(cell.ljust(w) for cell, w in zip(row, widths)).rstrip() for row in rows)


def summary(found: list[list[Measured]]) -> list[Measured]:
    """Return the median over recordings of each quantity, from the lowest to the highest."""
    gathered: dict[tuple[str, str, str], list[float]] = {}
    for lines in found:
        for line in lines:
            if np.isfinite(line.value):
                key = (line.sensor, line.quantity, line.unit)
                gathered.setdefault(key, []).append(line.value)
    return [Measured(*key, float(np.median(x)), min(x), max(x), len(x))
            for key, x in gathered.items()]


def _draw_allan(axis: Axes, curves: dict[str, Allan], unit: str) -> None:
    for (name, curve), style in zip(curves.items(), palette.lines(curves)):
        reach = [curve.deviation - curve.low, curve.high - curve.deviation]
        axis.errorbar(curve.tau, curve.deviation, reach, label=name, capsize=2, **style)
    axis.set(title='Allan deviation at rest', xlabel='averaging time [s]', ylabel=f'[{unit}]',
             xscale='log', yscale='log')
    axis.legend()


def _draw_sonar(axis: Axes, stream: Stream) -> None:
    heard = np.isfinite(stream.values)
    t, values = stream.t[heard], stream.values[heard]
    stray, level = outliers(values)
    axis.plot(t, level, color=palette.COLOURS['soft'], label=f'median of {NEIGHBOURS}')
    axis.plot(t[~stray], values[~stray], '.', markersize=3, color=palette.COLOURS['sonar'],
              label='values')
    if stray.any():
        axis.plot(t[stray], values[stray], 'x', color=palette.INK, label='outliers')
    axis.set(title='sonar', xlabel='time [s]', ylabel='range [m]')
    axis.legend()


def _draw_latency(axis: Axes, lags: Array, misfit: Array) -> None:
    axis.plot(lags, misfit, color=palette.INK)
    axis.set(title='flow against inertial velocity', xlabel='flow late by [ms]',
             ylabel='1 - R^2, mean of the bands')


def draw(recording: Recording, curves: dict[str, Any], file: Path) -> bool:
    """
    Write a figure: Allan deviations, sonar with its outliers, misfit over the flow's lag.

    Returns False, and writes none, if the recording has nothing of these.
    """
    panels: list[Callable[[Axes], None]] = []
    for sensor, unit in (('gyro', 'rad/s'), ('accel', 'm/s^2')):
        shown = {name: c for name, c in curves['allan'].items() if name.startswith(sensor)}
        if shown:
            panels.append(functools.partial(_draw_allan, curves=shown, unit=unit))
    if recording.sonar is not None and np.isfinite(recording.sonar.values).any():
        panels.append(functools.partial(_draw_sonar, stream=recording.sonar))
    if curves['latency'] is not None:
        lags, misfit = curves['latency']
        panels.append(functools.partial(_draw_latency, lags=lags, misfit=misfit))
    if not panels:
        return False
    figure = Figure(figsize=(5.5 * len(panels), 4.2), layout='constrained')
    figure.suptitle(recording.name)
    for axis, panel in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels):
        panel(axis)
    figure.savefig(file, dpi=110)
    return True


def _print_tables(recordings: list[Recording], measured: list[list[Measured]]) -> None:
    """Print a table of each recording, and of all where there are several."""
    for recording, lines in zip(recordings, measured):
        print(f'{recording.name}\n{table(lines)}\n')
    if len(recordings) > 1:
        heading = 'median over recordings, from the lowest to the highest; samples: recordings'
        text = table(summary(measured))
        print(f"{heading}\n{text.replace('95 % interval', 'lowest to highest', 1)}\n")


def _report(files: list[Path], options: argparse.Namespace) -> None:
    """Measure all files; print, draw and write what was asked for."""
    recordings = [read_sensors(file, options.namespace) for file in files]
    measured = [measure(recording) for recording in recordings]
    if options.json != '-':
        _print_tables(recordings, [lines for lines, _ in measured])
    if options.output is not None:
        options.output.mkdir(parents=True, exist_ok=True)
        for number, (recording, (_, curves)) in enumerate(zip(recordings, measured), 1):
            target = options.output / f'{number:02d}_{Path(recording.name).stem}_sensors.png'
            if draw(recording, curves, target) and options.json != '-':
                print(f'figure: {target}')
    if options.json is not None:
        content = {'level': LEVEL, 'recordings': [
            {'file': str(file), 'measured': [
                {key: None if value != value else value for key, value in line._asdict().items()}
                for line in lines]}
            for file, (lines, _) in zip(files, measured)]}
        if path := write_json(options.json, json.dumps(content, indent=1)):
            print(f'json: {path}')


def parser() -> Parser:
    """Return the command line."""
    out = Parser('identify_sensors', __doc__.split('\n\n')[0])
    out.add_argument('files', type=Path, nargs='+', metavar='FILE',
                     help='bag, minidrone log (rt_yout) or noisedata.mat')
    out.add_output('DIR', 'write a figure of each file here')
    out.add_json()
    out.add_argument('--namespace', help='of the drone, if a bag holds several')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``identify_sensors``; return the exit code."""
    options = parser().parse_args(arguments)
    return guard('identify_sensors', lambda: _report(options.files, options))


if __name__ == '__main__':
    raise SystemExit(main())
