"""Barometer: rate, resolution and noise."""

from __future__ import annotations

from ..allan import deviation_at_rest
from ..recording import Recording
from .phases import stretch_at_rest
from .repeats import filled, only_changes, rate_note, shown, smallest_step
from .statistics import STRETCHES, white_sigma
from .table import entry, Measured, timing


def measure(recording: Recording) -> list[Measured]:
    """Return rate, resolution and noise of the barometer."""
    stream = recording.barometer
    if stream is None or len(stream.t) < 4 * STRETCHES:
        return []
    lines, n = timing('barometer', stream, rate_note(recording, 'barometer')), len(stream.t)
    step = smallest_step(stream.values)
    if step:
        lines.append(Measured('barometer', 'smallest change', 'Pa', step, step, step, n - 1))
    full = white_sigma(filled(stream.t, stream.values)) if only_changes(
        recording, 'barometer') else None
    found, note = shown(white_sigma(stream.values), step, full)
    lines.append(entry('barometer', 'noise from value to value', 'Pa', found, n,
                       note or 'what is averaged before is not in it'))
    rest = stretch_at_rest(recording)
    if rest is not None:
        times = recording.gyro.t[rest]
        still = stream.values[(stream.t >= times[0]) & (stream.t <= times[-1])]
        if len(still) > 4 * STRETCHES:
            found, note = shown(deviation_at_rest(still), step)
            lines.append(entry('barometer', 'noise at rest', 'Pa', found, len(still), note))
    return lines
