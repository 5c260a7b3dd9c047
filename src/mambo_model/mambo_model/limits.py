"""How much a file may take while it is read: limits that an environment variable raises."""

from __future__ import annotations

import os

from .schema import ParameterError

YAML_NODES = 'MAMBO_MAX_YAML_NODES', 100_000
UNPACKED_MB = 'MAMBO_MAX_UNPACKED_MB', 512


def limit(which: tuple[str, int]) -> int:
    """
    Return a limit: the number in its environment variable, else its default.

    Parameters
    ----------
    which
        Name of the variable and default, as ``YAML_NODES``.

    Raises
    ------
    ParameterError
        If the variable holds no whole number above 0.

    """
    name, default = which
    text = os.environ.get(name, '')
    if not text:
        return default
    if not (text.isdecimal() and len(text) < 16 and int(text) > 0):
        raise ParameterError(f'{name}={text[:40]!r} must be a whole number above 0')
    return int(text)
