"""Any function of time as a course: a spline through its values, refined until it fits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
import importlib.util
from pathlib import Path
import re
import traceback

from mambo_model.errors import InputError
from mambo_model.motion.polynomial import Array, AXES, Course
from mambo_model.motion.uav_trajectories import LONGEST, MAX_PIECES
import numpy as np
from scipy.interpolate import make_interp_spline, PPoly

Function = Callable[[float], Sequence[float]]

DEGREE = 7
FIRST = 16        # pieces that are tried at first
POSITION = 1e-6   # m and rad, that the spline may be away between its knots
SNAP = 0.02       # of the largest snap, that two splines may differ by
_NAME = re.compile(r'(.+\.py):(\w+)')


def is_function(name: str) -> bool:
    """Return whether a name is ``FILE.py:FUNCTION``."""
    return _NAME.fullmatch(name) is not None


def load(name: str) -> Function:
    """
    Return the function ``FILE.py:FUNCTION``.

    Raises
    ------
    InputError
        If the file is not there or fails, or has no such function.

    """
    found = _NAME.fullmatch(name)
    if not found:
        raise InputError(f'{name}: write FILE.py:FUNCTION')
    path, function = Path(found[1]), found[2]
    if not path.is_file():
        raise InputError(f'{path}: No such file or directory')
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None  # of a .py file
    module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise InputError(_said(path, error)) from None
    if not callable(getattr(module, function, None)):
        raise InputError(f'{path}: has no function {function}')
    return getattr(module, function)


def _said(path: Path, error: Exception) -> str:
    """Return where in a file of the user an error comes from, and what it says."""
    if isinstance(error, SyntaxError):
        return f'{path}:{error.lineno}: {error.msg}'
    lines = [frame.lineno for frame in traceback.extract_tb(error.__traceback__)
             if Path(frame.filename).name == path.name]
    return f'{path}:{lines[-1] if lines else 1}: {type(error).__name__}: {error}'


def _sample(function: Function, times: Array, where: str) -> Array:
    """Return x, y, z and yaw at times, (n, 4); InputError if the function gives anything else."""
    out = np.zeros((len(times), len(AXES)))
    for k, t in enumerate(times.tolist()):
        try:
            values = np.asarray(function(t), dtype=float)
        except Exception as error:
            raise InputError(f'{_said(Path(where.partition(":")[0]), error)}, at t = {t:g} s'
                             ) from None
        if values.shape not in ((3,), (4,)):
            raise InputError(f'{where}: gives an array of shape {values.shape} at t = {t:g} s; '
                             'it must be x, y, z in m, NED, and yaw in rad or nothing')
        if not np.isfinite(values).all():
            raise InputError(f'{where}: gives {values.tolist()} at t = {t:g} s')
        out[k, :len(values)] = values
    return out


def _spline(function: Function, duration: float, pieces: int, where: str) -> PPoly:
    """Return the spline of degree 7 through evenly spaced values with so many pieces."""
    times = np.linspace(0.0, duration, pieces + DEGREE)
    spline = make_interp_spline(times, _sample(function, times, where), k=DEGREE)
    axes = [PPoly.from_spline((spline.t, c, DEGREE)) for c in spline.c.T]
    return PPoly(np.stack([axis.c for axis in axes], axis=-1), axes[0].x)


def fit(function: Function, duration: float, where: str = 'the function') -> Course:
    """
    Return a course that follows a function of time.

    Parameters
    ----------
    function
        Takes the time in s, from 0 on; returns x, y, z in m, inertial NED, and yaw in rad if
        it has four. Smooth: the controller needs four derivatives.
    duration : s
    where
        What errors call the function.

    Returns
    -------
    course
        Of degree 7, six times continuously differentiable; at most 1e-6 m or rad away.

    Raises
    ------
    InputError
        If the function fails, returns something else, or is not smooth enough for 1000 pieces.

    """
    if not 0.0 < duration <= LONGEST:
        raise InputError(f'duration = {duration:g} s must be above 0 and at most {LONGEST:g} s')
    pieces = FIRST
    spline = _spline(function, duration, pieces, where)
    while 2 * pieces <= MAX_PIECES:
        pieces *= 2
        finer = _spline(function, duration, pieces, where)
        times = np.linspace(0.0, duration, 4 * pieces + 1)
        gap = np.abs(finer(times) - _sample(function, times, where)).max()
        snap, other = (one.derivative(4)(times) for one in (finer, spline))
        if gap <= POSITION and np.abs(snap - other).max() <= SNAP * max(np.abs(snap).max(), 1.0):
            return _course(finer)
        spline = finer
    raise InputError(
        f'{where}: is not smooth enough: {pieces} polynomials miss it by {gap:.2g} m or rad, or '
        'its snap does not converge')


def _course(spline: PPoly) -> Course:
    """Return a spline of scipy as a course."""
    kept = np.diff(spline.x) > 0.0
    return Course(np.diff(spline.x)[kept], np.ascontiguousarray(
        spline.c[::-1, kept].transpose(1, 2, 0)))
