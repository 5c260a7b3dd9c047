"""Sums and products in two doubles, and constants to more digits than one double has."""

from __future__ import annotations

from decimal import Decimal
import math

from ..compiled import jit

DIGITS = 70  # of the constants, before they are split into doubles


def pi() -> Decimal:
    """Return pi by Machin's formula."""
    return 4 * (4 * arctangent(Decimal(1) / 5) - arctangent(Decimal(1) / 239))


def arctangent(x: Decimal) -> Decimal:
    """Return the arc tangent of x in [0, 1] in rad: halved three times, then its series."""
    for _ in range(3):
        x = x / (1 + (1 + x * x).sqrt())
    total, power, n = Decimal(0), x, 1
    while abs(power) > Decimal(10) ** -DIGITS:
        total += power / n
        power, n = -power * x * x, n + 2
    return 8 * total


def split(value: Decimal, *bits: int) -> tuple[float, ...]:
    """
    Return doubles that sum to a value.

    Parameters
    ----------
    value
        To :data:`DIGITS` digits.
    *bits
        Of each double but the last, which has all of its 53.

    """
    out = []
    for count in bits:
        mantissa, exponent = math.frexp(float(value))
        out.append(math.ldexp(math.floor(math.ldexp(mantissa, count)), exponent - count))
        value -= Decimal(out[-1])
    return (*out, float(value))


@jit
def two_sum(a: float, b: float) -> tuple[float, float]:
    """Return a + b rounded, and what was rounded off (Knuth)."""
    s = a + b
    t = s - a
    return s, (a - (s - t)) + (b - t)


@jit
def two_product(a: float, b: float) -> tuple[float, float]:
    """Return a b rounded, and what was rounded off (Dekker, Veltkamp); for |a|, |b| < 1e299."""
    c, d = 134217729.0 * a, 134217729.0 * b
    high_a, high_b = c - (c - a), d - (d - b)
    low_a, low_b = a - high_a, b - high_b
    p = a * b
    return p, ((high_a * high_b - p) + high_a * low_b + low_a * high_b) + low_a * low_b
