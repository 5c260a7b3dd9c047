"""The claims of the figures of the thesis, the measurements that test them, and verdicts."""

from __future__ import annotations

from collections.abc import Callable
import dataclasses
from typing import NamedTuple

from matplotlib.figure import Figure
import numpy as np

REPRODUCED, BY_CONSTRUCTION, PARTLY, NOT_REPRODUCED, NOTHING = (
    'reproduced', 'by construction', 'partly', 'not reproduced', 'nothing to measure')
VERDICTS = {
    REPRODUCED: 'all that was measured holds, the simulator does not contain it, and at least one '
                'mutated truth breaks it',
    BY_CONSTRUCTION: 'all holds, but the simulator contains what is shown, or no mutated truth '
                     'can break it',
    PARTLY: 'some of it holds',
    NOT_REPRODUCED: 'nothing of it holds',
    NOTHING: 'photographs and diagrams'}
"""Every verdict and what it means."""


class Measured(NamedTuple):
    """
    One measured number, or its range over the seeds.

    Attributes
    ----------
    what
        The quantity, in words.
    low, high
        Its smallest and largest value over the seeds.
    unit
    expected
        The condition that the claim sets, in words.
    holds
        Whether every seed meets it.

    """

    what: str
    low: float
    high: float
    unit: str
    wanted: str
    holds: bool
    reason: str = ''  # of the limit or the tolerance

    def __str__(self) -> str:
        value = f'{self.low:.4g}'
        if f'{self.high:.4g}' != value:
            value = f'{value} to {self.high:.4g}'
        return f'{value} {self.unit}'.rstrip()


class Result(NamedTuple):
    """What a figure's function returns."""

    measured: list[Measured]
    figure: Figure | None = None
    why_not: str = ''  # for what does not hold, or is not measured: the reason


@dataclasses.dataclass(frozen=True)
class Claim:
    """
    A figure, table or section of the thesis.

    Attributes
    ----------
    number
        Of the figure, or a table or section with that word.
    says
        What it claims, in our words.
    flights
        Scenario file, '' where nothing is flown.
    examine
        Measures it.
    contains
        What the simulator has of it by construction.
    tests
        What is then left to test.
    broken_by
        Names of mutated truths, see :mod:`mambo_thesis.figures.truths`, for which less of it
        holds; others may break it too.
    given
        Whether the simulator contains what is shown.

    """

    number: str
    says: str
    flights: str
    examine: Callable[[], Result]
    contains: str = ''
    tests: str = ''
    broken_by: tuple[str, ...] = ()
    given: bool = False

    @property
    def place(self) -> str:
        """Return the number of the first figure, ``4.1``, without the word of a table."""
        return self.number.split(',')[0].rpartition(' ')[2]

    @property
    def order(self) -> list[tuple[bool, int, str]]:
        """Return what sorts figures as the thesis has them, a table after the figure."""
        word = self.title.split()[0]
        parts = [*self.place.split('.'), *([] if word.startswith('Figure') else [word])]
        return [(not part.isdigit(), int(part) if part.isdigit() else 0, part) for part in parts]

    @property
    def title(self) -> str:
        """Return e.g. ``Figure 5.11``; a section or a table keeps its own word."""
        if ' ' in self.number.split(',')[0]:
            return self.number
        return f'Figure{"s" if "," in self.number else ""} {self.number}'

    def verdict(self, result: Result) -> str:
        """Return the verdict on what was measured."""
        found = verdict(result)
        return BY_CONSTRUCTION if found == REPRODUCED and (
            self.given or not self.broken_by) else found


CLAIMS: dict[str, Claim] = {}


def claim(
    number: str, says: str, flights: str = '', *, contains: str = '', tests: str = '',
    broken_by: tuple[str, ...] = (), given: bool = False,
) -> Callable:
    """Register a function as what examines a figure; arguments as of :class:`Claim`."""
    def register(examine: Callable[[], Result]) -> Callable[[], Result]:
        CLAIMS[number] = Claim(number, says, flights, examine, contains, tests, broken_by, given)
        return examine
    return register


def verdict(result: Result) -> str:
    """Return the verdict by what holds alone, whatever the simulator contains."""
    if not result.measured:
        return NOTHING
    held = [m.holds for m in result.measured]
    if all(held):
        return REPRODUCED
    return PARTLY if any(held) else NOT_REPRODUCED


def at_most(what: str, values: float | list[float], limit: float, unit: str = '',
            reason: str = '') -> Measured:
    """Return a measurement that must not exceed a limit, for any seed."""
    low, high = _range(values)
    return Measured(what, low, high, unit, f'at most {limit:.3g}', high <= limit, reason)


def at_least(what: str, values: float | list[float], limit: float, unit: str = '',
             reason: str = '') -> Measured:
    """Return a measurement that must reach a limit, for every seed."""
    low, high = _range(values)
    return Measured(what, low, high, unit, f'at least {limit:.3g}', low >= limit, reason)


def near(
    what: str, values: float | list[float], wanted: float, tolerance: float, unit: str = '',
    reason: str = '',
) -> Measured:
    """Return a measurement that must be within a tolerance of a number, for every seed."""
    low, high = _range(values)
    return Measured(
        what, low, high, unit, f'{wanted:.4g} within {tolerance:.3g}',
        bool(wanted - tolerance <= low and high <= wanted + tolerance), reason)


def _range(values: float | list[float]) -> tuple[float, float]:
    """Return the smallest and the largest value; NaN if any value is NaN, which fails a claim."""
    return float(np.min(values)), float(np.max(values))
