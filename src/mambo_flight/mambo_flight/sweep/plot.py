"""Plots of a sweep: distribution of the errors, and their dependence on each parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any

from mambo_model import palette
from mambo_model.whole_file import PICTURE, replacing
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
import numpy as np

METRICS = {
    'tracking_rms': 'tracking error, RMS [m]', 'tracking_max': 'tracking error, max [m]',
    'estimation_rms': 'estimation error, RMS [m]', 'estimation_final': 'drift at the end [m]'}
NO_UNITS: Mapping[str, str] = MappingProxyType({})
BANDS = ((5, 95, 0.2), (25, 75, 0.35))
MOST_GROUPS, MOST_PARAMETERS, MOST_BINS = 6, 4, 12
FEW = 5  # flights of a bin, below which it has no percentiles
MARGIN = 0.04  # of an axis, beside what was flown


def percentiles(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return percentiles and sorted values of the finite values, (n,) each."""
    good = np.sort(values[np.isfinite(values)])
    return 100.0 * (np.arange(len(good)) + 0.5) / max(len(good), 1), good


def groups(column: Sequence[Any]) -> list[tuple[Any, np.ndarray]]:
    """Return the rows of each value of a column; one group if there are too many values."""
    values = sorted(set(column), key=lambda x: (str(type(x)), x))
    if not 1 < len(values) <= MOST_GROUPS:
        return [('', np.ones(len(column), dtype=bool))]
    return [(value, np.array([x == value for x in column])) for value in values]


def bins(x: np.ndarray, y: np.ndarray) -> list[tuple[float, np.ndarray]]:
    """Return (middle, values) of bins of a parameter with equal numbers of flights."""
    order = np.argsort(x, kind='stable')
    edges = np.unique(x)
    if len(edges) <= MOST_BINS:
        return [(float(value), y[x == value]) for value in edges]
    parts = np.array_split(order, MOST_BINS)
    return [(float(np.median(x[part])), y[part]) for part in parts]


def numbers(data: Mapping[str, Sequence[Any]], names: Sequence[str]) -> list[str]:
    """Return the parameters that are numbers and vary, seeds aside."""
    return [name for name in names if not isinstance(data[name][0], (bool, str))
            and len(set(data[name])) > 1 and not name.endswith('seed')]


def measured(data: Mapping[str, Sequence[Any]]) -> dict[str, str]:
    """Return {name: label} of the errors that some flight has, as a finite number."""
    found = {name: np.asarray(data[name], dtype=float) for name in METRICS}
    return {name: label for name, label in METRICS.items()
            if (found[name][np.isfinite(found[name])] > 0.0).any()}


def axis_label(name: str, units: Mapping[str, str], parts: int = 3) -> str:
    """Return the label of a parameter's axis: parts of its name, and its unit if known."""
    short = '.'.join(name.split('.')[-parts:])
    return f'{short} [{units[name]}]' if units.get(name, '-') != '-' else short


def of_flights(values: np.ndarray) -> str:
    """Return of how many flights finite values are, as ``185 of 300``; '' if every one has one."""
    count = int(np.isfinite(values).sum())
    return '' if count == len(values) else f'{count} of {len(values)}'


def _curves(axes: Any, values: np.ndarray, parts: Sequence[tuple[Any, np.ndarray]]) -> None:
    """Draw the percentiles of each group of flights, and say of how many they are."""
    for (value, members), style in zip(parts, palette.lines(str(v) for v, _ in parts)):
        percent, sorted_values = percentiles(values[members])
        part = of_flights(values[members])
        axes.plot(percent, sorted_values, **style, label=palette.in_figure(
            f'{value} ({part})' if part and len(parts) > 1 else str(value)))
    whole = of_flights(values)
    axes.set(xlabel=f'percentile\n{whole} flights have a value' if whole else 'percentile',
             xlim=(0, 100))


def _span(axes: Any, x: np.ndarray, y: np.ndarray, label: str) -> None:
    """Let the axis of a parameter span what was flown; mark and count flights without a value."""
    low, high = x.min(), x.max()
    side = MARGIN * (high - low)
    missing = x[~np.isfinite(y)]
    if len(missing):
        axes.plot(missing, np.full(len(missing), 0.03), '|', color=palette.INK, ms=6, mew=0.8,
                  transform=axes.get_xaxis_transform())
        label += f'\n| {len(missing)} of {len(x)} flights have no value'
    axes.set(xlabel=label, xlim=(low - side, high + side))


def _band(axes: Any, x: np.ndarray, y: np.ndarray) -> None:
    good = np.isfinite(y)
    x, y = x[good], y[good]
    parts, colour = bins(x, y), palette.COLOURS[palette.SERIES[0]]
    if not parts:
        return
    at = [middle for middle, _ in parts]
    few = min(len(part) for _, part in parts) < FEW
    if few:
        axes.plot(x, y, '.', label='one flight each', color=colour, alpha=0.6)
        if len(np.unique(x)) > MOST_BINS or len(parts) == len(x):
            return  # a median of drawn values would follow single flights
    for low, high, alpha in () if few else BANDS:
        edges = np.array([np.percentile(part, (low, high)) for _, part in parts])
        axes.fill_between(at, edges[:, 0], edges[:, 1], alpha=alpha, linewidth=0, color=colour,
                          label=f'{low} to {high} %')
    axes.plot(at, [np.median(part) for _, part in parts], '-' if few else '.-', label='median',
              color=colour)


def draw(path: Path, data: Mapping[str, Sequence[Any]], names: Sequence[str], title: str,
         units: Mapping[str, str] = NO_UNITS) -> None:
    """
    Draw a sweep into a PNG.

    Parameters
    ----------
    path
        PNG to write.
    data
        Columns of the result.
    names
        Columns that are varied parameters.
    title
        Above the plots.
    units
        Of the parameters that have one.

    """
    metrics, varied = measured(data), numbers(data, names)[:MOST_PARAMETERS]
    colour = next((name for name in names if not name.endswith('seed')
                   and 1 < len(set(data[name])) <= MOST_GROUPS), None)
    rows, columns = 1 + len(varied), max(len(metrics), 1)
    figure = Figure(figsize=(3.6 * columns, 2.9 * rows), layout='constrained')
    FigureCanvasAgg(figure)
    grid = figure.subplots(rows, columns, squeeze=False)
    for column, (name, label) in enumerate(metrics.items()):
        values = np.asarray(data[name], dtype=float)
        parts = groups(data[colour]) if colour else [
            ('', np.ones(len(values), dtype=bool))]
        _curves(grid[0, column], values, parts)
        for row, parameter in enumerate(varied, 1):
            x = np.asarray(data[parameter], dtype=float)
            _band(grid[row, column], x, values)
            _span(grid[row, column], x, values, axis_label(parameter, units))
        for axes in grid[:, column]:
            axes.set_ylabel(label)
    titles = [('.'.join(colour.split('.')[-2:]), grid[0, 0])] if colour else []
    for heading, axes in [*titles, *((None, axes) for axes in grid[1:, 0])]:
        if axes.get_legend_handles_labels()[0]:  # without finite values nothing is drawn
            axes.legend(title=heading, fontsize='small')
        axes.grid(alpha=0.3)
        axes.set_ylim(bottom=0.0)
    nothing = '' if metrics else f': none of {len(next(iter(data.values())))} flights has a value'
    figure.suptitle(palette.in_figure(f'{title}{nothing}'))
    with replacing(path, PICTURE) as part:
        figure.savefig(part, format='png', dpi=110, metadata={'Software': None})
