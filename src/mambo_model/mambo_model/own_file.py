"""Users' Python files as modules, each loaded once per content, as its hash identifies it."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from contextlib import contextmanager
import hashlib
import importlib.util
from pathlib import Path
import signal
import sys
import threading
from types import ModuleType
from typing import Any, NoReturn

from . import limits
from .compiled import own_cache, OWN_MODULES
from .errors import MamboError
from .schema import ParameterError


def nothing(path: Path) -> None:
    """Do nothing."""


before_loading: Callable[[Path], None] = nothing
"""Called with the file before a user's code is loaded for the first time."""


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


def _named_tuples(holder: Any, module: str) -> Iterator[type]:
    """Yield the NamedTuples that a module defines, including those nested in its classes."""
    for value in list(vars(holder).values()):
        if isinstance(value, type) and value.__module__ == module:
            if issubclass(value, tuple):
                yield value
            else:
                yield from _named_tuples(value, module)


def _siblings(path: Path, known: set[Path]) -> set[Path]:
    """Return a file and the files in its folder that it imports, directly or indirectly."""
    if path in known or not path.is_file():
        return known
    known.add(path)
    try:
        tree = ast.parse(path.read_bytes())
    except (SyntaxError, ValueError):
        return known
    for node in ast.walk(tree):
        names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else (
            [node.module or ''] if isinstance(node, ast.ImportFrom) else [])
        for name in names:
            _siblings(path.with_name(f'{name.partition(".")[0]}.py'), known)
    return known


def digest(path: Path) -> str:
    """Return the sha256 of a source file and of the files in its folder that it imports."""
    files = sorted(_siblings(path, set()))
    if files == [path]:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    out = hashlib.sha256()
    for file in files:
        out.update(file.name.encode() + b'\0' + file.read_bytes())
    return out.hexdigest()


def fault_place(path: Path | None, error: BaseException) -> str:
    """Return the file and line in the user's code at which an error was raised."""
    at, trace = '', error.__traceback__
    while trace is not None:
        if path is not None and Path(trace.tb_frame.f_code.co_filename).parent == path.parent:
            at = f'{trace.tb_frame.f_code.co_filename}:{trace.tb_lineno}'
        trace = trace.tb_next
    return at or str(path)


def load_file(path: Path) -> ModuleType:
    """
    Return the module of a file, loaded once for each content.

    Its name holds the hash of the source, so that what was compiled for another version of the
    file is not taken for it.

    Raises
    ------
    ParameterError
        If the file is not there or fails while it is loaded, with its line; also if that takes
        more than ``MAMBO_MAX_READING_S`` (default 120 s).

    """
    limits.check_regular(path)
    if not path.is_file():
        raise ParameterError(f'{path}: No such file or directory')
    name = f'{OWN_MODULES}{path.stem}_{digest(path)[:16]}'
    if getattr(sys.modules.get(name), '__file__', None):
        return sys.modules[name]
    before_loading(path)
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None and spec.loader is not None  # of a .py file
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    sys.path.insert(0, str(path.parent))  # for files beside it
    try:
        with own_cache(name), bounded(path):  # what is compiled goes with this content
            spec.loader.exec_module(module)
        for kind in _named_tuples(module, name):
            name_apart(kind, digest(path))
    except BaseException as error:
        del sys.modules[name]
        if isinstance(error, KeyboardInterrupt | TooLongError):
            raise
        if isinstance(error, SyntaxError):
            at = f'{error.filename}:{error.lineno}' if error.filename else path
            raise ParameterError(f'{at}: {error.msg}') from None
        raise ParameterError(f'{fault_place(path, error)}: {describe(error)}') from None
    finally:
        sys.path.remove(str(path.parent))
    return module
