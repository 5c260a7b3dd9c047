"""
Motor map from a bench: thrust of one motor over its command, (4.5)-(4.7).

A power law T = a X^b by least squares on logarithms (4.6), which weighs every reading by its
magnitude, and the line X = c T through the origin. Where repeated readings clearly scatter by an
error that does not grow with the thrust, as of a scale, the power law is that of the largest
likelihood. A bag is a flight, not a bench: its map is that
of the accelerometer (:mod:`.from_flight`).
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from mambo_bags.cli.option_types import real, whole
from mambo_bags.command import Parser, refuse_unused
from mambo_model import palette
from mambo_model.schema import ParameterError
from mambo_model.vehicle.parameters import find
from matplotlib.figure import Figure
import numpy as np
from numpy.typing import NDArray
from scipy import stats

from . import columns, from_flight, regression, result
from .regression import IdentifyError, LEVEL, Value
from .thrust_terms import (
    described, Drift, LEAST_REPEATED, one_way, repeated_drift, repeated_errors, scatter,
    systematic, weighted)

Floats = NDArray[np.float64]

METHOD = 'intervals of 95 %: least squares of independent readings, Student t'
LIFT = (1.0, 6.0)  # largest thrust of four motors over the weight, of what flies; the Mambo 2.6
COARSE = 0.02  # [-] step of a display by the smallest thrust, above which it is told
STRAY = 2.0  # factor by which a thrust is misread; 1.03 at most on a real bench
REACH = (0.5, 1.5)  # largest command of a bench over the limit of the base; 0.96 on a real one
LIKE = (0.4, 2.5)  # thrust over that of the base at the largest command; 0.8 on a real bench
MISSED = 0.02  # [-] RMS of mean thrusts, that is told of readings that repeat to the last digit
LEAST_MISSED = 1e-4  # [-] of others: no scale is linear to 0.01 %
SURE = 1e-3  # of the F test of lack of fit
USUAL = (1.0, 2.5)  # exponent of the map of a rotor: 1.47 in the thesis
THESIS = (4.29e-5, 1.47)  # a [N] and b of (4.5), sec. 4.4.2


class Thrust(NamedTuple):
    """Both motor maps, and the readings that they were fitted to."""

    gain: Value          # PWM/N, X = gain T
    a: Value             # N
    b: Value             # 1
    correlation: float   # of ln a with b: report them together
    linear_rms: float    # 1, of ln(T gain / X)
    power_rms: float     # 1, of ln(T / (a X^b))
    used: NDArray[np.bool_]  # (n,)
    scale_error: float = 0.0  # N, standard deviation whatever the thrust; 0: none is clear
    share_error: float = 1.0  # 1, besides, of the thrust; of no concern without a scale error
    drift: Drift | None = None  # of the thrust from the first reading to the last; None: not clear

    @property
    def better(self) -> str:
        """Return the map for the vehicle: linear unless the exponent surely differs from 1."""
        return 'linear' if self.b.low <= 1.0 <= self.b.high else 'power'


def fit_thrust(pwm: Floats, thrust: Floats, largest: float = np.inf) -> Thrust:
    """
    Fit both motor maps to bench readings, which are independent.

    Parameters
    ----------
    pwm : (n,)
        Commands; readings at 0 or below are no measurement and left out.
    thrust : (n,) N
        Of one motor.
    largest
        Commands above it are left out: there thrust fades (sec. 4.4.2).

    Raises
    ------
    IdentifyError
        For readings that are no motor map, in one line.

    """
    pwm, thrust = np.asarray(pwm, float), np.asarray(thrust, float)
    regression.check_columns({'command': pwm, 'thrust': thrust}, 1)
    used = (pwm > 0.0) & (pwm <= largest)
    X, T = pwm[used], thrust[used]
    if len(X) < 4:
        raise IdentifyError(f'{len(X)} readings of {len(pwm)} can be used, at least 4 are needed')
    if len(np.unique(X)) < 3:
        raise IdentifyError('the command is nearly constant: give at least 3 different ones')
    if not (T > 0.0).all():
        raise IdentifyError(
            f'the thrust at command {X[T <= 0.0][0]:g} is {T[T <= 0.0][0]:g} N: a motor that '
            'runs pushes; check sign and zero of the scale')
    _refuse_stray(X, T)
    with np.errstate(all='ignore'):  # of readings that no bench gives; told below
        found = _fit(X, T, used)
    if not np.isfinite([*found.gain[:3], *found.a[:3], *found.b[:3], *found[3:6]]).all():
        raise IdentifyError('commands or thrusts are too large or too small for a map')
    return found


def _refuse_stray(X: Floats, T: Floats) -> None:
    """Raise IdentifyError if a thrust is not between those of the commands beside it."""
    levels, level = np.unique(np.log(X), return_inverse=True)
    middle = np.array([np.median(np.log(T[level == k])) for k in range(len(levels))])
    inside = np.arange(1, len(levels) - 1)
    beside = middle.copy()  # a curve through the neighbours, in logarithms
    beside[inside] = middle[inside - 1] + (middle[inside + 1] - middle[inside - 1]) * (
        levels[inside] - levels[inside - 1]) / (levels[inside + 1] - levels[inside - 1])
    rest = np.where((level > 0) & (level < len(levels) - 1), np.log(T) - beside[level], 0.0)
    k = int(np.abs(rest).argmax())
    if abs(rest[k]) > np.log(STRAY):
        raise IdentifyError(f'the thrust at command {X[k]:g} is {T[k]:.4g} N, '
                            f'{np.exp(rest[k]):.2g} times what those of the commands beside it '
                            'say: correct it or leave it out')


def _fit(X: Floats, T: Floats, used: NDArray[np.bool_]) -> Thrust:
    """Return both maps of the readings that are used."""
    gain = float(X @ T / (T @ T))
    spread = float(np.sqrt(np.sum((X - gain * T) ** 2) / (len(X) - 1) / (T @ T)))
    half = float(stats.t.ppf(0.5 + 0.5 * LEVEL, len(X) - 1)) * spread
    A = np.stack([np.ones(len(X)), np.log(X)], axis=1)
    (log_a, b), *_ = np.linalg.lstsq(A, np.log(T))
    rest = np.log(T) - A @ (log_a, b)
    covariance = float(rest @ rest) / (len(X) - 2) * np.linalg.inv(A.T @ A)
    drift = repeated_drift(X, T)
    errors = repeated_errors(X, drift.removed(T) if drift else T) or (0.0, 1.0)
    if errors[0]:
        (log_a, b), covariance, _ = weighted(A, T, np.array([log_a, b]), *errors)
    sd = np.sqrt(np.diag(covariance)) * stats.t.ppf(0.5 + 0.5 * LEVEL, len(X) - 2)
    return Thrust(
        Value(gain, gain - half, gain + half, 'PWM/N'),
        Value(*(float(np.exp(log_a + d)) for d in (0.0, -sd[0], sd[0])), 'N'),
        Value(float(b), float(b - sd[1]), float(b + sd[1]), '1'),
        float(covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1])),
        float(np.sqrt(np.mean(np.log(T * gain / X) ** 2))),
        float(np.sqrt(np.mean(rest ** 2))), used, *errors, drift)


def weighed(found: Thrust) -> str:
    """Return in words that readings are weighed by the error of the scale; empty: not."""
    if not found.scale_error:
        return ''
    return (f'repeated readings scatter by {found.scale_error:.2g} N whatever the thrust, as by '
            'the scale: the power law is that of the largest likelihood, not of least squares on '
            'logarithms (4.6), where small thrusts would count too much')


def uneven(X: Floats, T: Floats, found: Thrust) -> str:
    """Return in words that a fit on logarithms misses small thrusts; empty: it does not."""
    rest = np.log(T) - np.log(found.a.value) - found.b.value * np.log(X)
    if found.scale_error or len(X) < LEAST_REPEATED or (
            errors := scatter(rest, T, np.ones(len(X)))) is None:
        return ''
    return (f'a X^b misses small thrusts by a larger share, as with a scale that errs by '
            f'{errors[0]:.2g} N or has a wrong zero: the intervals do not hold; take several '
            'readings at each command, or more of large thrusts')


def unrepeated(X: Floats, found: Thrust) -> str:
    """Return in words that too few readings are repeated to show how they err; empty: enough."""
    if found.scale_error or (again := len(X) - len(np.unique(X))) >= LEAST_REPEATED:
        return ''
    return (f'{again or "no"} reading{"s repeat" if again != 1 else " repeats"} a command: the '
            'intervals hold if readings err by a share of the thrust; with a scale that errs by '
            f'the same whatever the thrust they are too narrow, which {LEAST_REPEATED} repeated '
            'readings would show')


def display_step(thrust: Floats) -> float:
    """Return the step of a display: 1, 2 or 5 times a power of ten that divides all; 0: none."""
    for power in range(2, -7, -1):
        for digit in (5.0, 2.0, 1.0):
            parts = thrust / (step := digit * 10.0 ** power)
            if np.abs(parts - np.round(parts)).max(initial=0.0) < 1e-6:
                return step if np.any(thrust) else 0.0
    return 0.0


def coarse(T: Floats, step: float) -> str:
    """Return in words that thrusts, (n,) N, are read in coarse steps, N; empty: they are not."""
    if not step > COARSE * T.min():
        return ''
    return (f'the thrusts are multiples of {step:.3g} N, {100.0 * step / T.min():.2g} % of the '
            'smallest: the errors of readings are not independent then, and the intervals may '
            'not hold; leave small thrusts out, or read a finer scale')


def misfit(X: Floats, T: Floats, found: Thrust) -> str:
    """
    Return in words that the power law misses repeated readings; empty: it does not, or none are.

    The F test of lack of fit, on logarithms: what the means at each command miss, beside what the
    readings at one command scatter. With an error of the scale, small thrusts count less.
    """
    levels, level, counts = np.unique(X, return_inverse=True, return_counts=True)
    n, m = len(X), len(levels)
    law = np.log(found.a.value) + found.b.value * np.log(X)
    rest = np.log(T) - law
    weight = np.ones(n)
    if found.scale_error:
        rest = T * np.exp(-law) - 1.0
        weight = 1.0 / (found.share_error ** 2 + (found.scale_error * np.exp(-law)) ** 2)
        weight /= weight.mean()
    means = np.bincount(level, rest) / counts
    if m < 4 or n - m < m:
        return ''
    scatter = float(np.sqrt(weight @ (rest - means[level]) ** 2 / (n - m)))
    # of a reading, if the power law fits
    variance = float(weight @ means[level] ** 2 / (m - 2))
    missed = float(np.sqrt(variance * m / n))
    if missed < (LEAST_MISSED if scatter > 0.0 else MISSED) or scatter > 0.0 and stats.f.sf(
            variance / scatter ** 2, m - 2, n - m) > SURE:
        return ''
    return (f'a X^b misses the mean thrusts by {100.0 * missed:.2g} % RMS, where '
            f'readings at one command scatter by {100.0 * scatter:.2g} %: the intervals do not '
            'hold; check the zero of the scale, the time between command and reading, a supply or '
            'scale that drifts, and where thrust fades (--max-pwm)')


def _draw(pwm: Floats, thrust: Floats, found: Thrust) -> Callable[[Figure], None]:
    X, T = pwm[found.used], thrust[found.used]
    fine = np.linspace(X.min(), X.max(), 200)

    def draw(figure: Figure) -> None:
        """Draw the readings with both maps, and the residual."""
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
        bench = palette.COLOURS[palette.MEASURED]
        power, linear, thesis = palette.lines(['a X^b', 'linear', 'thesis'])
        if not found.used.all():
            above.plot(pwm[~found.used], thrust[~found.used], 'x', color=bench, label='left out')
        above.plot(X, T, '.', color=bench, label='bench')
        above.plot(fine, found.a.value * fine ** found.b.value, label='a X^b', **power)
        above.plot(fine, fine / found.gain.value, label='linear', **linear)
        above.plot(fine, THESIS[0] * fine ** THESIS[1], label='thesis, Mambo', **thesis)
        above.set_ylabel('thrust of one motor [N]')
        above.legend()
        for model, style, marker in ((found.a.value * X ** found.b.value, power, '.'),
                                     (X / found.gain.value, linear, 'x')):
            below.plot(X, 100.0 * (T / model - 1.0), marker, color=style['color'])
        below.axhline(0.0, color=palette.INK, lw=0.5)
        below.set_ylabel('residual [%]')
        below.set_xlabel('command [PWM]')
    return draw


def _changed(found: Thrust, source: str) -> dict[str, tuple[Any, str]]:
    """Return the parameters of the vehicle with their sources."""
    return {
        'thrust_map': (found.better, f'{source}: is 1 in the interval of b?'),
        'linear_gain': (found.gain.value, f'{source}, 95 %: {found.gain.low:.6g} to '
                                          f'{found.gain.high:.6g}'),
        'power_a': (found.a.value, f'{source}, 95 %: {found.a.low:.4g} to {found.a.high:.4g}'),
        'power_b': (found.b.value, f'{source}, 95 %: {found.b.low:.4g} to {found.b.high:.4g}')}


def drifting(found: Thrust, steady: Thrust) -> str:
    """
    Return in words that repeated readings show a drift; empty: they do not.

    Parameters
    ----------
    found
        Of the readings.
    steady
        Of the readings without the drift.

    """
    if found.drift is None:
        return ''
    share = 100.0 * np.expm1([found.drift.rate, *found.drift.interval])
    return (f'readings at the same command show a thrust that drifts by {share[0]:+.2g} % '
            f'({share[1]:+.2g} to {share[2]:+.2g} %) from the first reading to the last: the '
            'intervals hold only without it; as at the first reading, the linear gain is '
            f'{steady.gain.value:.5g} PWM/N and b = {steady.b.value:.4g}, {steady.b.low:.4g} to '
            f'{steady.b.high:.4g}; measure at a steady supply')


def _doubts(X: Floats, T: Floats, found: Thrust, step: float) -> list[str]:
    """Return in words what speaks against the intervals; empty where nothing does."""
    even, steady = T, found  # without the drift
    if found.drift:
        even = found.drift.removed(T)
        steady = _fit(X, even, np.ones(len(X), bool))
    terms = systematic(X, even, np.array([np.log(steady.a.value), steady.b.value]),
                       steady.scale_error, steady.share_error)
    return [drifting(found, steady), uneven(X, even, steady) or unrepeated(X, steady),
            misfit(X, even, steady), described(terms) or one_way(X, steady.b.half),
            coarse(T, step)]


def _report(
    options: argparse.Namespace, pwm: Floats, thrust: Floats, step: float,
) -> result.Report:
    found = fit_thrust(pwm, thrust, options.max_pwm)
    changed = _changed(found, f'identify_thrust, {options.file.name}')
    middle = float(np.exp(np.mean(np.log(pwm[found.used]))))
    share = found.a.value * middle ** found.b.value / (THESIS[0] * middle ** THESIS[1])
    facts = {
        'correlation of ln a and b': found.correlation,
        'rms residual of the power law [%]': 100.0 * found.power_rms,
        'rms residual of the line [%]': 100.0 * found.linear_rms,
        'readings used': f'{int(found.used.sum())} of {len(pwm)}',
        'map of the vehicle': found.better,
        'b minus that of the thesis': found.b.value - THESIS[1],
        f'thrust over that of the thesis at {middle:.0f}': share}
    notes = ['a and b belong together: neither is known as well as their map']
    notes += filter(None, [weighed(found)])
    for left, why in ((pwm <= 0.0, 'a command of 0 or below: the motor stands'),
                      (pwm > options.max_pwm, f'a command above --max-pwm {options.max_pwm:g}')):
        notes += [f'{left.sum()} of {len(pwm)} readings are left out, as they have {why}'
                  ] if left.any() else []
    base = options.base or result.DEFAULT
    vehicle = find(base)
    lift = 4.0 * float(thrust[found.used].max()) / (vehicle.mass * vehicle.gravity)
    heavy = None
    if not LIFT[0] < lift < LIFT[1]:
        heavy = (f'four such motors lift {lift:.3g} times the weight of {base}: check '
                 '--unit, --motors and --base')
        notes.append(heavy)
    reach = float(pwm[found.used].max()) / vehicle.pwm_max
    if not REACH[0] < reach < REACH[1]:
        notes.append(f'the largest command is {reach:.2g} times pwm_max = {vehicle.pwm_max:g} of '
                     f'{base}: the map holds in the unit of the bench, check it and --base')
    elif heavy is None:
        top = int(np.argmax(np.where(found.used, pwm, 0.0)))
        of_base = (pwm[top] / vehicle.linear_gain if vehicle.thrust_map == 'linear'
                   else vehicle.power_a * pwm[top] ** vehicle.power_b)
        if not LIKE[0] < thrust[top] / of_base < LIKE[1]:
            notes.append(f'at the command {pwm[top]:g} the thrust is {thrust[top] / of_base:.3g} '
                         f'times that of a motor of {base}: check --unit, --motors and --base')
    if found.b.high < USUAL[0] or found.b.low > USUAL[1]:
        notes.append(f'the thrust grows with the command to the power {found.b.value:.3g}; of '
                     f'rotors {USUAL[0]:g} to {USUAL[1]:g} are usual: check the zero of the scale '
                     'and of the command')
    notes += filter(None, _doubts(pwm[found.used], thrust[found.used], found, step))
    report = result.Report(
        f'motor map of {options.file.name}',
        {'linear gain': found.gain, 'a': found.a, 'b': found.b}, facts, notes, changed,
        _draw(pwm, thrust, found), method=METHOD)
    try:
        result.vehicle_text(report, base)
    except ParameterError as error:
        why = heavy or (
            'the thrust of one motor must rise with its command; check --command, --thrust, '
            '--unit, --motors and the zero of the scale')
        raise IdentifyError(
            f'{options.file}: no motor map of a vehicle: {error}: {why}') from None
    return report


def _refuse_copies(pwm: Floats, thrust: Floats, path: Path) -> None:
    """
    Raise IdentifyError if every reading, (n,), stands there equally often, more than once.

    A display with coarse steps may well repeat its number.
    """
    if len(pwm) != len(thrust) or display_step(thrust) > 0.1 * COARSE * np.abs(thrust).max():
        return  # the former is said where they are fitted
    _, counts = np.unique(np.stack([pwm, thrust]), axis=1, return_counts=True)
    if len(counts) and counts.min() == counts.max() > 1:
        raise IdentifyError(
            f'{path}: every reading stands there {counts[0]} times, which is no new measurement: '
            'leave the copies out')


def parser() -> Parser:
    """Return the command line."""
    out = result.parser(
        'identify_thrust', 'Motor map from commands and thrusts of a bench, (4.5)-(4.7).')
    out.add_argument('file', type=Path, help='.csv, .mat or .json; or the bag of a flight')
    out.add_argument('--command', default='pwm', help='column with the commands')
    out.add_argument('--thrust', default='thrust', help='column with what the scale says')
    out.add_argument('--unit', choices=('N', 'g'), default='N', help='of that column')
    out.add_argument('--motors', type=whole(1, 100), default=1,
                     help='that the scale carries together')
    out.add_argument('--gravity', type=real(0.0, 100.0, 'm/s^2', above=True), default=9.81,
                     help='m/s^2, for grams')
    out.add_argument('--max-pwm', type=real(0.0, 1e6, above=True), default=np.inf,
                     help='leave out what is above: there thrust fades (350 in the thesis)')
    out.add_argument('--namespace', help='of the drone, if a bag has several')
    from_flight.add_options(out)
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``identify_thrust``; return the exit code."""
    command = parser()
    options = command.parse_args(arguments)

    def work() -> result.Report:
        """Read the bench file and return the result."""
        if result.is_bag(options.file):
            refuse_unused(
                command, options, ('command', 'thrust', 'unit', 'motors', 'gravity', 'max_pwm'),
                f'{options.file} is the bag of a flight, not a bench')
            return from_flight.thrust_report(from_flight.read(
                options.file, options.base, options.mass, options.namespace))
        refuse_unused(command, options, ('mass', 'namespace'),
                      f'{options.file} is a bench, not the bag of a flight')
        if options.unit == 'N':
            refuse_unused(command, options, ('gravity',), 'the thrust is in N, not in g')
        table = columns.read(options.file)
        _, pwm = columns.column(table, options.command, options.file)
        _, thrust = columns.column(table, options.thrust, options.file)
        _refuse_copies(pwm, thrust, options.file)
        factor = options.gravity / 1000.0 if options.unit == 'g' else 1.0
        factor /= options.motors
        return _report(options, pwm, factor * thrust, factor * display_step(thrust))
    return result.run('identify_thrust', options, work)


if __name__ == '__main__':
    raise SystemExit(main())
