"""What a figure of the thesis claims, what was measured of it here, and the verdict."""

from __future__ import annotations

from collections.abc import Callable
import dataclasses
from typing import NamedTuple

from matplotlib.figure import Figure

REPRODUCED, PARTLY, NOT_REPRODUCED, NOTHING = (
    'reproduced', 'partly', 'not reproduced', 'nothing to measure')


class Measured(NamedTuple):
    """One number, or its range over seeds, and whether it is what the claim needs."""

    what: str
    low: float
    high: float
    unit: str
    wanted: str
    holds: bool

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
    """A figure or table of the thesis."""

    number: str
    says: str        # in our words
    flights: str     # scenario files, '' where nothing is flown
    examine: Callable[[], Result]

    @property
    def order(self) -> list[tuple[bool, int, str]]:
        """Return what sorts figures as the thesis has them."""
        first = self.number.split(',')[0]
        return [(not part.isdigit(), int(part) if part.isdigit() else 0, part)
                for part in first.split('.')]

    @property
    def title(self) -> str:
        """Return e.g. ``Figure 5.11``; a section keeps its own word."""
        return f'Figure{"s" if "," in self.number else ""} {self.number}'


CLAIMS: dict[str, Claim] = {}


def claim(number: str, says: str, flights: str = '') -> Callable:
    """Register a function as what examines a figure."""
    def register(examine: Callable[[], Result]) -> Callable[[], Result]:
        CLAIMS[number] = Claim(number, says, flights, examine)
        return examine
    return register


def verdict(result: Result) -> str:
    """Return the verdict on a figure, by what holds of it."""
    if not result.measured:
        return NOTHING
    held = [m.holds for m in result.measured]
    if all(held):
        return REPRODUCED
    return PARTLY if any(held) else NOT_REPRODUCED


def at_most(what: str, values: float | list[float], limit: float, unit: str = '') -> Measured:
    """Return a measurement that must not exceed a limit, for any seed."""
    low, high = _range(values)
    return Measured(what, low, high, unit, f'at most {limit:.3g}', high <= limit)


def at_least(what: str, values: float | list[float], limit: float, unit: str = '') -> Measured:
    """Return a measurement that must reach a limit, for every seed."""
    low, high = _range(values)
    return Measured(what, low, high, unit, f'at least {limit:.3g}', low >= limit)


def near(
    what: str, values: float | list[float], wanted: float, tolerance: float, unit: str = '',
) -> Measured:
    """Return a measurement that must be within a tolerance of a number, for every seed."""
    low, high = _range(values)
    return Measured(
        what, low, high, unit, f'{wanted:.4g} within {tolerance:.3g}',
        bool(wanted - tolerance <= low and high <= wanted + tolerance))


def _range(values: float | list[float]) -> tuple[float, float]:
    numbers = list(values) if isinstance(values, (list, tuple)) else [values]
    return float(min(numbers)), float(max(numbers))
