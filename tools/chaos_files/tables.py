"""The table at the end of a campaign."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence


def table(
    tried: Counter[tuple[str, str]], names: Sequence[str], outcomes: Sequence[str],
    width: int = 10,
) -> str:
    """
    Return how often each outcome came, a row for each kind, as text.

    Parameters
    ----------
    tried
        Numbers by (kind, outcome).
    names
        Kinds, in their order.
    outcomes
        Headings of the columns.
    width
        Of the column of the kinds, characters.

    """
    rows = [f'{"":<{width}}' + ''.join(f'{outcome:>9}' for outcome in outcomes)]
    rows += [f'{name:<{width}}' + ''.join(f'{tried[name, outcome]:>9}' for outcome in outcomes)
             for name in names]
    return '\n'.join(rows)


def with_outcome(tried: Counter[tuple[str, str]], wanted: str) -> int:
    """Return how often an outcome came, of all kinds."""
    return sum(number for (_, outcome), number in tried.items() if outcome == wanted)
