"""One case of the comparison: what is flown or replayed, and what makes its rows."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from .paired_rows import Row


class Case(NamedTuple):
    """
    One case.

    Attributes
    ----------
    section, name
        Section of the tables, and name within it.
    rows
        Returns the rows, from the seeds and the names of other estimators to show besides.

    """

    section: str
    name: str
    rows: Callable[[range, list[str]], list[Row]]
