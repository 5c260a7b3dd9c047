"""Where references are counted in compiled code."""

from typing import NamedTuple

from mambo_model.compilation.references import may_refer
from mambo_model.compiled import hold, jit
import numba
from numba.core.runtime import rtsys
from numba.core.runtime._nrt_python import memsys_enable_stats
import numpy as np
import pytest


class Numbers(NamedTuple):
    """Nothing but numbers."""

    a: float
    b: tuple[int, bool]
    c: tuple[float, float, float]


class Mixed(NamedTuple):
    """Numbers and an array, two levels down."""

    numbers: Numbers
    more: tuple


NUMBERS = Numbers(1.0, (2, True), (3.0, 4.0, 5.0))
ARRAY = np.array([1.0, 2.0])


@pytest.mark.parametrize(
    'value', [1, 2.0, True, np.uint64(3), (), (1.0, 2.0), NUMBERS, (1, NUMBERS)])
def test_numbers_and_tuples_of_them_hold_no_references(value):
    assert not may_refer(numba.typeof(value))


@pytest.mark.parametrize('value', [
    ARRAY, (1.0, ARRAY), (ARRAY, ARRAY), Mixed(NUMBERS, (1.0, ARRAY)), np.random.default_rng(1),
    hold((1.0,), None, None), 'text', None], ids=str)
def test_all_else_may(value):
    assert may_refer(numba.typeof(value))


@jit
def taken_apart(mixed, often):
    """Make arrays inside tuples and drop them."""
    total = 0.0
    for k in range(often):
        made = (mixed.numbers, (k * 1.0, mixed.more[1] + k))
        other = made
        total += other[1][1][0] + made[0].a
    return total


def test_of_arrays_that_are_dropped_nothing_is_left():
    mixed = Mixed(NUMBERS, (1.0, ARRAY))
    assert taken_apart(mixed, 1) == 2.0
    memsys_enable_stats()
    before = rtsys.get_allocation_stats()
    assert taken_apart(mixed, 100) == 100 * 2.0 + sum(range(100))
    after = rtsys.get_allocation_stats()
    assert after.alloc - before.alloc >= 100
    assert after.alloc - before.alloc == after.free - before.free
