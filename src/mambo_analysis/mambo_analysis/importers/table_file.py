"""Columns of a CSV or Parquet table, read in a process of bounded memory and time."""

from __future__ import annotations

from collections import Counter
import csv
from pathlib import Path
import re
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
ARROW = ('.arrow', '.feather', '.ipc')
WITHOUT_LINES = (*PARQUET, '.ulg', '.mat', '.gz', '.bz2', '.zip', '.xz', '.zst', '.tar')
DELIMITERS = (',', ';', '\t', '|', ' ')
Read = tuple[dict[str, Any], list[str]]  # wanted columns that there are; names of all


def _names(names: Any, wanted: list[str]) -> list[str]:
    """Return names of columns without blanks; ValueError if a wanted one stands there twice."""
    out = [str(name).strip() for name in names]
    count = Counter(out)
    twice = next((name for name in wanted if count[name] > 1), None)
    if twice is not None:
        raise ValueError(f'{count[twice]} columns have the name {quoted(twice)}')
    return out


def _delimiter(names: list[str], wanted: list[str]) -> str:
    """Return what separates the wanted names in a header that was read as one name, or ''."""
    if len(names) != 1:
        return ''
    return next((one for one in DELIMITERS if len(
        {name.strip(' "') for name in names[0].split(one)} & set(wanted)) > 1), '')


def row_name(path: Path, row: int, delimiter: str) -> str:
    """
    Return where a row of a table is, for an error: its line, or else its number.

    Parameters
    ----------
    path
    row
        Index in the data, from 0.
    delimiter
        Of a CSV file.

    Returns
    -------
    ``line 203`` of a CSV file, in which blank lines count; ``row 102 of the data`` of others.

    """
    number = f'row {row + 1} of the data'
    if path.suffix.lower() in WITHOUT_LINES:
        return number
    try:
        with path.open(encoding='utf-8-sig', newline='') as file:
            reader = csv.reader(file, delimiter=delimiter, skipinitialspace=True)
            left, line = row + 1, 1  # rows to pass, with the header; line at which one begins
            for cells in reader:
                if len(cells) > 1 or ''.join(cells).strip():
                    if not left:
                        return f'line {line}'
                    left -= 1
                line = reader.line_num + 1
    except (OSError, ValueError, TypeError, csv.Error):
        pass  # a character or a cell that only pandas reads
    return number


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
    with path.open('rb') as file:
        if re.match(rb'(\xef\xbb\xbf)?\s*[{\[]\s*["{\[]', file.read(1000)):
            raise ValueError('it is JSON, no table: a log of a Crazyflie client is for mambo '
                             'import crazyflie')
    options: dict[str, Any] = {
        'sep': delimiter, 'skipinitialspace': True, 'encoding': 'utf-8-sig'}
    try:
        header = pandas.read_csv(
            path, header=None, nrows=1, dtype=object, keep_default_na=False, **options)
        first = str(header.iloc[0, 0]).strip()
        if first.lower().startswith('sep='):
            line = delimiter.join(str(cell) for cell in header.iloc[0]).strip()
            raise ValueError(f'remove the first line, {quoted(line)}, which only Excel reads')
        names = _names(header.iloc[0], wanted)
        if first.startswith('#') and not set(wanted) <= set(names):
            raise ValueError(f'line 1 is a comment, {quoted(delimiter.join(names))}: the first '
                             'line must be the names of the columns, without a #')
        if _delimiter(names, wanted):
            return {}, names
        with warnings.catch_warnings():
            warnings.simplefilter('error', pandas.errors.ParserWarning)
            frame = pandas.read_csv(path, index_col=False, on_bad_lines='error', **options)
    except pandas.errors.ParserWarning as warning:
        if 'Length of header' not in str(warning):
            raise ValueError(str(warning)) from None
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
    if path.suffix.lower() in ARROW:
        raise BagError(f'{path}: Arrow files are not read: save the table as Parquet or CSV')

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
        other = _delimiter(names, wanted).replace('\t', '\\t')
        hint = nearest(missing[0], names)
        if other:
            hint = (f"; the cells are separated by '{other}': give delimiter: '{other}' in the "
                    'mapping')
        raise BagError(f'{path}: no column {quoted(missing[0])}{hint}; it has {shortened(names)}')
    return ({name: numbers(path, name, found[name], delimiter) for name in wanted},
            [name for name in names if name not in wanted])


def numbers(path: Path, name: str, found: Any, delimiter: str = ',') -> NDArray[np.float64]:
    """Return a column as numbers, (n,); BagError naming the line of what is none."""
    if found.dtype.kind in 'mM':
        raise BagError(f'{path}: column {name} holds times of the type {found.dtype}, not '
                       'numbers: save it as a number of seconds')
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
            cell = str(found[bad[0]])
            comma = re.fullmatch(r'\s*[-+]?\d*,\d+(e[-+]?\d+)?\s*', cell, re.IGNORECASE)
            hint = ': write decimal points instead of commas' if comma else ''
            raise BagError(f'{path}: {row_name(path, bad[0], delimiter)}, column {name}: '
                           f'{quoted(cell)} is not a number{hint}')
    wrong = np.flatnonzero(np.abs(values) >= LARGEST)
    if len(wrong):
        raise BagError(f'{path}: {row_name(path, wrong[0], delimiter)}, column {name}: '
                       f'{values[wrong[0]]:g} is absurd')
    return values
