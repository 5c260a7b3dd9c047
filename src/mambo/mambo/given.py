"""What a script gives, checked before it is used: paths, parameters, numbers of numpy."""

from __future__ import annotations

from collections.abc import Mapping
import os
from pathlib import Path
from typing import Any

from mambo_flight.gym.inputs import plain, whole
from mambo_model.errors import InputError

__all__ = ['parameters', 'path', 'plain', 'whole']


def parameters(values: Mapping[str, Any] | None) -> dict[str, Any]:
    """
    Return parameters by name as plain values; nothing for None.

    Raises
    ------
    InputError
        If they are not a mapping from names.

    """
    if values is None:
        return {}
    if not isinstance(values, Mapping):
        raise InputError(f"parameters: must be {{'name': value}}, not {_kind(values)}")
    for name in values:
        if not isinstance(name, str):
            raise InputError(f'parameters: the name {name!r} must be text')
    return plain(values)


def path(value: Any, name: str) -> Path:
    """Return a path; InputError naming the argument if it is none."""
    if not isinstance(value, str | os.PathLike):
        raise InputError(f'{name}: must be a path, not {_kind(value)}')
    if not os.fspath(value):
        raise InputError(f'{name}: is empty')
    if '\0' in os.fsdecode(value):
        raise InputError(f'{name}: {value!r} holds a null character')
    return Path(value)


def _kind(value: Any) -> str:
    return 'None' if value is None else f'a value of type {type(value).__name__}'
