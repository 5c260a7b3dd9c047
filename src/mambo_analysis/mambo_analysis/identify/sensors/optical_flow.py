"""Optical flow: rate, pauses, failures, noise, and its latency behind the motion by the IMU."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid
from scipy.signal import butter, sosfiltfilt

from ..allan import Interval
from ..recording import Recording
from .phases import airborne, heights
from .repeats import rate_note
from .statistics import Array, jackknife, median, proportion, STRETCHES, white_sigma
from .table import entry, Measured, PAUSE, timing

GRAVITY = 9.81  # m/s^2
LATENCY_BANDS = ((0.5, 1.0), (1.0, 2.0), (2.0, 4.0), (4.0, 8.0))  # Hz
LEAST_SHARE = 0.3  # R^2 of the best band below which there is no common motion
LAGS = np.arange(-0.05, 0.2501, 0.005)  # s
CLIMB = 1.0  # Hz, of the vertical velocity by the sonar


def measure(recording: Recording) -> tuple[list[Measured], tuple[Array, Array] | None]:
    """Return rate, pauses, failures, noise and latency of the flow; and misfit over lag."""
    stream = recording.flow
    if stream is None or len(stream.t) < 4 * STRETCHES:
        return [], None
    lines = timing('flow', stream, rate_note(recording, 'flow'))
    gaps = np.diff(stream.t)
    long = np.flatnonzero(gaps > PAUSE * np.median(gaps))
    if len(long) > 5:
        lines += [
            entry('flow', 'pause', 'ms', Interval(*(1e3 * v for v in median(gaps[long]))),
                  len(long)),
            entry('flow', 'values from pause to pause', '1', median(np.diff(long).astype(float)),
                  len(long) - 1)]
    failed = np.isnan(stream.values).any(axis=1)
    lines.append(entry('flow', 'failed', '1', proportion(int(failed.sum()), len(failed)),
                       len(failed)))
    air = airborne(recording, stream.t) & ~failed
    if air.sum() < 4 * STRETCHES:
        return lines, None
    for axis in range(2):
        lines.append(entry(f'flow {"xy"[axis]}', 'noise', 'rad/s', white_sigma(
            stream.values[air, axis]), air.sum(), 'motion of the vehicle included'))
    found = flow_latency(recording)
    if found is None:
        return lines, None
    interval, share, misfit = found
    note = f'R^2 {share:.2f}'
    if share < LEAST_SHARE or not (LAGS[0] < interval.low and interval.high < LAGS[-1]):
        interval, note = Interval(np.nan, np.nan, np.nan), 'not to be told from this flight'
    lines.append(entry('flow', 'latency', 'ms', Interval(*(1e3 * v for v in interval)), air.sum(),
                       note))
    return lines, (1e3 * LAGS, misfit)


def inertial_velocity(recording: Recording, speed: Array | None = None) -> Array:
    """
    Return the velocity along body x and y by the IMU, (n, 2) m/s, high-pass filtered.

    The rate of the body velocity is specific force plus gravity, less what the body's turning
    makes of the velocity along body z, ``omega x v`` of (3.1b) and (3.3) in the body's frame:
    where that is ``w``, the rest is ``w / g`` late, 10 ms at 0.1 m/s. Roll and pitch are the
    integrated gyro. Biases lie below 0.1 Hz and are taken out.

    Parameters
    ----------
    recording
        With gyro and accelerometer at the same times.
    speed : (n, 2) m/s
        Along body x and y by the flow, for the velocity along z, together with the sonar. None:
        that is 0.

    """
    times, rates = recording.gyro.t, recording.gyro.values
    step = float(np.median(np.diff(times)))
    fast = butter(1, 0.1, 'high', fs=1.0 / step, output='sos')

    def integral(x: Array) -> Array:
        """Return the integral over time, high-pass filtered at 0.1 Hz."""
        return cumulative_trapezoid(sosfiltfilt(fast, x, axis=0), dx=step, axis=0, initial=0.0)

    angle = integral(rates)
    gravity = GRAVITY * np.stack([-angle[:, 1], angle[:, 0]], axis=1)
    turned = 0.0
    if speed is not None:
        calm = butter(2, CLIMB, fs=1.0 / step, output='sos')
        height, mean = (sosfiltfilt(calm, x, axis=0) for x in (
            heights(recording.sonar, times), speed))
        tilt = sosfiltfilt(fast, angle, axis=0)  # without the constant of the integral
        down = (tilt[:, 1] * mean[:, 0] - tilt[:, 0] * mean[:, 1]
                - np.gradient(height, times))
        turned = down[:, None] * np.stack([-rates[:, 1], rates[:, 0]], axis=1)
    return integral(recording.accel.values[:, :2] + gravity + turned)


def _compared(recording: Recording, climbing: bool) -> Array | None:
    """
    Return the products of flow and lagged inertial velocity, summed over stretches of flight.

    Parameters
    ----------
    recording
        Of a flight.
    climbing
        Whether the inertial velocity takes account of that along z.

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
    # the filters below need a value at every instant, in the sensor's pauses too
    even = np.stack([np.interp(imu.t, times, speed[:, k]) for k in range(2)], axis=1)
    starts = np.arange(STRETCHES) * len(use) // STRETCHES
    sums = np.empty((3, 2, len(LATENCY_BANDS), len(LAGS), STRETCHES))
    whole = inertial_velocity(recording, even if climbing else None)
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
    Return the latency of the flow behind the motion: the most likely lag.

    Flow times height and inertial velocity are compared in ``LATENCY_BANDS``, a gain and a noise
    for each band and axis; each band counts by its width. Between the lags of the grid the
    likelihood is a parabola. The interval includes the lag that takes account of the velocity
    along z: its own errors, and the height in the scale of the flow, may move a lag as much.

    Returns
    -------
    interval : s
        Positive: the flow is late.
    share
        Largest R^2 of a band and axis at that lag.
    misfit : (k,)
        Geometric mean of 1 - R^2 over ``LAGS``.

    """
    level, climbing = (_compared(recording, climbing) for climbing in (False, True))
    if level is None or climbing is None:
        return None
    (value, low, high), share, misfit = _likeliest(level)
    other = _likeliest(climbing)[0].value
    return Interval(value, min(low, other), max(high, other)), share, misfit


def _likeliest(sums: Array) -> tuple[Interval, float, Array]:
    """Return :func:`flow_latency` by the products of :func:`_compared`."""
    widths = np.array([high - low for low, high in LATENCY_BANDS])

    def rest(keep: NDArray[np.int64]) -> Array:
        """Return the share of the flow that the motion does not explain, over some stretches."""
        cross, left, right = sums[..., keep].sum(axis=-1)
        common, both = np.maximum(cross, 0.0)**2, left * right
        return 1.0 - np.divide(common, both, out=np.zeros_like(both), where=both > 0.0)

    def misfit(keep: NDArray[np.int64]) -> Array:
        """Return the logarithm of the misfit at each lag."""
        weight = widths[None, :, None] / widths.sum() / 2.0
        return (weight * np.log(rest(keep))).sum(axis=(0, 1))

    everything = np.arange(STRETCHES)
    curve = misfit(everything)
    found = jackknife(lambda keep: lowest(misfit(keep), LAGS), STRETCHES)
    share = float(1.0 - rest(everything)[..., int(np.argmin(curve))].min())
    return found, share, np.exp(curve)


def lowest(curve: Array, lags: Array) -> float:
    """Return the lag, s, of the lowest point of a curve, (n,), over even lags, (n,) s."""
    k = int(np.clip(np.argmin(curve), 1, len(curve) - 2))
    bend = curve[k - 1] - 2.0 * curve[k] + curve[k + 1]
    shift = 0.5 * (curve[k - 1] - curve[k + 1]) / bend if bend > 0.0 else 0.0
    return float(lags[k] + np.clip(shift, -1.0, 1.0) * (lags[1] - lags[0]))
