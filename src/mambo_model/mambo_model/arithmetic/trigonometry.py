"""Sine, cosine and their inverses."""

from __future__ import annotations

from decimal import Decimal, localcontext
import math

import numpy as np

from ..compiled import jit, jit_apart
from .double_double import arctangent, DIGITS, pi, split, two_product, two_sum

LARGEST_ANGLE = 6.0e9  # rad, up to which the reduction below is exact enough
STEPS = 16             # of the table of arc tangents, from 0 to 1

with localcontext() as _context:
    _context.prec = DIGITS
    _pi = pi()
    PI, PI_LOW = split(_pi, 53)
    HALF_PI, HALF_PI_LOW = split(_pi / 2, 53)
    _NEAR = split(_pi / 2, 33)                 # a product with 20 bits is exact
    _FAR = split(_pi / 2, 21, 21, 21, 21)      # a product with 32 bits is exact
    _ARCTANGENTS = np.array([
        split(arctangent(Decimal(i) / STEPS), 53) for i in range(STEPS + 1)])


@jit
def _sine(r: float, low: float) -> float:
    """Return the sine of r + low in rad, |r| < 0.79: Taylor to r^17."""
    z = r * r
    w = z * z
    series = z * (((-1.0 / 6.0 + z * (1.0 / 120.0)) + w * (
        -1.0 / 5040.0 + z * (1.0 / 362880.0))) + w * w * (
            (-1.0 / 39916800.0 + z * (1.0 / 6227020800.0)) + w * (
                -1.0 / 1307674368000.0 + z * (1.0 / 355687428096000.0))))
    return r + (r * series + low * (1.0 - 0.5 * z))


@jit
def _cosine(r: float, low: float) -> float:
    """Return the cosine of r + low in rad, |r| < 0.79: Taylor to r^16."""
    z = r * r
    w = z * z
    series = w * (((1.0 / 24.0 - z * (1.0 / 720.0)) + w * (
        1.0 / 40320.0 - z * (1.0 / 3628800.0))) + w * w * (
            (1.0 / 479001600.0 - z * (1.0 / 87178291200.0)) + w * (1.0 / 20922789888000.0)))
    half = 0.5 * z
    one = 1.0 - half
    return one + (((1.0 - one) - half) + (series - r * low))


@jit
def _reduce(x: float) -> tuple[int, float, float]:
    """
    Return the quadrant of x in rad, 0 to 3, and what is left in two doubles (Cody, Waite).

    Two parts of pi/2 are enough unless x is large or close to a multiple of pi/2.
    """
    n = math.floor(x * (2.0 / math.pi) + 0.5)
    a, b = x - n * _NEAR[0], n * _NEAR[1]
    r = a - b
    if abs(x) < 2e5 and abs(r) > 1e-3:
        return int(n) & 3, r, (a - r) - b
    r, low = two_sum(x - n * _FAR[0], -n * _FAR[1])
    r, more = two_sum(r, -n * _FAR[2])
    low += more
    r, more = two_sum(r, -n * _FAR[3])
    low += more - n * _FAR[4]
    high = r + low
    return int(n) & 3, high, low - (high - r)


@jit
def sin(x: float) -> float:
    """Return the sine of x in rad; beyond 6e9 rad the C library's."""
    return sin_cos(x)[0]


@jit
def cos(x: float) -> float:
    """Return the cosine of x in rad; beyond 6e9 rad the C library's."""
    return sin_cos(x)[1]


@jit
def sin_cos(x: float) -> tuple[float, float]:
    """Return sine and cosine of x in rad; beyond 6e9 rad those of the C library."""
    if abs(x) < 0.785:
        if abs(x) < 1e-8:
            return x, 1.0
        return _sine(x, 0.0), _cosine(x, 0.0)
    if not abs(x) < LARGEST_ANGLE:
        return (math.sin(x), math.cos(x)) if abs(x) < math.inf else (math.nan, math.nan)
    quadrant, r, low = _reduce(x)
    s, c = _sine(r, low), _cosine(r, low)
    if quadrant & 1:
        s, c = c, -s
    return (-s, -c) if quadrant & 2 else (s, c)


@jit
def _arc(y: float, x: float, low: float) -> tuple[float, float]:
    """Return the angle of (x + low, y) in two doubles, 0 <= y <= x, x > 0."""
    cell = int(math.floor(STEPS * (y / x) + 0.5))
    c = cell / STEPS
    p, error = two_product(c, x)
    n, rest = two_sum(y - p, -error - c * low)
    p, error = two_product(c, y)
    d, more = two_sum(x, p)
    more += error + low
    t = n / d
    p, error = two_product(t, d)
    t_low = ((n - p) - error + rest - t * more) / d
    z = t * t
    series = t * z * (-1.0 / 3.0 + z * (0.2 + z * (-1.0 / 7.0 + z * (1.0 / 9.0 + z * (
        -1.0 / 11.0 + z * (1.0 / 13.0))))))
    high, a = two_sum(_ARCTANGENTS[cell, 0], t)
    return high, a + (_ARCTANGENTS[cell, 1] + t_low + series)


@jit_apart
def _arc_of_sum(y: float, x: float, low: float) -> float:
    """Return the angle of (x + low, y) in rad, y >= 0, in [0, pi]."""
    short = abs(x)
    if x < 0.0:
        low = -low
    if y <= short:
        high, rest = _arc(y, short, low)
    else:
        high, rest = _arc_beyond(y, short, low)
    if x < 0.0:
        high, more = two_sum(PI, -high)
        rest = PI_LOW + more - rest
    return high + rest


@jit
def _arc_beyond(y: float, x: float, low: float) -> tuple[float, float]:
    """Return the angle of (x + low, y) in two doubles, 0 <= x < y."""
    angle, rest = _arc(x, y, 0.0)
    if low != 0.0:
        rest += low * y / (x * x + y * y)
    high, more = two_sum(HALF_PI, -angle)
    return high, HALF_PI_LOW + more - rest


@jit
def atan2(y: float, x: float) -> float:
    """Return the angle of the point (x, y) in rad, in [-pi, pi]; signs of zero as in C."""
    high, side = abs(y), abs(x)
    size = high + side
    if not 1e-270 < size < 1e290:
        if math.isnan(size) or size == 0.0 or math.isinf(high) or math.isinf(side):
            return math.atan2(y, x)  # exact: 0 and quarters of pi
        scale = 2.0 ** 200 if size < 1.0 else 2.0 ** -200
        x, high = x * scale, high * scale
    return math.copysign(_arc_of_sum(high, x, 0.0), y) if y != 0.0 or x < 0.0 else y


@jit
def atan(x: float) -> float:
    """Return the arc tangent of x in rad."""
    return atan2(x, 1.0)


@jit
def asin(x: float) -> float:
    """Return the arc sine of x in rad; NaN beyond +-1."""
    y = abs(x)
    if not y <= 1.0:
        return math.nan
    p, error = two_product(y, y)
    rest, low = two_sum(1.0, -p)
    low -= error
    if rest <= 0.0:
        return math.copysign(HALF_PI, x)
    root = math.sqrt(rest)
    p, error = two_product(root, root)
    return math.copysign(
        _arc_of_sum(y, root, ((rest - p) - error + low) / (2.0 * root)), x)
