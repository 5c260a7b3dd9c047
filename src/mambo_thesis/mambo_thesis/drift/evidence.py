r"""
Which mechanisms do flights support? Bayesian comparison of single mechanisms and of pairs.

A model is the equation of :mod:`mambo_thesis.drift.mechanisms` with the scale, a small delay
and the parameters of one or two mechanisms free. Its residuals are modelled as a stationary
autoregressive process, whose coefficients are estimated from the residuals of the model with all
parameters free. The residuals whitened with them are treated as independent. With a normal prior
on every parameter (the widths are in ``PARAMETERS``), Laplace's method gives the evidence

.. math:: \ln p(D | M) = -\tfrac12 \chi^2 - \tfrac12 \sum (\theta_j / s_j)^2 - \sum \ln s_j
          - \tfrac12 \ln \det H

and, with the prior probabilities of the models in ``PRIOR``, their posterior probabilities. These
assume that one of the models is true; :func:`misfit` tests whether the best one can be.

There are two kinds of evidence. With ``window`` None, every sample counts. With a window in
seconds, the residuals are displacements over windows of that length: the displacement according
to the flow minus the true one. A window of one turn leaves only the drift, which is what the
thesis had. The scale is then taken from the samples, with a standard deviation of
``CALIBRATION``, because the drift hardly depends on it.
"""

from __future__ import annotations

from collections.abc import Sequence
import itertools
import math
from typing import NamedTuple

import numpy as np
from scipy.linalg import eigvalsh, solve_toeplitz, toeplitz
from scipy.signal import lfilter
from scipy.stats import chi2

from .flight import Flight
from .mechanisms import flow, MECHANISMS, PARAMETERS, rate_share
from .paths import Array, DRAG_RATE, EXPERIMENTS, LEVEL, PATHS, perfect, Track

Model = tuple[str, ...]

PRIOR = (0.1, 0.6, 0.3)
"""Prior probability of no mechanism, of one and of two; models of one size share it equally."""
CALIBRATION = 0.1  # standard deviation of the scale with windows: offset of 0.15 m at 1.5 m
ORDER = 8          # of the autoregressive process
DURATION = 30.0    # s, length of a proposed experiment
ITERATIONS = 8     # of the Gauss-Newton method
NOISE_ITERATIONS = 3
UNLIKELY = 1e-4    # probability of values as far from the prior as those of no true model
LEFT, LEFT_SHARE = 2.0, 0.5
"""Part of the residual that follows the motion, over the noise of a sample and as share of the
residual's power [-], of no true model: those of known mechanisms leave 0.1 and 0.01."""
LEAST_SHARE = 0.1
"""Least share of the true height that an offset leaves at the lowest sample. Offsets are those of
a mounting, less than 0.2 m; a fit that leaves less makes the flow 0 there, or turns its sign."""
LEAST_NOISE = 1e-6  # rad/s, far below the resolution of any flow
MIN_SHARE = 0.1    # of the residuals' power that always counts as noise other than the gyro's
STEP = 1e-3        # of the numerical derivative, in prior widths
MODELS: tuple[Model, ...] = tuple(
    model for size in range(3) for model in itertools.combinations(MECHANISMS, size))


class Fit(NamedTuple):
    """
    One model fitted to the flights.

    Attributes
    ----------
    model
        Letters of its mechanisms; () is the scale alone.
    values, sigmas
        {parameter: most probable value} and {parameter: standard deviation}.
    log_evidence
        Logarithm of the evidence.
    chi_square
        Sum of squares of the whitened residuals.
    probability
        Posterior probability among the models compared.

    """

    model: Model
    values: dict[str, float]
    sigmas: dict[str, float]
    log_evidence: float
    chi_square: float
    probability: float = 0.0


class Noise(NamedTuple):
    """Noise of the flow, rad/s, as an autoregressive process."""

    coefficients: Array  # (p,), of the previous samples
    sigma: float         # standard deviation of the innovation

    @property
    def long_run(self) -> float:
        """Return the standard deviation of the white noise with the same slow part, rad/s."""
        return self.sigma / max(1.0 - float(self.coefficients.sum()), 0.05)


