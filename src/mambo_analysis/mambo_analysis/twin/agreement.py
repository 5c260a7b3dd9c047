"""
Whether flights of one vehicle agree: the same parameter from each, with its interval.

The tilt holds the bias of the accelerometer at this turn-on and the place of the battery: it may
differ from flight to flight. The other parameters are those of the vehicle.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
import math

from ..identify.regression import plus_minus, Value
from .force import fit_force, Found, NAMES
from .recorded import Recorded

COMPARED = tuple(name for name in NAMES if name != 'thrust')
"""The thrust belongs to the mean command and voltage of its flight."""
OF_FLIGHT = ('tilt x', 'tilt y')


def agree(a: Value, b: Value) -> bool:
    """Return whether two values differ by less than their difference's interval."""
    return abs(a.value - b.value) <= math.hypot(a.half, b.half)


def identified(flights: Sequence[Recorded]) -> list[tuple[str, Found]]:
    """Return the name of each flight, and what it tells alone."""
    return [(one.name, fit_force(one)) for one in flights]


def table(found: Sequence[tuple[str, Found]]) -> tuple[str, list[str], list[list[str]]]:
    """Return caption, head and rows: each parameter by flight, and how many pairs agree."""
    shown = [one.shown for _, one in found]
    body, counts = [], []
    for name in COMPARED:
        values = [one.get(name) for one in shown]
        pairs = list(combinations([one for one in values if one is not None], 2))
        cells = ['-' if one is None else plus_minus(one.value, one.half) for one in values]
        unit = found[0][1].values[name].unit
        counts.append((name, sum(agree(a, b) for a, b in pairs), len(pairs)))
        body.append([f'{name} [{unit}]', *cells, '{1} of {2}'.format(*counts[-1])])
    for title, left_out in (('all', ()), ('all but tilt', OF_FLIGHT)):
        some = [row for row in counts if row[0] not in left_out]
        body.append([title, *('' for _ in found),
                     f'{sum(row[1] for row in some)} of {sum(row[2] for row in some)}'])
    return ('each flight alone, interval of 95 %, axes of body FLU; pairs of flights that agree',
            ['parameter', *(name for name, _ in found), 'agree'], body)
