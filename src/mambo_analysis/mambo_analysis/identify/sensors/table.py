"""Measured quantities as lines of a table."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..allan import Interval
from ..recording import Stream
from .statistics import jackknife, median, STRETCHES

PAUSE = 1.8  # median intervals, from which on an interval is a pause


class Measured(NamedTuple):
    """One line of the table."""

    sensor: str
    quantity: str
    unit: str
    value: float
    low: float
    high: float
    samples: int
    note: str = ''


def entry(
    sensor: str, quantity: str, unit: str, found: Interval, n: int, note: str = '',
) -> Measured:
    """Return a line of the table from a value with its interval and the number of samples."""
    return Measured(sensor, quantity, unit, *(float(v) for v in found), int(n), note)


def timing(sensor: str, stream: Stream, note: str = '') -> list[Measured]:
    """Return rate and sample intervals of a sensor, pauses excluded; a note for the rate."""
    gaps = np.diff(stream.t)
    if len(gaps) < 2 * STRETCHES:
        return []
    usual = np.median(gaps)
    short = gaps[gaps < PAUSE * usual]
    lines = [
        entry(sensor, 'interval', 'ms', Interval(*(1e3 * v for v in median(gaps))), len(gaps),
              f'{1e3 * gaps.min():.4g} to {1e3 * gaps.max():.4g}'),
        entry(sensor, 'rate', 'Hz', jackknife(
            lambda keep: float(1.0 / short[keep].mean()), len(short)), len(short),
            '; '.join(filter(None, ['pauses left out', note])))]
    return lines


def table(lines: list[Measured]) -> str:
    """Return the lines as text in columns."""
    rows = [('sensor', 'quantity', 'value', '95 % interval', 'unit', 'samples', '')]
    for line in lines:
        value, bounds = f'{line.value:.4g}', f'{line.low:.4g} to {line.high:.4g}'
        if not np.isfinite(line.value):
            value, bounds = '-', ''
        elif line.low == line.high:
            bounds = 'none'
        rows.append((line.sensor, line.quantity, value, bounds, line.unit, str(line.samples),
                     line.note))
    widths = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    return '\n'.join(
        '  '.join(cell.ljust(w) for cell, w in zip(row, widths)).rstrip() for row in rows)


def summary(found: list[list[Measured]]) -> list[Measured]:
    """Return the median over recordings of each quantity, from the lowest to the highest."""
    gathered: dict[tuple[str, str, str], list[float]] = {}
    for lines in found:
        for line in lines:
            if np.isfinite(line.value):
                key = (line.sensor, line.quantity, line.unit)
                gathered.setdefault(key, []).append(line.value)
    return [Measured(*key, float(np.median(x)), min(x), max(x), len(x))
            for key, x in gathered.items()]
