"""Tables 2.1, 4.1 and 4.2: operations of rotations, sensors of the Mambo, moments of inertia."""

from __future__ import annotations

from collections.abc import Callable
import dataclasses
import types

from mambo_model.motion import quaternion
from mambo_model.vehicle.parameters import preset
from mambo_sim.simulator import SimulatorParams
import numpy as np

from . import truths
from .claim import at_most, claim, near, Result

OPERATIONS = {  # of Table 2.1: multiplications, additions
    'product of two matrices': (27, 18), 'product of two quaternions': (16, 12),
    'vector turned by a matrix': (9, 6), 'vector turned by a quaternion': (18, 12)}
SENSORS = {  # of Table 4.1, the Mambo: whether it has one
    'barometer': True, 'imu': True, 'sonar': True, 'optical_flow': True, 'gps': False,
    'magnetometer': False}
INCREASES = (19.0, 8.0, 50.0)  # %, sec. 4.4.1


class Counted:
    """A number that counts the multiplications and additions of all its instances."""

    done = {'multiplications': 0, 'additions': 0}

    def __mul__(self, other: object) -> Counted:
        Counted.done['multiplications'] += 1
        return Counted()

    __rmul__ = __mul__

    def __add__(self, other: object) -> Counted:
        Counted.done['additions'] += 1
        return Counted()

    __sub__ = __radd__ = __rsub__ = __add__


def counted(function: Callable[[], object]) -> tuple[int, int]:
    """Return the numbers of multiplications and additions of :class:`Counted` in a function."""
    Counted.done = {'multiplications': 0, 'additions': 0}
    function()
    return Counted.done['multiplications'], Counted.done['additions']


def plain(function: Callable) -> Callable:
    """Return a compiled function, and those it calls, as plain Python."""
    source = getattr(function, 'py_func', function)
    names = {name: source.__globals__[name] for name in source.__code__.co_names
             if name in source.__globals__}
    return types.FunctionType(source.__code__, {
        name: plain(value) if hasattr(value, 'py_func') else value
        for name, value in names.items()})


@claim('Table 2.1', 'operations of rotations and of their products, as matrices and quaternions',
       contains='the functions that every flight uses',
       tests='whether they need as many as in the table: mathematics, independent of the drone')
def table_2_1() -> Result:
    """Count the operations of our functions, with numbers that count them."""
    A, B, v = (np.array([Counted() for _ in range(n)], object) for n in (9, 9, 3))
    p, q, r = (tuple(Counted() for _ in range(n)) for n in (4, 4, 3))
    done = {
        'product of two matrices': counted(lambda: A.reshape(3, 3) @ B.reshape(3, 3)),
        'product of two quaternions': counted(lambda: plain(quaternion.multiply)(p, q)),
        'vector turned by a matrix': counted(lambda: A.reshape(3, 3) @ v),
        'vector turned by a quaternion': counted(lambda: plain(quaternion.rotate)(q, r))}
    return Result([
        near(f'{what}: {kind}', found, wanted, 0.0, '', 'a count')
        for what, counts in done.items() for kind, found, wanted in zip(
            ('multiplications', 'additions'), counts, OPERATIONS[what], strict=True)])


@claim('Table 4.1', 'the Mambo has barometer, gyro, accelerometer, sonar and flow, but no GPS and '
       'no magnetometer', contains='the sensors of the table', tests='that none is missing and '
       'none is extra')
def table_4_1() -> Result:
    """Compare the simulated sensors with the table."""
    has = {field.name for field in dataclasses.fields(SimulatorParams)}
    wrong = sum((name in has) != there for name, there in SENSORS.items())
    return Result([at_most('sensors that differ from the table', wrong, 0, '', 'present or not')])


@claim('Table 4.2', 'the measured moments of inertia are 19, 8 and 50 % above those of the '
       'package', contains='both sets of numbers', given=True,
       tests='the percentages of the text', broken_by=('inertia x 2',))
def table_4_2() -> Result:
    """Compare the vehicle files of the package and of the thesis."""
    old, new = preset('toolbox').inertia, truths.vehicle().inertia
    return Result([
        near(f'J_{axis}{axis}, increase', 100.0 * (b / a - 1.0), wanted, 1.0, '%',
             'printed without decimals; 18.4 % is printed as 19')
        for axis, a, b, wanted in zip('xyz', old, new, INCREASES, strict=True)])
