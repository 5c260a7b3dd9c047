"""What compiled code of a user's file keeps: its functions and values may come from outside."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
import dataclasses
import dis
import enum
import hashlib
from pathlib import Path
import re
from types import BuiltinFunctionType, CodeType, FunctionType, ModuleType
from typing import Any
import uuid

from numba.core.types import Type
import numpy as np

from ..compiled import CPUDispatcher

_PLAIN = (bool, int, float, complex, str, bytes, type(None))
_NAMED = (BuiltinFunctionType, np.ufunc)  # known by their names
_PICKLING = ('__reduce_ex__', '__reduce__', '__getstate__')  # may leave out what an object holds
_ADDRESS = re.compile(r'(#|0x)[0-9a-f]{6,}')
_UNKNOWN = uuid.uuid4().hex  # of this process: what is compiled with it serves no other one
_DEEPEST = 20  # names of modules in modules, and lists in lists


def kept(module: ModuleType, within: str) -> dict[str, str]:
    """
    Return a digest of all that the compiled functions of a module take from outside of their code.

    numba takes a global, a variable of an enclosing function or a default as a constant. What is
    compiled and cached on disk belongs to these values, too, not to the source alone: a file of
    weights may have changed, a compiled function of a package, or which of several functions a
    name stands for.

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
    if next(_compiled_functions(module, module.__name__, set()), None) is None:
        return {}
    reader = _Reader(module, within)
    reader.read_names(module, '')
    return {place: _sha256('\n'.join(notes)) for place, notes in reader.found.items()}


def _compiled_functions(holder: Any, module: str, seen: set[int]) -> Iterator[Any]:
    """Yield the compiled functions of a module, and of its classes and objects inside."""
    for value in list(getattr(holder, '__dict__', {}).values()):
        if isinstance(value, staticmethod):
            value = value.__func__
        if _python_function(value) is not value:
            yield value
        elif _may_hold_functions(value, module) and id(value) not in seen:
            seen.add(id(value))
            yield from _compiled_functions(value, module, seen)


def _may_hold_functions(value: Any, module: str) -> bool:
    """Return whether a class or an object is of a user's file, or may stand for a module of it."""
    kind = value if isinstance(value, type) else type(value)
    return kind.__module__.startswith(module) or kind.__qualname__ == 'SimpleNamespace'


def _python_function(value: Any) -> Any:
    """Return the Python function of a compiled one; any other value as it is."""
    if isinstance(value, CPUDispatcher):
        return value.py_func
    if not type(value).__module__.startswith('numba.'):
        return value
    for path in ('_dispatcher.py_func', 'gufunc_builder.py_func',  # of vectorize and guvectorize
                 'kernel_ir.func_id.func', '_defn'):  # of stencil and intrinsic
        found = value
        for name in path.split('.'):
            found = getattr(found, name, None)
        if isinstance(found, FunctionType):
            return found
    return value


def assigned(module: ModuleType, called: Iterable[str]) -> set[str]:
    """
    Return the globals that a module's functions assign in flight, as :func:`kept` names them.

    Parameters
    ----------
    module
        With the functions, in classes too.
    called
        Names of those that are called in flight; what they call is followed.

    """
    new, seen, names = set(called), set(), set()
    holders = [module, *(value for value in vars(module).values() if isinstance(value, type))]
    while new:
        seen |= new
        found = [getattr(vars(holder).get(name), '__func__', vars(holder).get(name))
                 for holder in holders for name in new]
        codes = [function.__code__ for function in found if isinstance(function, FunctionType)
                 and function.__globals__ is vars(module)]
        names |= {name for code in codes for name in _assigned(code)}
        new = set().union(*map(_names, codes)) - seen
    return {f'{Path(getattr(module, "__file__", None) or module.__name__).name}: {name}'
            for name in names}


def _assigned(code: CodeType) -> Iterator[str]:
    """Yield the globals that code assigns."""
    for step in dis.get_instructions(code):
        if step.opname == 'STORE_GLOBAL':
            yield str(step.argval)
    for part in code.co_consts:
        if isinstance(part, CodeType):
            yield from _assigned(part)


def hides(kind: type, own: bool) -> bool:
    """Return whether pickling may leave out what the objects of a user's own class hold."""
    return own and any(
        getattr(kind, name, None) is not getattr(object, name, None)
        and getattr(getattr(kind, name), '__module__', '') not in ('dataclasses', 'enum')
        for name in _PICKLING)


def _sha256(text: str | bytes) -> str:
    return hashlib.sha256(text.encode() if isinstance(text, str) else text).hexdigest()


