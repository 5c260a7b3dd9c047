"""The variables of a MATLAB file, read within bounds, and the signals that Simulink logs."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

from mambo_bags.mcap_reader import BagError
import numpy as np
from numpy.typing import NDArray
import scipy.io

from . import bounded
from .logs import hdf5

Floats = NDArray[np.float64]
_HDF5 = b'\x89HDF\r\n\x1a\n'  # begins it, or follows a first block of text
DEEPEST = 8  # structures in structures that are looked into


class Signal(NamedTuple):
    """One logged signal."""

    name: str  # of the variable; with the block or label behind a slash where it has several
    times: Floats  # (n,) s
    values: Floats  # (n, k)


def _plain(value: Any, depth: int = 0) -> Any:
    """Return plain data: numbers, texts, dictionaries and lists of these; else None."""
    if isinstance(value, dict) and depth < DEEPEST:
        return {str(key): _plain(below, depth + 1) for key, below in value.items()}
    if isinstance(value, np.ndarray) and value.dtype.kind in 'fiub':
        return np.asarray(value)
    if isinstance(value, list | tuple) or isinstance(value, np.ndarray) and value.dtype == object:
        if depth >= DEEPEST:
            return None
        return [_plain(below, depth + 1) for below in np.ravel(np.asarray(value, object))]
    return value if isinstance(value, str | int | float | bool) else None


def load(content: bytes) -> dict[str, Any]:
    """
    Return the variables of a MATLAB file's content as scipy reads them; for ``bounded.call``.

    Raises
    ------
    ValueError
        Saying what the content is instead; other errors of damaged bytes are those of scipy.

    """
    if content[:10].upper() == b'MATLAB 7.3' or _HDF5 in (content[:8], content[512:520]):
        return hdf5.load(content)
    try:
        found = scipy.io.loadmat(BytesIO(content), simplify_cells=True)
    except OSError as error:  # of content that ends too early: no file is read here
        raise ValueError(str(error)) from None
    except IndexError:
        raise ValueError('it is damaged or not of MATLAB') from None
    return {name: value for name, value in found.items() if not name.startswith('__')}


def variables(path: Path, content: bytes) -> dict[str, Any]:
    """
    Return the variables of a MATLAB file's content.

    Parameters
    ----------
    path
        Of the file, for errors.
    content
        Of the file.

    Returns
    -------
    {name: number, text, array, or dictionary or list of such; None for what is nothing of it}

    Raises
    ------
    BagError
        If the file is damaged, cut off, no such file, too large, or of version 7.3 without h5py.

    """
    def read(_: Path) -> dict[str, Any]:
        """Read it, in a process of its own."""
        return {name: _plain(value) for name, value in load(content).items()}
    try:
        return bounded.call(read, path)
    except OSError as error:  # the file has gone since
        raise BagError(f'{path}: cannot be read ({error.strerror})') from None
    except bounded.UnreadableError as error:
        raise BagError(f'{path}: not a readable mat file ({error})') from None


def _numbers(path: Path, name: str, value: Any) -> Floats:
    """Return an array of numbers; BagError if it is not one."""
    if not isinstance(value, np.ndarray | int | float):
        raise BagError(f'{path}: {name} holds what is no number')
    return np.asarray(value, float)


def columns(path: Path, name: str, values: Any, count: int) -> Floats:
    """
    Return the values of a signal, (count, k), a row for each time.

    Parameters
    ----------
    path, name
        Of file and signal, for errors.
    values
        (count,), (count, k), or with the times last, as Simulink logs matrices.
    count
        Number of times.

    Raises
    ------
    BagError
        If they are no numbers, or have another shape.

    """
    table = _numbers(path, name, values)
    if table.ndim > 1 and len(table) != count and table.shape[-1] == count:
        table = np.moveaxis(table, -1, 0).reshape(count, -1)
    elif table.ndim < 2:
        table = table.reshape(-1, 1)
    if table.ndim != 2 or len(table) != count or not table.shape[1]:
        raise BagError(f'{path}: {name} has the shape {table.shape}, expected a row for each of '
                       f'its {count} times')
    return table


def _entries(name: str, signals: Any) -> list[tuple[str, Any]]:
    """Return name and values of each of the signals of one structure with time."""
    if isinstance(signals, dict):
        return [(name, signals.get('values'))]
    out: list[tuple[str, Any]] = []
    for number, entry in enumerate(signals if isinstance(signals, list) else []):
        if isinstance(entry, dict):
            block = str(entry.get('blockName') or '').split('/')[-1]
            label = block or str(entry.get('label') or '') or str(number)
            if any(label == taken.split('/')[-1] for taken, _ in out):
                label = str(number)
            out.append((f'{name}/{label}', entry.get('values')))
    return out


def logged(path: Path, found: dict[str, Any]) -> tuple[dict[str, Signal], list[str]]:
    """
    Return the logged signals of a file's variables, and the names of other variables.

    A signal is a structure with time, of one signal or several, or an array with a row for each
    value of ``rt_tout``.

    Returns
    -------
    {name: signal}; the other variables in words.

    Raises
    ------
    BagError
        If a structure with time holds what is no number or has too few rows or times.

    """
    signals: dict[str, Signal] = {}
    others: list[str] = []
    tout = found.get('rt_tout')
    for name, value in found.items():
        if name == 'rt_tout':
            continue
        if isinstance(value, dict) and {'time', 'signals'} <= set(value):
            times = _numbers(path, f'{name}.time', value['time']).reshape(-1)
            for label, values in _entries(name, value['signals']):
                signals[label] = Signal(label, times, columns(path, label, values, len(times)))
        elif (isinstance(tout, np.ndarray) and isinstance(value, np.ndarray) and tout.ndim == 1
                and len(tout) > 1 and value.ndim in (1, 2) and len(value) == len(tout)):
            signals[name] = Signal(name, _numbers(path, 'rt_tout', tout),
                                   columns(path, name, value, len(tout)))
        else:
            shape = np.shape(value) if isinstance(value, np.ndarray) else ()
            others.append(f'{name} {shape}' if shape else name)
    return signals, others
