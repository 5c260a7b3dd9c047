"""
Functions of time as courses: a spline through the values, refined until it fits.

A function is named by its file (``mine.py``, or ``mine.py:NAME`` for one of several in it) or as
an installed entry point of the group ``mambo.trajectories``; a script may offer its own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
import importlib.metadata
import inspect
from pathlib import Path
from typing import Any, NamedTuple, TYPE_CHECKING

from mambo_model import own_file
from mambo_model.components import absolute, file_and_name
from mambo_model.errors import InputError, MamboError
from mambo_model.motion.polynomial import Array, AXES, Course
from mambo_model.motion.uav_trajectories import LONGEST, MAX_PIECES
from mambo_model.own_file import bounded, describe, digest, fault_place, load_file
from mambo_model.script import script_source
import numpy as np

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

Function = Callable[[float], Sequence[float]]

GROUP = 'mambo.trajectories'
USUAL = 'trajectory'  # name of the default function of a file with several
DEGREE = 7
FIRST = 16        # pieces of the first spline
POSITION = 1e-6   # m and rad, largest error of the spline between its knots
SNAP = 0.02       # largest relative change of the snap by a refinement
STATED = 0.01     # largest relative error of a derivative that the function states
_ROWS = ('position', 'velocity', 'acceleration', 'jerk', 'snap')
_SHAPES = ('it must be x, y, z in m, NED, and yaw in rad or nothing; or rows of these: '
           f'{", ".join(_ROWS)}')


class Source(NamedTuple):
    """A function and where it comes from."""

    function: Function
    name: str             # in error messages
    path: Path | None     # of its file, if it has one
    about: str            # name, version and hash of the source in one line
    duration: float | None  # s, as the file states; None: not stated


_OFFERED: dict[str, Source] = {}  # functions of scripts, by name


def is_function(name: str) -> bool:
    """Return whether a name refers to a Python file or to a function of a script."""
    return name in _OFFERED or file_and_name(name) is not None


def installed() -> dict[str, importlib.metadata.EntryPoint]:
    """Return the functions of installed packages, by name."""
    return {entry.name: entry for entry in importlib.metadata.entry_points(group=GROUP)}


def offer(function: Function) -> str:
    """
    Return a name under which a function of this process can be flown.

    Its source may be in a notebook. The hash is that of the source text if Python knows it, else
    of the compiled function.

    Raises
    ------
    InputError
        If it cannot be called.

    """
    if not callable(function):
        raise InputError(f'trajectory: {function!r} is neither a name, a path nor a function')
    name = getattr(function, '__name__', type(function).__name__).strip('<>')
    path, sha256 = script_source(function)
    key = f'{name} of a script, sha256 {sha256}'
    _OFFERED[key] = Source(function, name, path, key, _stated_duration(function, None, name))
    return key


def load(name: str, folder: Path = Path()) -> Source:
    """
    Return a function by name: ``FILE.py``, ``FILE.py:NAME``, an installed or an offered one.

    Parameters
    ----------
    name
        See above.
    folder
        Folder of a relative path.

    Raises
    ------
    InputError
        If the file is missing or fails, has no such function, or has several and none is named.

    """
    if name in _OFFERED:
        return _OFFERED[name]
    found = file_and_name(absolute(name, folder))
    if found is None:
        return _load_installed(name)
    try:
        return _from_file(Path(found[0]), found[1])
    except MamboError:
        raise
    except Exception as error:  # what is looked at is a user's and may do anything
        raise InputError(_message(Path(found[0]), error)) from None


def _from_file(path: Path, chosen: str) -> Source:
    """Return the function of a file, the chosen one if there is a name."""
    module = load_file(path)
    if not chosen:
        own = [key for key, value in vars(module).items() if not key.startswith('_') and (
            inspect.isfunction(value) and value.__module__ == module.__name__)]
        if USUAL not in own and len(own) != 1:
            has = f'has the functions {", ".join(own)}' if own else 'has no function'
            raise InputError(f'{path}: {has}: write {path.name}:NAME, or call one {USUAL}')
        chosen = USUAL if USUAL in own else own[0]
    function = getattr(module, chosen, None)
    if isinstance(function, type):
        function = _instance(path, function)
    if not callable(function):
        raise InputError(f'{path}:{chosen}: there is no such function')
    version = getattr(module, '__version__', '')
    about = f'{path.name}:{chosen}{version and f" {version}"}, sha256 {digest(path)}'
    return Source(function, f'{path}:{chosen}', path, about,
                  _stated_duration(function, module, f'{path}:{chosen}'))


def _load_installed(name: str) -> Source:
    """Return the function of an entry point."""
    entry = installed().get(name)
    if entry is None:
        raise InputError(f'{name}: write FILE.py or FILE.py:FUNCTION')
    own_file.before_loading(Path(name))
    try:
        function = entry.load()
    except Exception as error:  # whatever a package raises while it is imported
        raise InputError(f'{name}: {entry.value} cannot be loaded: {describe(error)}') from None
    path = Path(inspect.getsourcefile(inspect.getmodule(function)) or '')
    version = f' {entry.dist.version}' if entry.dist else ''
    return Source(function, name, path, f'{name}{version}, sha256 {digest(path)}',
                  _stated_duration(function, inspect.getmodule(function), name))


def _instance(path: Path, kind: type) -> Any:
    """Return an instance of a class whose instances are functions of time."""
    try:
        return kind()
    except Exception as error:
        raise InputError(_message(path, error)) from None


def _stated_duration(function: Any, module: Any, where: str) -> float | None:
    """Return the duration that a function or its file states, in s; None: not stated."""
    value = getattr(function, 'duration', getattr(module, 'duration', None))
    if value is None or callable(value):
        return None
    try:
        if isinstance(value, (str, bytes, bool)):  # which float() would read
            raise TypeError
        return float(value)
    except (TypeError, ValueError):
        raise InputError(f'{where}: duration = {value!r} is not a number of seconds') from None


def _message(path: Path | None, error: BaseException, name: str = '') -> str:
    """Return file, line and text of an error in a user's file."""
    at = fault_place(path, error) if path is not None else name
    return f'{at}: {describe(error)}'