def _code(code: CodeType) -> str:
    """Return a digest of code without the place where it stands."""
    constants = [_code(part) if isinstance(part, CodeType) else
                 repr(sorted(map(repr, part)) if isinstance(part, frozenset) else part)
                 for part in code.co_consts]
    return _sha256(repr((code.co_code, code.co_names, code.co_varnames, constants)))


def _names(code: CodeType) -> set[str]:
    """Return every name that code reads, that of functions inside it too."""
    names = set(code.co_names)
    for part in code.co_consts:
        if isinstance(part, CodeType):
            names |= _names(part)
    return names


def _content(value: Any, depth: int = 0) -> bytes | None:
    """Return numbers, texts, arrays, and tuples, lists and dicts of them as bytes; else None."""
    if type(value) in _PLAIN:
        return f'{type(value).__name__} {value!r}'.encode()
    if isinstance(value, np.ndarray | np.generic) and not value.dtype.hasobject:
        return f'{value.dtype!r} {value.shape} '.encode() + value.tobytes()
    if type(value) is dict:
        value = tuple(value.items())
    if type(value) in (tuple, list) and depth < _DEEPEST:
        parts = []
        for part in value:
            if (content := _content(part, depth + 1)) is None:
                return None
            parts.append(content)
        return f'{type(value).__name__} {len(parts)}('.encode() + b', '.join(parts) + b')'
    return None


