"""
Limits on resources for reading a file and for a flight; environment variables raise them.

Beside them, by how much the stamp of a message may be ahead.
"""

from __future__ import annotations

import os
from pathlib import Path
import stat
from typing import NamedTuple

from .schema import ParameterError

RATIO = 20
"""Unpacked over packed that every file may have: a flight packs to a third, rest to a tenth."""


AHEAD_NS = 100_000_000
"""Time in ns by which a sample may be stamped after the filter step that it arrives with."""


class Limit(NamedTuple):
    """
    A limit that an environment variable can change.

    Attributes
    ----------
    name
        The environment variable.
    default
    most
        The largest value it may have.

    """

    name: str
    default: int
    most: int = 10 ** 15

    def value(self) -> int:
        """
        Return the number in the environment variable, or the default if it is not set.

        Raises
        ------
        ParameterError
            If the variable does not hold a whole number from 1 to ``most``.

        """
        text = os.environ.get(self.name, '')
        if not text:
            return self.default
        if not (text.isdecimal() and len(text) < 16 and 0 < int(text) <= self.most):
            raise ParameterError(
                f'{self.name}={text[:40]!r} must be a whole number from 1 to {self.most}')
        return int(text)


YAML_NODES = Limit('MAMBO_MAX_YAML_NODES', 100_000)
YAML_DEPTH = Limit('MAMBO_MAX_YAML_DEPTH', 64, 400)  # Python itself nests a thousand calls
UNPACKED_MB = Limit('MAMBO_MAX_UNPACKED_MB', 512)
READING_S = Limit('MAMBO_MAX_READING_S', 120)
FLIGHT_MB = Limit('MAMBO_MAX_FLIGHT_MB', 2000)


def unpacked(size: int) -> int:
    """Return how many bytes a file of ``size`` bytes may unpack to."""
    return max(UNPACKED_MB.value() * 1_000_000, RATIO * size)


def raised_by(limit: Limit) -> str:
    """Return the end of a message that says which variable raises the limit."""
    return f'{limit.name} (now {limit.value()}) raises the limit'


def check_regular(path: Path) -> None:
    """
    Check that a path to be read is no pipe, device or file of the kernel.

    Reading such a one can wait or go on for ever. A path that is not there passes: its reader
    says so.

    Raises
    ------
    ParameterError
        Naming the path.

    """
    try:
        found = path.stat()
    except (OSError, ValueError):
        return
    kernel = found.st_size == 0 and Path(os.path.realpath(path)).is_relative_to('/proc')
    if kernel or not (stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode)):
        raise ParameterError(f'{path}: not a regular file; copy its content to one first')
