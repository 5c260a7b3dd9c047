"""
Noise of a sensor at rest: overlapping Allan deviation, white noise and random walk.

IEEE Std 952-1997, annex C, for the terms; W. J. Riley, Handbook of Frequency Stability Analysis,
NIST SP 1065 (2008), section 5.4, for the equivalent degrees of freedom.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dst
from scipy.optimize import brentq, minimize_scalar
from scipy.stats import chi2, norm

Floats = NDArray[np.float64]
FLICKER = np.sqrt(2.0 * np.log(2.0) / np.pi)  # 0.664: flat part of the curve over B
LEVEL = 0.95  # of every interval
WALK_MEAN = 0.1  # s


class Interval(NamedTuple):
    """A value and its confidence interval at ``LEVEL``."""

    value: float
    low: float
    high: float


class Allan(NamedTuple):
    """Curve of one signal; interval of each point for the noise seen there."""

    tau: Floats        # (k,) s
    deviation: Floats  # (k,) unit of the signal
    low: Floats        # (k,)
    high: Floats       # (k,)


def degrees_of_freedom(n: int, m: int, noise: str) -> float:
    """
    Return the equivalent degrees of freedom of an overlapping Allan variance.

    Parameters
    ----------
    n
        Samples.
    m
        Samples averaged, at most n / 2.
    noise
        ``white``, ``flicker`` or ``walk`` of the signal.

    """
    N = n + 1  # points of the integrated signal
    if noise == 'white':
        return (1.5 * (N - 1) / m - 2 * (N - 2) / N) * 4 * m**2 / (4 * m**2 + 5)
    if noise == 'flicker':
        return 2 * (N - 2)**2 / (2.3 * N - 4.9) if m == 1 else 1.25 * N**2 / (m * (N + 3 * m))
    return (N - 2) / m * ((N - 1)**2 - 3 * m * (N - 1) + 4 * m**2) / (N - 3)**2


def deviation(x: Floats, m: int) -> float:
    """Return the overlapping Allan deviation of samples, (n,), in averages of m <= n / 2."""
    integral = np.r_[0.0, np.cumsum(x - x.mean())]
    second = integral[2 * m:] - 2.0 * integral[m:-m] + integral[:-2 * m]
    return float(np.sqrt((second**2).mean() / 2.0) / m)


def interval_of_deviation(value: float, dof: float) -> Interval:
    """Return a standard deviation with its chi-squared interval, from its degrees of freedom."""
    low, high = chi2.ppf([0.5 + LEVEL / 2, 0.5 - LEVEL / 2], dof)
    return Interval(value, value * np.sqrt(dof / low), value * np.sqrt(dof / high))


def allan(x: Floats, rate: float) -> Allan:
    """
    Return the Allan curve of a signal at rest, in octaves.

    The kind of noise behind an interval is read off the local slope: -1/2 white, 0 flicker, +1/2
    random walk.

    Parameters
    ----------
    x : (n,)
        At least 8 samples.
    rate : Hz
        Of the samples.

    """
    n = len(x)
    m = 2 ** np.arange(int(np.log2(n / 3)) + 1)
    points = np.array([deviation(x, k) for k in m.tolist()])
    with np.errstate(divide='ignore', invalid='ignore'):
        slope = np.nan_to_num(np.gradient(np.log(points), np.log(m)))
    bounds = []
    for k, value, s in zip(m.tolist(), points.tolist(), slope.tolist()):
        noise = 'white' if s < -0.25 else 'flicker' if s < 0.25 else 'walk'
        bounds.append(interval_of_deviation(value, degrees_of_freedom(n, k, noise))[1:])
    return Allan(m / rate, points, *np.array(bounds).T)


def white_density(x: Floats, rate: float, walk: Interval, tau: float = 0.1) -> Interval:
    """
    Return the angle (velocity) random walk N, unit of the signal per sqrt(Hz).

    The Allan variance near ``tau`` seconds, where vibration and other fast noise are averaged
    away, is ``N^2 / tau + K^2 tau / 3 (1 + 1 / (2 m^2))`` in averages of m samples. The interval
    adds the squared errors of the Allan variance and of what the bias walks.

    Parameters
    ----------
    x : (n,)
        Signal at rest, at least 8 samples.
    rate : Hz
        Of the samples.
    walk
        Random walk K of its bias, of :func:`random_walk`.
    tau : s
        Averaging time.

    """
    m = min(max(round(tau * rate), 1), len(x) // 8)
    size, (k, k_low, k_high) = deviation(x, m), (
        v * v * m / rate / 3.0 * (1.0 + 0.5 / (m * m)) for v in walk)
    kind = 'white' if 2.0 * k < size * size else 'walk'
    value, low, high = (
        v * v for v in interval_of_deviation(size, degrees_of_freedom(len(x), m, kind)))
    white = max(value - k, 0.0)
    ends = (white, white - np.hypot(value - low, k_high - k),
            white + np.hypot(high - value, k - k_low))
    return Interval(*(float(np.sqrt(max(v, 0.0) * m / rate)) for v in ends))


def bias_instability(curve: Allan) -> tuple[Interval, bool, float]:
    """
    Return the minimum of the curve over 0.664, and whether the curve rises after it.

    If it does not, the recording is too short and the value is a bound from above. The third
    value is the factor by which the variance of white noise in a sample enters its square.
    """
    k = int(np.argmin(curve.deviation))
    found = Interval(*(float(v[k] / FLICKER) for v in curve[1:]))
    rises = bool((curve.low[k:] > curve.deviation[k]).any())
    return found, rises, float(curve.tau[0] / curve.tau[k] / FLICKER**2)


def random_walk(x: Floats, rate: float) -> Interval:
    """
    Return the random walk K of the bias, unit of the signal per sqrt(s): exact likelihood.

    Means over ``WALK_MEAN`` seconds, so that what a filter in the sensor does to its noise plays
    no part. For white noise on a random walk their first differences have the covariance
    ``q (1 - T/6) + r T``, with T tridiagonal (2, -1); the discrete sine transform makes them
    independent, of the variances with ``2 - 2 cos(pi j / n)``, j = 1 ... n - 1, for T. The
    interval holds what is at most chi2(1)/2 less likely than the best; its lower end is 0 where
    no walk is seen.

    Parameters
    ----------
    x : (n,)
        Signal at rest.
    rate : Hz
        Of the samples.

    """
    m = max(round(WALK_MEAN * rate), 1)
    n = len(x) // m
    means = x[:n * m].reshape(n, m).mean(axis=1)
    power = dst(np.diff(means), type=1, norm='ortho')**2
    roots = 2.0 - 2.0 * np.cos(np.pi * np.arange(1, n) / n)
    unit = float(power.mean())
    if unit == 0.0:  # the means are all the same: there is nothing but resolution
        return Interval(0.0, 0.0, 0.0)
    power = power / unit

    def misfit(q: float) -> float:
        """Return -2 log likelihood of a random walk, minimised over the white noise."""
        def of_noise(log_r: float) -> float:
            """Return -2 log likelihood at one white noise."""
            variance = q * (1.0 - roots / 6.0) + np.exp(log_r) * roots
            return float(np.log(variance).sum() + (power / variance).sum())

        return float(minimize_scalar(of_noise, bounds=(-30.0, 5.0), method='bounded').fun)

    grid = np.r_[0.0, np.logspace(-10, 0.3, 42)]
    values = np.array([misfit(q) for q in grid.tolist()])
    k = int(np.argmin(values))
    best, least = float(grid[k]), float(values[k])
    if 0 < k < len(grid) - 1:
        fine = minimize_scalar(
            lambda log_q: misfit(np.exp(log_q)), method='bounded',
            bounds=(np.log(grid[max(k - 1, 1)]), np.log(grid[k + 1])))
        best, least = float(np.exp(fine.x)), min(least, float(fine.fun))
    ends = _profile(misfit, grid, values, best, least + chi2.ppf(LEVEL, 1))
    return Interval(*(float(np.sqrt(q * unit * rate / m)) for q in (best, *ends)))


def _profile(misfit, grid: Floats, values: Floats, best: float, limit: float) -> tuple[
        float, float]:
    """Return the points below and above the optimum where the misfit crosses the limit; or 0."""
    below = grid[(grid < best) & (values > limit)]
    above = grid[(grid > best) & (values > limit)]
    low = brentq(lambda q: misfit(q) - limit, below[-1], best) if len(below) else 0.0
    high = brentq(lambda q: misfit(q) - limit, best, above[0]) if len(above) else float(grid[-1])
    return float(low), float(high)


def deviation_at_rest(x: Floats) -> Interval:
    """
    Return the standard deviation of samples, (n,), correlated or not.

    The degrees of freedom are (n - 1) over one plus twice the sum of the squared
    autocorrelations that differ from those of white noise (Bartlett).
    """
    n, lags = len(x), min(len(x) // 4, 400)
    centred = x - x.mean()
    variance = float((centred**2).sum())
    if variance == 0.0:
        return Interval(0.0, 0.0, 0.0)
    rho = np.array([(centred[k:] * centred[:-k]).sum() for k in range(1, lags + 1)]) / variance
    rho = rho[np.abs(rho) > norm.ppf(1 - 0.5 / (20 * lags)) / np.sqrt(n)]
    return interval_of_deviation(
        float(x.std(ddof=1)), max((n - 1) / (1 + 2 * float((rho**2).sum())), 1.0))
