"""Columns of a CSV or Parquet table, read in a process of bounded memory and time."""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Any
import warnings

from mambo_bags.command import nearest
from mambo_bags.mcap_reader import BagError
from mambo_model import limits
import numpy as np
from numpy.typing import NDArray
import pandas
from pyarrow import parquet

from . import bounded
from .common import LARGEST, quoted, shortened

PARQUET = ('.parquet', '.pq')
Read = tuple[dict[str, Any], list[str]]  # wanted columns that there are; names of all


def _names(names: Any, wanted: list[str]) -> list[str]:
    """Return names of columns without blanks; ValueError if a wanted one stands there twice."""
    out = [str(name).strip() for name in names]
    count = Counter(out)
    twice = next((name for name in wanted if count[name] > 1), None)
    if twice is not None:
        raise ValueError(f'{count[twice]} columns have the name {quoted(twice)}')
    return out


def _parquet(path: Path, wanted: list[str]) -> Read:
    """Return the wanted columns of a Parquet file; in a process of its own."""
    try:
        with parquet.ParquetFile(path) as file:
            given = file.schema_arrow.names
            names = _names(given, wanted)
            chosen = [one for one, name in zip(given, names, strict=True) if name in wanted]
            if 8 * file.metadata.num_rows * len(chosen) > limits.unpacked(path.stat().st_size):
                raise MemoryError
            frame = file.read(chosen).to_pandas(ignore_metadata=True)
    except OSError:
        raise ValueError('its content is damaged') from None
    return {str(name).strip(): frame[name].to_numpy() for name in frame.columns}, names


def _csv(path: Path, wanted: list[str], delimiter: str) -> Read:
    """Return the wanted columns of a CSV file; in a process of its own."""
    options: dict[str, Any] = {
        'sep': delimiter, 'skipinitialspace': True, 'encoding': 'utf-8-sig'}
    try:
        header = pandas.read_csv(
            path, header=None, nrows=1, dtype=object, keep_default_na=False, **options)
        names = _names(header.iloc[0], wanted)
        with warnings.catch_warnings():
            warnings.simplefilter('error', pandas.errors.ParserWarning)
            frame = pandas.read_csv(path, index_col=False, on_bad_lines='error', **options)
    except pandas.errors.ParserWarning:
        raise ValueError('the rows have more cells than the header has names: is a comma the '
                         'decimal mark, or a name missing?') from None
    except pandas.errors.ParserError as error:
        if 'out of memory' in str(error):
            raise MemoryError from None
        raise ValueError(str(error).rpartition('C error: ')[2]) from None
    return {name: frame.iloc[:, i].to_numpy() for i, name in enumerate(names)
            if name in wanted}, names


def read_table(path: Path, wanted: list[str], delimiter: str) -> tuple[dict[str, Any], list[str]]:
    """
    Return {column: (n,) numbers, NaN where a cell is empty} and the names of other columns.

    Parameters
    ----------
    path
        Parquet by its ending, else CSV with a header, which may be compressed.
    wanted
        Columns to read.
    delimiter
        Of a CSV file.

    Raises
    ------
    BagError
        If it is no table, lacks a column, has it twice, or holds something else than numbers.

    """
    def read(file: Path) -> Read:
        """Read it, in a process of its own."""
        if file.suffix.lower() in PARQUET:
            return _parquet(file, wanted)
        return _csv(file, wanted, delimiter)
    try:
        found, names = bounded.call(read, path)
    except bounded.UnreadableError as error:
        raise BagError(f'{path}: no table that can be read: {error}') from None
    except OSError as error:
        raise BagError(f'{path}: {error.strerror or error}') from None
    missing = [name for name in wanted if name not in found]
    if missing:
        raise BagError(f'{path}: no column {quoted(missing[0])}{nearest(missing[0], names)}; '
                       f'it has {shortened(names)}')
    return ({name: numbers(path, name, found[name]) for name in wanted},
            [name for name in names if name not in wanted])


def numbers(path: Path, name: str, found: Any) -> NDArray[np.float64]:
    """Return a column as numbers, (n,); BagError naming the row of what is none."""
    if found.dtype.kind in 'iufb':
        values = found.astype(float)
    else:
        try:
            values = pandas.to_numeric(found, errors='coerce').astype(float)
        except OverflowError:  # whole numbers of hundreds of digits, as Python has them
            values = pandas.to_numeric([f'{x}.' if isinstance(x, int) else x for x in found],
                                       errors='coerce').astype(float)
        bad = np.flatnonzero(np.isnan(values) & ~pandas.isna(found))
        if len(bad):
            raise BagError(f'{path}: row {bad[0] + 2}, column {name}: '
                           f'{quoted(str(found[bad[0]]))} is not a number')
    wrong = np.flatnonzero(np.abs(values) >= LARGEST)
    if len(wrong):
        raise BagError(f'{path}: row {wrong[0] + 2}, column {name}: {values[wrong[0]]:g} is '
                       'absurd')
    return values
