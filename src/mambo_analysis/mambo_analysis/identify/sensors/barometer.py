"""Barometer: rate, resolution and noise."""

from __future__ import annotations

import numpy as np

from ..allan import deviation_at_rest
from ..recording import Recording
from .phases import stretch_at_rest
from .statistics import STRETCHES, white_sigma
from .table import entry, Measured, timing


def measure(recording: Recording) -> list[Measured]:
    """Return rate, resolution and noise of the barometer."""
    stream = recording.barometer
    if stream is None or len(stream.t) < 4 * STRETCHES:
        return []
    lines, n = timing('barometer', stream), len(stream.t)
    changes = np.abs(np.diff(stream.values))
    least = changes[changes > 0.0].min(initial=np.inf)
    if np.isfinite(least):
        lines.append(Measured('barometer', 'smallest change', 'Pa', *[float(least)] * 3, n - 1))
    lines.append(entry('barometer', 'noise from value to value', 'Pa',
                       white_sigma(stream.values), n, 'what is averaged before is not in it'))
    rest = stretch_at_rest(recording)
    if rest is not None:
        times = recording.gyro.t[rest]
        still = stream.values[(stream.t >= times[0]) & (stream.t <= times[-1])]
        if len(still) > 4 * STRETCHES:
            lines.append(entry('barometer', 'noise at rest', 'Pa', deviation_at_rest(still),
                               len(still)))
    return lines
