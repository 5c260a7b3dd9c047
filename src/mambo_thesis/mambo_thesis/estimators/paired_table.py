"""The comparison as tables, and whether the joint filter may be the default."""

from __future__ import annotations

import math
from typing import Any

from ..recordings.validate import Table
from .paired_rows import BETTER, rms, Row, UNDECIDED, WORSE

TITLES = {
    'thesis': 'Thesis trajectories, unknown slope, scale and latency of the flow',
    'slopes': 'Drift with a given slope, unknown scale and latency of the flow',
    'flow_deck': 'Flow deck of a Crazyflie, simulated',
    'run': 'The default flight of ./run',
    'faults': 'A sensor that fails in flight',
    'crazyflie': 'Crazyflie against motion capture',
    'rolling_spider': 'Rolling Spider against its sonar'}
"""Titles of the sections, in their order."""


def _number(x: float) -> str:
    return f'{x:.3g}' if math.isfinite(x) else '-'


def _percent(row: Row) -> tuple[str, str]:
    """Return the typical ratio less 1 and its interval, %."""
    value, low, high = (100.0 * x for x in row.ratio)
    return f'{value:+.1f}', '' if math.isnan(low) else f'{low:+.1f} to {high:+.1f}'


def section(name: str, rows: list[Row]) -> Table:
    """Return the table of a section."""
    others = list(rows[0].others)
    heads = ('case', 'quantity', 'bound', 'kalman', 'joint', *others, 'joint / kalman - 1 [%]',
             '95 %', 'better')
    return Table(TITLES[name], heads, ('',) * len(heads), [
        (row.case, row.quantity, _number(row.bound), _number(rms(row.kalman)),
         _number(rms(row.joint)), *(_number(row.others[other]) for other in others),
         *_percent(row), row.verdict) for row in rows])


def may_be_default(found: dict[str, list[Row]]) -> bool:
    """Return whether no row shows the joint filter to be worse."""
    return all(row.verdict != WORSE for rows in found.values() for row in rows)


def decision(found: dict[str, list[Row]]) -> str:
    """Return how many rows each estimator wins, and which rows speak against the joint filter."""
    every = [(TITLES[name], row) for name, rows in found.items() for row in rows]
    count = {verdict: sum(row.verdict == verdict for _, row in every)
             for verdict in (BETTER, UNDECIDED, WORSE)}
    lines = [f'Of {len(every)} rows the joint filter is better in {count[BETTER]}, worse in '
             f'{count[WORSE]}; {count[UNDECIDED]} are undecided.']
    lines += [f'- {said}: {title}, {row.case}, {row.quantity}: {_number(rms(row.joint))} against '
              f'{_number(rms(row.kalman))}' for verdict, said in (
                  (WORSE, 'worse'), (UNDECIDED, 'larger, but undecided'))
              for title, row in every
              if row.verdict == verdict and (row.larger or verdict == WORSE)]
    lines.append('No row is worse.' if may_be_default(found) else
                 'As it is worse in a row, it should not be the default estimator.')
    return '\n'.join(lines)


def numbers(found: dict[str, list[Row]]) -> dict[str, Any]:
    """Return everything as numbers for JSON; what is not finite as None."""
    def plain(x: float) -> float | None:
        return x if math.isfinite(x) else None
    return {'may_be_default': may_be_default(found), 'sections': {name: [
        {'case': row.case, 'quantity': row.quantity, 'compared': len(row.joint),
         'bound': plain(row.bound), 'kalman': plain(rms(row.kalman)),
         'joint': plain(rms(row.joint)),
         'others': {key: plain(x) for key, x in row.others.items()},
         'ratio': [plain(x) for x in row.ratio], 'better': row.verdict}
        for row in rows] for name, rows in found.items()}}
