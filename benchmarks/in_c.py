"""The C reference: compiled here, checked against the project's plant, timed."""

from __future__ import annotations

from collections.abc import Callable
import ctypes
from pathlib import Path
import shutil
import subprocess

from mambo_model.vehicle.parameters import Vehicle, VehicleValues
import numpy as np
from numpy.typing import NDArray

from . import geometric
from .measure import Contender, Gap, timed

SOURCE = Path(__file__).with_name('reference.c')
TOLERANCE = 1e-9  # m over 20 s: rounding of a stable loop, in another order of operations
_ARRAY = ctypes.POINTER(ctypes.c_double)
Fly = Callable[[int, bool], NDArray[np.float64]]


def build(folder: Path, compiler: str = 'gcc') -> Path:
    """
    Compile ``reference.c`` with -O2 into a library.

    Raises
    ------
    Gap
        Without a compiler, or if it fails.

    """
    if shutil.which(compiler) is None:
        raise Gap(f'no {compiler}: sudo apt install gcc')
    out = folder / 'reference.so'
    done = subprocess.run(
        [compiler, '-O2', '-shared', '-fPIC', str(SOURCE), '-o', str(out), '-lm'],
        text=True, capture_output=True)
    if done.returncode:
        raise Gap(f'{compiler} does not compile {SOURCE.name}: {done.stderr.splitlines()[0]}')
    return out


def loaded(library: Path, gains: geometric.Gains, vv: VehicleValues) -> Fly:
    """Return a function that flies so many control steps; its path (n, 3) in m if asked for."""
    function = ctypes.CDLL(str(library)).fly
    function.argtypes = [
        _ARRAY, ctypes.c_long, ctypes.c_double, ctypes.c_double, _ARRAY, _ARRAY, _ARRAY]
    function.restype = None
    vehicle = np.array([
        vv.mass, *vv.inertia, vv.gravity, vv.arm, vv.yaw_ratio, vv.power_a, vv.power_b,
        vv.pwm_min, vv.pwm_max, vv.drag_coefficient])

    def fly(steps: int, recorded: bool) -> NDArray[np.float64]:
        start = geometric.START.body
        state = np.array([*start.rho, *start.nu, *start.q, *start.omega])
        path = np.empty((steps if recorded else 0, 3))
        arguments = [array.ctypes.data_as(_ARRAY) for array in (state, np.array(gains), vehicle)]
        function(arguments[0], steps, geometric.STEP / geometric.SUBSTEPS, 1.5, *arguments[1:],
                 path.ctypes.data_as(_ARRAY) if recorded else None)
        return path
    return fly


def difference(fly: Fly, gains: geometric.Gains, vv: VehicleValues, seconds: float) -> float:
    """Return by how many m the C reference leaves the path of the project's plant, at most."""
    path = np.empty((round(seconds / geometric.STEP), 3))
    geometric.fly(geometric.START, gains, vv, path)
    return float(np.abs(fly(len(path), True) - path).max())


def contenders(quick: bool, folder: Path) -> list[Contender]:
    """Return the C reference, and the same flight by the project's plant."""
    gains, vv, made = geometric.Gains(), Vehicle().values(), {}
    seconds = 40.0 if quick else 400.0
    steps = round(seconds / geometric.STEP)

    def prepare() -> str:
        made['fly'] = loaded(build(folder), gains, vv)
        off = difference(made['fly'], gains, vv, 20.0)
        if not off < TOLERANCE:
            raise Gap(f'it leaves the path of the plant by {off:.1g} m')
        return f'leaves the path of the plant by {off:.1g} m in 20 s'

    def ours() -> None:
        geometric.fly(geometric.START, gains, vv, np.empty((steps, 3)))

    return [  # the plant first: the check of the other flies it too
        Contender('reference', 'reference_numba', 'the same flight by `mambo_sim`',
                  lambda: timed(seconds, ours), ours, 'its plant, and the same controller'),
        Contender('reference', 'reference_c', 'C reference',
                  lambda: timed(seconds, lambda: made['fly'](steps, False)), prepare,
                  '`gcc -O2`, Runge-Kutta steps at 1 kHz, SO(3) controller at 200 Hz')]
