"""Picture of a course: its path from above, its height and its demands on the vehicle."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mambo_model import palette
from mambo_model.motion.polynomial import Array, Course, state_at
from mambo_model.whole_file import replacing
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
import numpy as np

from .feasibility import Limit, QUANTITIES

PANELS = (('height', 'speed'), ('thrust', 'tilt'), ('body rate', 'PWM of motor 1'))


def draw(
    path: Path, course: Course, t: Array, columns: Array, limits: dict[str, Limit], title: str,
) -> None:
    """
    Draw a course into a file.

    Parameters
    ----------
    path
        File to create; its suffix selects the format.
    course
        In m, inertial NED.
    t, columns
        Result of ``feasibility.demand``.
    limits
        Result of ``feasibility.limits``; a limit is drawn if a quantity comes near it.
    title
        Title of the figure.

    """
    figure = Figure(figsize=(11.0, 8.0), layout='constrained')
    FigureCanvasAgg(figure)
    figure.suptitle(palette.in_figure(title))
    grid = figure.add_gridspec(3, 3)
    at = np.array([state_at(course, x)[:3, 0] for x in t[::4]])
    knots = np.array([state_at(course, x)[:3, 0] for x in [*course.begin, course.total]])
    above = figure.add_subplot(grid[:, 0], xlabel='y, east [m]', ylabel='x, north [m]')
    above.plot(at[:, 1], at[:, 0], color=palette.COLOURS['reference'])
    above.plot(knots[:, 1], knots[:, 0], 'o', markersize=3.0, color=palette.COLOURS['optitrack'],
               label='seams')
    above.set_aspect('equal', adjustable='datalim')
    above.legend(loc='best')
    for row, names in enumerate(PANELS):
        for column, name in enumerate(names):
            _panel(figure.add_subplot(grid[row, column + 1]), t, columns, limits, name)
    with replacing(path) as part:
        figure.savefig(part, format=path.suffix[1:].lower())


def _panel(axes: Any, t: Array, columns: Array, limits: dict[str, Limit], name: str) -> None:
    """Draw one quantity; the PWM of all motors."""
    shown = [other for other in QUANTITIES if other == name or (
        name.startswith('PWM') and other.startswith('PWM'))]
    for other, series in zip(shown, palette.SERIES, strict=False):
        axes.plot(t, columns[:, list(QUANTITIES).index(other)], linewidth=1.0,
                  color=palette.COLOURS[series if len(shown) > 1 else 'reference'], label=other)
    low, high = axes.get_ylim()
    for edge in limits.get(name, ()):
        if low - (high - low) <= edge <= high + (high - low):
            axes.axhline(edge, color=palette.COLOURS['bad'], linestyle='--', linewidth=1.0)
    axes.set(xlabel='t [s]', ylabel=f'{name.removesuffix(" of motor 1")} [{QUANTITIES[name]}]')
