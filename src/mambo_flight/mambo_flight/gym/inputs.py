"""What a user gives to an environment, checked before use: numbers of numpy, names, seeds."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
import operator
from typing import Any

from mambo_model import schema
from mambo_model.errors import InputError
import numpy as np
from numpy.typing import NDArray

_NO_NUMBERS = (str, bytes, np.datetime64, np.timedelta64)  # but numpy turns them into floats


def plain(value: Any) -> Any:
    """Return a value with its numbers and arrays of numpy as numbers and lists of Python."""
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if isinstance(value, Mapping):
        return {plain(key): plain(inner) for key, inner in value.items()}
    if type(value) in (list, tuple):
        return type(value)(map(plain, value))
    return value


def _shown(value: Any) -> str:
    """Return a value for an error message, in one line."""
    return ' '.join(schema.shown(plain(value)).split())


def mapping(argument: str, form: str, values: Any) -> Mapping[Any, Any]:
    """
    Return an argument that is a mapping; an empty one for None.

    Parameters
    ----------
    argument, form
        Its name and what it must look like, for error messages.
    values
        As the user gave it.

    Raises
    ------
    InputError
        If it is something else.

    """
    if values is None:
        return {}
    if not isinstance(values, Mapping):
        raise InputError(f'{argument} = {_shown(values)} must be {form}')
    return values


def by_name(argument: str, form: str, values: Any) -> dict[str, Any]:
    """
    Return the values of a :func:`mapping` by name, as numbers and lists of Python.

    Raises
    ------
    InputError
        If it is not a mapping, or a key is not text.

    """
    given = mapping(argument, form, values)
    for name in given:
        if not isinstance(name, str):
            raise InputError(f'{argument}: the name {_shown(name)} must be text')
    return {name: plain(value) for name, value in given.items()}


def options(values: Any, form: str = '', known: str = '') -> Mapping[Any, Any]:
    """
    Return the options of a reset; an empty mapping for None.

    Parameters
    ----------
    values
        As the user gave them.
    form, known
        What they must look like, and the name of the only one; empty: there is none.

    Raises
    ------
    InputError
        If they are not a mapping, or there is another one.

    """
    given = mapping('options', form or '{}', values)
    for name in given:
        if name != known or not known:
            raise InputError(f'options: there is no {_shown(name)}: ' + (
                f'give {form}' if known else 'what an episode draws depends on seed alone'))
    return given


def whole(name: str, value: Any, least: int, most: int | None = None) -> int:
    """
    Return a whole number of Python or numpy as an int.

    Raises
    ------
    InputError
        If it is something else, such as True, less than ``least`` or more than ``most``.

    """
    try:
        number = None if isinstance(value, bool) else operator.index(value)
    except TypeError:  # of numpy's booleans, too
        number = None
    if number is None or number < least or most is not None and number > most:
        limits = f'at least {least}' if most is None else f'{least} to {most}'
        raise InputError(f'{name} = {_shown(value)} must be a whole number, {limits}')
    return number


def seeds(value: Any, count: int) -> list[int | None]:
    """
    Return the seed of each drone of a vector environment.

    Parameters
    ----------
    value
        None; the seed of the first drone, from which the others count on; or a seed or None for
        each drone.
    count
        Number of drones.

    Raises
    ------
    InputError
        If it is something else, or a seed is negative.

    """
    if value is None:
        return [None] * count
    single = np.ndim(value) == 0 if isinstance(value, np.ndarray) else (
        isinstance(value, str | bytes) or not isinstance(value, Iterable))
    if single:
        first = whole('seed', value, 0)
        return [first + i for i in range(count)]
    each = list(value)
    if len(each) != count:
        raise InputError(
            f'seed has {len(each)} numbers, one for each of {count} drones is needed')
    return [None if one is None else whole(f'seed[{i}]', one, 0) for i, one in enumerate(each)]


def floats(name: str, values: Any, form: str) -> NDArray[np.float64]:
    """
    Return numbers as an array of floats; it may share memory with them.

    Parameters
    ----------
    name, form
        Of the argument, and what it must hold, for error messages.
    values
        As the user gave them.

    Raises
    ------
    InputError
        For text, dates, complex numbers, lists of unequal length, masked numbers and integers
        beyond all floats.

    """
    try:
        given = np.asarray(values)
        kind = given.dtype.kind
        if np.ma.is_masked(values) or kind not in 'biufO' or kind == 'O' and any(
                isinstance(one, _NO_NUMBERS) for one in given.flat):
            raise TypeError
        return given.astype(float, copy=False)
    except OverflowError:
        raise InputError(f'{name} has a number that is too large: {form}') from None
    except (TypeError, ValueError):
        raise InputError(f'{name} must be numbers: {form}') from None