class Evidence:
    """
    Flights and their noise, to which models can be fitted.

    Parameters
    ----------
    flights
        Flights with the same sensor.
    window : s
        Length of the windows; None: use every sample.
    noise
        Noise of the flow; None: estimate it from the flights.

    Raises
    ------
    ValueError
        If no flight is as long as a window.

    """

    def __init__(self, flights: Sequence[Flight], window: float | None = None,
                 noise: Noise | None = None) -> None:
        self.flights, self.window = list(flights), None
        self.scale = (1.0, PARAMETERS['scale'].width)
        self.windows = [_windows(f, window) for f in self.flights] if window else []
        if window and not any(len(rows) for rows in self.windows):
            raise ValueError(f'no flight has {window:g} s of flow without a gap; give a shorter '
                             '--window')
        self.noise = noise or self._noise()
        if window:
            self.scale = (self.fit(()).values['scale'], CALIBRATION)
            self.window = window

    def residuals(self, values: dict[str, float]) -> list[Array]:
        """Return measured flow minus the flow of a model, (n, 2) rad/s for each flight."""
        lag, delay = values.get('height_lag', 0.0), values.get('delay', 0.0)
        out = []
        for f in self.flights:
            exact = flow(f.track, f.height_before(lag), values)
            if delay:
                # backward differences: the noise of the flow steers the vehicle afterwards
                step = np.diff(f.track.t, prepend=2.0 * f.track.t[0] - f.track.t[1])
                exact = exact - delay / step[:, None] * np.diff(exact, axis=0, prepend=exact[:1])
            out.append(f.flow - exact)
        return out

    def _noise(self) -> Noise:
        """
        Estimate the noise from the residuals of the model with all parameters free.

        The noise that the gyro adds through the rotation terms of the model is not part of it.
        """
        everything = tuple(MECHANISMS)
        noise = Noise(np.zeros(ORDER), 0.02)
        for _ in range(NOISE_ITERATIONS):
            self.noise = noise
            values = self.fit(everything).values
            noise = _autoregression(
                self.residuals(values),
                [rate_share(f.track, values) * f.rate_noise for f in self.flights])
        return noise

    def whitened(self, values: dict[str, float]) -> Array:
        """
        Return the whitened residuals of a model, which have unit variance, and width terms.

        A model that explains flow by the measured rotation also takes over the noise of the gyro,
        which widens its residuals. The likelihood contains the logarithm of that width. It is
        appended as further numbers whose squares add up to it.
        """
        residuals = self.residuals(values)
        if self.window is None:
            kernel = np.r_[1.0, -self.noise.coefficients]
            out = []
            for f, r in zip(self.flights, residuals, strict=True):
                innovation = lfilter(kernel, [1.0], r, axis=0)[ORDER:] / self.noise.sigma
                gyro = rate_share(f.track, values)[ORDER:] * f.rate_noise / self.noise.sigma
                more = np.linalg.norm(kernel)**2 * gyro**2  # variance, relative to the flow noise
                out += [(innovation / np.sqrt(1.0 + more)).ravel(),
                        (np.sign(gyro) * np.sqrt(np.log1p(more))).ravel()]
            return np.concatenate(out)
        out = []
        for f, r, windows in zip(self.flights, residuals, self.windows, strict=True):
            Z, t = f.track.depth, f.track.t
            step = np.gradient(t)
            body = np.column_stack([r * (Z * step)[:, None], np.zeros(len(t))])
            moved = np.einsum('nij,nj->ni', f.track.R, body)[:, :2]
            for rows in windows:
                spread = self.noise.long_run * np.linalg.norm((Z * step)[rows])
                out.append(moved[rows].sum(axis=0) / spread)
        return np.concatenate(out)

    def fit(self, model: Model, known: Fit | None = None) -> Fit:
        """Return the most probable values of a model; ``known``, if given, replaces the prior."""
        names = ['scale', 'delay', *(n for letter in model for n in MECHANISMS[letter].parameters)]
        widths = np.array([self.scale[1], *(PARAMETERS[name].width for name in names[1:])])
        prior = np.array([self.scale[0]] + [0.0] * (len(names) - 1))
        if known is not None:
            prior = np.array([known.values[name] for name in names])
            widths = np.array([known.sigmas[name] for name in names])
        theta = prior.copy()

        def residual(x: Array) -> Array:
            return self.whitened(dict(zip(names, x.tolist(), strict=True)))

        def cost(x: Array, r: Array) -> float:
            return 0.5 * float(np.sum(r * r) + np.sum(((x - prior) / widths)**2))

        r = residual(theta)
        for _ in range(ITERATIONS):
            J = np.column_stack([(residual(theta + d) - r) / (STEP * w) for d, w in zip(
                STEP * np.diag(widths), widths, strict=True)])
            H = J.T @ J + np.diag(widths**-2.0)
            step = np.linalg.solve(H, -J.T @ r - (theta - prior) / widths**2)
            share, start = 1.0, cost(theta, r)
            while cost(theta + share * step, residual(theta + share * step)) > start \
                    and share > 0.01:
                share *= 0.5
            theta = theta + share * step
            r = residual(theta)
            if float(step @ H @ step) < 1e-4:
                break
        sigmas = np.sqrt(np.diag(np.linalg.inv(H)))
        evidence = -cost(theta, r) - float(np.log(widths).sum()) \
            - 0.5 * float(np.linalg.slogdet(H)[1])
        return Fit(model, dict(zip(names, theta.tolist(), strict=True)),
                   dict(zip(names, sigmas.tolist(), strict=True)), evidence, float(r @ r))

    def compare(self, models: Sequence[Model] = MODELS) -> list[Fit]:
        """Fit all models; return them with their probabilities, the most probable first."""
        fits = [self.fit(model) for model in models]
        counts = [sum(len(m) == size for m in models) for size in range(3)]
        logs = np.array([
            f.log_evidence + math.log(PRIOR[len(f.model)] / counts[len(f.model)]) for f in fits])
        weights = np.exp(logs - logs.max())
        fits = [f._replace(probability=float(w)) for f, w in zip(
            fits, weights / weights.sum(), strict=True)]
        return sorted(fits, key=lambda f: -f.probability)


