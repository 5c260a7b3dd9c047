"""Figures in the layout of the thesis: positions over time, one plot per axis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from mambo_model import palette
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Curves = Mapping[str, tuple[Array, Array]]  # label: time (n,) s, positions (n, 3) m

POSITION = ('$x$ [m]', '$y$ [m]', '$z$ down [m]')
"""Axis labels of a position, inertial NED as in the thesis."""


def sheet(rows: int, columns: int = 1, height: float = 1.7) -> tuple[Figure, list[Axes]]:
    """Return a figure with rows x columns plots, and its axes row by row; height in inches."""
    figure = Figure(figsize=(7.0, 0.5 + height * rows), layout='constrained')
    grid = figure.subplots(rows, columns, squeeze=False)
    for axes in grid.flat:
        axes.grid(alpha=0.3)
        axes.spines[['top', 'right']].set_visible(False)
    return figure, list(grid.flat)


def lines(axes: Axes, curves: Mapping[str, tuple[Array, Array]], ylabel: str) -> None:
    """Draw labelled curves in the style of :func:`mambo_model.palette.lines`; NaN leaves gaps."""
    for (label, (x, y)), style in zip(curves.items(), palette.lines(curves), strict=True):
        if np.isfinite(y).any():
            axes.plot(x, y, label=label, **style)
    axes.set_ylabel(ylabel)


def over_time(curves: Mapping[str, tuple[Array, Array]], ylabel: str) -> Figure:
    """Draw one quantity over time, ``{label: (time in s, values (n,))}``, with a legend."""
    figure, (axes,) = sheet(1, height=3.0)
    lines(axes, curves, ylabel)
    axes.set_xlabel('time [s]')
    axes.legend(frameon=False)
    return figure


def positions(curves: Curves, axes_shown: Sequence[int] = (0, 1, 2)) -> Figure:
    """
    Draw positions over time, one plot per axis, inertial NED (z down) as in the thesis.

    Parameters
    ----------
    curves
        {label: (time in s, positions (n, 3) in m)}; NaN leaves gaps.
    axes_shown
        Indices of the axes to draw: 0 for x, 1 for y, 2 for z.

    """
    figure, plots = sheet(len(axes_shown))
    for axes, i in zip(plots, axes_shown, strict=True):
        lines(axes, {k: (t, p[:, i]) for k, (t, p) in curves.items()}, POSITION[i])
    _finish(figure, plots)
    return figure


def positions_and_rms(
    curves: Curves, t: Array, rms: Array, axes_shown: Sequence[int] = (0, 1, 2),
) -> Figure:
    """Draw positions over time, with the running RMS of an error, (n, 3) m, beside each."""
    figure, plots = sheet(len(axes_shown), 2)
    for row, i in enumerate(axes_shown):
        left, right = plots[2 * row], plots[2 * row + 1]
        lines(left, {k: (s, p[:, i]) for k, (s, p) in curves.items()}, POSITION[i])
        right.plot(t, rms[:, i], color=palette.INK, linewidth=1.2)
        right.set_ylabel(f'RMS ${"xyz"[i]}$ [m]')
        right.set_ylim(bottom=0.0)
    _finish(figure, plots, columns=2)
    return figure


def _finish(figure: Figure, plots: Sequence[Axes], columns: int = 1) -> None:
    for axes in plots[-columns:]:
        axes.set_xlabel('time [s]')
    drawn: dict[str, Artist] = {}  # from all plots: a curve may be missing in the first
    for axes in plots:
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            drawn.setdefault(label, handle)
    figure.legend(list(drawn.values()), list(drawn), loc='outside upper center',
                  ncols=len(drawn), frameon=False)
