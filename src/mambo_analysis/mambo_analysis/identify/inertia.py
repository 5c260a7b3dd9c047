"""
Moment of inertia from the gyroscope of a swinging body, (4.2)-(4.3).

On two wires it swings about the vertical; ``--rig physical`` about a horizontal axis beside it.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from mambo_bags.cli.option_types import real, TIME
from mambo_bags.command import Parser, refuse_unused
from mambo_model import palette
from mambo_model.vehicle import bifilar
from mambo_signals.resample import longest_run
from matplotlib.figure import Figure
import numpy as np
from numpy.typing import NDArray

from . import columns, regression, result
from .base import Base, based, choose, of_bag
from .regression import IdentifyError, Value

Floats = NDArray[np.float64]

LEAST_SWINGS = 2.0   # in a recording
PAUSE = 0.1          # of a swing, longest time between two samples
USUAL = 3.0          # steps, which are no pause either
LARGEST = 2.8        # rad, of a swing: beyond is no pendulum but deg/s taken for rad/s
EXPLAINED = 0.5      # least part of the power of the gyro that a swing of (4.2) has to explain
OTHER_UNIT = 2.0     # [-] unexplained variance in the unit given over that in the other, at least:
                     # a large swing is slower, and slows less as it decays, than a small one
FLAT = 2.0           # times as long as the top of a swing in numbers of its resolution
LIKE = 3.0           # [-] radius of gyration over that of the base; 47 mm about z of a Mambo
HEAVY = 10.0         # [-] mass over that of the base
COHERENT = 0.01      # of the rate: a coloured residual beyond is an error of the model
NAMES = ('frequency', 'quadratic damping', 'linear damping', 'first angle', 'first rate')
AXES = ('x', 'y', 'z')


class Geometry(NamedTuple):
    """Geometry of the rig, with standard deviations."""

    mass: float               # kg
    separation: float         # m, D between the wires, or from a horizontal axis to the centre
    length: float = 0.0       # m, h of the wires; 0: a horizontal axis
    gravity: float = 9.81     # m/s^2
    mass_error: float = 0.0   # kg
    separation_error: float = 0.0  # m
    length_error: float = 0.0  # m

    def inertia(self, frequency: float) -> float:
        """Return J in kg m^2 for a frequency in rad/s."""
        if self.length > 0.0:
            return bifilar.inertia(
                frequency, self.mass, self.gravity, self.separation, self.length)
        return bifilar.physical_inertia(frequency, self.mass, self.gravity, self.separation)

    def about_axis(self, J: float) -> float:
        """Return the moment about the axis of the swing in kg m^2, which scales its damping."""
        if self.length > 0.0:
            return J  # the wires turn the body about its centre of mass
        return J + self.mass * self.separation * self.separation

    def shares(self, frequency: float) -> dict[str, float]:
        """Return the change of J in % for 1 % of each length and of the mass."""
        names = {'separation': 'D', 'length': 'h', 'mass': 'mass'}
        if not self.length > 0.0:
            del names['length']
        J = self.inertia(frequency)
        return {short: 100.0 * (self._replace(**{name: 1.01 * getattr(self, name)}).inertia(
            frequency) / J - 1.0) for name, short in names.items()}


class Inertia(NamedTuple):
    """Result of a swing; J, K_D and C need the geometry."""

    frequency: Value         # rad/s, of small swings without damping
    quadratic: Value         # 1/rad, K_D over the moment about the axis of the swing
    linear: Value            # 1/s, C over it
    amplitude: float         # rad, largest
    J: Value | None          # kg m^2, about the centre of mass
    K_D: Value | None        # kg m^2
    C: Value | None          # kg m^2/s
    bias: float              # rad/s, of the gyroscope
    fit: regression.Fit


def _start(t: Floats, rate: Floats) -> tuple[float, float]:
    """Return angular frequency and amplitude of the rate, as a first guess."""
    steady = rate - rate.mean()
    grid = np.linspace(t[0], t[-1], len(t))
    even = np.interp(grid, t, steady) * np.hanning(len(t))
    power = np.abs(np.fft.rfft(even, 8 * len(t)))
    frequency = 2.0 * np.pi * np.fft.rfftfreq(8 * len(t), grid[1] - grid[0])[np.argmax(power)]
    return float(frequency), float(np.abs(steady).max())


def _check(t: Floats, rate: Floats) -> tuple[float, float]:
    """Return the initial guess; IdentifyError if the data cannot be a swing."""
    regression.check_columns({'time': t, 'gyro': rate}, 50)
    regression.check_times(t)
    if not np.ptp(rate) > 0.0:
        raise IdentifyError('the gyro is constant: nothing swings')
    if rate.min() >= 0.0 or rate.max() <= 0.0:
        raise IdentifyError(
            f'the gyro never changes its sign, {rate.min():.3g} to {rate.max():.3g}: a swing '
            'turns both ways; is it the length of a rate?')
    frequency, top = _start(t, rate)
    swings = frequency * (t[-1] - t[0]) / (2.0 * np.pi)
    if swings < LEAST_SWINGS:
        raise IdentifyError(
            f'{swings:.1f} swings in {t[-1] - t[0]:.1f} s, at least {LEAST_SWINGS:g} are needed')
    steps = np.diff(t)
    gap = int(np.argmax(steps))
    if steps[gap] > max(PAUSE * 2.0 * np.pi / frequency, USUAL * np.median(steps)):
        raise IdentifyError(
            f'no sample from {t[gap]:.4g} to {t[gap + 1]:.4g} s, where the clock may have jumped: '
            'give --start and --end of a part without such a gap')
    if top / frequency > LARGEST:
        raise IdentifyError(
            f'a rate of {top:.3g} at {frequency:.3g} rad/s would be a swing of '
            f'{top / frequency:.1f} rad: is the gyro in deg/s? then give --unit deg/s')
    _refuse_clipped(t, rate, frequency)
    return frequency, top


def _refuse_clipped(t: Floats, rate: Floats, frequency: float) -> None:
    """
    Raise IdentifyError for a gyro that stands at its limit where the swing is fastest.

    The top of a swing of amplitude A in steps of q lasts ``2 sqrt(2 q / A) / frequency``.
    """
    levels = np.unique(rate)
    step = float(np.diff(levels).min())
    for end in (rate.max(), rate.min()):
        flat = longest_run(rate == end)
        top = 2.0 * np.sqrt(2.0 * step / (0.5 * np.ptp(rate))) / frequency
        if flat.stop - flat.start > FLAT * (top / np.median(np.diff(t)) + 3.0):
            raise IdentifyError(
                f'{flat.stop - flat.start} samples from {t[flat.start]:.4g} s on stand at '
                f'{end:.4g} rad/s: the gyro is at its limit; give --start of a part '
                'with smaller swings')


def fit_swing(t: Floats, rate: Floats, geometry: Geometry | None = None) -> Inertia:
    """
    Fit (4.2) to a gyroscope, least squares (4.3) on the logarithms of frequency and damping.

    Parameters
    ----------
    t : (n,) s
        Rising; nearly even.
    rate : (n,) rad/s
        About the axis of the swing, with any constant bias.
    geometry
        None: frequency and damping only, of a pendulum whose D/h is small.

    Raises
    ------
    IdentifyError
        For data that are no swing, in one line.

    """
    t, rate = np.asarray(t, float), np.asarray(rate, float)
    frequency, top = _check(t, rate)
    ratio = geometry.separation / geometry.length if geometry and geometry.length > 0.0 else 0.0
    if ratio >= 1.0:
        raise IdentifyError('wires further apart than long: D must be below h')
    found, shown = _fit(t, rate, frequency, top, ratio)
    explained = 1.0 - float(np.var(rate - shown) / np.var(rate))
    if explained < EXPLAINED:
        raise IdentifyError(
            f'no swing that decays: (4.2) explains {100.0 * max(explained, 0.0):.0f} % of the '
            'gyro; give --start and --end of the swing, and its --axis')
    for factor, doubt in ((np.pi / 180.0, 'is the gyro in deg/s? then give --unit deg/s'),
                          (180.0 / np.pi, 'is the gyro in rad/s? then give no --unit deg/s')):
        if factor * top / frequency < LARGEST:
            other = _fit(t, factor * rate, frequency, factor * top, ratio)[0]
            if found.rms ** 2 > OTHER_UNIT * (other.rms / factor) ** 2:
                raise IdentifyError(
                    f'a swing of {factor * top / frequency:.2g} rad fits this gyro better than '
                    f'one of {top / frequency:.2g} rad, which it would be: {doubt}')
    regression.refuse_bound(found, *_ends(frequency, top), NAMES, NAMES[1:3])
    return _result(found, rate, geometry, shown)


def _fit(
    t: Floats, rate: Floats, frequency: float, top: float, ratio: float,
) -> tuple[regression.Fit, Floats]:
    """
    Return the fit of (4.2) to rates (n,) rad/s, and the rates that it shows, (n,) rad/s.

    ``frequency`` [rad/s] and ``top`` [rad/s] are first guesses, ``ratio`` is D/h.
    """
    def model(theta: Floats) -> Floats:
        """Return a rate, (n, 1) rad/s; theta: logarithms, angle and rate at the start."""
        w, quadratic, linear = np.exp(theta[:3]).tolist()
        swing = bifilar.Swing(w, quadratic, linear, ratio)
        return bifilar.swing(t, float(theta[3]), float(theta[4]), swing)[:, None]
    first = float(rate[0] - rate.mean())
    angle = np.sqrt(max(top * top - first * first, 0.0)) / frequency
    rising = np.mean(np.diff(rate[:max(3, len(t) // 200)])) > 0.0
    found = regression.fit(
        model, rate[:, None],
        [np.log(frequency), np.log(0.02), np.log(0.02 * frequency), -angle if rising else angle,
         first], *_ends(frequency, top), NAMES, np.ones((len(t), 1)))
    return found, model(found.theta)[:, 0]


def _ends(frequency: float, top: float) -> tuple[list[float], list[float]]:
    """Return the least and the largest parameters of a fit, for its first guesses."""
    w, low, high = np.log(frequency), np.log(1e-6), np.log(1e2)
    return ([w - 0.5, low, low, -LARGEST, -2.0 * top], [w + 0.5, high, high, LARGEST, 2.0 * top])


def _result(
    found: regression.Fit, rate: Floats, geometry: Geometry | None, model: Floats,
) -> Inertia:
    frequency = found.positive(0, 'rad/s')
    J = K_D = C = None
    if geometry:
        J = _inertia(frequency, geometry)
        if not J.value > 0.0:
            raise IdentifyError(
                f'J = {J.value:.3g} kg m^2: the geometry does not fit {frequency.value:.4g} rad/s')
        K_D, C = (_times(found, i, J, geometry, unit)
                  for i, unit in ((1, 'kg m^2'), (2, 'kg m^2/s')))
    bias = float(np.mean(rate - found.residual[:, 0] - model))
    top = float(np.abs(model).max()) / frequency.value
    return Inertia(
        frequency, found.positive(1, '1/rad'), found.positive(2, '1/s'), top, J, K_D, C, bias,
        found)


def _inertia(frequency: Value, g: Geometry) -> Value:
    """Return J with the errors of frequency and geometry, which are independent."""
    J, squares = g.inertia(frequency.value), 0.0
    for changed, share in (
            (g._replace(mass=g.mass + g.mass_error), 1.96),
            (g._replace(separation=g.separation + g.separation_error), 1.96),
            (g._replace(length=g.length + g.length_error), 1.96)):
        squares += (share * (changed.inertia(frequency.value) - J)) ** 2
    squares += (g.inertia(frequency.value + frequency.half) - J) ** 2
    half = float(np.sqrt(squares))
    return Value(J, J - half, J + half, 'kg m^2')


def _times(found: regression.Fit, i: int, J: Value, g: Geometry, unit: str) -> Value:
    """Return a damping that was fitted as its logarithm times the moment that it slows down."""
    moment, damping = g.about_axis(J.value), found.positive(i, unit)
    value, low, high = (moment * x for x in damping[:3])
    rig = value * J.half / moment  # of frequency and geometry, independent of the damping
    return Value(value, max(value - float(np.hypot(value - low, rig)), 0.0),
                 value + float(np.hypot(high - value, rig)), unit)


def _draw(t: Floats, rate: Floats, found: Inertia) -> Callable[[Figure], None]:
    def draw(figure: Figure) -> None:
        """Draw the gyro with (4.2), and the residual."""
        above, below = figure.subplots(2, 1, sharex=True)
        above.plot(t, rate, '.', ms=2, color=palette.COLOURS[palette.MEASURED], label='gyro')
        above.plot(t, rate - found.fit.residual[:, 0], label='(4.2)',
                   color=palette.COLOURS[palette.SERIES[0]], lw=1)
        above.set_ylabel('rate [rad/s]')
        above.legend(loc='upper right')
        below.plot(t, found.fit.residual[:, 0], '.', ms=2, color=palette.INK)
        below.set_ylabel('residual [rad/s]')
        below.set_xlabel('time [s]')
    return draw


def _report(
    options: argparse.Namespace, t: Floats, rate: Floats, found: Inertia,
    geometry: Geometry | None,
) -> result.Report:
    moment = 'J' if options.rig == 'bifilar' else 'J_axis'
    values = {'omega_0': found.frequency, f'K_D/{moment}': found.quadratic,
              f'C/{moment}': found.linear}
    facts = {
        'largest swing [rad]': found.amplitude, 'gyro bias [rad/s]': found.bias,
        'rms residual [rad/s]': found.fit.rms, 'samples': len(t),
        'order of the residual': found.fit.order[0]}
    changed: dict = {}
    base: Base | None = None
    notes = []
    if found.fit.rms > COHERENT * float(np.std(rate)) and found.fit.order[0]:
        notes.append('what is left swings too: (4.2) is not all that acts on this rig')
    name = f'J_{options.axis}{options.axis}'
    if found.J is None or geometry is None:
        notes.append('without the geometry of the rig there is no moment of inertia')
        if options.rig == 'physical' and options.mass:
            length = options.gravity / found.frequency.value ** 2
            facts['J at most [kg m^2]'] = 0.25 * options.mass * length ** 2
            notes.append('whatever the distance of the axis, J is at most m (g/omega_0^2)^2/4')
    else:
        values = {name: found.J, 'K_D': found.K_D, 'C': found.C, **values}
        bag = result.is_bag(options.file)
        base = (of_bag(options.base, options.file, options.namespace) if bag
                else choose(options.base, None)._replace(notes=()))
        moments = list(base.vehicle.inertia)
        moments[AXES.index(options.axis)] = found.J.value
        source = (f'{name} by {options.rig} pendulum, {options.file.name}, 95 %: '
                  f'{found.J.low:.4g} to {found.J.high:.4g}; others as {base.name}')
        changed = {'inertia': (tuple(moments), source)}
        notes += _unlike(options, found.J.value, base)
        if not (options.separation_error or options.length_error or options.mass_error):
            shares = geometry.shares(found.frequency.value)
            notes.append(
                'the interval holds no error of the geometry: '
                + ', '.join(f'1 % of {name} is {abs(share):.2g} % of J'
                            for name, share in shares.items())
                + f' (--separation-error, {"--length-error, " if "h" in shares else ""}'
                '--mass-error)')
    report = result.Report(
        f'swing about body {options.axis} of {options.file.name}', values, facts, notes, changed,
        _draw(t, rate, found))
    return report if base is None else based(report, base)


def _unlike(options: argparse.Namespace, J: float, base: Base) -> list[str]:
    """Return a note if size or mass are not those of a vehicle like the base."""
    vehicle = base.vehicle
    own = float(np.sqrt(vehicle.inertia[AXES.index(options.axis)] / vehicle.mass))
    radius, mass = float(np.sqrt(J / options.mass)), options.mass / vehicle.mass
    if not 1.0 / LIKE < radius / own < LIKE:
        return [f'the radius of gyration is {1e3 * radius:.3g} mm, {radius / own:.3g} times that '
                f'of {base.name}: check --separation, --length and --base']
    if not 1.0 / HEAVY < mass < HEAVY:
        return [f'the mass is {mass:.3g} times that of {base.name}: check --mass and --base']
    return []


def _data(options: argparse.Namespace) -> tuple[Floats, Floats]:
    """Return times s and rates rad/s selected by the options."""
    path, factor = options.file, np.pi / 180.0 if options.unit == 'deg/s' else 1.0
    if result.is_bag(path):
        imu = result.open_bag(path, ('imu/data_raw',), options.namespace)['imu/data_raw']
        t, rate = imu.t - imu.t[0], imu.angular_velocity[:, AXES.index(options.axis)]
    else:
        table = columns.read(path)
        own, rate = columns.column(table, options.column or f'gyro.{options.axis}', path)
        t = columns.times(own, table, options.time, options.rate, len(rate), path)
    regression.check_columns({'time': t, 'gyro': rate}, 1)
    kept = (t >= options.start) & (t <= options.end)
    return t[kept], factor * rate[kept]


def _geometry(options: argparse.Namespace) -> Geometry | None:
    """Return the rig given on the command line; None if it is not given."""
    if options.separation is None:
        return None
    length = options.length or 0.0
    if options.rig == 'bifilar' and not length > 0.0:
        raise IdentifyError('a bifilar pendulum needs --length, of its wires in m')
    if options.mass is None:
        raise IdentifyError('the moment of inertia needs --mass in kg')
    for name in ('separation', 'mass'):
        if not getattr(options, name) > 0.0:
            raise IdentifyError(f'--{name} must be above 0')
    return Geometry(
        options.mass, options.separation, length if options.rig == 'bifilar' else 0.0,
        options.gravity, options.mass_error, options.separation_error, options.length_error)


def _refuse_unused(options: argparse.Namespace, command: Parser) -> None:
    """Refuse options of another source or rig; InputError."""
    if result.is_bag(options.file):
        refuse_unused(command, options, ('column', 'time', 'rate', 'unit'),
                      f'{options.file} is a bag, whose topics have times and rad/s')
    else:
        refuse_unused(command, options, ('namespace',), f'{options.file} is no bag')
    if options.rig == 'physical':
        refuse_unused(command, options, ('length', 'length_error'),
                      'a physical pendulum has no wires')
    if options.separation is None:
        rest = ('length', 'separation_error', 'length_error', 'mass_error', 'base')
        known = options.rig == 'physical' and options.mass  # gives the largest J
        refuse_unused(command, options, rest if known else (*rest, 'mass', 'gravity'),
                      'there is no moment of inertia without --separation')


def parser() -> Parser:
    """Return the command line."""
    out = result.parser(
        'identify_inertia', 'Moment of inertia from the gyro of a pendulum, (4.2)-(4.3).')
    out.add_argument('file', type=Path, help='bag with imu/data_raw, or .csv, .mat, .json')
    out.add_argument('--axis', choices=AXES, default='z', help='of the body, that is vertical')
    out.add_argument('--column', help='with the rate; default: gyro.AXIS')
    out.add_argument('--time', default='t', help='column with the time in s')
    out.add_argument('--rate', type=real(0.0, 1e6, 'Hz'), default=0.0,
                     help='Hz, if there are no times')
    out.add_argument('--unit', choices=('rad/s', 'deg/s'), default='rad/s')
    out.add_argument('--start', type=TIME, default=0.0, help='s, drop what is before')
    out.add_argument('--end', type=TIME, default=np.inf, help='s, drop what is after')
    out.add_argument('--rig', choices=('bifilar', 'physical'), default='bifilar',
                     help='two wires, or a horizontal axis beside the body')
    out.add_argument('--separation', type=real(0.0, 100.0, 'm', above=True), metavar='D',
                     help='m between the wires; physical: from the axis to the centre of mass')
    out.add_argument('--length', type=real(0.0, 100.0, 'm', above=True), metavar='H',
                     help='m, of the wires')
    out.add_argument('--mass', type=real(0.0, 1000.0, 'kg', above=True), help='kg')
    out.add_argument('--gravity', type=real(0.0, 100.0, 'm/s^2', above=True), default=9.81,
                     help='m/s^2')
    for name, unit in (('separation', 'm'), ('length', 'm'), ('mass', 'kg')):
        out.add_argument(f'--{name}-error', type=real(0.0, 100.0, unit), default=0.0,
                         help=f'{unit}, standard deviation')
    out.add_argument('--namespace', help='of the drone, if a bag has several')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``identify_inertia``; return the exit code."""
    command = parser()
    options = command.parse_args(arguments)

    def work() -> result.Report:
        _refuse_unused(options, command)
        geometry = _geometry(options)
        t, rate = _data(options)
        return _report(options, t, rate, fit_swing(t, rate, geometry), geometry)
    return result.run('identify_inertia', options, work)


if __name__ == '__main__':
    raise SystemExit(main())
