"""One compiler setting for every numerical function, and a cache that cannot go stale."""

from __future__ import annotations

import atexit
from collections.abc import Callable, Iterator, Mapping
import contextlib
import functools
import hashlib
import importlib
import importlib.abc
import importlib.machinery
import importlib.metadata
import importlib.util
import os
from pathlib import Path
import shutil
import sys
import tempfile
from typing import Any, TypeVar

F = TypeVar('F', bound=Callable)
OWN_MODULES = 'mambo_own_'  # begins the names of modules made of users' files
ENTRY_POINTS = ('mambo.controllers', 'mambo.estimators')
COMPILED = ('mambo_model', 'mambo_sim', 'mambo_estimation', 'mambo_control', 'mambo_flight',
            'mambo_analysis')
NUMBA_VARIABLES = {  # of numba that are followed; it has about 90
    f'NUMBA_{name}' for name in (
        'CACHE_DIR', 'CPU_NAME', 'CPU_FEATURES', 'DISABLE_JIT', 'NUM_THREADS', 'THREADING_LAYER',
        'DISABLE_ERROR_MESSAGE_HIGHLIGHTING', 'DISABLE_PERFORMANCE_WARNINGS')}


class _Forgotten(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """
    Finds the module of a user's file that is not loaded in this process, as an empty one.

    The index of what is compiled names the types that it was compiled for, those of files that
    were flown once among them. They must not keep it from being read.
    """

    def find_spec(self, name: str, path: Any = None, target: Any = None) -> Any:
        """Return the specification of such a module, None for any other."""
        if name.startswith(OWN_MODULES) and '.' not in name:  # those of a package have none
            return importlib.machinery.ModuleSpec(name, self)
        return None

    def exec_module(self, module: Any) -> None:
        """Give the module a class of any name that is asked for."""
        def anything(name: str) -> type:
            if name.startswith('__'):
                raise AttributeError(name)
            return _stand_in(module, name)
        module.__getattr__ = anything


class _StandIn(type):
    """Type of classes that stand for those of a file that is not loaded, and for those inside."""

    def __getattr__(cls, name: str) -> type:
        """Return a class inside."""
        if name.startswith('__'):
            raise AttributeError(name)
        return _stand_in(cls, name)


def _stand_in(owner: Any, name: str) -> type:
    """Return the class of a name in a module or a class that is not loaded."""
    inside = isinstance(owner, type)
    found = _StandIn(name, (), {
        '__module__': owner.__module__ if inside else owner.__name__,
        '__qualname__': f'{owner.__qualname__}.{name}' if inside else name})
    setattr(owner, name, found)
    return found


sys.meta_path.insert(0, _Forgotten())


def _package(module: str) -> list[Path]:
    """Return the files of the package that a module belongs to, without importing it."""
    try:
        spec = importlib.util.find_spec(module.partition('.')[0])
    except (ImportError, ValueError):  # of an entry that names no module
        return []
    if spec is None or spec.origin is None or not spec.origin.endswith('.py'):
        return []
    path = Path(spec.origin)
    return sorted(path.parent.rglob('*.py')) if path.name == '__init__.py' else [path]


def source_digest() -> str:
    """
    Return a short digest of the numerical sources of every installed ``mambo_*`` package.

    numba invalidates a cached function when its own file changes, but not when a function that
    it calls in another file changes. A cache folder named after all sources avoids stale code.
    Most files of mambo_flight and mambo_analysis are not compiled; only their files with @jit
    count.
    """
    digest = hashlib.sha256()
    entries = (entry for group in ENTRY_POINTS
               for entry in importlib.metadata.entry_points(group=group)
               if entry.value.partition('.')[0] not in COMPILED)  # those count below
    # components that are installed may be part of what is compiled
    for entry in sorted(entries, key=lambda entry: (entry.group, entry.name)):
        version = entry.dist.version if entry.dist else ''
        digest.update(f'{entry.group} {entry.name} {entry.value} {version}'.encode())
        # its source may change without its version
        for path in _package(entry.value.partition(':')[0].strip()):
            digest.update(path.read_bytes())
    for name in COMPILED:
        for path in _package(name):
            source = path.read_bytes()
            if not path.stem.endswith('_node') and (
                    name not in ('mambo_flight', 'mambo_analysis') or b'@jit' in source):
                digest.update(source)
    return digest.hexdigest()[:16]


def _cache_root() -> Path:
    """Return the folder for compiled code: MAMBO_CACHE_DIR, or else the user's cache folder."""
    root = os.environ.get('MAMBO_CACHE_DIR')
    if root:
        return Path(root)
    return Path(os.environ.get('XDG_CACHE_HOME') or Path.home() / '.cache') / 'mambo'


def _usable(folder: Path) -> bool:
    """Return whether files can be made in a folder, which is made if it is missing."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


def _make_cache() -> str:
    """
    Return a folder that can be written for compiled code.

    Without one, numba would write beside the sources, both functions of :class:`_Compiled` into
    the same file, and what it then loads crashes. A folder for this process and its children
    takes the place of one that cannot be written: they compile once more.
    """
    folder = Path(os.environ.get('NUMBA_CACHE_DIR') or _cache_root() / f'numba-{source_digest()}')
    if _usable(folder):
        return str(folder)
    try:
        made = tempfile.mkdtemp(prefix='mambo-compiled-')
    except OSError as error:
        sys.exit(f'mambo: {folder}: compiled code cannot be written there, nor to a temporary '
                 f'folder ({error.strerror}): set MAMBO_CACHE_DIR to a folder that can')
    owner = os.getpid()
    atexit.register(lambda: os.getpid() == owner and shutil.rmtree(made, ignore_errors=True))
    sys.stderr.write(f'mambo: {folder}: compiled code cannot be written there, so all is compiled '
                     'again for about a minute: set MAMBO_CACHE_DIR to a folder that can\n')
    return made


def _leave_out_variables() -> None:
    """
    Remove variables of numba that would have every flight compiled in another way, and say so.

    They are for functions of one's own. Left set, those for debugging let a flight compile for
    minutes, and one with a value that cannot be read gives a warning with a traceback. A script
    that imported numba before has chosen for itself.
    """
    ignored = sorted(name for name in os.environ if name.startswith('NUMBA_')
                     and name not in NUMBA_VARIABLES)
    if ignored and 'numba' not in sys.modules:
        for name in ignored:
            del os.environ[name]
        sys.stderr.write(f'mambo: ignored from the environment: {", ".join(ignored)} '
                         '(every flight is compiled alike)\n')


_leave_out_variables()
os.environ['NUMBA_CACHE_DIR'] = _make_cache()
# numba prepares the colours of messages for each function that it tries in a call, fitting or not
os.environ.setdefault('NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING', '1')

import llvmlite.binding  # noqa: E402 (whose options count from the first compilation)
import numba  # noqa: E402 (reads NUMBA_CACHE_DIR while it is imported; all others import it here)
from numba import objmode, typeof  # noqa: E402, F401
from numba.core import caching  # noqa: E402
from numba.core.errors import NumbaError  # noqa: E402, F401
from numba.core.registry import CPUDispatcher  # noqa: E402
from numba.experimental import structref  # noqa: E402
from numba.extending import overload  # noqa: E402
from numba.typed import List  # noqa: E402

from .compilation import references  # noqa: E402
from .compilation.bitcode import (  # noqa: E402
    ApartCompiler, InsideCache, InsideCompiler, PythonCompiler)
from .compilation.checked_file import CheckedFile, without_space  # noqa: E402

numba.config.CACHE_DIR = os.environ['NUMBA_CACHE_DIR']  # of a script that imported numba before

# LLVM's register coalescer updates the live range of a value that it computes again after each of
# its copies; with that put off it takes a tenth of the time for a function as large as a closed
# loop. The default of 100 copies puts it off for few values.
llvmlite.binding.set_option('mambo', '-late-remat-update-threshold=3')

# Loops over matrices of a filter are short and their columns lie apart: vectors of their numbers
# gain nothing and take a tenth of the time to compile a flight with the joint filter.
numba.config.LOOP_VECTORIZE = 0
references.NRTContext.get_meminfos = references.get_meminfos

caching.IndexDataCacheFile = CheckedFile
caching.Cache._guard_against_spurious_io_errors = lambda self: without_space()


def _load_arrays() -> None:
    """
    Import numba's functions of arrays without scipy's linear algebra, 0.4 s of CPU.

    They import it only to see whether it is there. What needs it imports it when it is compiled.
    """
    name = 'scipy.linalg.cython_blas'
    if name in sys.modules:
        return
    sys.modules[name] = None  # type: ignore[assignment]  # cannot be imported meanwhile
    try:
        importlib.import_module('numba.np.arraymath')
    finally:
        del sys.modules[name]


_load_arrays()


class _Compiled(CPUDispatcher):
    """
    A compiled function; calls from Python are compiled apart, when there is the first one.

    Code that takes a call from Python apart, number by number, is a third of what numba compiles
    for such functions, and compiled callers do not use it. So they get the function without it,
    as bitcode, and what Python calls is compiled once more, with it.

    Attributes
    ----------
    cache : str
        Folder of the compiled code for calls from Python.

    """

    cache = ''

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Call from Python."""
        return self.for_python(*arguments, **named)

    @functools.cached_property
    def for_python(self) -> CPUDispatcher:
        """The same function for calls from Python."""
        with own_cache(self.cache):
            return numba.njit(
                cache=True, error_model='numpy', no_cfunc_wrapper=True,
                pipeline_class=PythonCompiler)(self.py_func)


# of functions that only compiled code calls
_INSIDE = {'no_cpython_wrapper': True, 'no_cfunc_wrapper': True, 'pipeline_class': InsideCompiler}


def _compiled(function: Callable, **options: Any) -> Any:
    """Return a compiled function; the function itself with compilation switched off."""
    made = numba.njit(error_model='numpy', **_INSIDE | options)(function)
    if isinstance(made, CPUDispatcher):
        made.__class__ = _Compiled
        made.cache = numba.config.CACHE_DIR
        with own_cache('inside'):
            made._cache = InsideCache(function)
    return made


@contextlib.contextmanager
def own_cache(name: str) -> Iterator[None]:
    """Cache functions that are defined inside this context in a folder inside the present one."""
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(Path(before) / name)
    try:
        yield
    finally:
        numba.config.CACHE_DIR = before


def jit(function: F) -> F:
    """
    Compile a pure numerical function: cached on disk, IEEE arithmetic (no fastmath).

    Every caller (node, replay, closed loop, Monte Carlo) runs the same compiled code and so gets
    the same bits.
    """
    return _compiled(function)


def jit_inside(function: F) -> F:
    """
    Compile as :func:`jit`, and make the machine code part of that of every compiled caller.

    numba passes this on to all that is first compiled for such a function, but for what is
    compiled by :func:`jit_apart`.

    For functions that take or return the memory or the parameters of a whole filter: a call copies
    each of their numbers to the stack and back. With calls the closed loop had 0.41 of its speed,
    and without sensors 0.64. Only for functions with one or two callers, as each of these
    compiles the code anew; not for what is rarely reached, such as the alignment at rest.
    """
    return _compiled(function, forceinline=True)


def jit_apart(function: F) -> F:
    """
    Compile as :func:`jit`, as one function that all its callers call.

    For what is called in many places and rarely reached, or takes much longer than a call: it
    would be copied into each of them.
    """
    return _compiled(function, forceinline=False, pipeline_class=ApartCompiler)


def jit_beside_python(function: F) -> F:
    """Compile as :func:`jit` what several threads run at once: it does not hold Python's lock."""
    return numba.njit(cache=True, error_model='numpy', nogil=True)(function)


class _Held(structref.StructRefProxy):
    """Memory, random generator and values of a component between its steps; see :func:`hold`."""


class _Fields:
    """The same with compilation switched off."""

    def __init__(self, memory: Any, rng: Any, values: Any) -> None:
        self.memory, self.rng, self.values = memory, rng, values


@structref.register
class _HeldType(numba.types.StructRef):
    """Type of :class:`_Held` in compiled code."""


structref.define_proxy(_Held, _HeldType, ['memory', 'rng', 'values'])
Held = _Fields if numba.config.DISABLE_JIT else _Held


@jit
def hold(memory, rng, values):
    """
    Return what a component keeps between its steps, kept where compiled code has it.

    Arguments from Python are taken apart number by number at each call, which takes ten times as
    long as a step of the simulator. A process that steps for ever holds what does not change
    hands, and gives its compiled step the holder alone: ``held.memory``, ``held.rng`` and
    ``held.values`` are read there, and ``held.memory`` is set.

    Parameters
    ----------
    memory
        Result of the previous step.
    rng
        Generator or generators, None where there is no chance.
    values
        Parameters.

    """
    return Held(memory, rng, values)


@jit
def memory_of(held):
    """Return the memory in a holder to Python."""
    return held.memory


@jit
def hold_again(held, memory, rng, values):
    """Let a holder hold something else, of the same types."""
    held.memory, held.rng, held.values = memory, rng, values


@jit
def set_values(held, values):
    """Let a holder hold other parameters, of the same types."""
    held.values = values


@jit
def row_of(held):
    """Return a list for compiled code with one holder; :func:`lengthen` appends others."""
    return List([held])


@jit
def lengthen(row, held):
    """Append a holder to a list for compiled code."""
    row.append(held)


def by_type(
    position: int, functions: Mapping[type, Callable], default: Callable | None = None,
) -> Callable:
    """
    Return one function for several: which one is called depends on the type of one argument.

    In compiled code the choice is made while it is compiled: it costs nothing, not even a call,
    and what is not chosen is not compiled. An argument of another type is a TypeError, in compiled
    code at compile time.

    Parameters
    ----------
    position
        Of the argument that decides, from 0.
    functions
        Function for each type of this argument, NamedTuples and ``type(None)``; for compiled
        code compiled ones. One that is added later is chosen from then on.
    default
        Function for NamedTuples that are not among them.

    """
    def chosen(*arguments):
        """Dispatch a call from Python."""
        kind = type(arguments[position])
        if kind not in functions and default is None:
            known = ', '.join(sorted(one.__name__ for one in functions))
            raise TypeError(f'argument {position} is {kind.__name__}; known: {known}')
        return functions.get(kind, default)(*arguments)

    @overload(chosen, jit_options={'forceinline': True, **_INSIDE})
    def _choose(*arguments):
        """Dispatch at compile time."""
        kind = arguments[position]
        if isinstance(kind, numba.types.NoneType):
            found = functions.get(type(None))
        else:
            found = functions.get(getattr(kind, 'instance_class', None), default)
        return found and (lambda *arguments: found(*arguments))

    return chosen
