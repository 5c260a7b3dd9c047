"""Picture of the distance of drones over time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mambo_model import palette
from mambo_model.whole_file import replacing
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from .separation import Pair


def draw(path: Path, found: Sequence[Pair], limit: float) -> None:
    """
    Draw the distance of the nearest pairs into a file.

    Parameters
    ----------
    path
        File to create; its suffix selects the format.
    found
        Pairs, the nearest first.
    limit : m
        Distance of a collision.

    """
    figure = Figure(figsize=(9.0, 4.5), layout='constrained')
    FigureCanvasAgg(figure)
    axes = figure.add_subplot(xlabel='t [s]', ylabel='distance of centres [m]')
    shown = list(found[:len(palette.SERIES)])
    labels = [' - '.join(pair.names) for pair in shown]
    for pair, label, style in zip(shown, labels, palette.lines(labels), strict=True):
        axes.plot(pair.t * 1e-9, pair.distance, label=palette.in_figure(label), **style)
    axes.axhline(limit, color=palette.COLOURS['bad'], linestyle='--', linewidth=1.0,
                 label='collision')
    axes.set_ylim(bottom=0.0)
    axes.legend(loc='best')
    with replacing(path) as part:
        figure.savefig(part, format=path.suffix[1:].lower())
