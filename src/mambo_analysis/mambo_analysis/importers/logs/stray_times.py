"""
Rows of a table whose time is out of order: :func:`stray_rows`.

A logger that stamps what it receives writes a stale sample now and then, or a wrong time. Such a
row is left out, and told with its time. It is not sorted in: its values may be as old as its time.
Times that stay behind are no stray ones: a clock was set back, or a counter began again, and what
comes later belongs to another recording. These are refused.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable
from pathlib import Path

from mambo_bags.mcap_reader import BagError
from mambo_signals.resample import Bools, Floats, runs
import numpy as np

from ..checks.plausible import FEW

LONGEST_RUN = 2  # rows one after another; more are times of another clock
SHOWN = 3        # rows of a line


def too_many(count: int, rows: int) -> bool:
    """Return whether so many of some rows are more than a few; one is always a few."""
    return count > max(1.0, FEW * rows)


def out_of_order(t: Floats) -> Bools:
    """
    Return the fewest rows without which times never go back; of equal choices the later rows.

    Parameters
    ----------
    t : (n,)
        In the order of the file, finite.

    """
    stray = np.zeros(len(t), bool)
    if not (np.diff(t) < 0.0).any():
        return stray
    # longest sequence that does not rise, from the end: for each length that with the best last
    # time, and for each row that before it
    last: list[float] = []
    row_of: list[int] = []
    before = []
    for row, time in enumerate((-t[::-1]).tolist()):
        length = bisect_right(last, time)
        before.append(row_of[length - 1] if length else -1)
        last[length:length + 1], row_of[length:length + 1] = [time], [row]
    stray[:] = True
    row = row_of[-1]
    while row >= 0:
        stray[len(t) - 1 - row] = False
        row = before[row]
    return stray


def stray_rows(
    path: Path, column: str, t: Floats, row_name: Callable[[int], str],
) -> tuple[Bools, list[str]]:
    """
    Return which rows to leave out as their time is out of order, (n,), and a line about them.

    Parameters
    ----------
    path
        Of the file, for an error.
    column
        Name of the times.
    t : (n,)
        As they are in the file, finite.
    row_name
        Returns where a row is, by its index.

    Raises
    ------
    BagError
        If they are more than a few, or more than ``LONGEST_RUN`` one after another.

    """
    stray = out_of_order(t)
    if not stray.any():
        return stray, []
    rows = np.flatnonzero(stray)
    if too_many(len(rows), len(t)) or np.diff(runs(stray)).max() > LONGEST_RUN:
        row = int(np.flatnonzero(np.diff(t) < 0.0)[0]) + 1
        raise BagError(
            f'{path}: {row_name(row)}: the time in column {column} does not increase: '
            f'{t[row]:.15g} after {t[row - 1]:.15g}; {len(rows)} of {len(t)} rows are out of '
            'order: import each part alone if the clock was set back or a counter began again '
            'there; sort the rows by time if they are only mixed up')
    kept, shown = np.flatnonzero(~stray), []
    for row in rows[:SHOWN].tolist():
        i = int(np.searchsorted(kept, row))
        beside = ([f'after {t[kept[i - 1]]:.15g}'] if i else []) + (
            [f'before {t[kept[i]]:.15g}'] if i < len(kept) else [])
        shown.append(f'{t[row]:.15g} {" and ".join(beside)} in {row_name(row)}')
    more = f'; and {len(rows) - SHOWN} more' if len(rows) > SHOWN else ''
    return stray, [f'{column}: {len(rows)} of {len(t)} rows {"is" if len(rows) == 1 else "are"} '
                   f'out of order and left out: {"; ".join(shown)}{more}']
