"""Whether two modules that were made of one source hold the same values."""

from __future__ import annotations

import functools
from types import CellType, CodeType, FunctionType, MappingProxyType, ModuleType
from typing import Any

import numpy as np

from ..compiled import CPUDispatcher
from .constants import hides

_PLAIN = (bool, int, float, complex, type(None))
_OF_MODULES = {
    '__name__', '__doc__', '__package__', '__loader__', '__spec__', '__file__', '__cached__',
    '__builtins__', '__path__'}
_OF_CLASSES = {'__module__', '__doc__', '__dict__', '__weakref__', '_abc_impl'}


class _UnknownError(Exception):
    """A value cannot be compared."""


class _Comparison:
    """Compares what stands at the same place in two modules; each pair once, as loops may be."""

    def __init__(self, one: ModuleType, two: ModuleType) -> None:
        self.names = one.__name__, two.__name__
        self.seen: dict[tuple[int, int], Any] = {}
        self.spaces: dict[int, Any] = {id(vars(one)): None, id(vars(two)): None}

    def alike(self, a: Any, b: Any) -> bool:
        """Return whether two values are the same; raise an Exception if that cannot be told."""
        if a is b or (id(a), id(b)) in self.seen:
            return True
        self.seen[id(a), id(b)] = a, b  # kept, so that no other object gets these numbers
        if type(a) is str and type(b) is str:
            return a.replace(self.names[0], '') == b.replace(self.names[1], '')
        if isinstance(a, type) and isinstance(b, type):
            return self._types(a, b)
        if type(a) is not type(b) and not self._types(type(a), type(b)):
            return False
        if type(a) in _PLAIN:
            return repr(a) == repr(b)
        if isinstance(a, CodeType) or type(a) is bytes:
            return a == b
        if isinstance(a, np.generic) and not a.dtype.hasobject:
            return a.dtype == b.dtype and a.tobytes() == b.tobytes()
        if type(a) is np.ndarray and not a.dtype.hasobject:
            return a.dtype == b.dtype and a.shape == b.shape and np.array_equal(*(
                np.ascontiguousarray(x).reshape(-1).view(np.uint8) for x in (a, b)))
        if type(a) in (dict, MappingProxyType):
            return self._all(list(a.items()), list(b.items()))
        if type(a) in (tuple, list):
            return self._all(a, b)
        if isinstance(a, ModuleType):
            return self._modules(a, b)
        if isinstance(a, FunctionType) and not self.alike(self._space(a), self._space(b)):
            return False
        if hides(type(a), type(a).__module__.startswith(self.names[0])):
            raise _UnknownError
        return self.alike(_parts(a), _parts(b))

    def _all(self, a: Any, b: Any) -> bool:
        return len(a) == len(b) and all(map(self.alike, a, b))

    def _modules(self, a: ModuleType, b: ModuleType) -> bool:
        return self.alike(_without(vars(a), _OF_MODULES), _without(vars(b), _OF_MODULES))

    def _space(self, function: FunctionType) -> dict[str, Any] | None:
        """Return the globals of a function, or None if they are those of the two modules."""
        space = function.__globals__
        if id(space) not in self.spaces:
            self.spaces[id(space)] = _without(space, _OF_MODULES)
        return self.spaces[id(space)]

    def _types(self, a: type, b: type) -> bool:
        """Return whether two classes are the same, or those of one place in the source."""
        own = (a.__module__.startswith(self.names[0]), b.__module__.startswith(self.names[1]))
        return a is b or own == (True, True) and a.__qualname__ == b.__qualname__ and (
            self.alike(a.__bases__, b.__bases__) and self.alike(_members(a), _members(b)))


def _members(kind: type) -> dict[str, Any]:
    """Return the members of a class without those that Python adds, or its first use."""
    return {name: value for name, value in _without(vars(kind), _OF_CLASSES).items()
            if getattr(value, 'made_from', None) is not kind}  # of mambo_model.values


def _without(members: Any, names: set[str]) -> dict[str, Any]:
    """Return the members of a module or a class without those that Python adds."""
    return {name: value for name, value in members.items() if name not in names}


def _parts(value: Any) -> Any:
    """Return what a value consists of; raise an Exception if that cannot be told."""
    if isinstance(value, CPUDispatcher):
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
        return _Comparison(one, two).alike(one, two)
    except Exception:  # objects are a user's, and taking them apart may do anything
        return False
