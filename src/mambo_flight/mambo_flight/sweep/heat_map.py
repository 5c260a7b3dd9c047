"""Heat map of a sweep over two numbers, with the number of a flight in each cell."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from mambo_model import palette
from mambo_model.whole_file import PICTURE, replacing
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
import numpy as np

from .plot import axis_label, measured, NO_UNITS, numbers, of_flights

MOST_VALUES = 60  # of each parameter
NUMBERED = 14  # cells along an edge at most that carry the number of their flight
_FILLED = 0.5  # least share of the cells with a flight: random draws make no map


class Grid(NamedTuple):
    """Flights by the values of two parameters."""

    names: tuple[str, str]
    values: tuple[list[float], list[float]]  # sorted
    cells: dict[tuple[int, int], list[int]]  # flights of each cell, by the indexes of its values


def grid(data: Mapping[str, Sequence[Any]], names: Sequence[str]) -> Grid | None:
    """
    Return the flights of a sweep by cell; None unless exactly two numbers vary, on a grid.

    Parameters
    ----------
    data
        Columns of the result.
    names
        Columns that are varied parameters; a seed is not counted.

    """
    varied = numbers(data, names)
    if len(varied) != 2:
        return None
    values = tuple(sorted(set(data[name])) for name in varied)
    if max(map(len, values)) > MOST_VALUES:
        return None
    at = [{value: k for k, value in enumerate(column)} for column in values]
    cells: dict[tuple[int, int], list[int]] = {}
    for number, pair in enumerate(zip(*(data[name] for name in varied), strict=True)):
        cells.setdefault((at[0][pair[0]], at[1][pair[1]]), []).append(number)
    if len(cells) < _FILLED * len(values[0]) * len(values[1]):
        return None
    return Grid((varied[0], varied[1]), (values[0], values[1]), cells)


def typical(values: np.ndarray, flights: Sequence[int]) -> tuple[float, int]:
    """
    Return the median of some flights, and the flight at it or, of an even number, just below.

    Without a finite value: nan, and the first of them.
    """
    good = sorted((values[number], number) for number in flights if np.isfinite(values[number]))
    if not good:
        return np.nan, flights[0]
    return float(np.median([value for value, _ in good])), good[(len(good) - 1) // 2][1]


def draw(path: Path, data: Mapping[str, Sequence[Any]], names: Sequence[str], title: str,
         units: Mapping[str, str] = NO_UNITS) -> None:
    """
    Draw the map of each error into a PNG.

    A file of an earlier result is removed where there is no map to draw.

    Parameters
    ----------
    path
        PNG to write.
    data
        Columns of the result.
    names
        Columns that are varied parameters.
    title
        Above the maps.
    units
        Of the parameters that have one.

    """
    found, metrics = grid(data, names), measured(data)
    if found is None or not metrics:
        path.unlink(missing_ok=True)
        return
    across, up = map(len, found.values)
    size = (max(3.6, 0.42 * min(across, NUMBERED) + 2.0), max(3.0, 0.34 * min(up, NUMBERED) + 1.4))
    figure = Figure(figsize=(size[0] * len(metrics), size[1]), layout='constrained')
    FigureCanvasAgg(figure)
    numbered = max(across, up) <= NUMBERED
    for axes, (name, label) in zip(
            figure.subplots(1, len(metrics), squeeze=False)[0], metrics.items(), strict=True):
        _map(axes, found, np.asarray(data[name], dtype=float), label, numbered, units)
    note = '; in each cell the number of its middle flight' if numbered else ''
    figure.suptitle(palette.in_figure(f'{title}: median{note}'))
    with replacing(path, PICTURE) as part:
        figure.savefig(part, format='png', dpi=110, metadata={'Software': None})


def _map(axes: Any, found: Grid, values: np.ndarray, label: str, numbered: bool,
         units: Mapping[str, str]) -> None:
    """Draw the map of one error."""
    shown = np.full((len(found.values[1]), len(found.values[0])), np.nan)
    flights = {}
    for (column, row), members in found.cells.items():
        shown[row, column], flights[column, row] = typical(values, members)
    image = axes.imshow(shown, origin='lower', aspect='auto', cmap='cividis')
    part = of_flights(values)
    axes.figure.colorbar(
        image, ax=axes, label=f'{label}\n{part} flights have a value' if part else label)
    finite = shown[np.isfinite(shown)]
    middle = 0.5 * (finite.min() + finite.max())
    for (column, row), number in flights.items() if numbered else ():
        dark = shown[row, column] < middle
        axes.text(column, row, str(number), ha='center', va='center', fontsize='x-small',
                  color='white' if dark else 'black')
    for axis, name, ticks in zip((axes.xaxis, axes.yaxis), found.names, found.values, strict=True):
        places = np.unique(np.linspace(0, len(ticks) - 1, min(len(ticks), 6)).round().astype(int))
        axis.set_ticks(places, [f'{ticks[k]:.4g}' for k in places])
        axis.set_label_text(axis_label(name, units, parts=2))