def _windows(f: Flight, window: float) -> list[slice]:
    """Return the rows of consecutive whole windows that contain no gap."""
    t, out, begin = f.track.t, [], 0
    period = float(np.median(np.diff(t)))
    gaps = np.append(np.diff(t) > 2.5 * period, True)
    count = round(window / period)
    while begin + count <= len(t):
        gap = np.flatnonzero(gaps[begin:begin + count])
        if len(gap) and gap[0] < count - 1:
            begin += int(gap[0]) + 1
            continue
        out.append(slice(begin, begin + count))
        begin += count
    return out


def _autoregression(residuals: Sequence[Array], white: Sequence[Array]) -> Noise:
    """
    Return the autoregressive process of residuals, by the Yule-Walker equations.

    Parameters
    ----------
    residuals : (n, 2) rad/s of each flight
    white : (n, 2) rad/s of each flight
        Standard deviation of white noise in the residuals that is not part of the process.

    """
    sums, known, count = np.zeros(ORDER + 1), 0.0, 0
    for r, s in zip(residuals, white, strict=True):
        r = r - r.mean(axis=0)
        sums += [float(np.sum(r[k:] * r[:len(r) - k])) for k in range(ORDER + 1)]
        known += (1.0 - MIN_SHARE) * min(float(np.sum(s * s)), float(np.sum(r * r)))
        count += r.size
    covariance = sums / count
    # a process has no more white noise than its least eigenvalue: the rest would be none
    most = max(float(eigvalsh(toeplitz(covariance))[0]), 0.0)
    covariance[0] -= min(known / count, (1.0 - MIN_SHARE) * most)
    a = solve_toeplitz(covariance[:-1], covariance[1:])
    power = covariance[0] - float(a @ covariance[1:])  # of an exact flow 0, but for rounding
    return Noise(a, math.sqrt(max(power, LEAST_NOISE ** 2)))


