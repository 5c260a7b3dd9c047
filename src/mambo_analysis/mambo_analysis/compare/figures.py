"""
Plots of a flight, one function per figure; each draws the signals that the bag has.

A signal has one colour everywhere, see :mod:`mambo_model.palette`. Captions name the signals.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from mambo_bags.reader import Bag
from mambo_model import palette
from mambo_model.palette import COLOURS, INK, LINE
from mambo_signals import metrics
from mambo_signals.flight_phases import Phases, phases
from mambo_signals.metrics import Floats
from mambo_signals.motion import position_errors
import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np
from numpy.typing import NDArray

from . import digest

POINTS = 1000  # largest number of points of a line
AIR = 1.2 * 9.81  # [Pa/m], converts pressure to height
STYLE = {
    'font.size': 10.0, 'font.family': 'DejaVu Sans', 'axes.edgecolor': INK, 'axes.labelcolor': INK,
    'text.color': INK, 'xtick.color': INK, 'ytick.color': INK, 'axes.grid': True,
    'grid.color': LINE, 'grid.linewidth': 0.6, 'axes.spines.top': False,
    'axes.spines.right': False, 'lines.linewidth': 1.3, 'legend.frameon': False,
    'legend.fontsize': 9.0, 'axes.titlesize': 10.5, 'axes.titleweight': 'bold',
    'axes.titlelocation': 'left', 'axes.axisbelow': True, 'svg.fonttype': 'path',
    'svg.hashsalt': 'mambo'}
TRACKS = (
    ('reference', 'reference', 'reference'), ('ground_truth/odom', 'truth', 'ground truth'),
    ('optitrack/pose', 'optitrack', 'Optitrack'), ('estimate/odom', 'estimate', 'estimate'),
    ('onboard/odom', 'onboard', 'onboard estimate'))
"""Topics with a position: topic, colour, label, in the order of drawing."""


class Plot(NamedTuple):
    """A figure: how to draw it, its text and its layout."""

    name: str
    title: str
    text: str  # what it shows
    shape: tuple[int, int]  # rows and columns of axes
    height: float  # inches
    legend: int  # columns of the legend below all axes, 0: none
    draw: Callable[[list[Axes], Bag, Phases], None]


def _thin(*columns: Floats) -> tuple[Floats, ...]:
    """Return columns of equal length, thinned to at most ``POINTS`` evenly spaced rows."""
    step = max(1, -(-len(columns[0]) // POINTS))
    return tuple(column[::step] for column in columns)


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


def _line(
    ax: Axes, t: Floats, values: Floats, role: str, label: str | None, **style: Any,
) -> None:
    """Draw a signal over time in the style of its role, with overrides."""
    ax.plot(*metrics.envelope(t, values, POINTS), label=label, **{**palette.line(role), **style})


def _mark(axes: list[Axes], parts: Phases) -> None:
    """Shade the take-off, and the landing."""
    for ax in axes:
        low, high = ax.get_xlim()
        if parts.takeoff_end is not None:
            ax.axvspan(low, parts.takeoff_end * 1e-9, color=LINE, alpha=0.35, lw=0, zorder=0)
        if parts.landing_start is not None:
            ax.axvspan(parts.landing_start * 1e-9, high, color=LINE, alpha=0.35, lw=0, zorder=0)
        ax.set_xlim(low, high)
    axes[-1].set_xlabel('time [s]')


def _span(bag: Bag, axes: list[Axes]) -> None:
    for ax in axes:
        ax.set_xlim(bag.start * 1e-9, max(bag.end * 1e-9, bag.start * 1e-9 + 1e-3))


def draw_position(axes: list[Axes], bag: Bag, parts: Phases) -> None:
    """Position by axis, z up."""
    for topic, role, label in tracks(bag):
        t, p = bag[topic].t, bag[topic].position
        for axis, ax in enumerate(axes):
            _line(ax, t, p[:, axis], role, label)
    for ax, name in zip(axes, ('x', 'y', 'z up')):
        ax.set_ylabel(f'{name} [m]')
    _span(bag, axes)
    _mark(axes, parts)


def _errors(bag: Bag) -> list[tuple[str, str, Floats, Floats]]:
    """Return (role, label, t, errors (n, 3)) of every position that can be compared."""
    found = []
    truth = next((name for name in ('ground_truth/odom', 'optitrack/pose') if name in bag), None)
    if truth and 'reference' in bag:
        stamps, e = position_errors(bag['reference'], bag[truth])
        label = 'ground truth' if truth.startswith('ground') else 'Optitrack'
        found.append(('reference', f'tracking: {label} minus reference', stamps * 1e-9, e))
    source = next((name for name in ('optitrack/pose', 'ground_truth/odom') if name in bag), None)
    if source and 'estimate/odom' in bag:
        stamps, e = position_errors(bag['estimate/odom'], bag[source])
        label = 'ground truth' if source.startswith('ground') else 'Optitrack'
        found.append(('estimate', f'estimation: estimate minus {label}', stamps * 1e-9, e))
    return found


def draw_errors(axes: list[Axes], bag: Bag, parts: Phases) -> None:
    """Size of the position errors."""
    for role, label, t, e in _errors(bag):
        _line(axes[0], t, np.linalg.norm(e, axis=1), role, label)
    axes[0].set_ylabel('error [m]')
    axes[0].set_ylim(bottom=0.0)
    _span(bag, axes)
    _mark(axes, parts)


def draw_path(axes: list[Axes], bag: Bag, parts: Phases) -> None:
    """Top view and side view of the path, to scale."""
    for ax, (across, up) in zip(axes, ((0, 1), (0, 2))):
        for topic, role, label in tracks(bag):
            p = bag[topic].position
            ax.plot(*_thin(p[:, across], p[:, up]), label=label if ax is axes[0] else None,
                    **palette.line(role))
        ax.set_aspect('equal', adjustable='datalim')
        ax.set_xlabel('x [m]')
        ax.set_ylabel(('', 'y [m]', 'z up [m]')[up])
    axes[0].set_title('from above')
    axes[1].set_title('from the side')


def draw_motors(axes: list[Axes], bag: Bag, parts: Phases) -> None:
    """Motor commands, the panels where the motors are seen from above."""
    motors = bag['motor_pwm']
    shown = motors.pwm[np.isfinite(motors.pwm)]  # a bag also holds refused commands
    low, high = (float(shown.min()), float(shown.max())) if shown.size else (0.0, 1.0)
    margin = max(0.05 * (high - low), 1.0)
    places = ((0, 'front left'), (1, 'front right'), (3, 'rear left'), (2, 'rear right'))
    for ax, (number, name) in zip(axes, places):
        ax.plot(*metrics.envelope(motors.t, motors.pwm[:, number], POINTS), color=INK, lw=0.8)
        ax.set_title(f'{number} {name}', weight='normal', size=9.0)
        ax.set_ylabel('PWM [-]')
        ax.set_ylim(low - margin, high + margin)
    _span(bag, axes)
    _mark(axes, parts)
    axes[2].set_xlabel('time [s]')


def _dots(ax: Axes, t: Floats, values: Floats, role: str, label: str) -> None:
    t, values = _thin(t, values)
    ax.plot(t, values, ls='none', marker='.', ms=2.5, color=COLOURS[role], label=label)


def draw_height(axes: list[Axes], bag: Bag, parts: Phases) -> None:
    """Height by each sensor and by the estimate."""
    ax = axes[0]
    if 'barometer/pressure' in bag:
        pressure = bag['barometer/pressure']
        ground = np.median(pressure.pressure[pressure.t <= pressure.t[0] + 0.5])
        _dots(ax, pressure.t, (ground - pressure.pressure) / AIR, 'barometer', 'barometer')
    if 'sonar/range' in bag:
        sonar = bag['sonar/range']
        valid = _valid_ranges(bag)
        if valid.any():
            _dots(ax, sonar.t[valid], sonar.range[valid], 'sonar', 'sonar, slant')
    for topic, role, label in tracks(bag):
        _line(ax, bag[topic].t, bag[topic].position[:, 2], role, label)
    ax.set_ylabel('height [m]')
    _span(bag, axes)
    _mark(axes, parts)


def draw_flow(axes: list[Axes], bag: Bag, parts: Phases) -> None:
    """Optical flow on both body axes."""
    flow = bag['optical_flow']
    for ax, name, values in zip(axes, ('forward', 'left'), (flow.rate_x, flow.rate_y)):
        _line(ax, flow.t, values, 'flow', 'optical flow' if ax is axes[0] else None, ls='-',
              lw=0.9)
        ax.set_ylabel(f'{name} [rad/s]')
    _span(bag, axes)
    _mark(axes, parts)


def _innovations(bag: Bag) -> list[tuple[str, str, Floats, Floats]]:
    """Return (role, label, innovation (n,), test ratio (n,)) of each sensor that was used."""
    state = bag['estimator/state']
    every = (
        ('sonar', 'sonar [m]', state.sonar_innovation, state.sonar_test_ratio),
        ('flow', 'flow x [m/s]', state.flow_innovation[:, 0], state.flow_test_ratio),
        ('flow', 'flow y [m/s]', state.flow_innovation[:, 1], state.flow_test_ratio),
        ('barometer', 'barom. [m]', state.barometer_innovation, state.barometer_test_ratio))
    return [row for row in every if np.isfinite(row[2]).any()]


def draw_innovations(axes: list[Axes], bag: Bag, parts: Phases) -> None:
    """Innovations of the estimator; refused samples are crosses."""
    t = bag['estimator/state'].t
    for ax, (role, label, innovation, ratio) in zip(axes, _innovations(bag)):
        refused = np.isfinite(innovation) & (ratio > 1.0)
        taken = np.isfinite(innovation) & ~refused
        ax.plot(*_thin(t[taken], innovation[taken]), ls='none', marker='.', ms=2.5,
                color=COLOURS[role])
        ax.plot(t[refused], innovation[refused], ls='none', marker='x', ms=4.0, color=INK)
        ax.axhline(0.0, color=INK, lw=0.6)
        ax.set_ylabel(label)
        ax.set_title(f'{int(refused.sum())} of {int((taken | refused).sum())} refused',
                     loc='right', weight='normal', size=9.0)
    _span(bag, axes)
    _mark(axes, parts)


def draw_covariance(axes: list[Axes], bag: Bag, parts: Phases) -> None:
    """Estimation error inside three standard deviations of the filter."""
    estimate = bag['estimate/odom']
    truth = 'ground_truth/odom' if 'ground_truth/odom' in bag else 'optitrack/pose'
    stamps, e = position_errors(estimate, bag[truth])
    variance = estimate.pose_covariance[:, [0, 7, 14]]
    sigma = np.sqrt(np.where(variance >= 0.0, variance, np.nan))
    t = stamps * 1e-9
    for axis, ax in enumerate(axes):
        when, low, high = _thin(t, -3.0 * sigma[:, axis], 3.0 * sigma[:, axis])
        ax.fill_between(when, low, high, color=COLOURS['estimate'], alpha=0.18, lw=0,
                        label='three standard deviations' if axis == 0 else None)
        _line(ax, t, e[:, axis], 'estimate', 'estimate minus '
              f'{"ground truth" if truth.startswith("ground") else "Optitrack"}'
              if axis == 0 else None, lw=1.0)
        ax.set_ylabel(f'{"xyz"[axis]} [m]')
        known = e[np.isfinite(e[:, axis]), axis], sigma[np.isfinite(sigma[:, axis]), axis]
        if all(map(len, known)):  # so that a short, wide band does not hide the rest
            ax.set_ylim(*(np.array([-1.2, 1.2]) * max(
                np.abs(known[0]).max(), 3.0 * np.quantile(known[1], 0.9), 1e-6)))
    _span(bag, axes)
    _mark(axes, parts)


def _has_band(bag: Bag) -> bool:
    """Return whether there is an estimate with a covariance, and a truth to compare it with."""
    if 'estimate/odom' not in bag or not any(
            name in bag for name in ('ground_truth/odom', 'optitrack/pose')):
        return False
    return bool(np.any(bag['estimate/odom'].pose_covariance))


def _height_text(bag: Bag) -> str:
    """Return the text of the height figure."""
    names, left_out = [label for _, _, label in tracks(bag)], ''
    if 'barometer/pressure' in bag:
        names.insert(0, 'barometer')
    if 'sonar/range' in bag:
        valid = _valid_ranges(bag)
        if valid.any():
            names.insert(0, 'sonar')
        if not valid.all():
            left_out = (f' {int((~valid).sum())} of {len(valid)} sonar samples are outside of its '
                        'limits and left out.')
    return f'Height over time by {listed(names)}.{left_out}' if names else left_out.strip()


def _innovations_text(rows: list[tuple[str, str, Floats, Floats]]) -> str:
    """Return the text of the innovation figure."""
    names = {'sonar': 'sonar', 'flow': 'optical flow', 'barometer': 'barometer'}
    sensors = [name for role, name in names.items() if any(row[0] == role for row in rows)]
    refused = any((np.isfinite(innovation) & (ratio > 1.0)).any()
                  for _, _, innovation, ratio in rows)
    return (f'Measurement minus prediction of {listed(sensors)} over time.'
            + (' Refused samples are crosses.' if refused else ' No sample was refused.'))


def plots(bag: Bag) -> list[Plot]:
    """Return the figures that can be drawn from the bag, in the order of a page."""
    found, errors, shade = tracks(bag), _errors(bag), shaded(phases(bag))
    names = listed([label for _, _, label in found]) if found else ''
    rows = _innovations(bag) if 'estimator/state' in bag else []
    heard = 'sonar/range' in bag and bool(_valid_ranges(bag).any())
    every = (
        (bool(found), Plot(
            'position', 'Position',
            f'Position of {names} over time on the axes x, y and z, which is up.{shade}',
            (3, 1), 5.4, 5, draw_position)),
        (bool(errors), Plot(
            'errors', 'Position errors', 'Length of the position error over time: '
            f'{listed([label for _, label, _, _ in errors])}.' if errors else '',
            (1, 1), 2.6, 2, draw_errors)),
        (bool(found), Plot(
            'path', 'Path', f'The path of {names}, seen from above and from the side, to scale.',
            (1, 2), 3.5, 5, draw_path)),
        ('motor_pwm' in bag, Plot(
            'motors', 'Motor commands',
            'PWM commands of the four motors over time, laid out as seen from above.',
            (2, 2), 3.4, 0, draw_motors)),
        (bool(found) or heard, Plot(
            'height', 'Height', _height_text(bag), (1, 1), 3.1, 3, draw_height)),
        ('optical_flow' in bag, Plot(
            'flow', 'Optical flow', 'Optical flow forward and left over time.',
            (2, 1), 3.2, 1, draw_flow)),
        (bool(rows), Plot(
            'innovations', 'Innovations of the estimator', _innovations_text(rows),
            (len(rows), 1), 0.6 + 1.25 * len(rows), 0, draw_innovations)),
        (_has_band(bag), Plot(
            'covariance', 'Does the filter know its error?',
            'Position error of the estimate on each axis, z up, and the band of three standard '
            'deviations that the filter gives.', (3, 1), 5.0, 2, draw_covariance)))
    return [plot for wanted, plot in every if wanted]


def _paint(figure: Any, plot: Plot, bag: Bag, parts: Phases) -> list[Axes]:
    """Draw a plot into a figure or a part of one, its legend in a row of its own."""
    rows, columns = plot.shape
    row = (plot.height - 0.3) / rows  # inches
    grid = figure.add_gridspec(
        rows + (plot.legend > 0), columns, height_ratios=[row] * rows + [0.02] * (plot.legend > 0))
    axes: list[Axes] = []
    for place in range(rows * columns):
        axes.append(figure.add_subplot(
            grid[place // columns, place % columns],
            sharex=axes[0] if axes and columns == 1 else None))
    if columns == 1:
        for ax in axes[:-1]:
            ax.tick_params(labelbottom=False)
    plot.draw(axes, bag, parts)
    handles, labels = axes[0].get_legend_handles_labels()  # every curve is in the first
    if plot.legend and handles:
        below = figure.add_subplot(grid[rows, :])
        below.axis('off')
        below.legend(handles, labels, loc='upper center', ncol=plot.legend, borderaxespad=0.0,
                     handlelength=1.4, columnspacing=1.2)
    return axes


def figure_of(plot: Plot, bag: Bag, width: float = 6.6) -> Figure:
    """Return one plot as a figure without background, ``width`` inches wide."""
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(width, plot.height), layout='constrained', facecolor='none')
        for ax in _paint(figure, plot, bag, phases(bag)):
            ax.set_facecolor('none')
    return figure


def overview(bag: Bag, title: str) -> Figure:
    """Return all plots of a flight on one white sheet, two columns."""
    columns: list[list[Plot]] = [[], []]
    for plot in plots(bag):
        columns[0 if sum(p.height for p in columns[0]) <= sum(p.height for p in columns[1])
                else 1].append(plot)
    columns = [column for column in columns if column]
    height = max((sum(p.height + 0.35 for p in column) for column in columns), default=1.0)
    with matplotlib.rc_context(STYLE):
        sheet = Figure(figsize=(6.8 * max(len(columns), 1), height + 0.4), layout='constrained',
                       facecolor=palette.PAPER)
        sheet.suptitle(palette.in_figure(title), x=0.01, ha='left', weight='bold')
        parts = phases(bag)
        halves = np.atleast_1d(sheet.subfigures(1, len(columns))) if columns else []
        for half, column in zip(halves, columns):
            pieces = np.atleast_1d(half.subfigures(
                len(column), 1, height_ratios=[p.height + 0.35 for p in column]))
            for piece, plot in zip(pieces, column):
                piece.suptitle(plot.title, x=0.02, ha='left', size=10.5, weight='bold')
                _paint(piece, plot, bag, parts)
    return sheet


def write_overview(bag: Bag, path: Path, title: str) -> None:
    """Write all plots of a flight on one white sheet, two columns, as PNG."""
    with matplotlib.rc_context(STYLE):
        digest.save(overview(bag, title), path, dpi=110)
