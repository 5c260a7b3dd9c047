"""Whether two modules that were made of one source hold the same values."""

from __future__ import annotations

import enum
import functools
from types import CellType, CodeType, FunctionType, MappingProxyType, ModuleType
from typing import Any

import numpy as np

_PLAIN = (bool, int, float, complex, bytes, type(None), np.generic, enum.Enum)
_COMPARED = ('__version__', '__dataclass_fields__')  # the other special names are Python's
_LEFT_OUT = '_abc_impl'  # of abstract classes: cannot be compared


class _UnknownError(Exception):
    """A value cannot be compared."""


class _Comparison:
    """Compares what stands at the same place in two modules; each pair once, as loops may be."""

    def __init__(self, one: str, two: str) -> None:
        self.names = one, two
        self.seen: dict[tuple[int, int], Any] = {}

    def alike(self, a: Any, b: Any) -> bool:
        """Return whether two values are the same; raise an Exception if that cannot be told."""
        if a is b or (id(a), id(b)) in self.seen:
            return True
        self.seen[id(a), id(b)] = a, b  # kept, so that no other object gets these numbers
        if isinstance(a, str) and isinstance(b, str):
            return a.replace(self.names[0], '') == b.replace(self.names[1], '')
        if isinstance(a, type) and isinstance(b, type):
            return self._types(a, b)
        if type(a) is not type(b) and not self._types(type(a), type(b)):
            return False
        if isinstance(a, _PLAIN):
            return repr(a) == repr(b)
        if isinstance(a, CodeType):
            return a == b
        if isinstance(a, dict | MappingProxyType):
            return self._all(list(a.items()), list(b.items()))
        if type(a) in (tuple, list):
            return self._all(a, b)
        return self.alike(_parts(a), _parts(b))

    def _all(self, a: Any, b: Any) -> bool:
        return len(a) == len(b) and all(map(self.alike, a, b))

    def _types(self, a: type, b: type) -> bool:
        """Return whether two classes are the same, or those of one place in the source."""
        own = (a.__module__.startswith(self.names[0]), b.__module__.startswith(self.names[1]))
        return a is b or own == (True, True) and a.__qualname__ == b.__qualname__ and (
            self.alike(_members(a), _members(b)))


def _members(holder: Any) -> dict[str, Any]:
    """Return what a module or a class holds by name, without what Python adds."""
    return {name: value for name, value in vars(holder).items()
            if name in _COMPARED or not name.startswith('__') and name != _LEFT_OUT}


def _parts(value: Any) -> Any:
    """Return what a value consists of; raise an Exception if that cannot be told."""
    if isinstance(value, ModuleType):
        return value.__name__  # those beside the file are compared on their own
    if hasattr(value, 'py_func'):
        return value.py_func
    if isinstance(value, FunctionType):
        return (value.__code__, value.__defaults__, value.__kwdefaults__, value.__closure__,
                vars(value))
    if isinstance(value, CellType):
        return value.cell_contents
    if isinstance(value, staticmethod | classmethod):
        return value.__func__
    if isinstance(value, property):
        return value.fget, value.fset, value.fdel
    if isinstance(value, functools.cached_property):
        return value.func
    if isinstance(value, functools._lru_cache_wrapper):
        if value.cache_info().currsize:
            raise _UnknownError  # what it holds may be of another time
        return value.__wrapped__
    whole = value.__reduce_ex__(2)  # as pickle takes it apart
    if isinstance(whole, str):
        raise _UnknownError
    return tuple(list(part) if i > 2 and part is not None else part
                 for i, part in enumerate(whole[:5]))


def twins(one: ModuleType, two: ModuleType) -> bool:
    """
    Return whether two modules of one source hold the same values; if that is not known, False.

    Values are compared by what pickle would write of them.
    """
    try:
        return _Comparison(one.__name__, two.__name__).alike(_members(one), _members(two))
    except Exception:  # objects are a user's, and taking them apart may do anything
        return False
