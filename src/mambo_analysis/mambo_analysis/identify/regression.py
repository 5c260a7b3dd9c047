r"""
Least squares with intervals that account for correlated residuals of a recording.

The residual of every channel is modelled as an autoregressive process (its order by the Bayesian
information criterion), and the fit is repeated on what that process cannot predict: feasible
generalised least squares. Intervals are those of Gauss and Newton on these whitened residuals,

.. math:: \hat\theta_i \pm t_{n} \sqrt{[s^2 (J^T J)^{-1}]_{ii}}

with Student's t. They are valid if the model is right and its errors are small against its
curvature; an error common to a whole recording, of a ruler say, is not in them.

A model of a real flight is right for a while: warm motors and gusts change it within seconds.
With ``blocks`` the recording is therefore cut into parts, each is left out once, and where the
estimates scatter by more than the interval above admits, the interval is theirs (the jackknife of
Kuensch, Annals of Statistics 17, 1989, with few long blocks).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

from mambo_model.errors import MamboError
import numpy as np
from numpy.typing import NDArray
from scipy import linalg, optimize, signal, stats

Floats = NDArray[np.float64]
Model = Callable[[Floats], Floats]

LEVEL = 0.95          # of every interval
LARGEST_ORDER = 8     # of the autoregressive model
PASSES = 3            # of whitening and fitting
BLOCK_TOLERANCE = 1e-4  # of fits without a block, far below what they scatter
UNKNOWN = 1e3         # times an interval, where a fit without a block is impossible
BOUND = 1e-3          # of a range, from its end: there the search ended
POOREST = 1e-10       # least eigenvalue over largest of a scaled J^T J that determines a parameter


class IdentifyError(MamboError, ValueError):
    """The data do not determine the parameter; the message says why and what to do."""


class Value(NamedTuple):
    """An identified number and its interval at ``LEVEL``."""

    value: float
    low: float
    high: float
    unit: str

    @property
    def half(self) -> float:
        """Return half of the width of the interval."""
        return 0.5 * (self.high - self.low)

    def __str__(self) -> str:
        return f'{self.value:.5g} {self.unit} [{self.low:.5g}, {self.high:.5g}]'


def plus_minus(value: float, half: float) -> str:
    """
    Return ``value +- half`` with two digits of the half width, and three decimals at least.

    A half width above 0 therefore never reads as 0. One of exactly 0 reads ``+- 0``: the samples
    do not scatter beyond the resolution of their log.
    """
    if not half > 0.0 or not np.isfinite(half):
        return f'{value:.6g} +- {half:g}'
    digits = min(max(3, 1 - int(np.floor(np.log10(half)))), 12)
    return f'{value:.{digits}f} +- {half:.{digits}f}'


class Fit(NamedTuple):
    """
    A fit of p parameters to n samples of k channels.

    Attributes
    ----------
    theta : (p,)
    covariance : (p, p)
        Of theta; of what correlates with the nuisance terms only the rest counts.
    freedom
        Degrees of freedom of Student's t: samples less everything fitted.
    residual : (n, k)
        Data minus model minus nuisance terms.
    order : (k,)
        Of the autoregressive model of each channel's residual; 0 is white.

    """

    theta: Floats
    covariance: Floats
    freedom: int
    residual: Floats
    order: tuple[int, ...]

    @property
    def rms(self) -> float:
        """Return the root mean square of the residual."""
        return float(np.sqrt(np.mean(self.residual ** 2)))

    def half(self, i: int) -> float:
        """Return half of the width of the interval of parameter i."""
        return float(stats.t.ppf(0.5 + 0.5 * LEVEL, self.freedom)
                     * np.sqrt(self.covariance[i, i]))

    def value(self, i: int, unit: str) -> Value:
        """Return parameter i with its interval."""
        x, half = float(self.theta[i]), self.half(i)
        return Value(x, x - half, x + half, unit)

    def positive(self, i: int, unit: str) -> Value:
        """
        Return a parameter that was fitted by its logarithm.

        One that may be anything between 0 and a multiple of itself has an even interval, cut at 0.
        """
        x, half = float(np.exp(self.theta[i])), self.half(i)
        if half < 1.0:
            return Value(x, x * float(np.exp(-half)), x * float(np.exp(half)), unit)
        return Value(x, max(0.0, x - x * half), x + x * half, unit)


def autoregression(x: Floats, largest: int = LARGEST_ORDER) -> Floats:
    """
    Return the coefficients of x[i] = a_1 x[i-1] + ... + noise; (p,), none if x is white.

    Burg's method, which keeps the process stable; p minimises the Bayesian information criterion.

    Parameters
    ----------
    x : (n,)
        Of mean 0.
    largest
        Order to consider at most; n/10 at most.

    """
    forward, backward = x[1:].copy(), x[:-1].copy()
    power, a, best = float(np.mean(x * x)), np.empty(0), np.empty(0)
    if not power > 0.0:
        return best
    count = len(x)
    score = count * np.log(power)
    for order in range(1, min(largest, count // 10) + 1):
        scale = float(forward @ forward + backward @ backward)
        if not scale > 0.0:
            break
        k = 2.0 * float(forward @ backward) / scale
        a = np.append(a - k * a[::-1], k)
        power *= 1.0 - k * k
        forward, backward = (forward - k * backward)[1:], (backward - k * forward)[:-1]
        if not power > 0.0:
            break
        criterion = count * np.log(power) + order * np.log(count)
        if criterion < score:
            score, best = criterion, a
    return best


class _Whitener(NamedTuple):
    """Filters of the channels; from ``largest`` samples on all channels have their past."""

    coefficients: list[Floats]
    scales: Floats  # (k,)

    def __call__(self, x: Floats) -> Floats:
        """Return (n - largest, k, ...) whitened, every channel of unit variance."""
        largest = max(map(len, self.coefficients))
        if not x.size:  # no nuisance terms
            return x[largest:]
        out = [signal.lfilter(np.concatenate(([1.0], -a)), 1.0, x[:, j], axis=0)[largest:] / s
               for j, (a, s) in enumerate(zip(self.coefficients, self.scales))]
        return np.stack(out, axis=1)


def _whitener(residual: Floats) -> _Whitener:
    """Return the whitening filters of a residual (n, k)."""
    coefficients = [autoregression(column - column.mean()) for column in residual.T]
    plain = _Whitener(coefficients, np.ones(residual.shape[1]))
    scales = np.sqrt(np.mean(plain(residual) ** 2, axis=0))
    return plain._replace(scales=np.where(scales > 0.0, scales, 1.0))


class _Problem:
    """Residuals of a model, whitened, with the nuisance terms projected out."""

    def __init__(self, model: Model, data: Floats, nuisance: Floats) -> None:
        self.model, self.data, self.nuisance = model, data, nuisance
        self.whiten = _Whitener([np.empty(0)] * data.shape[1], np.ones(data.shape[1]))
        self._last: tuple[bytes, Floats] | None = None

    def rest(self, theta: Floats) -> Floats:
        """Return data minus model, (n, k); the last result is cached."""
        key = np.asarray(theta).tobytes()
        if self._last is None or self._last[0] != key:
            self._last = key, self.data - self.model(theta)
        return self._last[1]

    def _bases(self) -> list[Floats]:
        """Return an orthonormal basis of the whitened nuisance terms for each channel."""
        count, k = self.data.shape
        terms = np.broadcast_to(self.nuisance[:, None, :], (count, k, self.nuisance.shape[1]))
        white = self.whiten(terms)
        return [linalg.qr(white[:, j], mode='economic')[0] for j in range(k)]

    def residual(self, theta: Floats) -> Floats:
        """Return the residuals for :func:`scipy.optimize.least_squares`, ((n - p) k,)."""
        white = self.whiten(self.rest(theta))
        for j, basis in enumerate(self.bases):
            white[:, j] -= basis @ (basis.T @ white[:, j])
        return white.ravel()

    def set(self, whiten: _Whitener) -> None:
        """Replace the whitening filters."""
        self.whiten = whiten
        self.bases = self._bases()

    def unexplained(self, theta: Floats) -> Floats:
        """Return data minus model minus nuisance terms, (n, k), not whitened."""
        rest, out = self.rest(theta), []
        if not self.nuisance.size:
            return rest
        terms = self.whiten(np.broadcast_to(
            self.nuisance[:, None, :], (*self.data.shape, self.nuisance.shape[1])))
        white = self.whiten(rest)
        for j in range(rest.shape[1]):
            share = linalg.lstsq(terms[:, j], white[:, j])[0]
            out.append(rest[:, j] - self.nuisance @ share)
        return np.stack(out, axis=1)


def fit(
    model: Model, data: Floats, start: Sequence[float], low: Sequence[float],
    high: Sequence[float], names: Sequence[str], nuisance: Floats | None = None,
    step: float | None = None, colour: bool = True, tolerance: float = 1e-7, blocks: int = 0,
) -> Fit:
    """
    Fit a model to recorded channels.

    Parameters
    ----------
    model
        (p,) -> (n, k), the channels that parameters predict.
    data : (n, k)
        At even times, as the autoregressive model needs; finite.
    start, low, high : (p,)
        First guess, and limits that the search keeps to.
    names : (p,)
        For errors.
    nuisance : (n, q)
        Terms of every channel whose amount is fitted too, an unknown offset and drift say.
    step
        Relative step of the differences that make J; default: of rounding.
    colour
        Whether to whiten; without, intervals are those of independent residuals.
    tolerance
        Relative change of theta that ends the search.
    blocks
        Parts of the recording whose disagreement widens the intervals; 0: none.

    Raises
    ------
    IdentifyError
        If there are too few samples, too extreme ones, or they do not determine a parameter.

    """
    nuisance = np.empty((len(data), 0)) if nuisance is None else nuisance
    problem, theta = _Problem(model, data, nuisance), np.asarray(start, float)
    freedom = data.size - len(theta) - nuisance.shape[1] * data.shape[1]
    if freedom < 1:
        raise IdentifyError(
            f'{data.size} samples are too few for {data.size - freedom} unknowns')
    for number in range(PASSES if colour else 1):
        problem.set(problem.whiten if not number else _whitener(problem.unexplained(theta)))
        first = problem.residual(theta)
        if not np.isfinite(first @ first):
            raise IdentifyError('the numbers are too extreme to fit')
        if number > 1 and all(len(a) == 0 for a in problem.whiten.coefficients):
            break
        found = optimize.least_squares(
            problem.residual, theta, bounds=(low, high), x_scale='jac', diff_step=step,
            xtol=tolerance, ftol=1e-2 * tolerance, gtol=1e-2 * tolerance)
        theta = found.x
    freedom = max(freedom - sum(map(len, problem.whiten.coefficients)), 1)
    covariance = _covariance(found.jac, 2.0 * found.cost / freedom, names)
    if blocks:
        wider = _wider([_without(rows, model, data, theta, low, high, names, nuisance,
                                  colour)
                        for rows in np.array_split(np.arange(len(data)), blocks)],
                       covariance, freedom)
        covariance = covariance * np.outer(wider, wider)
    return Fit(
        theta, covariance, freedom, problem.unexplained(theta),
        tuple(len(a) for a in problem.whiten.coefficients))


def _without(
    rows: NDArray[np.intp], model: Model, data: Floats, theta: Floats, low: Sequence[float],
    high: Sequence[float], names: Sequence[str], nuisance: Floats, colour: bool,
) -> Floats | None:
    """Return the parameters of a fit without some rows; None if the rest shows too little."""
    try:
        return fit(lambda x: np.delete(model(x), rows, axis=0), np.delete(data, rows, axis=0),
                   theta, low, high, names, np.delete(nuisance, rows, axis=0),
                   colour=colour, tolerance=BLOCK_TOLERANCE).theta
    except IdentifyError:
        return None


def _covariance(J: Floats, variance: float, names: Sequence[str]) -> Floats:
    """Return the covariance (J^T J)^-1; J must have full rank."""
    length = np.linalg.norm(J, axis=0)
    for name, size in zip(names, length):
        if not size > 0.0:
            raise IdentifyError(f'the data do not depend on {name}')
    values, vectors = np.linalg.eigh((J / length).T @ (J / length))
    if values[0] < POOREST * values[-1]:
        mixed = [name for name, part in zip(names, vectors[:, 0]) if abs(part) > 0.3]
        raise IdentifyError(f'the data do not tell {" from ".join(mixed)}: excite them more')
    inverse = (vectors / values) @ vectors.T
    return variance * inverse / np.outer(length, length)


def _wider(fits: Sequence[Floats | None], covariance: Floats, freedom: int) -> Floats:
    """
    Return by how much estimates without one block each scatter more than a covariance says.

    Parameters
    ----------
    fits : (p,) each
        Parameters without a block; None: what is left does not determine them.
    covariance : (p, p)
        Of all blocks, if their residuals are alike.
    freedom
        Of the covariance.

    Returns
    -------
    factor : (p,)
        Of the half widths, at least 1; Student's t of the few blocks is in it.

    """
    known = [one for one in fits if one is not None]
    if len(known) < len(fits):
        return np.full(len(covariance), UNKNOWN)
    spread = np.sqrt((len(fits) - 1) * np.var(known, axis=0))
    level = 0.5 + 0.5 * LEVEL
    ratio = float(stats.t.ppf(level, len(fits) - 1) / stats.t.ppf(level, freedom))
    return np.maximum(1.0, ratio * spread / np.sqrt(np.diag(covariance)))


def at_bound(
    theta: Floats, low: Sequence[float], high: Sequence[float], names: Sequence[str],
    natural: Sequence[str] = (),
) -> dict[str, float]:
    """
    Return the parameters at an end of their range, where a fit tells nothing, with that end.

    Parameters
    ----------
    theta, low, high : (p,)
        As fitted, and the limits of the search.
    names : (p,)
    natural
        Those that are never below their lower limit, a lag or a damping: there they may be.

    """
    out = {}
    for name, x, first, last in zip(names, theta, low, high, strict=True):
        near = BOUND * (last - first)
        if x > last - near or (x < first + near and name not in natural):
            out[name] = float(last if x > last - near else first)
    return out


def refuse_bound(
    found: Fit, low: Sequence[float], high: Sequence[float], names: Sequence[str],
    natural: Sequence[str] = (),
) -> None:
    """Raise IdentifyError for a parameter :func:`at_bound`."""
    for name in at_bound(found.theta, low, high, names, natural):
        raise IdentifyError(f'{name} is at the end of its range: the data show another effect, or '
                            'have another unit')


def check_columns(columns: dict[str, Floats], least: int) -> None:
    """
    Check columns that belong together.

    Raises
    ------
    IdentifyError
        Naming one that is not finite or has another length, or too few samples.

    """
    length = len(next(iter(columns.values())))
    for name, column in columns.items():
        if len(column) != length:
            raise IdentifyError(f'{name} has {len(column)} samples, not {length} as the others')
    if length < max(least, 1):
        raise IdentifyError(f'{length} samples, at least {max(least, 1)} are needed')
    for name, column in columns.items():
        bad = int(np.count_nonzero(~np.isfinite(column).reshape(length, -1).all(axis=1)))
        if bad:
            raise IdentifyError(
                f'{name} is not finite in {bad} of {length} samples: leave them out')


def check_times(t: Floats) -> None:
    """Raise IdentifyError if times (n,) s do not increase."""
    wrong = np.flatnonzero(np.diff(t) <= 0.0)
    if len(wrong):
        raise IdentifyError(f'time does not rise after {t[wrong[0]]:.6g} s')
