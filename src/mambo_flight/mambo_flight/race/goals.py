"""
The goals for tracking, and which controller reaches them.

An error is the median over the draws of the RMS error of a flight, of the worst course. The course
``step`` does not count, because no controller follows a jump of 1 m within 15 mm.
"""

from __future__ import annotations

from collections.abc import Sequence

from .comparison import AIDED, TRUE
from .result import length, Result

WRONG = 'twenty_percent'
ON_TRUTH, ON_AIDED = 0.015, 0.040  # m
LESS = 0.78  # of the error of the cascade on the fast circle
SURVIVED = 0.99
JUMPS = ('step',)
_MARKS = {True: 'reached', False: 'missed'}


def worst(found: Sequence[Result], entrant: str, state: str) -> float | None:
    """Return the worst error with mass and drag wrong [m], None if that was not flown."""
    return max((r.rms for r in found if (r.entrant, r.condition, r.state) == (
        entrant, WRONG, state) and r.course not in JUMPS), default=None)


def reduction(found: Sequence[Result], entrant: str) -> float | None:
    """Return how far the error on the fast circle is below that of the cascade, a share."""
    fast = {r.entrant: r.rms for r in found
            if (r.course, r.condition, r.state) == ('circle_fast', 'known', TRUE)}
    if entrant not in fast or 'cascaded' not in fast:
        return None
    return 1.0 - fast[entrant] / fast['cascaded']


def alive(found: Sequence[Result], entrant: str) -> float | None:
    """Return the share of survivors with mass and drag wrong, None if that was not flown."""
    flown = [r for r in found if (r.entrant, r.condition) == (entrant, WRONG)]
    flights = sum(r.flights for r in flown)
    return sum(r.survived * r.flights for r in flown) / flights if flights else None


def _cell(value: float | None, reached: bool, text: str) -> str:
    return '' if value is None else f'{text}, {_MARKS[reached]}'


def lines(found: Sequence[Result]) -> list[str]:
    """Return the section of a page."""
    out = [
        '## Goals', '',
        'Mass and drag are wrong by 20 %, in gusts of 0.5 m/s; errors are those of the worst '
        'course but `step`, whose reference jumps by 1 m. The fast circle is compared with '
        '`cascaded`, everything known, on the true state.', '',
        f'|  | true state: {1e3 * ON_TRUTH:.0f} mm | aided by motion capture: '
        f'{1e3 * ON_AIDED:.0f} mm | fast circle: {100 * LESS:.0f} % less | survived: '
        f'{100 * SURVIVED:.0f} % |',
        '| --- | ---: | ---: | ---: | ---: |']
    for name in dict.fromkeys(r.entrant for r in found):
        true, aided = worst(found, name, TRUE), worst(found, name, AIDED)
        less, survived = reduction(found, name), alive(found, name)
        cells = (
            _cell(true, (true or 0.0) <= ON_TRUTH, f'{length(true or 0.0)} mm'),
            _cell(aided, (aided or 0.0) <= ON_AIDED, f'{length(aided or 0.0)} mm'),
            _cell(less, (less or 0.0) >= LESS, f'{100 * (less or 0.0):.1f} %'),
            _cell(survived, (survived or 0.0) >= SURVIVED, f'{100 * (survived or 0.0):.1f} %'))
        out.append(f'| `{name}` | {" | ".join(cells)} |')
    return [*out, '']
