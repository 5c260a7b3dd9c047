"""Figures in the layout of the thesis: positions over time, one axis below the other."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Curves = Mapping[str, tuple[Array, Array]]  # label: time (n,) s, positions (n, 3) m

COLOURS = ('#0072B2', '#D55E00', '#009E73', '#CC79A7', '#E69F00', '#56B4E9')  # Okabe and Ito
STYLE = {  # of what has one colour throughout the thesis
    'reference': ('#2f7ed8', '--'), 'IMU': ('#e0403f', '-'), 'Optitrack': ('#2ca25f', '-'),
    'optical flow': ('#a06cd5', '-')}


def sheet(rows: int, columns: int = 1, height: float = 1.7) -> tuple[Figure, list[Axes]]:
    """Return a figure with so many plots, row by row."""
    figure = Figure(figsize=(7.0, 0.5 + height * rows), layout='constrained')
    grid = figure.subplots(rows, columns, squeeze=False)
    for axes in grid.flat:
        axes.grid(alpha=0.3)
        axes.spines[['top', 'right']].set_visible(False)
    return figure, list(grid.flat)


def lines(axes: Axes, curves: Mapping[str, tuple[Array, Array]], ylabel: str) -> None:
    """Draw x, y pairs by label; references are grey and dashed."""
    colours = iter(COLOURS)
    for label, (x, y) in curves.items():
        colour, dash = STYLE.get(label, (None, '-'))
        axes.plot(x, y, dash, color=colour or next(colours), label=label, linewidth=1.2)
    axes.set_ylabel(ylabel)


def positions(curves: Curves, axes_shown: Sequence[int] = (0, 1, 2)) -> Figure:
    """
    Draw positions over time, z upside down as the thesis's NED z is plotted.

    Parameters
    ----------
    curves
        {label: (time in s, positions (n, 3) in m)}; NaN leaves gaps.
    axes_shown
        Which of x, y, z.

    """
    figure, plots = sheet(len(axes_shown))
    for axes, i in zip(plots, axes_shown, strict=True):
        lines(axes, {k: (t, p[:, i]) for k, (t, p) in curves.items()}, f'${"xyz"[i]}$ [m]')
    _finish(figure, plots)
    return figure


def positions_and_rms(
    curves: Curves, t: Array, rms: Array, axes_shown: Sequence[int] = (0, 1, 2),
) -> Figure:
    """Draw positions over time, and beside each the running RMS of an error, (n, 3) m."""
    figure, plots = sheet(len(axes_shown), 2)
    for row, i in enumerate(axes_shown):
        left, right = plots[2 * row], plots[2 * row + 1]
        lines(left, {k: (s, p[:, i]) for k, (s, p) in curves.items()}, f'${"xyz"[i]}$ [m]')
        right.plot(t, rms[:, i], color=COLOURS[3], linewidth=1.2)
        right.set_ylabel(f'RMS ${"xyz"[i]}$ [m]')
        right.set_ylim(bottom=0.0)
    _finish(figure, plots, columns=2)
    return figure


def _finish(figure: Figure, plots: Sequence[Axes], columns: int = 1) -> None:
    for axes in plots[-columns:]:
        axes.set_xlabel('time [s]')
    handles, labels = plots[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc='outside upper center', ncols=len(labels), frameon=False)
