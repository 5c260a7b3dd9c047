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
    REPRODUCED: 'all measurements hold, the simulator does not contain the result, and at least '
                'one mutated drone breaks the claim',
    BY_CONSTRUCTION: 'all measurements hold, but the simulator contains the result, or no mutated '
                     'drone can break the claim',
    PARTLY: 'some measurements hold',
    NOT_REPRODUCED: 'no measurement holds',
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
    expected: str
    holds: bool
    reason: str = ''  # of the limit or the tolerance

    def __str__(self) -> str:
        value = f'{self.low:.4g}'
        if f'{self.high:.4g}' != value:
            value = f'{value} to {self.high:.4g}'
        return f'{value} {self.unit}'.rstrip()


class Result(NamedTuple):
    """Measurements, the redrawn figure and a remark: the return value of a figure's function."""

    measured: list[Measured]
    figure: Figure | None = None
    remark: str = ''  # explains what does not hold or is not measured


@dataclasses.dataclass(frozen=True)
class Claim:
    """
    A figure, table or section of the thesis.

    Attributes
    ----------
    number
        Number of the figure, or ``Table`` or ``Section`` with its number.
    statement
        The claim, in our words.
    scenario
        Scenario file, or '' if nothing is flown.
    examine
        Function that measures and draws it.
    contains
        The part of it that the simulator contains by construction.
    tests
        What the measurements therefore test.
    broken_by
        Names of mutations, see :mod:`mambo_thesis.figures.truths`, for which fewer of its
        measurements hold. Others may break it too.
    given
        Whether the simulator contains the result itself.

    """

    number: str
    statement: str
    scenario: str
    examine: Callable[[], Result]
    contains: str = ''
    tests: str = ''
    broken_by: tuple[str, ...] = ()
    given: bool = False

    @property
    def place(self) -> str:
        """Return the first number, such as ``4.1``, without ``Table`` or ``Section``."""
        return self.number.split(',')[0].rpartition(' ')[2]

    @property
    def order(self) -> list[tuple[bool, int, str]]:
        """Return the key that sorts figures in the order of the thesis, tables after figures."""
        word = self.title.split()[0]
        parts = [*self.place.split('.'), *([] if word.startswith('Figure') else [word])]
        return [(not part.isdigit(), int(part) if part.isdigit() else 0, part) for part in parts]

    @property
    def title(self) -> str:
        """Return the heading, such as ``Figure 5.11``, ``Figures 4.1, 4.2`` or ``Table 2.1``."""
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
    number: str, statement: str, scenario: str = '', *, contains: str = '', tests: str = '',
    broken_by: tuple[str, ...] = (), given: bool = False,
) -> Callable:
    """Register the decorated function as the one that examines a figure; see :class:`Claim`."""
    def register(examine: Callable[[], Result]) -> Callable[[], Result]:
        CLAIMS[number] = Claim(
            number, statement, scenario, examine, contains, tests, broken_by, given)
        return examine
    return register


def verdict(result: Result) -> str:
    """Return the verdict by how many measurements hold, whatever the simulator contains."""
    if not result.measured:
        return NOTHING
    holds = [m.holds for m in result.measured]
    if all(holds):
        return REPRODUCED
    return PARTLY if any(holds) else NOT_REPRODUCED


def at_most(what: str, values: float | list[float], limit: float, unit: str = '',
            reason: str = '') -> Measured:
    """Return a measurement that must not exceed a limit for any seed."""
    low, high = _range(values)
    return Measured(what, low, high, unit, f'at most {limit:.3g}', high <= limit, reason)


def at_least(what: str, values: float | list[float], limit: float, unit: str = '',
             reason: str = '') -> Measured:
    """Return a measurement that must reach a limit for every seed."""
    low, high = _range(values)
    return Measured(what, low, high, unit, f'at least {limit:.3g}', low >= limit, reason)


def near(
    what: str, values: float | list[float], expected: float, tolerance: float, unit: str = '',
    reason: str = '',
) -> Measured:
    """Return a measurement that must be within a tolerance of a number for every seed."""
    low, high = _range(values)
    return Measured(
        what, low, high, unit, f'{expected:.4g} within {tolerance:.3g}',
        bool(expected - tolerance <= low and high <= expected + tolerance), reason)


def _range(values: float | list[float]) -> tuple[float, float]:
    """Return the smallest and the largest value; NaN if any value is NaN, which fails a claim."""
    return float(np.min(values)), float(np.max(values))