def _values(source: Source, t: float) -> Array:
    """Return the value of a function at a time, rows of x, y, z and yaw; may raise InputError."""
    try:
        found = np.asarray(source.function(t))
        if found.dtype.kind in 'US':  # which numpy would read as numbers
            raise TypeError(f'{found.tolist()} is text, not numbers')
        if found.dtype.kind == 'c':  # of which it would take the real part
            raise TypeError(f'{found.tolist()} is complex')
        values = found.astype(float)
    except (Exception, SystemExit) as error:
        raise InputError(f'{_message(source.path, error, source.name)}, at t = {t:g} s') from None
    rows = values if values.ndim == 2 else values[None]
    if values.ndim not in (1, 2) or rows.shape[1] not in (3, 4) or not (
            1 <= len(rows) <= len(_ROWS)):
        raise InputError(
            f'{source.name}: returns an array of shape {values.shape} at t = {t:g} s; {_SHAPES}')
    if not np.isfinite(rows).all():
        raise InputError(f'{source.name}: returns {values.tolist()} at t = {t:g} s')
    return rows


def check(source: Source) -> None:
    """Raise InputError if a function fails at 0 s or returns no position there."""
    with bounded(source.path):
        _values(source, 0.0)


def _sample(source: Source, times: Array) -> Array:
    """Return x, y, z and yaw at times, (n, 4); InputError for any other value."""
    out = np.zeros((len(times), len(AXES)))
    for k, t in enumerate(times.tolist()):
        row = _values(source, t)[0]
        out[k, :len(row)] = row
    return out


