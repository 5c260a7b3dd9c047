"""Sonar: rate, resolution, limits, noise, outliers and missing echoes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from ..recording import Recording, Stream
from .phases import LOWEST, NEIGHBOURS
from .repeats import (
    filled, NOT_TOLD, only_changes, period, rate_note, shown, smallest_step, undecided)
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
    lines = timing('sonar', stream, rate_note(recording, 'sonar'))
    heard = np.isfinite(stream.values)
    values, n = stream.values[heard], int(heard.sum())
    step = resolution(values)
    if step:
        lines.append(entry('sonar', 'resolution', 'm', step, n))
    for quantity, pick in (('smallest', values.min()), ('largest', values.max())):
        times = int((np.abs(values - pick) < 1e-6).sum())
        lines.append(Measured('sonar', quantity, 'm', float(pick), float(pick), float(pick), n,
                              f'{times} times'))
    lines += _noise(recording, stream.t[heard], values)
    stray, level = outliers(values)
    lines.append(entry('sonar', 'outliers', '1', proportion(int(stray.sum()), n), n))
    late = stray & (values > level)
    if stray.any():
        lines.append(entry(
            'sonar', 'late of outliers', '1', proportion(int(late.sum()), int(stray.sum())),
            stray.sum()))
    if late.sum() >= 5:
        lines.append(entry('sonar', 'excess of late', '1', median(
            values[late] / level[late] - 1.0), late.sum(), 'over the range of the neighbours'))
    lines.append(_dropouts(recording, stream, n))
    return lines


def _second_differences(values: Array) -> Array:
    """Return the second differences of the ranges above the floor that are no outliers."""
    stray, level = outliers(values)
    good = (level > LOWEST) & ~stray
    return np.diff(values, 2)[good[:-2] & good[1:-1] & good[2:]]


def _noise(recording: Recording, t: Array, values: Array) -> list[Measured]:
    """Return the line of the noise of ranges, (n,), as far as the recording shows it."""
    second = _second_differences(values)
    if len(second) <= 3 * STRETCHES:
        return []
    full = None
    if only_changes(recording, 'sonar'):
        full = robust_sigma(_second_differences(filled(t, values)) / np.sqrt(6.0))
    found, note = shown(robust_sigma(second / np.sqrt(6.0)), smallest_step(values), full)
    return [entry('sonar', 'noise', 'm', found, len(second),
                  note or f'above {LOWEST} m, outliers left out')]


def _dropouts(recording: Recording, stream: Stream, n: int) -> Measured:
    """Return the line of missing echoes of a sonar with n values."""
    changes = only_changes(recording, 'sonar') and not recording.held
    usual = period(stream.t) if changes else float(np.median(np.diff(stream.t)))
    lost = _missing(recording, stream, usual)
    found, note = proportion(lost, n + lost), ''
    if recording.held:
        note = 'reads 0; repeated values are not counted'
    elif changes:
        note = ('not to be told: equal readings are left out, and look like lost ones; at most '
                f'{found.high:.2g}')
        found = NOT_TOLD
    elif undecided(stream):
        found, note = NOT_TOLD, 'not to be told: readings may be held or equal'
    return entry('sonar', 'dropouts', '1', found, n + lost, note)


def _missing(recording: Recording, stream: Stream, usual: float) -> int:
    """Return the number of missing values: marked as invalid, or absent when due."""
    spans = np.diff(np.r_[stream.t, stream.t[-1] + usual])
    counts = np.round(spans / usual).astype(int)
    if recording.held:
        return int(np.maximum(counts, 1)[np.isnan(stream.values)].sum())
    return int(np.isnan(stream.values).sum() + np.maximum(counts - 1, 0).sum())