def misfit(evidence: Evidence, fit: Fit) -> str:
    """
    Return in words why a model cannot be true, '' if it can.

    It cannot if its values are improbable by their prior (chi squared of as many degrees of
    freedom), if its offset leaves next to nothing of the height, or if the residuals of its
    samples still follow the motion: velocity over depth and its derivative, along both axes.
    """
    prior = {name: evidence.scale if name == 'scale' else (0.0, PARAMETERS[name].width)
             for name in fit.values}
    far = {name: abs(fit.values[name] - middle) / width
           for name, (middle, width) in prior.items()}
    if sum(x * x for x in far.values()) > chi2.isf(UNLIKELY, len(far)):
        name = max(far, key=lambda one: far[one])
        unit = PARAMETERS[name].unit.removesuffix('1')
        return (f'needs {name} = {fit.values[name]:.2g} {unit}'.rstrip()
                + f', {far[name]:.1f} standard deviations of the prior')
    lag, offset = (fit.values.get(name, 0.0) for name in ('height_lag', 'height_offset'))
    for f in evidence.flights:
        share = (f.height_before(lag) + offset) / f.track.height
        k = int(np.argmin(share))
        if share[k] < LEAST_SHARE:
            return (f'needs height_offset = {offset:.2g} m, which leaves '
                    f'{share[k] * f.track.height[k]:.2g} m of a height of '
                    f'{f.track.height[k]:.2f} m')
    if evidence.window is not None:
        return ''
    left, power, count = 0.0, 0.0, 0
    for f, r in zip(evidence.flights, evidence.residuals(fit.values), strict=True):
        exact = f.track.nu[:, :2] / f.track.depth[:, None]
        terms = np.column_stack([exact, np.gradient(exact, f.track.t, axis=0)])
        terms, rest = terms - terms.mean(axis=0), r - r.mean(axis=0)
        left += float(np.sum((terms @ np.linalg.lstsq(terms, rest, rcond=None)[0]) ** 2))
        power, count = power + float(np.sum(rest ** 2)), count + r.size
    size = math.sqrt(left / count)
    if size > LEFT * evidence.noise.sigma and left > LEFT_SHARE * power:
        return (f'leaves {size:.3f} rad/s that follow the motion, the noise of a sample is '
                f'{evidence.noise.sigma:.3f} rad/s')
    return ''


def inclusion(fits: Sequence[Fit]) -> dict[str, float]:
    """Return the probability of each mechanism, summed over the models that contain it."""
    return {letter: sum(f.probability for f in fits if letter in f.model)
            for letter in MECHANISMS}


def negligible(flights: Sequence[Flight], fit: Fit, noise: Noise) -> list[str]:
    """
    Return which mechanism of a pair is too small beside the other one to be a finding.

    It is negligible if it changes the flow by less than the noise of one sample and by less than
    half of what the other one does. Effects that no model here contains may be of that size.
    """
    if len(fit.model) < 2:
        return []
    sizes = {}
    for letter in fit.model:
        others = {name: value for name, value in fit.values.items()
                  if name not in MECHANISMS[letter].parameters}
        change = np.concatenate([np.subtract(*(
            flow(f.track, f.height_before(values.get('height_lag', 0.0)), values)
            for values in (fit.values, others))) for f in flights])
        sizes[letter] = math.sqrt(np.mean(change**2))
    return [x for x in fit.model if sizes[x] < min(noise.sigma, 0.5 * max(sizes.values()))]


def credible_models(fits: Sequence[Fit], level: float = 0.95) -> list[Fit]:
    """Return the smallest set of models whose probabilities sum to a level, best first."""
    total, out = 0.0, []
    for fit in fits:
        out.append(fit)
        total += fit.probability
        if total >= level:
            break
    return out


def separating_odds(a: Fit, b: Fit, noise: Noise, window: float | None = None) -> dict[str, float]:
    """
    Return the ln odds by which 30 s of each experiment would separate two models.

    The prediction of one model is fitted by the other, whose values may move within their present
    standard deviations. The smaller of the two directions counts.

    Parameters
    ----------
    a, b
        Fitted models.
    noise
        Noise of the flow.
    window : s
        As in :class:`Evidence`.

    """
    out = {}
    for name, (speed, size, path) in EXPERIMENTS.items():
        t = np.arange(0.0, DURATION, 1.0 / 32.0)

        def motion(t: Array, speed: float = speed, size: float = size, path: str = path) -> Track:
            return perfect(PATHS[path], t, speed, size, path == LEVEL, DRAG_RATE)

        fine = np.arange(-1.0, DURATION, 0.01)
        still = Flight(name, motion(t), np.zeros((len(t), 2)),
                       np.column_stack([fine, motion(fine).height]), 0.0)
        odds = []
        for truth, other in ((a, b), (b, a)):
            before = still.height_before(truth.values.get('height_lag', 0.0))
            flown = still._replace(flow=flow(still.track, before, truth.values))
            fit = Evidence([flown], window, noise).fit(other.model, other)
            change = sum(((value - other.values[name]) / other.sigmas[name])**2
                         for name, value in fit.values.items())
            odds.append(0.5 * (fit.chi_square + change))
        out[name] = min(odds)
    return out
