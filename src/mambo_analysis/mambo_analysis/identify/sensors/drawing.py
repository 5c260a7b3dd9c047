"""A recording's figure: Allan deviations, sonar with its outliers, misfit over the flow's lag."""

from __future__ import annotations

from collections.abc import Callable
import functools
from pathlib import Path
from typing import Any

from mambo_model import palette
from mambo_model.whole_file import PICTURE, replacing
from matplotlib.axes import Axes
from matplotlib.figure import Figure
import numpy as np

from ..allan import Allan
from ..recording import Recording, Stream
from .phases import NEIGHBOURS
from .sonar import outliers
from .statistics import Array


def _draw_allan(axis: Axes, curves: dict[str, Allan], unit: str) -> None:
    for (name, curve), style in zip(curves.items(), palette.lines(curves)):
        reach = [curve.deviation - curve.low, curve.high - curve.deviation]
        axis.errorbar(curve.tau, curve.deviation, reach, label=name, capsize=2, **style)
    axis.set(title='Allan deviation at rest', xlabel='averaging time [s]', ylabel=f'[{unit}]',
             xscale='log', yscale='log')
    axis.legend()


def _draw_sonar(axis: Axes, stream: Stream) -> None:
    heard = np.isfinite(stream.values)
    t, values = stream.t[heard], stream.values[heard]
    stray, level = outliers(values)
    axis.plot(t, level, color=palette.COLOURS['soft'], label=f'median of {NEIGHBOURS}')
    axis.plot(t[~stray], values[~stray], '.', markersize=3, color=palette.COLOURS['sonar'],
              label='values')
    if stray.any():
        axis.plot(t[stray], values[stray], 'x', color=palette.INK, label='outliers')
    axis.set(title='sonar', xlabel='time [s]', ylabel='range [m]')
    axis.legend()


def _draw_latency(axis: Axes, lags: Array, misfit: Array) -> None:
    axis.plot(lags, misfit, color=palette.INK)
    axis.set(title='flow against inertial velocity', xlabel='flow late by [ms]',
             ylabel='1 - R^2, mean of the bands')


def draw(recording: Recording, curves: dict[str, Any], file: Path) -> bool:
    """
    Write a figure: Allan deviations, sonar with its outliers, misfit over the flow's lag.

    Returns False, and writes none, if the recording has nothing of these.
    """
    panels: list[Callable[[Axes], None]] = []
    for sensor, unit in (('gyro', 'rad/s'), ('accel', 'm/s^2')):
        shown = {name: c for name, c in curves['allan'].items() if name.startswith(sensor)}
        if shown:
            panels.append(functools.partial(_draw_allan, curves=shown, unit=unit))
    if recording.sonar is not None and np.isfinite(recording.sonar.values).any():
        panels.append(functools.partial(_draw_sonar, stream=recording.sonar))
    if curves['latency'] is not None:
        lags, misfit = curves['latency']
        panels.append(functools.partial(_draw_latency, lags=lags, misfit=misfit))
    if not panels:
        return False
    figure = Figure(figsize=(5.5 * len(panels), 4.2), layout='constrained')
    figure.suptitle(palette.in_figure(recording.name))
    for axis, panel in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels):
        panel(axis)
    with replacing(file, PICTURE) as part:
        figure.savefig(part, format='png', dpi=110)
    return True
