"""
Files of piecewise polynomials in the format of the Crazyswarm and of uav_trajectories.

The format is CSV with a header and a row for each piece: its duration in s, then eight
coefficients each of x, y and z in m and of yaw in rad, in ascending powers of the time since the
piece began. Axes in the file are z-up, here NED: y, z and yaw change their sign, which is exact
(:mod:`mambo_model.frames`).
"""

from __future__ import annotations

from functools import lru_cache
import math
from pathlib import Path
from typing import NoReturn

import numpy as np

from .. import limits
from ..schema import ParameterError, shown
from .polynomial import AXES, Course, ends

COEFFICIENTS = 8
HEADER = ('duration', *(f'{axis}^{i}' for axis in AXES for i in range(COEFFICIENTS)))
MAX_PIECES = 1000
LONGEST = 3600.0   # s, of a piece
FARTHEST = 1000.0  # m, of a seam from the origin
JUMPS = (('position', 0.01, 'm'), ('velocity', 0.05, 'm/s'))  # that rounding does not explain
YAW_JUMP = 0.01    # rad, likewise; whole turns are none
_SIGNS = np.array([1.0, -1.0, -1.0, -1.0])[:, None]
_BYTES = 30 * len(HEADER) * MAX_PIECES  # of a text


def fail(where: str, row: int, text: str) -> NoReturn:
    """Raise ParameterError naming file and row."""
    raise ParameterError(f'{where}:{row}: {text}')


def read_text(path: Path, most: int = _BYTES) -> str:
    """
    Return the text of a file of bounded size.

    Raises
    ------
    ParameterError
        If there is no such file, or if it is empty, too long or not text.

    """
    limits.check_regular(path)
    try:
        with path.open(encoding='utf-8-sig') as stream:
            text = stream.read(most + 1)
    except OSError as error:
        raise ParameterError(f'{path}: {error.strerror}') from None
    except ValueError:  # another encoding, or a path with a zero
        raise ParameterError(f'{str(path)!r}: not a text file') from None
    if len(text) > most:
        raise ParameterError(
            f'{path}: longer than {most} characters; a course has at most {MAX_PIECES} rows')
    if not text.strip():
        raise ParameterError(f'{path}: the file is empty')
    return text


def rows(text: str) -> list[tuple[int, list[str]]]:
    """Return line number and cells of every line that is neither empty nor a comment (#)."""
    out = []
    for number, line in enumerate(text.splitlines(), 1):
        line = line.strip()
        if line and not line.startswith('#'):
            cells = [cell.strip() for cell in line.split(',')]
            out.append((number, cells[:-1] if cells[-1] == '' and len(cells) > 1 else cells))
    return out


def number(where: str, row: int, name: str, cell: str) -> float:
    """Return the number in a cell; errors name file, row and column."""
    try:
        value = float(cell)
    except ValueError:
        fail(where, row, f'{name}: {shown(cell)} is not a number')
    if not math.isfinite(value):
        fail(where, row, f'{name}: {cell} is not a finite number')
    return value


@lru_cache(maxsize=16)
def parse(text: str, where: str = 'course') -> Course:
    """
    Return the course of a text in this format.

    Parameters
    ----------
    text
        Header and rows.
    where
        Name of the text in error messages, such as the name of the file.

    Raises
    ------
    ParameterError
        If something is missing, not a number, out of range or not continuous; the message names
        file and row.

    """
    table = rows(text)
    if not table:
        raise ParameterError(f'{where}: holds no header and no pieces')
    header = [cell.lower() for cell in table[0][1]]
    if header != list(HEADER):
        fail(where, table[0][0], f'the header must be {HEADER[0]},{HEADER[1]},...,{HEADER[-1]} '
             f'({len(HEADER)} columns)')
    if len(table) == 1:
        raise ParameterError(f'{where}: holds no pieces below its header')
    if len(table) - 1 > MAX_PIECES:
        raise ParameterError(
            f'{where}: {len(table) - 1} pieces; a course has at most {MAX_PIECES}')
    numbers = []
    for row, cells in table[1:]:
        if len(cells) != len(HEADER):
            fail(where, row, f'{len(cells)} columns; a piece has {len(HEADER)}: its duration and '
                 f'{COEFFICIENTS} coefficients each of {", ".join(AXES)}')
        numbers.append([number(where, row, name, cell)
                        for name, cell in zip(HEADER, cells, strict=True)])
        if not 0.0 < numbers[-1][0] <= LONGEST:
            fail(where, row, f'duration = {cells[0]} s must be above 0 and at most {LONGEST:g} s')
    values = np.array(numbers)
    course = Course(
        values[:, 0].copy(), values[:, 1:].reshape(len(values), 4, COEFFICIENTS) * _SIGNS + 0.0)
    _check_seams(course, where, [row for row, _ in table[1:]])
    return course


def _check_seams(course: Course, where: str, lines: list[int]) -> None:
    """Raise ParameterError if pieces are far away or do not continue each other."""
    first, last = ends(course)
    for i, line in enumerate(lines):
        far = max(np.abs(first[i, :3, 0]).max(), np.abs(last[i, :3, 0]).max())
        if not far <= FARTHEST:
            fail(where, line, f'the piece is {far:.3g} m away from the origin, limit '
                 f'{FARTHEST:g} m: positions are in metres, times in seconds')
        for order, (name, most, unit) in enumerate(JUMPS):
            gap = np.abs(first[i, :3, order] - last[i - 1, :3, order]).max() if i else 0.0
            if gap > most:
                fail(where, line, f'{name} jumps by {gap:.3g} {unit} from the end of the piece '
                     'before')
        turn = float(first[i, 3, 0] - last[i - 1, 3, 0]) if i else 0.0
        if (turn := abs(math.remainder(turn, 2.0 * math.pi))) > YAW_JUMP:
            fail(where, line, f'yaw jumps by {turn:.3g} rad from the end of the piece before')


def load(path: Path) -> Course:
    """Read a file in this format; errors as for :func:`parse`."""
    return parse(read_text(path), str(path))


def to_text(course: Course) -> str:
    """
    Return a course in this format, with numbers that read back exactly.

    Raises
    ------
    ParameterError
        If its degree is above 7, the limit of the format.

    """
    n, axes, count = course.coefficients.shape
    if count > COEFFICIENTS:
        raise ParameterError(f'degree {count - 1}: the format holds degree {COEFFICIENTS - 1}')
    c = np.zeros((n, axes, COEFFICIENTS))
    c[:, :, :count] = course.coefficients * _SIGNS
    table = np.hstack((course.duration[:, None], (c + 0.0).reshape(n, -1)))
    return '\n'.join((','.join(HEADER), *(
        ','.join(repr(value) for value in row) for row in table.tolist()))) + '\n'
