"""Types of numeric options: every number of a command line has limits."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any


def real(
    low: float, high: float, unit: str = '', above: bool = False,
) -> Callable[[str], float]:
    """
    Return the type of an option that takes a number within limits.

    Parameters
    ----------
    low, high
        Smallest and largest value. Only infinite limits admit infinite values; NaN is refused.
    unit
        Shown in the message.
    above
        Whether ``low`` itself is refused.

    Returns
    -------
    read
        Function of a text that returns the number or raises argparse.ArgumentTypeError.

    """
    return _bounded(float, 'a number', low, high, unit, above)


def whole(low: int, high: int) -> Callable[[str], int]:
    """Return the type of an option that takes a whole number from ``low`` to ``high``."""
    return _bounded(int, 'a whole number', low, high, '', False)


def declared(
    default: Any, low: float, high: float, unit: str = '', above: bool = False,
) -> Callable[[str], Any]:
    """Return the type of an option that sets a parameter: whole as its default, in its range."""
    if isinstance(default, int):
        return whole(int(low), int(high))
    return real(low, high, '' if unit == '1' else unit, above)


def _bounded(
    convert: type, kind: str, low: float, high: float, unit: str, above: bool,
) -> Callable[[str], Any]:
    start = f'more than {low:.10g} and at most' if above else f'within {low:.10g} to'
    limits = f'{start} {high:.10g}{unit and f" {unit}"}'

    def read(text: str) -> Any:
        """Return the number of a text."""
        try:
            value = convert(text)
        except ValueError:
            raise argparse.ArgumentTypeError(f'{text!r} is not {kind}') from None
        if not low <= value <= high or (above and value == low):
            raise argparse.ArgumentTypeError(f'{text} must be {limits}')
        return value
    return read


SLOPE = real(-100.0, 100.0, '1/m')
TIME = real(-1e12, 1e12, 's')
"""A time of a recording; stamps since 1970 are 2e9 s."""
MOST_WORKERS = 1024
WORKERS = whole(1, MOST_WORKERS)
FLIGHT = whole(0, 10_000_000)
