"""Values that compiled code of a user's file keeps: they may come from outside of its source."""

from __future__ import annotations

from collections.abc import Iterator
import enum
import hashlib
from pathlib import Path
from types import CodeType, ModuleType, SimpleNamespace
from typing import Any

import numpy as np

from ..compiled import CPUDispatcher

_PLAIN = (bool, int, float, complex, str, bytes, type(None), np.generic, enum.Enum)
_UNKNOWN = b'\0unknown\0'  # a part of a value that compiled code does not keep


def kept(module: ModuleType, within: str) -> dict[str, str]:
    """
    Return a digest of each value that the compiled functions of a module read from outside.

    numba takes a global, a variable of an enclosing function or a default as a constant. What is
    compiled and cached on disk belongs to these values, too, not to the source alone: a file of
    weights may have changed, or a compiled function of a package.

    Parameters
    ----------
    module
        With compiled functions, in classes too.
    within
        Begins the names of the modules whose functions are followed.

    Returns
    -------
    dict
        {file and name: digest}; empty without compiled functions.

    """
    found: dict[str, str] = {}
    seen: set[int] = set()
    for function in compiled_functions(module, module.__name__):
        _follow(function, within, seen, found)
    return found


def compiled_functions(
    holder: Any, module: str, seen: set[int] | None = None,
) -> Iterator[Any]:
    """
    Yield the compiled functions of a module, and of its classes and objects inside.

    Parameters
    ----------
    holder
        The module, or a class in it.
    module
        Name of the module; those of modules beside it begin with it.
    seen
        Classes by their ids that are not looked at again.

    """
    seen = set() if seen is None else seen
    for value in list(vars(holder).values()):
        if isinstance(value, staticmethod):
            value = value.__func__
        if isinstance(value, CPUDispatcher):
            yield value
        elif isinstance(value, type):
            if value.__module__.startswith(module) and id(value) not in seen:
                seen.add(id(value))
                yield from compiled_functions(value, module, seen)
        elif isinstance(value, SimpleNamespace) or type(value).__module__.startswith(module):
            yield from (part for part in getattr(value, '__dict__', {}).values()
                        if isinstance(part, CPUDispatcher))


def _names(code: CodeType) -> set[str]:
    """Return every name that code reads, that of functions inside it too."""
    names = set(code.co_names)
    for part in code.co_consts:
        if isinstance(part, CodeType):
            names |= _names(part)
    return names


def _follow(function: Any, within: str, seen: set[int], found: dict[str, str]) -> None:
    """Add the values that a function, and what it calls, reads; a package's with its source."""
    compiled, function = hasattr(function, 'py_func'), getattr(function, 'py_func', function)
    module, code = function.__module__ or '', function.__code__
    own = module.startswith(within)
    if id(function) in seen or not own and (not compiled or module.startswith('mambo_')):
        return  # the workspace's own source names the folder of what is compiled
    seen.add(id(function))
    if not own and (source := Path(code.co_filename)).is_file():
        found[str(source)] = hashlib.sha256(source.read_bytes()).hexdigest()
    file = code.co_filename.rpartition('/')[2]
    names = _names(code)
    values = {name: function.__globals__[name] for name in names & function.__globals__.keys()}
    for name, cell in zip(code.co_freevars, function.__closure__ or ()):
        try:
            values[f'{function.__qualname__}.{name}'] = cell.cell_contents
        except ValueError:  # has none yet
            continue
    for i, value in enumerate(function.__defaults__ or ()):
        values[f'{function.__qualname__}, default {i}'] = value
    for name, value in sorted(values.items()):
        _add(f'{file}: {name}', value, names, within, seen, found)


def _add(
    place: str, value: Any, names: set[str], within: str, seen: set[int], found: dict[str, str],
) -> None:
    """Add a value under its place, or follow it if it is a function or holds some."""
    if isinstance(value, ModuleType):  # numba reads its attributes as globals
        for inner in sorted(names & vars(value).keys()):
            if vars(value)[inner] is not value and place.count('.') < 9:
                _add(f'{place}.{inner}', vars(value)[inner], names, within, seen, found)
    elif isinstance(value, type) and issubclass(value, enum.Enum):
        found[place] = hashlib.sha256(repr(list(value)).encode()).hexdigest()
    elif isinstance(value, tuple) and any(isinstance(part, CPUDispatcher) for part in value):
        for i, part in enumerate(value):
            _add(f'{place}[{i}]', part, names, within, seen, found)
    elif hasattr(value, 'py_func') or hasattr(value, '__code__'):
        _follow(value, within, seen, found)
    elif (text := _content(value)) is not None:
        found[place] = hashlib.sha256(text).hexdigest()


def _content(value: Any, depth: int = 0) -> bytes | None:
    """Return a value as bytes; None for what compiled code does not keep."""
    if isinstance(value, _PLAIN):
        return f'{type(value).__name__} {value!r}'.encode()
    if isinstance(value, np.ndarray) and not value.dtype.hasobject:
        return f'{value.dtype.str} {value.shape} '.encode() + value.tobytes()
    if isinstance(value, dict):
        value = tuple(value.items())
    if isinstance(value, tuple | list) and depth < 20:
        parts = [_content(part, depth + 1) for part in value]
        return b'(' + b', '.join(_UNKNOWN if part is None else part for part in parts) + b')'
    return None
