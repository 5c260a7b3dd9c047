"""Users' Python files as modules, each loaded once per content, as its hash identifies it."""

from __future__ import annotations

import ast
import builtins
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
import hashlib
import importlib.abc
import importlib.machinery
from importlib.machinery import PathFinder
import importlib.util
import itertools
from pathlib import Path
import signal
import sys
import threading
from types import ModuleType
from typing import Any, NoReturn

from . import limits
from .compilation.constants import assigned, kept
from .compilation.twins import twins
from .compiled import own_cache, OWN_MODULES
from .errors import MamboError
from .schema import ParameterError


_IN_FLIGHT = ('initial', 'step')  # functions of a component


def nothing(path: Path) -> None:
    """Do nothing."""


before_loading: Callable[[Path], None] = nothing
"""Called with the file before a user's code is loaded for the first time."""


_LOCK = threading.RLock()  # one file at a time has its own modules among those of Python


class TooLongError(ParameterError):
    """A user's code takes too long; the text says where and what raises the limit."""


class OverdueError(BaseException):
    """A user's code takes too long; no Exception, which a loop in it may pass over."""


def _overdue(*_: Any) -> NoReturn:
    raise OverdueError


@contextmanager
def time_limit(seconds: float) -> Iterator[None]:
    """
    Raise OverdueError in work that takes longer, and again each second until the work has ended.

    Only the main thread has such a limit: signals come to that alone.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGALRM, _overdue)
    signal.setitimer(signal.ITIMER_REAL, seconds, 1.0)
    try:
        yield
    finally:
        try:
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        except OverdueError:  # at the last moment: the work has ended, and the next is 1 s away
            signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


@contextmanager
def bounded(path: Path | None) -> Iterator[None]:
    """
    End a user's code that takes longer than reading a file may, in the main thread.

    Parameters
    ----------
    path
        Of the code.

    Raises
    ------
    TooLongError
        With the line at which it was, if it takes more than ``MAMBO_MAX_READING_S`` (120 s).

    """
    seconds = limits.READING_S.value()
    try:
        with time_limit(seconds):
            yield
    except OverdueError as error:
        raise TooLongError(f'{fault_place(path, error)}: takes more than {seconds} s; '
                           f'{limits.raised_by(limits.READING_S)}') from None


def describe(error: BaseException) -> str:
    """Return an error of a user's code in one line, with its kind unless it is one of ours."""
    try:
        text = ' '.join(str(error).split())
    except Exception:
        text = 'its text cannot be read'
    return text if isinstance(error, MamboError) else (
        f'{type(error).__name__}: {text or "no message"}')


def name_apart(kind: type, sha256: str) -> None:
    """Give a NamedTuple a unique name; numba takes NamedTuples of equal name for one type."""
    if not kind.__name__.endswith(f'_{sha256[:12]}'):
        kind.__name__ = f'{kind.__name__}_{sha256[:12]}'


def _named_tuples(holder: Any, module: str, seen: set[type]) -> Iterator[type]:
    """Yield the NamedTuples that a module defines, including those nested in its classes."""
    for value in list(vars(holder).values()):
        if isinstance(value, type) and value.__module__ == module and value not in seen:
            seen.add(value)
            if issubclass(value, tuple):
                yield value
            else:
                yield from _named_tuples(value, module, seen)