def _check_derivatives(source: Source, spline: PPoly) -> None:
    """Raise InputError if stated derivatives are not those of the position."""
    times = np.linspace(spline.x[0], spline.x[-1], 41)[1:-1]
    given = [_values(source, t) for t in times.tolist()]
    if any(rows.shape != given[0].shape for rows in given):
        raise InputError(f'{source.name}: returns arrays of different shapes; {_SHAPES}')
    stated = np.array(given)  # (times, derivative, axis)
    for order in range(1, stated.shape[1]):
        own = spline.derivative(order)(times)[:, :stated.shape[2]]
        wrong = np.abs(stated[:, order] - own)
        k, axis = np.unravel_index(int(wrong.argmax()), wrong.shape)
        if wrong[k, axis] > STATED * max(np.abs(own).max(), 1.0):
            raise InputError(
                f'{source.name}: returns a {_ROWS[order]} along {AXES[axis]} of '
                f'{stated[k, order, axis]:.4g} at t = {times[k]:.4g} s, but the derivative of its '
                f'position is {own[k, axis]:.4g}')


def _spline(source: Source, duration: float, pieces: int) -> PPoly:
    """Return the spline of degree 7 through evenly spaced values."""
    from scipy.interpolate import make_interp_spline, PPoly  # 0.6 s of CPU, for functions alone
    times = np.linspace(0.0, duration, pieces + DEGREE)
    spline = make_interp_spline(times, _sample(source, times), k=DEGREE)
    axes = [PPoly.from_spline((spline.t, c, DEGREE)) for c in spline.c.T]
    return PPoly(np.stack([axis.c for axis in axes], axis=-1), axes[0].x)


def fit(
    function: Function | Source, duration: float, where: str = 'the function',
) -> Course:
    """
    Return a course that follows a function of time.

    Parameters
    ----------
    function
        Takes the time in s, from 0 on; returns x, y, z in m, inertial NED, and optionally yaw in
        rad; or up to five rows of these, the value and its time derivatives. It must be smooth:
        the controller uses four derivatives of the position. Stated derivatives are checked.
    duration : s
    where
        Name in error messages, for a function without a source.

    Returns
    -------
    course
        Of degree 7, six times continuously differentiable; its error is at most 1e-6 m or rad.

    Raises
    ------
    InputError
        If the function fails, returns a wrong value, states wrong derivatives, is not smooth
        enough for 1000 pieces, or takes more than ``MAMBO_MAX_READING_S``.

    """
    if not 0.0 < duration <= LONGEST:
        raise InputError(f'duration = {duration:g} s must be above 0 and at most {LONGEST:g} s')
    source = function if isinstance(function, Source) else Source(
        function, where, None, where, None)
    with bounded(source.path):
        return _fit(source, duration)


def _fit(source: Source, duration: float) -> Course:
    """Return the course; errors as those of :func:`fit`."""
    pieces = FIRST
    spline = _spline(source, duration, pieces)
    while 2 * pieces <= MAX_PIECES:
        pieces *= 2
        finer = _spline(source, duration, pieces)
        times = np.linspace(0.0, duration, 4 * pieces + 1)
        gap = np.abs(finer(times) - _sample(source, times)).max()
        snap, other = (one.derivative(4)(times) for one in (finer, spline))
        if gap <= POSITION and np.abs(snap - other).max() <= SNAP * max(np.abs(snap).max(), 1.0):
            _check_derivatives(source, finer)
            return _course(finer)
        spline = finer
    raise InputError(
        f'{source.name}: is not smooth enough: with {pieces} polynomials the error is {gap:.2g} m '
        'or rad, or the snap does not converge')


def _course(spline: PPoly) -> Course:
    """Return a spline of scipy as a course."""
    kept = np.diff(spline.x) > 0.0
    return Course(np.diff(spline.x)[kept], np.ascontiguousarray(
        spline.c[::-1, kept].transpose(1, 2, 0)))
