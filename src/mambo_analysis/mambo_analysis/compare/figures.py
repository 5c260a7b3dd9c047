"""
Plots of a flight as data, and a sheet of them drawn with matplotlib.

:func:`plots` says what a bag can show; :mod:`.report` draws the same plots in a page. A signal
has one colour everywhere, see :mod:`mambo_model.palette`. Captions name the signals.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple, TYPE_CHECKING

from mambo_bags.reader import Bag
from mambo_model import palette
from mambo_model.palette import COLOURS, INK, LINE
from mambo_signals import metrics
from mambo_signals.flight_phases import Phases, phases
from mambo_signals.metrics import Floats
from mambo_signals.motion import position_errors, TRUTH
from mambo_signals.spectrum import amplitude_density
import numpy as np
from numpy.typing import NDArray

from .events import number, parameters

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

POINTS = 1000  # largest number of points of a line
AIR = 1.2 * 9.81  # [Pa/m], converts pressure to height
TIME = 'time [s]'
LEAST_NIS = 1e-3  # smaller values are drawn here: the axis is logarithmic
CHI_SQUARE = {1: 3.841, 2: 5.991}  # 95 % quantile by degrees of freedom
STYLE = {
    'font.size': 10.0, 'font.family': 'DejaVu Sans', 'axes.edgecolor': INK, 'axes.labelcolor': INK,
    'text.color': INK, 'xtick.color': INK, 'ytick.color': INK, 'axes.grid': True,
    'grid.color': LINE, 'grid.linewidth': 0.6, 'axes.spines.top': False,
    'axes.spines.right': False, 'lines.linewidth': 1.3, 'legend.frameon': False,
    'legend.fontsize': 9.0, 'axes.titlesize': 10.5, 'axes.titleweight': 'bold',
    'axes.titlelocation': 'left', 'axes.axisbelow': True}
TRACKS = (
    ('reference', 'reference', 'reference'), ('ground_truth/odom', 'truth', 'ground truth'),
    ('optitrack/pose', 'optitrack', 'Optitrack'), ('estimate/odom', 'estimate', 'estimate'),
    ('onboard/odom', 'onboard', 'onboard estimate'))
"""Topics with a position: topic, colour, label, in the order of drawing."""
MOTORS = ((0, 'front left'), (1, 'front right'), (3, 'rear left'), (2, 'rear right'))
"""Number and place of the motors, row by row as seen from above."""
AXES = (('x', 'estimate'), ('y', 'sonar'), ('z', 'onboard'))
"""Axes of a sensor and their colours, those of the body axes in the replay."""


class Line(NamedTuple):
    """A curve, dots, crosses, or a band between ``low`` and ``y``."""

    name: str
    x: Floats  # (n,)
    y: Floats  # (n,) NaN: a gap
    role: str  # of the palette
    kind: str = 'line'
    low: Floats | None = None
    dash: str = ''  # as matplotlib has it; empty: that of the role
    width: float = 0.0  # points; 0: that of the role

    def style(self) -> tuple[str, float, int]:
        """Return dashes, width and drawing order."""
        dash, width, order = palette.LINES.get(self.role, ('-', 1.2, 3))
        return self.dash or dash, self.width or width, order

    def thinned(self, points: int = POINTS) -> Line:
        """Return the line with at most about that many points; the peaks of a curve stay."""
        if self.kind == 'line':
            x, y = metrics.envelope(self.x, self.y, points)
            return self._replace(x=x, y=y)
        keep = np.flatnonzero(np.isfinite(self.y))
        keep = keep[::max(1, -(-len(keep) // points))]
        return self._replace(x=self.x[keep], y=self.y[keep],
                             low=None if self.low is None else self.low[keep])


class Panel(NamedTuple):
    """Lines in common axes."""

    label: str  # quantity and unit of the vertical axis
    lines: list[Line]
    title: str = ''
    limits: tuple[float, float] | None = None


class Plot(NamedTuple):
    """A figure: panels below each other with a common horizontal axis, and its text."""

    name: str
    title: str
    text: str  # what it shows
    panels: list[Panel]
    row: float = 1.7  # inches, height of a panel
    columns: int = 1  # of panels on a sheet
    across: str = TIME
    log: str = ''  # logarithmic axes: x, y, xy
    shade: Sequence[tuple[float, float]] = ()  # s
    bag: str = ''  # A or B on a page of two, if it shows one of them

    def of(self, label: str, offset: float) -> Plot:
        """Return the plot of a named bag, on a clock that is ahead by an offset [s]."""
        if self.across != TIME:
            offset = 0.0
        return self._replace(
            name=f'{label}-{self.name}', title=f'{label}: {self.title}', bag=label,
            shade=[(a + offset, b + offset) for a, b in self.shade],
            panels=[panel._replace(lines=[line._replace(x=line.x + offset)
                                          for line in panel.lines]) for panel in self.panels])


def tracks(bag: Bag) -> list[tuple[str, str, str]]:
    """Return the rows of ``TRACKS`` for which a bag has positions."""
    return [row for row in TRACKS if row[0] in bag
            and np.isfinite(bag[row[0]].position).all(axis=1).any()]


def _valid_ranges(bag: Bag) -> NDArray[np.bool_]:
    """Return a mask of the sonar ranges inside the limits of the sensor, (n,)."""
    sonar = bag['sonar/range']
    return (sonar.range >= sonar.min_range) & (sonar.range <= sonar.max_range)


def listed(names: Sequence[str]) -> str:
    """Return names as a list in a sentence: a, b and c."""
    return ' and '.join([', '.join(names[:-1]), names[-1]] if len(names) > 1 else names)


def shaded(parts: Phases) -> str:
    """Return a sentence about the shaded parts of a flight, or nothing."""
    names = [name for name, at in (('take-off', parts.takeoff_end),
                                   ('landing', parts.landing_start)) if at is not None]
    if not names:
        return ''
    return f' {listed(names).capitalize()} {"are" if len(names) > 1 else "is"} shaded.'


def shade(parts: Phases, begin: int, end: int) -> list[tuple[float, float]]:
    """Return the spans [s] of take-off and landing in a flight, to be shaded."""
    spans = [(begin, parts.takeoff_end), (parts.landing_start, end)]
    return [(a * 1e-9, b * 1e-9) for a, b in spans if a is not None and b is not None]


def _positions(bag: Bag) -> Plot | None:
    found = tracks(bag)
    panels = [Panel(f'{name} [m]', [
        Line(label, bag[topic].t, bag[topic].position[:, axis], role)
        for topic, role, label in found]) for axis, name in enumerate(('x', 'y', 'z up'))]
    names = listed([label for _, _, label in found]) if found else ''
    return Plot('position', 'Position',
                f'Position of {names} over time on the axes x, y and z, which is up.'
                f'{shaded(phases(bag))}', panels) if found else None


def _errors(bag: Bag) -> Plot | None:
    found = []
    for signal, truths, text in (
            ('reference', TRUTH, 'tracking: {} minus reference'),
            ('estimate/odom', TRUTH[::-1], 'estimation: estimate minus {}')):
        truth = next((name for name in truths if name in bag), None)
        if truth and signal in bag:
            stamps, e = position_errors(bag[signal], bag[truth])
            found.append(Line(text.format(_name(truth)), stamps * 1e-9, np.linalg.norm(e, axis=1),
                              signal.partition('/')[0]))
    return Plot('errors', 'Position errors', 'Length of the position error over time: '
                f'{listed([line.name for line in found])}.', [Panel('error [m]', found)],
                2.3) if found else None


def _name(topic: str) -> str:
    return next(label for name, _, label in TRACKS if name == topic)


def _path(bag: Bag) -> Plot | None:
    found = tracks(bag)
    panels = [Panel(label, [
        Line(name, *bag[topic].position[:, (0, up)].T, role) for topic, role, name in found],
        title) for up, label, title in (
            (1, 'y [m]', 'from above'), (2, 'z up [m]', 'from the side'))]
    names = listed([label for _, _, label in found]) if found else ''
    return Plot('path', 'Path', f'The path of {names}, seen from above and from the side, to '
                'scale.', panels, 3.1, 2, 'x [m]') if found else None


def _motors(bag: Bag) -> Plot | None:
    if 'motor_pwm' not in bag:
        return None
    motors = bag['motor_pwm']
    pwm = np.where(np.isfinite(motors.pwm), motors.pwm, np.nan)  # of refused commands as well
    shown = pwm[np.isfinite(pwm)]
    low, high = (float(shown.min()), float(shown.max())) if shown.size else (0.0, 1.0)
    margin = max(0.05 * (high - low), 1.0)
    panels = [Panel('PWM [-]', [Line(f'{k} {place}', motors.t, pwm[:, k], 'ink', width=0.8)],
                    f'{k} {place}', (low - margin, high + margin)) for k, place in MOTORS]
    return Plot('motors', 'Motor commands', 'PWM commands of the four motors over time: 0 front '
                'left, 1 front right, 2 rear right, 3 rear left.', panels, 1.55, 2)


def _height(bag: Bag) -> Plot | None:
    lines, out = [], ''
    if 'sonar/range' in bag:
        valid, sonar = _valid_ranges(bag), bag['sonar/range']
        if valid.any():
            lines.append(Line('sonar, slant', sonar.t[valid], sonar.range[valid], 'sonar', 'dots'))
        if not valid.all():
            out = (f' {int((~valid).sum())} of {len(valid)} sonar samples are outside of its '
                   'limits and left out.')
    found = tracks(bag)
    if not found and not lines:
        return None
    if 'barometer/pressure' in bag:
        pressure = bag['barometer/pressure']
        ground = np.median(pressure.pressure[pressure.t <= pressure.t[0] + 0.5])
        lines.append(Line('barometer', pressure.t, (ground - pressure.pressure) / AIR,
                          'barometer', 'dots'))
    lines += [Line(label, bag[topic].t, bag[topic].position[:, 2], role)
              for topic, role, label in found]
    names = listed([line.name.partition(',')[0] for line in lines])
    return Plot('height', 'Height', f'Height over time by {names}.{out}',
                [Panel('height [m]', lines)], 2.8)


def _flow(bag: Bag) -> Plot | None:
    if 'optical_flow' not in bag:
        return None
    flow = bag['optical_flow']
    return Plot('flow', 'Optical flow', 'Optical flow forward and left over time.', [
        Panel(f'{name} [rad/s]', [Line('optical flow', flow.t, values, 'flow', dash='-',
                                       width=0.9)])
        for name, values in (('forward', flow.rate_x), ('left', flow.rate_y))], 1.6)


class _Innovation(NamedTuple):
    """Innovation of a sensor on one axis."""

    role: str
    label: str
    name: str  # of the sensor
    values: Floats  # (n,)
    ratio: Floats  # (n,) squared over the gate, 1 at the gate
    sigma: Floats  # (n,) its standard deviation; NaN: unknown
    nis: Floats  # (n,) normalised innovation squared
    degrees: int  # of freedom of ``nis``


def _innovations(bag: Bag) -> list[_Innovation]:
    """
    Return the innovations of each sensor that was used.

    The filter records the innovation and the test ratio, its normalised square over the squared
    gate; with the gate of the scenario they give the standard deviation, of two axes that along
    the innovation. The support package's estimator has no variance.
    """
    if 'estimator/state' not in bag:
        return []
    state, values, out = bag['estimator/state'], parameters(bag.scenario or {}), []
    estimator = values.get('estimator_node.estimator')
    for role, name, parts, innovation, ratio in (
            ('sonar', 'sonar', ('sonar [m]',), state.sonar_innovation, state.sonar_test_ratio),
            ('flow', 'optical flow', ('flow x [m/s]', 'flow y [m/s]'), state.flow_innovation,
             state.flow_test_ratio),
            ('barometer', 'barometer', ('barom. [m]',), state.barometer_innovation,
             state.barometer_test_ratio)):
        rows = innovation.reshape(len(ratio), -1)
        gate = number(values, f'estimator_node.{estimator}.{name.replace(" ", "_")}.gate')
        nis = np.where(ratio > 0.0, ratio, np.nan) * gate * gate
        sigma = np.linalg.norm(rows, axis=1) / np.sqrt(nis)
        out += [_Innovation(role, label, name, rows[:, k], ratio, sigma, nis, len(parts))
                for k, label in enumerate(parts) if np.isfinite(rows[:, k]).any()]
    return out


def _innovation_plot(bag: Bag) -> Plot | None:
    rows, panels = _innovations(bag), []
    if not rows:
        return None
    t = bag['estimator/state'].t
    for row in rows:
        refused = np.isfinite(row.values) & (row.ratio > 1.0)
        taken = np.isfinite(row.values) & ~refused
        band = 3.0 * np.where(taken, row.sigma, np.nan)
        lines = [Line('3 standard deviations', t, band, row.role, 'band', -band)] \
            if np.isfinite(band).any() else []
        panels.append(Panel(row.label, [
            *lines, Line('innovation', t[taken], row.values[taken], row.role, 'dots'),
            *([Line('refused', t[refused], row.values[refused], 'ink', 'crosses')]
              if refused.any() else [])],
            f'{int(refused.sum())} of {int((taken | refused).sum())} refused'))
    names = listed(list(dict.fromkeys(row.name for row in rows)))
    refused = any(line.kind == 'crosses' for panel in panels for line in panel.lines)
    return Plot(
        'innovations', 'Innovations of the estimator',
        f'Measurement minus prediction of {names} over time'
        + (', and three standard deviations by the filter.' if any(
            line.kind == 'band' for panel in panels for line in panel.lines) else '.')
        + (' Refused samples are crosses.' if refused else ' No sample was refused.'), panels,
        1.25)


def _nis(bag: Bag) -> Plot | None:
    panels = []
    for row in {row.name: row for row in _innovations(bag)}.values():
        known = np.isfinite(row.nis)
        if not known.any():
            continue
        t, nis = bag['estimator/state'].t[known], row.nis[known]
        bound = CHI_SQUARE[row.degrees]
        panels.append(Panel(f'{row.role} [-]', [
            Line('95 % bound', t[[0, -1]], np.full(2, bound), 'ink', dash='--'),
            Line('NIS', t, np.maximum(nis, LEAST_NIS), row.role, 'dots')],
            f'{100.0 * np.mean(nis <= bound):.1f} % below, mean {nis.mean():.2f} of '
            f'{row.degrees}'))
    return Plot('nis', 'Normalised innovations squared', 'NIS of each sensor over time, and the '
                'bound below which 95 % lie if the filter knows its error. A lower share: it is '
                'too sure of itself; a higher one: too unsure.', panels, 1.25,
                log='y') if panels else None


def _covariance(bag: Bag) -> Plot | None:
    truth = next((name for name in TRUTH if name in bag), None)
    if truth is None or 'estimate/odom' not in bag or not np.any(
            bag['estimate/odom'].pose_covariance):
        return None
    stamps, e = position_errors(bag['estimate/odom'], bag[truth])
    variance = bag['estimate/odom'].pose_covariance[:, [0, 7, 14]]
    sigma = np.sqrt(np.where(variance >= 0.0, variance, np.nan))
    t, panels = stamps * 1e-9, []
    for axis, name in enumerate(('x', 'y', 'z up')):
        known = (e[np.isfinite(e[:, axis]), axis], sigma[np.isfinite(sigma[:, axis]), axis])
        limit = 1.2 * max(np.abs(known[0]).max(), 3.0 * np.quantile(known[1], 0.9), 1e-6) \
            if all(map(len, known)) else None  # a short, wide band must not hide the rest
        panels.append(Panel(f'{name} [m]', [
            Line('three standard deviations', t, 3.0 * sigma[:, axis], 'estimate', 'band',
                 -3.0 * sigma[:, axis]),
            Line(f'estimate minus {_name(truth)}', t, e[:, axis], 'estimate', width=1.0)],
            limits=None if limit is None else (-limit, limit)))
    return Plot('covariance', 'Does the filter know its error?',
                'Position error of the estimate on each axis, z up, and the band of three '
                'standard deviations that the filter gives.', panels)


def _spectra(bag: Bag) -> list[Plot]:
    """Return the spectra of the inertial sensors, and of the motor commands."""
    out, across = [], 'frequency [Hz]'
    if 'imu/data_raw' in bag:
        imu, panels = bag['imu/data_raw'], []
        for label, values in (('gyro [rad/s/√Hz]', imu.angular_velocity),
                              ('accel. [m/s²/√Hz]', imu.acceleration)):
            found = amplitude_density(imu.stamp, values)
            if found is not None and (found[1] > 0.0).any():
                panels.append(Panel(label, [
                    Line(name, found[0], _positive(found[1][:, k]), role, dash='-', width=1.2)
                    for k, (name, role) in enumerate(AXES)]))
        out.append(Plot(
            'imu-spectrum', 'Spectrum of the IMU', 'Amplitude spectral density of the gyro and of '
            'the accelerometer on the body axes x forward, y left and z up.', panels, 1.9, 1,
            across, 'xy'))
    if 'motor_pwm' in bag:
        motors = bag['motor_pwm']
        found = amplitude_density(motors.stamp, motors.pwm)
        out.append(Plot(
            'motor-spectrum', 'Spectrum of the motor commands', 'Amplitude spectral density of '
            'the four PWM commands.', [] if found is None else [Panel('PWM [1/√Hz]', [
                Line(f'{k} {place}', found[0], _positive(found[1][:, k]), role, dash='-',
                     width=1.2) for (k, place), role in zip(sorted(MOTORS), palette.SERIES)])],
            2.6, 1, across, 'xy'))
    return [plot for plot in out if plot.panels]


def _positive(values: Floats) -> Floats:
    """Return values for a logarithmic axis, NaN for 0."""
    return np.where(values > 0.0, values, np.nan)


def plots(bag: Bag) -> list[Plot]:
    """Return the figures that can be drawn from the bag, in the order of a page."""
    every = (_positions(bag), _errors(bag), _path(bag), _motors(bag), _height(bag), _flow(bag),
             _innovation_plot(bag), _nis(bag), _covariance(bag), *_spectra(bag))
    spans = shade(phases(bag), bag.start, bag.end)
    return [plot._replace(shade=spans) if plot.across == TIME else plot
            for plot in every if plot is not None]


def _draw(ax: Axes, line: Line, label: str | None) -> None:
    """Draw a line into axes of matplotlib."""
    line, (dash, width, order) = line.thinned(), line.style()
    colour = COLOURS[line.role]
    if line.low is not None:
        ax.fill_between(line.x, line.low, line.y, color=colour, alpha=0.18, lw=0, label=label)
    elif line.kind == 'line':
        ax.plot(line.x, line.y, color=colour, ls=dash, lw=width, zorder=order, label=label)
    else:
        marker, size = ('.', 2.5) if line.kind == 'dots' else ('x', 4.0)
        ax.plot(line.x, line.y, ls='none', marker=marker, ms=size, color=colour, label=label)


def _paint(figure: Figure, plot: Plot, bag: Bag) -> None:
    """Draw a plot into a part of a sheet, its legend in a row of its own."""
    named = dict.fromkeys(line.name for panel in plot.panels for line in panel.lines)
    with_legend = plot.name != 'motors'
    rows = -(-len(plot.panels) // plot.columns)
    grid = figure.add_gridspec(rows + with_legend, plot.columns,
                               height_ratios=[plot.row] * rows + [0.02] * with_legend)
    axes: list[Axes] = []
    for k, panel in enumerate(plot.panels):
        ax = figure.add_subplot(grid[k // plot.columns, k % plot.columns],
                                sharex=axes[0] if axes and plot.columns == 1 else None)
        for line in panel.lines:
            _draw(ax, line, line.name)
        ax.set_ylabel(panel.label)
        ax.set_title(panel.title, loc='right', weight='normal', size=9.0)
        for name in plot.log:
            ax.set(**{f'{name}scale': 'log'})
        if plot.across == TIME:
            for a, b in plot.shade:
                ax.axvspan(a, b, color=LINE, alpha=0.35, lw=0, zorder=0)
            ax.set_xlim(bag.start * 1e-9, max(bag.end * 1e-9, bag.start * 1e-9 + 1e-3))
        if plot.name == 'path':
            ax.set_aspect('equal', adjustable='datalim')
        if panel.limits is not None:
            ax.set_ylim(*panel.limits)
        if k >= len(plot.panels) - plot.columns:
            ax.set_xlabel(plot.across)
        elif plot.columns == 1:
            ax.tick_params(labelbottom=False)
        axes.append(ax)
    if with_legend:
        found = {label: handle for ax in axes
                 for handle, label in zip(*ax.get_legend_handles_labels())}
        below = figure.add_subplot(grid[rows, :])
        below.axis('off')
        below.legend([found[name] for name in named], list(named), loc='upper center',
                     ncol=min(len(named), 5 if len(' '.join(named)) < 60 else 2),
                     borderaxespad=0.0, handlelength=1.4, columnspacing=1.2)


def overview(bag: Bag, title: str) -> Figure:
    """Return all plots of a flight on one white sheet, two columns."""
    import matplotlib
    from matplotlib.figure import Figure
    columns: list[list[Plot]] = [[], []]

    def height(column: list[Plot]) -> float:
        return sum(-(-len(plot.panels) // plot.columns) * plot.row + 0.65 for plot in column)
    for plot in plots(bag):
        min(columns, key=height).append(plot)
    columns = [column for column in columns if column]
    with matplotlib.rc_context(STYLE):
        sheet = Figure(figsize=(6.8 * max(len(columns), 1),
                                max(map(height, columns), default=1.0) + 0.4),
                       layout='constrained', facecolor=palette.PAPER)
        sheet.suptitle(palette.in_figure(title), x=0.01, ha='left', weight='bold')
        halves = np.atleast_1d(sheet.subfigures(1, len(columns))) if columns else []
        for half, column in zip(halves, columns):
            pieces = np.atleast_1d(half.subfigures(
                len(column), 1, height_ratios=[height([plot]) for plot in column]))
            for piece, plot in zip(pieces, column):
                piece.suptitle(plot.title, x=0.02, ha='left', size=10.5, weight='bold')
                _paint(piece, plot, bag)
    return sheet


def write_overview(bag: Bag, path: Path, title: str) -> None:
    """Write all plots of a flight on one white sheet, two columns, as PNG."""
    import matplotlib

    from . import digest
    with matplotlib.rc_context(STYLE):
        digest.save(overview(bag, title), path, dpi=110)