class _Reader:
    """
    Notes what compiled functions keep, by file and name.

    Several functions may be of one name, such as those that a function returns: their notes
    follow one another, in the order in which they are found.
    """

    def __init__(self, module: ModuleType, within: str) -> None:
        self.within = within
        self.folder = str(Path(getattr(module, '__file__', None) or '').parent)
        self.file = Path(getattr(module, '__file__', None) or module.__name__).name
        self.found: dict[str, list[str]] = defaultdict(list)
        self.seen: dict[int, tuple[int, Any]] = {}  # number in order, and what it is, kept alive
        self.holders: dict[int, Any] = {}  # classes and objects whose names were read
        self.walked: dict[tuple[int, int], Any] = {}  # modules, with the names that are read there
        self.extends = any(getattr(value, '__module__', '') == 'numba.core.extending'
                           for value in vars(module).values())

    def read_names(self, holder: Any, before: str) -> None:
        """Note what functions and classes the names of a module, class or object stand for."""
        for name, value in sorted(getattr(holder, '__dict__', {}).items()):
            if name.startswith('__'):
                continue
            value = value.__func__ if isinstance(value, staticmethod) else value
            place = f'{self.file}: {before}{name}'
            if isinstance(value, FunctionType) and not self.extends:
                self.found[place].append(
                    f'{self._own(value.__module__ or "")}.{value.__qualname__}')
            elif isinstance(value, type) or _is_function(value):
                self.read(place, value, set())
            if _may_hold_functions(value, self.within) and id(value) not in self.holders:
                self.holders[id(value)] = value
                self.read_names(value, f'{before}{name}.')

    def _is_new(self, value: Any) -> bool:
        """Return whether a value is met for the first time; it is not any more."""
        new = id(value) not in self.seen
        if new:
            self.seen[id(value)] = len(self.seen), value
        return new

    def read(self, place: str, value: Any, names: set[str], depth: int = 0) -> None:
        """Note the value at a place; names: all that the code that reads it uses."""
        note = self.found[place].append
        if type(value) is str:
            note(_sha256(value.replace(self.within, '')))
        elif (content := _content(value)) is not None:
            note(_sha256(content))
        elif isinstance(value, ModuleType):  # numba reads its attributes as globals
            note(self._own(value.__name__))
            if (id(value), id(names)) not in self.walked:
                self.walked[id(value), id(names)] = value, names
                for inner, part in self._attributes(value, names):
                    self.read(f'{place}.{inner}', part, names, depth)
        elif isinstance(value, type):
            self._read_type(place, value)
        elif _is_function(value):
            self._read_function(place, value)
        elif isinstance(value, tuple | list | dict) and depth < _DEEPEST:
            new = self._is_new(value)
            note(f'{self._kind(value)} {len(value)} {self.seen[id(value)][0]}')
            for part in () if not new else value.items() if isinstance(value, dict) else value:
                self.read(place, part, names, depth + 1)
        elif isinstance(value, enum.Enum):
            note(f'{self._kind(value)}.{value.name}')
            self.read(place, value.value, names, depth + 1)
        elif isinstance(value, np.dtype | Type):
            note(f'{self._kind(value)} {_ADDRESS.sub("", repr(value))}')
        elif isinstance(value, _NAMED):
            note(f'{self._kind(value)} {getattr(value, "__module__", "")} '
                 f'{getattr(value, "__qualname__", getattr(value, "__name__", ""))}')
        else:
            note(self._kind(value))
            self._read_object(place, value, depth)

    def _attributes(self, module: ModuleType, names: set[str]) -> Iterator[tuple[str, Any]]:
        """Yield what names are in a module, also if a user's one makes them when asked."""
        asks = module.__name__.startswith(self.within) or type(module) is not ModuleType
        for name in sorted(names):
            if name in vars(module) or asks and hasattr(module, name):
                if (value := getattr(module, name)) is not module:
                    yield name, value

    def _read_object(self, place: str, value: Any, depth: int) -> None:
        """Note what pickle would write of an object; what has no pickle serves this process."""
        if not self._is_new(value):
            return
        try:
            if depth >= _DEEPEST or hides(
                    type(value), type(value).__module__.startswith(self.within)):
                raise TypeError
            whole = value.__reduce_ex__(2)
            if not isinstance(whole, str):
                whole = [list(part) if i > 2 and part is not None else part
                         for i, part in enumerate(whole[:5])]
        except Exception:  # of a user's object, which may do anything
            self.found[place].append(_UNKNOWN)
            return
        self.read(place, whole, set(), depth + 1)

    def _own(self, name: str) -> str:
        """Return the name of a module; one of the user's without what differs by version."""
        return f'./{name.removeprefix(self.within)}' if name.startswith(self.within) else name

    def _kind(self, value: Any) -> str:
        return f'{self._own(type(value).__module__)}.{type(value).__qualname__}'

    def _read_type(self, place: str, kind: type) -> None:
        """Note a class, and the fields that compiled code knows by their order."""
        fields = getattr(kind, '_fields', None) or [
            field.name for field in dataclasses.fields(kind)] if (
                hasattr(kind, '_fields') or dataclasses.is_dataclass(kind)) else ()
        self.found[place].append(f'{self._own(kind.__module__)}.{kind.__qualname__} {fields}')
        if defaults := getattr(kind, '_field_defaults', None):
            self.read(place, defaults, set())
        if issubclass(kind, enum.Enum) and self._is_new(kind):
            self.read(place, list(kind), set())
        if (compiled := getattr(kind, 'class_type', None)) is not None:  # of numba's jitclass
            for part in ('jit_methods', 'jit_static_methods', 'jit_props'):
                self.read(place, getattr(compiled, part, {}), set())

    def _read_function(self, place: str, value: Any) -> None:
        """Note a function, and the values that it reads; a package's with its source."""
        function = _python_function(value)
        module, code = function.__module__ or '', function.__code__
        own, compiled = module.startswith(self.within), function is not value
        new = self._is_new(function)
        options = _options(value) if own else ''
        self.found[place].append(
            f'{self._own(module)}.{function.__qualname__} {code.co_firstlineno} '
            f'{self.seen[id(function)][0]} {options} {_code(code) if own else ""}')
        if not new or not own and (not compiled or module.startswith('mambo_')):
            return  # the workspace's own source names the folder of what is compiled
        if not own and (source := Path(code.co_filename)).is_file():
            self.found[str(source)] = [_sha256(source.read_bytes())]
        names, whole = _names(code), code.co_filename
        beside = whole.startswith(f'{self.folder}/')
        file = whole.removeprefix(f'{self.folder}/') if beside else Path(whole).name
        for name, part in self._outside(function):
            self.read(f'{file}: {name}', part, names)

    @staticmethod
    def _outside(function: Any) -> Iterator[tuple[str, Any]]:
        """Yield globals, variables of enclosing functions and defaults by their names."""
        code = function.__code__
        for name in sorted(_names(code) & function.__globals__.keys()):
            yield name, function.__globals__[name]
        for name, cell in zip(code.co_freevars, function.__closure__ or ()):
            try:
                yield f'{function.__qualname__}.{name}', cell.cell_contents
            except ValueError:  # has none yet
                continue
        for i, value in enumerate(function.__defaults__ or ()):
            yield f'{function.__qualname__}, default {i}', value


def _options(value: Any) -> str:
    """Return the options, the types and the signatures that a compiled function was given."""
    def text(option: Any) -> str:
        if isinstance(option, set | frozenset | dict):
            return str(sorted(map(str, option.items() if isinstance(option, dict) else option)))
        return str(option) if type(option) in _PLAIN else type(option).__name__
    given = {**getattr(value, 'targetoptions', {}), 'types': getattr(value, 'locals', {})}
    return f'{sorted((name, text(option)) for name, option in given.items())} ' + ' '.join(
        map(str, getattr(value, 'overloads', ())))


def _is_function(value: Any) -> bool:
    """Return whether a value is a function of Python code, compiled or not."""
    return isinstance(_python_function(value), FunctionType)
