"""Columns of any file that a mapping can name: tables, logs of PX4 and MATLAB files."""

from __future__ import annotations

from pathlib import Path
import re
from typing import Any

from mambo_bags.command import nearest
from mambo_bags.mcap_reader import BagError
import numpy as np
from numpy.typing import NDArray

from .. import bounded, mat_file
from ..common import quoted, shortened, Source
from ..table_file import numbers, read_table, WITHOUT_LINES
from ..table_map import Map
from .ulog import read as read_log

Floats = NDArray[np.float64]
INDEXED = re.compile(r'(.+)\[(\d{1,6})\]')


def read_columns(source: Source, wanted: Map) -> tuple[dict[str, Floats], list[str], list[str]]:
    """
    Return {column: (n,) numbers} of a mapping, names of what it does not use, lines on damage.

    By its ending a file is a log of PX4 (``.ulg``: message.field), a MATLAB file (``.mat``:
    a.b, or a.b[2] for the third column), or a table (:mod:`mambo_analysis.importers.table_file`).

    Raises
    ------
    BagError
        In one line that names the file, and the column.

    """
    path, suffix = source.path, source.path.suffix.lower()
    others, damage = [], []
    if suffix == '.ulg':
        try:
            found, wrong = bounded.call(lambda file: read_log(file, wanted.clocks()), path)
        except bounded.UnreadableError as error:
            raise BagError(f'{path}: {error}') from None
        except OSError as error:
            raise BagError(f'{path}: {error.strerror or error}') from None
        damage = [wrong] if wrong else []
    elif suffix == '.mat':
        found, others = _of_mat(path, mat_file.variables(path, source.content), wanted)
    else:
        found, others = read_table(path, wanted.columns(), wanted.delimiter)
        if suffix not in WITHOUT_LINES and _is_cut_off(source.content, wanted.delimiter):
            found = {name: values[:-1] for name, values in found.items()}
            damage = ['the last line of the file is cut off: left out']
        return found, others, damage
    return ({name: numbers(path, name, values) for name, values in found.items()}, others,
            damage)


def _is_cut_off(content: bytes, delimiter: str) -> bool:
    """Return whether the last line of a CSV file has no end, and fewer cells than the first."""
    begin, last = content[:content.find(b'\n') + 1], content[content.rfind(b'\n') + 1:]
    mark = delimiter.encode()
    return bool(last.strip()) and last.count(mark) < begin.count(mark)


def _of_mat(
    path: Path, held: dict[str, Any], wanted: Map,
) -> tuple[dict[str, Any], list[str]]:
    """Return the columns of a MATLAB file's variables; BagError for lengths that differ."""
    out = {name: _column(path, held, name) for name in wanted.columns()}
    for clock, names in wanted.clocks().items():
        for name in names:
            if len(out[name]) != len(out[clock]):
                raise BagError(f'{path}: {name} has {len(out[name])} values, its times in {clock} '
                               f'{len(out[clock])}')
    used = {re.split(r'[.\[]', name)[0] for name in out}
    return out, [name for name in held if name not in used]


def _column(path: Path, held: dict[str, Any], name: str) -> Any:
    """Return a vector of numbers by its name, (n,)."""
    indexed = INDEXED.fullmatch(name)
    words, value = (indexed[1] if indexed else name).split('.'), held
    for i, word in enumerate(words):
        if not isinstance(value, dict) or word not in value:
            known = list(value) if isinstance(value, dict) else []
            inside = f'{".".join(words[:i])} holds' if i else 'it has'
            raise BagError(f'{path}: no {quoted(".".join(words[:i + 1]))}{nearest(word, known)}; '
                           f'{inside} {shortened(known) or "no fields"}')
        value = value[word]
    if not isinstance(value, np.ndarray | int | float):
        raise BagError(f'{path}: {name} holds what is no number')
    table = np.asarray(value)
    if indexed:
        table = table[:, None] if table.ndim == 1 else table
        if table.ndim != 2 or int(indexed[2]) >= table.shape[1]:
            raise BagError(f'{path}: {indexed[1]} has the shape {table.shape}: no column '
                           f'{indexed[2]}, counted from 0')
        return table[:, int(indexed[2])]
    if table.ndim > 1:
        raise BagError(f'{path}: {name} has the shape {table.shape}: name one column, '
                       f'{name}[0] is the first')
    return np.atleast_1d(table)
