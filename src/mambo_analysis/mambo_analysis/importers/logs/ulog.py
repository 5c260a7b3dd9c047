"""Columns of a PX4 log, ``.ulg``, each named by message and field: ``vehicle_attitude.q[0]``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import contextlib
import io
from pathlib import Path
import re
from typing import Any

from mambo_bags.command import nearest
from mambo_signals import resample
import numpy as np
from numpy.typing import NDArray

from ..common import quoted, shortened

Floats = NDArray[np.float64]
Times = NDArray[np.integer]
NAME = re.compile(r'([A-Za-z_]\w*)(?:#(\d{1,3}))?\.(\S+)')
"""Message, its number where there are several, and field."""


def split(column: str) -> tuple[str, int, str]:
    """Return message, number and field of a column; ValueError if it names none."""
    found = NAME.fullmatch(column)
    if found is None:
        raise ValueError(f'column {quoted(column)}: wanted message.field, or message#1.field of '
                         'the second of its kind')
    return found[1], int(found[2] or 0), found[3]


class _Watched(io.BufferedReader):
    """A file that remembers whether less was there than was asked for."""

    cut_off = False

    def read(self, size: int | None = -1, /) -> bytes:
        """Return at most ``size`` bytes."""
        out = super().read(size)
        self.cut_off |= 0 < len(out) < (size or 0)
        return out


def _open(path: Path, messages: list[str] | None) -> tuple[Any, bool]:
    """
    Return the log with some or all messages, and whether it ends within a message.

    ValueError if it is none or pyulog is missing.
    """
    try:
        from pyulog import ULog
    except ImportError:
        raise ValueError('logs of PX4 need pyulog: pip install -r requirements/logs.txt') from None
    with _Watched(io.FileIO(path)) as file:
        if file.read(4) != b'ULog':
            raise ValueError('it does not begin as a log of PX4')
        file.seek(0)
        try:
            with contextlib.redirect_stdout(io.StringIO()):  # it prints each fault
                log = ULog(file, messages, disable_str_exceptions=True)
        except MemoryError:
            raise
        except Exception:  # its reader raises anything on damaged bytes
            raise ValueError('its content is damaged') from None
        return log, file.cut_off


def read(
    path: Path, clocks: Mapping[str, Sequence[str]],
) -> tuple[dict[str, Floats], str]:
    """
    Return columns at the times of their clocks; for ``bounded.call``.

    Parameters
    ----------
    path
        Of the log.
    clocks
        {column of times: columns that are wanted at these times}. Fields of another message than
        that of the times have their nearest sample, NaN in gaps.

    Returns
    -------
    {column: (n,) numbers}, and what is wrong with the log: a part is missing or it is cut off.

    Raises
    ------
    ValueError
        For a file, message or field that is not there, a column with two clocks, and times that
        run backwards in a message whose nearest samples are wanted.

    """
    names = {column: split(column) for clock, columns in clocks.items()
             for column in (clock, *columns)}
    log, cut_off = _open(path, sorted({message for message, _, _ in names.values()}))
    held = {(data.name, data.multi_id): data.data for data in log.data_list}

    def field(column: str) -> Floats:
        """Return the samples of a column, (n,); ValueError if the log has none."""
        message, number, name = names[column]
        data = held.get((message, number))
        if data is None:
            many = [n for kind, n in held if kind == message]
            if many:
                raise ValueError(f'no message {message}#{number}, its numbers are '
                                 f'{shortened(list(map(str, many)))}')
            kinds = sorted({one.name for one in _open(path, None)[0].data_list})
            if not kinds:
                raise ValueError('it holds no samples: it is cut off or damaged')
            raise ValueError(f'no message {message}{nearest(message, kinds)}, whose topic a copy '
                             f'of the mapping may leave out; it has {shortened(kinds)}')
        if name not in data:
            raise ValueError(f'{message} has no field {quoted(name)}{nearest(name, data)}; it has '
                             f'{shortened(list(data))}')
        return np.asarray(data[name], float)

    out: dict[str, Floats] = {}
    for clock, columns in clocks.items():
        out[clock] = field(clock)
        times = np.asarray(held[names[clock][:2]]['timestamp'])
        for column in columns:
            values = field(column)
            if names[column][:2] != names[clock][:2]:
                own = np.asarray(held[names[column][:2]]['timestamp']).astype(np.int64)
                if (np.diff(own) < 0).any():
                    raise ValueError(f'the times of {names[column][0]} run backwards')
                values = _nearest_in_time(times, own, values)
            if column in out and not np.array_equal(out[column], values, equal_nan=True):
                raise ValueError(f'column {quoted(column)} is wanted at two times')
            out[column] = values
    damage = 'a part of the log is damaged: its messages are missing' if log.file_corruption else (
        'the log is cut off within a message: what came after it is missing' if cut_off else '')
    return out, damage


def _nearest_in_time(times: Times, own: Times, values: Floats) -> Floats:
    """Return the samples nearest to times, (n,); NaN further than the longest usual step."""
    after = np.clip(np.searchsorted(own, times), 1, max(len(own) - 1, 1))
    if len(own) < 2:
        return np.full(len(times), np.nan)
    times = times.astype(np.int64)
    row = np.where(times - own[after - 1] <= own[after] - times, after - 1, after)
    far = np.abs(own[row] - times) > resample.longest_step(own)
    return np.where(far, np.nan, values[row])
