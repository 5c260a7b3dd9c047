"""The result of a sweep: a journal of finished rows, and the whole table as Parquet."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
import fcntl
import hashlib
import json
from pathlib import Path
from typing import Any

from mambo_model.compiled import source_digest
from mambo_model.components import own_components
from mambo_model.errors import InputError, JobError
from mambo_model.whole_file import replacing
import pyarrow as pa
import pyarrow.parquet as parquet

from .. import scenario as scenarios
from .design import Flights, Sweep


class SweepError(InputError):
    """A sweep cannot start; the message says why and what to do."""


KEPT = 'finished flights are kept, the same command continues'


class SweepEndedError(JobError):
    """A running sweep has ended early; finished flights are kept."""


def parameters(sweep: Sweep, number: int) -> dict[str, Any]:
    """Return the varied parameters of a flight by column, a vector as name.0, name.1, ..."""
    out: dict[str, Any] = {}
    for axis, value in zip(sweep.axes, sweep.rows[number]):
        if isinstance(value, tuple):
            out.update({f'{axis.name}.{i}': element for i, element in enumerate(value)})
        else:
            out[axis.name] = float(value) if isinstance(axis.field.default, float) else value
    return out


def units(sweep: Sweep) -> dict[str, str]:
    """Return the unit of each column of :func:`parameters` that is a number."""
    of_axis = {axis.name: axis.field.metadata.get('unit') for axis in sweep.axes}
    found = {column: of_axis[column if column in of_axis else column.rpartition('.')[0]]
             for column in parameters(sweep, 0)}
    return {column: unit for column, unit in found.items() if unit}


def digest(flights: Flights, ideal: bool) -> str:
    """
    Return a hash of what the result depends on: flights, sensors, numerics, users' components.

    Data files that a component reads itself are not in it.
    """
    out = hashlib.sha256(f'{ideal} {source_digest()} with faults'.encode())
    out.update(repr([axis.name for axis in flights.sweep.axes]).encode())
    for row in flights.sweep.rows:
        out.update(repr(row).encode())
    for base in flights.bases.values():
        out.update(scenarios.to_yaml(base).encode())
    out.update(repr(sources(flights.bases.values())).encode())
    return out.hexdigest()


def sources(flights: Iterable[scenarios.Scenario]) -> dict[str, str]:
    """Return {file: hash of its source} of the users' components that flights have."""
    return {str(c.path): c.sha256 for flight in flights for c in own_components(flight)}


def continued(flights: Flights, journal: Journal) -> str:
    """Return in words that finished flights are kept, and what may not have changed; or ''."""
    if not journal.rows:
        return ''
    read = ''.join(f'; data files that {path} reads itself must be those that they were flown with'
                   for path in sources(flights.bases.values()))
    count = len(journal.rows)
    return (f'{journal.path}: {count} finished flight{"s are" if count > 1 else " is"} '
            f'kept{read}')


def _line(row: Mapping[str, Any]) -> bytes:
    """Return a row as a line, with NaN and every bit of a float."""
    return json.dumps(row).encode() + b'\n'


class Journal:
    """
    Finished rows on disk, in any order, one line of JSON each.

    Parameters
    ----------
    path
        File, which is created or continued.
    head
        The :func:`digest` of the sweep.
    what
        What begins and continues it, for errors.

    Attributes
    ----------
    rows : dict[int, dict]
        Finished rows, by the number of the flight.

    Raises
    ------
    SweepError
        If the file belongs to another sweep, is being written or cannot be opened.
    mambo_model.errors.JobError
        If it cannot be written, also by :meth:`add`.

    """

    def __init__(self, path: Path, head: str, what: str = 'sweep file') -> None:
        self.path, self._what = path, what
        self.rows: dict[int, dict[str, Any]] = {}
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            header = _line({'sweep': head})
            self._stream = path.open('ab')
            self._lock()
            good = self._read(header)
            self._stream.truncate(good)  # drop a line that an interruption cut off
            if not good:
                self._put(header)
        except (SweepError, JobError):
            self._stream.close()
            raise
        except OSError as error:
            raise SweepError(f'{path}: {error.strerror}') from None

    def _lock(self) -> None:
        """Refuse a file that another process writes, until that ends."""
        try:
            fcntl.flock(self._stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise SweepError(f'{self.path}: is written by another process now: let it end, or '
                             'give another --output') from None
        except OSError:  # a file system without locks
            pass

    def _read(self, header: bytes) -> int:
        """Read the finished rows; return the length in bytes of the lines that are sound."""
        data = self.path.read_bytes()
        if header.startswith(data):  # empty, or cut off at once
            return 0
        if not data.startswith(header):
            raise SweepError(
                f'{self.path}: not begun by this {self._what} and this version of the software: '
                'remove it, or give another --output')
        good, names = len(header), None
        for line in data[good:].splitlines(keepends=True):
            try:
                row = json.loads(line) if line.endswith(b'\n') else None
                number = row.pop('flight')
            except (AttributeError, KeyError, RecursionError, TypeError, ValueError):
                break
            if type(number) is not int or row.keys() != (names or row.keys()):
                break
            self.rows[number], names = row, row.keys()
            good += len(line)
        return good

    def _put(self, line: bytes) -> None:
        try:
            self._stream.write(line)
            self._stream.flush()
        except OSError as error:
            with suppress(OSError):  # of the rest that is not written
                self._stream.close()
            raise JobError(
                f'{self.path}: cannot be written ({error.strerror}); {KEPT}') from None

    def add(self, number: int, row: dict[str, Any]) -> None:
        """Add a finished row."""
        self.rows[number] = row
        self._put(_line({'flight': number, **row}))

    def close(self) -> None:
        """Close the file; the rows stay in it."""
        self._stream.close()

    def leave(self) -> None:
        """Close the file, and remove it if it has no rows."""
        (self.close if self.rows else self.remove)()

    def remove(self) -> None:
        """Close and remove the file, once the result is written."""
        self.close()
        self.path.unlink(missing_ok=True)


def report_faults(faults: Sequence[tuple[str, str]]) -> None:
    """
    Raise JobError if a component of the user failed in a flight.

    Parameters
    ----------
    faults
        Of each flight, what it is called and its fault, empty for none.

    """
    if failed := [(name, fault) for name, fault in faults if fault]:
        name, fault = failed[0]
        raise JobError(f'a component failed in {len(failed)} of {len(faults)} flights, the first '
                       f'is {name}: {fault}')


def columns(sweep: Sweep, rows: Mapping[int, Mapping[str, Any]]) -> dict[str, list[Any]]:
    """Return the table: a row for each flight, parameters first, then metrics."""
    out: dict[str, list[Any]] = {'flight': list(range(len(sweep.rows)))}
    for number in out['flight']:
        for name, value in {**parameters(sweep, number), **rows[number]}.items():
            out.setdefault(name, []).append(value)
    return out


def write(path: Path, data: Mapping[str, Sequence[Any]], title: str) -> None:
    """
    Write a table as Parquet; the file appears complete or not at all.

    Raises
    ------
    InputError, JobError
        If the file cannot be written.

    """
    table = pa.table({name: pa.array(values) for name, values in data.items()})
    table = table.replace_schema_metadata({'title': title})
    with replacing(path) as part:
        parquet.write_table(table, part, compression='zstd')


def batches(numbers: Sequence[int], size: int) -> Iterator[Sequence[int]]:
    """Yield the numbers in batches of a size."""
    for start in range(0, len(numbers), size):
        yield numbers[start:start + size]
