"""Sonar: rate, resolution, limits, noise, outliers and missing echoes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from ..recording import Recording, Stream
from .phases import LOWEST, NEIGHBOURS
from .statistics import Array, median, proportion, resolution, robust_sigma, STRETCHES
from .table import entry, Measured, timing

OUTLIER = 0.25  # m: a climb of 0.5 m/s moves by less in those neighbours


def outliers(values: Array) -> tuple[NDArray[np.bool_], Array]:
    """Return a mask of sonar outliers, and the running median that they are compared with."""
    level = median_filter(values, NEIGHBOURS, mode='nearest')
    return np.abs(values - level) > OUTLIER, level


def measure(recording: Recording) -> list[Measured]:
    """Return limits, noise, outliers and missing echoes of the sonar."""
    stream = recording.sonar
    if stream is None or np.isfinite(stream.values).sum() < 2 * STRETCHES:
        return []
    lines = timing('sonar', stream)
    heard = np.isfinite(stream.values)
    values, n = stream.values[heard], int(heard.sum())
    step = resolution(values)
    if step:
        lines.append(entry('sonar', 'resolution', 'm', step, n))
    for quantity, pick in (('smallest', values.min()), ('largest', values.max())):
        times = int((np.abs(values - pick) < 1e-6).sum())
        lines.append(Measured('sonar', quantity, 'm', float(pick), float(pick), float(pick), n,
                              f'{times} times'))
    stray, level = outliers(values)
    good = (level > LOWEST) & ~stray
    triples = np.flatnonzero(good[:-2] & good[1:-1] & good[2:])
    if len(triples) > 3 * STRETCHES:
        second = np.diff(values, 2)[triples]
        lines.append(entry('sonar', 'noise', 'm', robust_sigma(second / np.sqrt(6.0)),
                           len(triples), f'above {LOWEST} m, outliers left out'))
    lines.append(entry('sonar', 'outliers', '1', proportion(int(stray.sum()), n), n))
    late = stray & (values > level)
    if stray.any():
        lines.append(entry(
            'sonar', 'late of outliers', '1', proportion(int(late.sum()), int(stray.sum())),
            stray.sum()))
    if late.sum() >= 5:
        lines.append(entry('sonar', 'excess of late', '1', median(
            values[late] / level[late] - 1.0), late.sum(), 'over the range of the neighbours'))
    usual = float(np.median(np.diff(stream.t)))
    lost = _missing(recording, stream, usual)
    lines.append(entry('sonar', 'dropouts', '1', proportion(lost, n + lost), n + lost,
                       'reads 0; repeated values are not counted' if recording.held else ''))
    return lines


def _missing(recording: Recording, stream: Stream, usual: float) -> int:
    """Return the number of missing values: marked as invalid, or absent when due."""
    spans = np.diff(np.r_[stream.t, stream.t[-1] + usual])
    counts = np.round(spans / usual).astype(int)
    if recording.held:
        return int(np.maximum(counts, 1)[np.isnan(stream.values)].sum())
    return int(np.isnan(stream.values).sum() + np.maximum(counts - 1, 0).sum())