def _imports(file: Path) -> Iterator[str]:
    """Yield the first names of the modules that a source imports; nothing if it has an error."""
    try:
        with _LOCK:  # Python 3.11 counts its depth of recursion for all threads together
            tree = ast.parse(file.read_bytes())
    except (SyntaxError, ValueError):
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition('.')[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and not node.level:
            yield str(node.module).partition('.')[0]


def _own_files(path: Path) -> set[Path]:
    """Return a file, and the files and packages in its folder that it imports, however far."""
    found: set[Path] = set()
    followed = set(sys.stdlib_module_names)
    new = [path]
    while new:
        file = new.pop()
        if file in found or not file.is_file():
            continue
        found.add(file)
        for name in set(_imports(file)) - followed:
            followed.add(name)
            new += [path.with_name(f'{name}.py'), *path.with_name(name).rglob('*.py')]
    return found


def digest(path: Path) -> str:
    """Return the sha256 of a source file and of what it imports from its folder."""
    return _digest(path, _own_files(path))


def _digest(path: Path, files: set[Path]) -> str:
    if files == {path}:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    out = hashlib.sha256()
    for file in sorted(files):
        out.update(file.relative_to(path.parent).as_posix().encode() + b'\0' + file.read_bytes())
    return out.hexdigest()


def fault_place(path: Path | None, error: BaseException) -> str:
    """Return the file and line in the user's code at which an error was raised."""
    at, trace = '', error.__traceback__
    while trace is not None:
        if path is not None and Path(trace.tb_frame.f_code.co_filename).parent == path.parent:
            at = f'{trace.tb_frame.f_code.co_filename}:{trace.tb_lineno}'
        trace = trace.tb_next
    return at or str(path)


def _is_library(name: str) -> bool:
    """Return whether a module is one of Python, of this workspace or of an installed package."""
    if name in sys.stdlib_module_names:
        return True
    loaded = sys.modules.get(name)
    if loaded is None:
        return False
    parts = Path(getattr(loaded, '__file__', None) or 'site-packages').parts
    return name.startswith('mambo') or not {'site-packages', 'dist-packages'}.isdisjoint(parts)


class _FromSource(importlib.abc.Loader):
    """
    Runs a source as a module of another name than the one that it is imported by.

    Never from bytecode: that counts as current if the source has its size and is of its second.
    """

    def __init__(self, path: Path, name: str, beside: _Beside) -> None:
        self.path, self.name, self.beside = path, name, beside

    def create_module(self, spec: Any) -> ModuleType:
        """Return the empty module."""
        return ModuleType(self.name)

    def exec_module(self, module: ModuleType) -> None:
        """Fill the module."""
        sys.modules[self.name] = module  # so that numba finds its types again
        # the statement import calls this function, now and in functions that are called later
        vars(module)['__builtins__'] = {**vars(builtins), '__import__': self.beside.importing}
        exec(compile(self.path.read_bytes(), self.path, 'exec', dont_inherit=True), vars(module))


class _Loaded(importlib.abc.Loader):
    """Gives a module that is loaded already, under one more name."""

    def __init__(self, module: ModuleType) -> None:
        self.module, self.spec = module, module.__spec__

    def create_module(self, spec: Any) -> ModuleType:
        """Return the module."""
        return self.module

    def exec_module(self, module: ModuleType) -> None:
        """Leave the module as it is."""
        module.__spec__ = self.spec


class _Beside(importlib.abc.MetaPathFinder):
    """
    Imports what stands in the folder of a user's file, for this file alone.

    Two folders may both have a ``gains.py``, and one may have another content at the next flight.

    Parameters
    ----------
    path
        Of the file.
    name
        Of its module; begins the names of the modules beside it.
    files
        The file, and what it imports from its folder.

    """

    def __init__(self, path: Path, name: str, files: set[Path]) -> None:
        self.folder, self.name = path.parent, name
        tops = {file.relative_to(self.folder).parts[0] for file in files}
        self.tops = {top for top in (top.removesuffix('.py') for top in tops)
                     if not _is_library(top)}
        self.loaded: dict[str, ModuleType] = {}
        self.names: dict[str, str] = {}  # by which modules are imported, by their own names
        importlib.invalidate_caches()

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> Any:
        """Return the specification of a module beside the file, None for any other."""
        package, _, last = name.rpartition('.')
        if package in self.names:  # "from package import module" asks by the package's own name
            return self._in_package(f'{self.names[package]}.{last}', name)
        if name.partition('.')[0] not in self.tops:
            return None
        found = PathFinder.find_spec(name, [str(self.folder)] if path is None else path)
        if found is None or found.origin is None or not found.origin.endswith('.py'):
            return found
        own = f'{self.name}__{name.replace(".", "__")}'
        self.names[own] = name
        return importlib.util.spec_from_file_location(
            name, found.origin, loader=_FromSource(Path(found.origin), own, self),
            submodule_search_locations=found.submodule_search_locations)

    @staticmethod
    def _in_package(whole: str, name: str) -> Any:
        """Return the specification of a module of a package, which it is imported by twice."""
        try:
            module = importlib.import_module(whole)
        except ModuleNotFoundError as error:
            if error.name != whole:
                raise
            raise ModuleNotFoundError(f'No module named {whole!r}', name=name) from None
        return importlib.machinery.ModuleSpec(name, _Loaded(module))

    @contextmanager
    def found(self) -> Iterator[None]:
        """Let imports find what stands beside the file."""
        with _LOCK:
            before = self._take_out()
            sys.modules.update(self.loaded)
            sys.meta_path.insert(0, self)
            sys.path.insert(0, str(self.folder))
            try:
                yield
            finally:
                with suppress(ValueError):  # the file has taken it out
                    sys.path.remove(str(self.folder))
                with suppress(ValueError):
                    sys.meta_path.remove(self)
                self.loaded = self._take_out()
                sys.modules.update(before)

    def _take_out(self) -> dict[str, ModuleType]:
        """Remove the modules of these names from those of Python, and return them."""
        names = [name for name in list(sys.modules) if name.partition('.')[0] in self.tops]
        return {name: sys.modules.pop(name) for name in names}

    def importing(
        self, name: str, globals: Any = None, locals: Any = None, fromlist: Any = (),
        level: int = 0,
    ) -> Any:
        """Import as Python does, from beside the file too."""
        whole = str((globals or {}).get('__package__')) if level else name
        if whole.partition('.')[0] not in self.tops or self in sys.meta_path:
            return builtins.__import__(name, globals, locals, fromlist, level)
        with self.found():
            return builtins.__import__(name, globals, locals, fromlist, level)


def _run(path: Path, files: set[Path], version: str) -> ModuleType:
    """Return a new module of a file; its name ends with a version of what it depends on."""
    name = _name(path, version)
    beside = _Beside(path, name, files)
    spec = importlib.util.spec_from_file_location(
        name, path, loader=_FromSource(path, name, beside))
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    try:
        # what is compiled goes with this version
        with own_cache(name), bounded(path), beside.found():
            spec.loader.exec_module(module)
        for part in _modules(name):
            for kind in _named_tuples(sys.modules[part], part, set()):
                name_apart(kind, version)
    except BaseException as error:
        _drop(name)
        if isinstance(error, KeyboardInterrupt | TooLongError):
            raise
        if isinstance(error, SyntaxError) and error.filename != '<unknown>':  # of ast
            at = f'{error.filename}:{error.lineno}' if error.filename else path
            raise ParameterError(f'{at}: {error.msg}') from None
        raise ParameterError(f'{fault_place(path, error)}: {describe(error)}') from None
    return module


def _name(path: Path, version: str) -> str:
    return f'{OWN_MODULES}{path.stem}_{version[:16]}'


def _modules(name: str) -> list[str]:
    """Return the names of a user's module and of what it has imported from beside it."""
    return [key for key in list(sys.modules) if key == name or key.startswith(f'{name}__')]


def _parts(name: str) -> dict[str, ModuleType]:
    """Return the modules of :func:`_modules` by what their names have behind the first."""
    return {key.removeprefix(name): sys.modules[key] for key in _modules(name)}


def _drop(name: str) -> None:
    for key in _modules(name):
        del sys.modules[key]


_loaded: dict[tuple[Path, str], ModuleType] = {}


def forget() -> None:
    """Let every file be loaded anew: it, or what it reads, may have changed."""
    _loaded.clear()


def load_file(path: Path) -> ModuleType:
    """
    Return the module of a file, loaded once for each content until :func:`forget`.

    Its name holds a hash of the source, of what it imports from its folder, and of the values
    that compiled code keeps. So nothing that was compiled for another version is taken for it.

    Raises
    ------
    ParameterError
        If the file is not there or fails while it is loaded, with its line; also if that takes
        more than ``MAMBO_MAX_READING_S`` (default 120 s), or if a value that compiled code keeps
        is another one each time.

    """
    limits.check_regular(path)
    if not path.is_file():
        raise ParameterError(f'{path}: No such file or directory')
    files = _own_files(path)
    sha256 = _digest(path, files)
    if (path, sha256) in _loaded:
        return _loaded[path, sha256]
    before_loading(path)
    with _LOCK:
        module = _load(path, files, sha256)
    _loaded[path, sha256] = module
    return module


def _load(path: Path, files: set[Path], sha256: str) -> ModuleType:
    """
    Return a new module of a file, or a former one with compiled functions that holds the same.

    numba takes two NamedTuples of one name for the same type in some places and not in others, so
    two modules with compiled functions never have the same name.
    """
    module = _run(path, files, sha256)
    with bounded(path):
        values = kept(module, module.__name__)
    if not values:
        return module
    if changing := sorted(assigned(module, _IN_FLIGHT) & values.keys()):
        _drop(module.__name__)
        raise ParameterError(
            f'{path.parent / changing[0]} is assigned in flight, and compiled code keeps the '
            'value that it has while the file is loaded: make it a parameter, or part of the '
            'memory')
    new = _parts(module.__name__)
    _drop(module.__name__)
    for number in itertools.count():
        content = f'{sha256} {sorted(values.items())} {number}'
        version = hashlib.sha256(content.encode()).hexdigest()
        old = _parts(_name(path, version))
        file = getattr(old.get(''), '__file__', None)
        if file is None:  # there is none, or an empty one that stands for it in an index
            break
        if file == module.__file__ and old.keys() == new.keys():
            with bounded(path):
                if all(twins(old[part], new[part]) for part in new):
                    return old['']  # with what it has compiled
    module = _run(path, files, version)
    with bounded(path):
        again = kept(module, module.__name__)
    if changing := sorted(name for name in values if again.get(name) != values[name]):
        _drop(module.__name__)
        raise ParameterError(
            f'{path.parent / changing[0]} has another value each time the file is loaded, and '
            'compiled code keeps one: make it a parameter, or leave out @jit')
    return module
