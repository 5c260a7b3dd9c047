"""Columns of bench files: CSV with a header, MATLAB files, JSON of the Crazyflie client."""

from __future__ import annotations

from collections import Counter
import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..importers import bounded, mat_file
from ..importers.checks import plausible
from .regression import IdentifyError

Floats = NDArray[np.float64]
Table = dict[str, tuple[Floats | None, Floats]]  # name: (its own times or None, values)
_TIMES = ('t', 'time', 'times', 'timestamp', 'seconds')  # usual names of columns of times


def read(path: Path) -> Table:
    """
    Return every column of numbers of a file.

    Parameters
    ----------
    path
        ``.csv`` with one line of names; ``.mat`` whose vectors, and columns of matrices as
        ``name[0]``, are columns (cells and structures too: ``name[1]``, ``name.field``);
        ``.json`` as ``{source: {name: {time, data}}}`` in any depth.

    Raises
    ------
    IdentifyError
        Naming the file if it is missing, foreign or has no numbers.

    """
    readers = {'.csv': _csv, '.mat': _mat, '.json': _json}
    if path.suffix.lower() not in readers:
        raise IdentifyError(f'{path}: is no {", ".join(readers)} file or bag')
    try:
        table = bounded.call(readers[path.suffix.lower()], path)
    except OSError as error:
        raise IdentifyError(f'{path}: {error.strerror or error}') from None
    except bounded.UnreadableError as error:
        raise IdentifyError(f'{path}: cannot be read ({error})') from None
    if not table:
        raise IdentifyError(f'{path}: holds no column of numbers')
    return table


def _csv(path: Path) -> Table:
    """Return the columns of a file with names in its first row; an empty field is NaN."""
    with path.open(newline='', encoding='utf-8-sig') as file:
        rows = [row for row in csv.reader(file) if row]
    if not rows:
        return {}
    names = [name.strip() for name in rows[0]]
    if len(set(names)) < len(names):
        raise ValueError(f'several columns have the name {Counter(names).most_common(1)[0][0]}')
    for number, row in enumerate(rows[1:], 2):
        if len(row) != len(names):
            raise ValueError(f'row {number} has {len(row)} fields, the first one {len(names)}: '
                             'separate columns by commas, and write numbers with decimal points')
    values = [[float(field) if field.strip() else np.nan for field in row] for row in rows[1:]]
    return {name: (None, column) for name, column in zip(names, np.array(values, float).T)}


def _mat(path: Path) -> Table:
    table: Table = {}
    for name, value in mat_file.load(path.read_bytes()).items():
        _gather(name, value, table)
    return table


def _gather(name: str, value: Any, table: Table) -> None:
    """Add the columns below one name of a MATLAB file."""
    if isinstance(value, dict):
        for key, below in value.items():
            _gather(f'{name}.{key}', below, table)
    elif isinstance(value, np.ndarray) and value.dtype == object or isinstance(value, list):
        for number, below in enumerate(value):
            _gather(f'{name}[{number}]', below, table)
    elif isinstance(value, np.ndarray) and value.dtype.kind in 'fiub':
        if value.ndim == 1:
            table[name] = None, value.astype(float)
        elif value.ndim == 2:
            for number, column in enumerate(value.T):
                table[f'{name}[{number}]'] = None, column.astype(float)


def _json(path: Path) -> Table:
    """Return the columns of all objects with ``time`` and ``data``, wherever they are."""
    table: Table = {}

    def walk(name: str, value: Any) -> None:
        """Add the columns below one name."""
        if not isinstance(value, dict):
            return
        if 'data' in value and 'time' in value:
            table[name] = np.array(value['time'], float), np.array(value['data'], float)
            return
        for key, below in value.items():
            walk(f'{name}.{key}' if name else key, below)
    walk('', json.loads(path.read_text(encoding='utf-8')))
    return table


def column(table: Table, name: str, path: Path) -> tuple[Floats | None, Floats]:
    """
    Return one column by its name, or by the last part of its dotted name.

    Raises
    ------
    IdentifyError
        Naming those that there are, if none or several match.

    """
    found = [key for key in table if key == name] or [
        key for key in table if key.endswith(f'.{name}')]
    if len(found) != 1:
        reason = 'several columns' if found else 'no column'
        raise IdentifyError(f'{path}: {reason} {name}; it has {", ".join(table)}')
    return table[found[0]]


def times(
    own: Floats | None, table: Table, name: str, rate: float, count: int, path: Path,
) -> Floats:
    """
    Return the times of a column, (n,) s, from 0.

    Parameters
    ----------
    own
        Times that the column came with.
    table, name
        Where they are otherwise: a column, for example ``t``.
    rate : Hz
        Of a column without times; 0: none.
    count
        n.
    path
        For errors.

    Raises
    ------
    IdentifyError
        If there are neither times nor a rate, or both; naming the row if times do not rise.
    mambo_bags.mcap_reader.BagError
        If the times cannot be in s.

    """
    there = name if name in table else next(
        (one for one in table if one.rpartition('.')[2].lower() in _TIMES), '')
    named = '' if there == name else f' and give --time {there}'
    if rate > 0.0:
        if own is not None or there:
            raise IdentifyError(
                f'--rate: {path} has times'
                f'{"" if own is not None else f" in its column {there}"}: leave it out'
                f'{"" if own is not None else named}')
        return np.arange(count) / rate
    if own is None:
        if name not in table:
            raise IdentifyError(f'{path}: no column {name}; give --time {there}' if there else (
                f'{path}: no times; name their column with --time or give --rate'))
        own = table[name][1]
    where = f'{path}: {f"column {name}" if name in table else "times"}'
    back = np.flatnonzero(np.diff(own) <= 0.0)
    if len(back):
        row = int(back[0]) + 1
        first = 1 + (path.suffix.lower() == '.csv')  # below the names
        raise IdentifyError(
            f'{where}: the time goes from {own[row - 1]:.6g} to {own[row]:.6g} s in row '
            f'{row + first}: give times that rise, one recording in a file')
    plausible.refuse_pace(where, own)
    return own - own[0] if len(own) else own
