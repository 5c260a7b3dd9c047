"""How much a file may take while it is read: limits that an environment variable raises."""

from __future__ import annotations

import os
from typing import NamedTuple

from .schema import ParameterError

RATIO = 20
"""Unpacked over packed that every file may have: a flight packs to a third, rest to a tenth."""


class Limit(NamedTuple):
    """
    A limit.

    Attributes
    ----------
    name
        The environment variable that sets another.
    default
    most
        Up to where it may be raised.

    """

    name: str
    default: int
    most: int = 10 ** 15

    def value(self) -> int:
        """
        Return the number in the environment variable, else the default.

        Raises
        ------
        ParameterError
            If the variable holds no whole number from 1 to ``most``.

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


def unpacked(size: int) -> int:
    """Return how many bytes a file of ``size`` bytes may unpack to."""
    return max(UNPACKED_MB.value() * 1_000_000, RATIO * size)


def raised_by(limit: Limit) -> str:
    """Return the end of a message: what raises a limit."""
    return f'{limit.name} (now {limit.value()}) raises the limit'
