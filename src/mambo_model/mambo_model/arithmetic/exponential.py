"""Exponential functions, logarithms and powers."""

from __future__ import annotations

from decimal import Decimal, localcontext
import math

import numpy as np

from ..compiled import jit
from .double_double import DIGITS, split, two_product, two_sum

BITS = 7
CELLS = 2 ** BITS  # of the tables of logarithms and of powers of 2, over one octave
_LEAST_NORMAL = 2.0 ** -1022
_FIRST = 0x3FF0000000000000 - (151 << 44)  # bits of 0.705: 1 is inside a cell, 75 before it
_ROUND = 1.5 * 2.0 ** 52  # what is added to it is rounded to a whole number


def _on_grid(value: Decimal) -> tuple[float, float]:
    """Return a multiple of 2^-42, so that a multiple of LN2 is added exactly, and the rest."""
    high = math.floor(math.ldexp(float(value), 42)) * 2.0 ** -42
    return high, float(value - Decimal(high))


def _inverse(cell: int) -> float:
    """Return a number of 9 bits near 1/z in the middle of a cell; 1 where a cell holds 1."""
    first, last = (np.int64(_FIRST + (i << 45)).view(np.float64) for i in (cell, cell + 1))
    return 1.0 if first < 1.0 < last else round(4.0 * CELLS / (first + last)) / (2.0 * CELLS)


with localcontext() as _context:
    _context.prec = DIGITS
    LN2, LN2_LOW = split(Decimal(2).ln(), 42)               # a product with 11 bits is exact
    _CELL, _CELL_LOW = split(Decimal(2).ln() / CELLS, 35)   # a product with 18 bits is exact
    _CELLS_PER_E = float(CELLS / Decimal(2).ln())
    _INVERSE = np.array([_inverse(i) for i in range(CELLS)])
    _LOGARITHMS = np.array([_on_grid(-Decimal(float(c)).ln()) for c in _INVERSE])
    _root = (Decimal(2).ln() / CELLS).exp()
    _ROOTS = np.array([split(_root ** i, 53) for i in range(CELLS)])
_POWERS = np.array([math.ldexp(1.0, k) for k in range(-1022, 1024)])


@jit
def _scale(value: float, k: int) -> float:
    """Return value 2^k for a value in [1/2, 4] and k in -1100 ... 1024, rounded once."""
    if k > 1022:
        return value * 2.0 * _POWERS[k + 1021]
    if k < -1020:  # one rounding, into a subnormal
        return value * _POWERS[k + 1122] * 2.0 ** -100
    return value * _POWERS[k + 1022]


@jit
def _power_of_e(x: float, low: float) -> tuple[int, float, float]:
    """Return k, a and b: e^(x + low) = 2^k (a + b), a in [1, 2) and b small (Tang)."""
    n = (x * _CELLS_PER_E + _ROUND) - _ROUND
    r = (x - n * _CELL) + (low - n * _CELL_LOW)
    square = r * r
    less = r + square * ((0.5 + r * (1.0 / 6.0)) + square * (1.0 / 24.0 + r * (1.0 / 120.0)))
    whole = int(n)
    cell = whole & (CELLS - 1)
    return whole >> BITS, _ROOTS[cell, 0], _ROOTS[cell, 1] + _ROOTS[cell, 0] * less


@jit
def exp(x: float) -> float:
    """Return e^x."""
    return _exp_of_sum(x, 0.0)


@jit
def _exp_of_sum(x: float, low: float) -> float:
    """Return e^(x + low), low below an ulp of x."""
    if not -745.2 < x < 709.79:
        return x if math.isnan(x) else math.inf if x > 0.0 else 0.0
    k, a, b = _power_of_e(x, low)
    return _scale(a + b, k)


@jit
def expm1(x: float) -> float:
    """Return e^x - 1, accurate for small x too."""
    if not abs(x) < 40.0:
        return exp(x) - 1.0
    if abs(x) < 0.2:
        return x + x * x * (0.5 + x * (1.0 / 6.0 + x * (1.0 / 24.0 + x * (1.0 / 120.0 + x * (
            1.0 / 720.0 + x * (1.0 / 5040.0 + x * (1.0 / 40320.0 + x * (1.0 / 362880.0 + x * (
                1.0 / 3628800.0 + x * (1.0 / 39916800.0 + x * (1.0 / 479001600.0)))))))))))
    k, a, b = _power_of_e(x, 0.0)
    scale = _POWERS[k + 1022]
    high, rest = two_sum(scale * a, -1.0)
    return high + (rest + scale * b)


@jit
def _logarithm(x: float) -> tuple[float, float]:
    """
    Return the natural logarithm of x as a number and a small correction, x > 0 and normal (Tang).

    x = 2^k z, and z = (1 + r) / c with c from a table of numbers with few bits: the products that
    make r, and the square of its upper part, are exact.
    """
    bits = np.float64(x).view(np.int64)
    beyond = bits - _FIRST
    cell, k = (beyond >> 45) & (CELLS - 1), beyond >> 52
    bits -= k << 52
    z, c = np.int64(bits).view(np.float64), _INVERSE[cell]
    upper = np.int64((bits + 0x80000000) & -0x100000000).view(np.float64)
    r_upper, r_lower = upper * c - 1.0, (z - upper) * c
    r = r_upper + r_lower
    square, half = r * r, -0.5 * r_upper * r_upper
    series = square * r * (((1.0 / 3.0 - 0.25 * r) + square * (0.2 - (1.0 / 6.0) * r))
                           + square * square * ((1.0 / 7.0 - 0.125 * r) + square * (1.0 / 9.0)))
    base = k * LN2 + _LOGARITHMS[cell, 0]
    first = base + r
    out = first + half
    rounded = (r_upper - r + r_lower) + (base - first + r) + (first - out + half)
    return out, (rounded + (k * LN2_LOW + _LOGARITHMS[cell, 1])) + (
        series - 0.5 * r_lower * (r_upper + r))


@jit
def log(x: float) -> float:
    """Return the natural logarithm of x; NaN below 0."""
    if not 0.0 < x < math.inf:
        return -math.inf if x == 0.0 else x if x > 0.0 else math.nan
    if x < _LEAST_NORMAL:
        high, low = _logarithm(x * 2.0 ** 54)
        high, rest = two_sum(high, -54.0 * LN2)
        return high + (rest + (low - 54.0 * LN2_LOW))
    high, low = _logarithm(x)
    return high + low


@jit
def log1p(x: float) -> float:
    """Return the natural logarithm of 1 + x, accurate for small x too; NaN below -1."""
    if abs(x) < 1e-300 or not -1.0 < x < math.inf:
        return x if abs(x) < 1e-300 else log(1.0 + x)
    near, low = two_sum(1.0, x)
    high, rest = _logarithm(near)
    return high + (rest + low / near)


@jit
def power(x: float, y: float) -> float:
    """Return x^y of a base x >= 0, within 2 ulp if x is subnormal; NaN for x < 0."""
    if not (_LEAST_NORMAL <= x < math.inf and 1e-150 < abs(y) < 1e150):
        return _rare_power(x, y)
    return _normal_power(x, y)


@jit
def _normal_power(x: float, y: float) -> float:
    """Return x^y, x normal and above 0."""
    high, low = _logarithm(x)
    p, rest = two_product(high, y)
    return _exp_of_sum(p, rest + low * y)


@jit
def _rare_power(x: float, y: float) -> float:
    """Return x^y where x is 0, subnormal, negative or no number, or y is extreme."""
    if y == 0.0 or x == 1.0:
        return 1.0
    if not x >= 0.0 or math.isnan(y):
        return math.nan
    if 0.0 < x < math.inf and abs(y) < 1e150:
        if x >= _LEAST_NORMAL:
            return 1.0  # |y| is below 1e-150
        return _normal_power(x * 2.0 ** 54, y) * _normal_power(2.0 ** -54, y)
    return math.inf if (x > 1.0) == (y > 0.0) else 0.0
