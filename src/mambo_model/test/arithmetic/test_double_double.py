"""Sums, products and constants in two doubles, against rational numbers and published digits."""

from decimal import Decimal, localcontext
from fractions import Fraction

from mambo_model.arithmetic.double_double import (
    arctangent, DIGITS, pi, split, two_product, two_sum)
import numpy as np
import pytest

PI = Decimal('3.14159265358979323846264338327950288419716939937510582097494459230781640')


@pytest.mark.parametrize('exact', [(two_sum, Fraction.__add__), (two_product, Fraction.__mul__)])
def test_nothing_is_lost(exact):
    function, reference = exact
    rng = np.random.default_rng(1)
    values = rng.normal(size=(500, 2)) * 10.0 ** rng.uniform(-20, 20, (500, 2))
    for a, b in values.tolist():
        rounded, rest = function(a, b)
        assert rounded == float(reference(Fraction(a), Fraction(b)))
        assert Fraction(rounded) + Fraction(rest) == reference(Fraction(a), Fraction(b))


def test_constants_have_their_digits():
    with localcontext() as context:
        context.prec = DIGITS
        assert abs(pi() - PI) < Decimal(10) ** (3 - DIGITS)
        assert abs(4 * arctangent(Decimal(1)) - PI) < Decimal(10) ** (3 - DIGITS)


def test_the_parts_of_a_constant_have_few_bits_and_sum_to_it():
    parts = split(PI, 21, 33)
    assert [Fraction(part).numerator.bit_length() <= bits
            for part, bits in zip(parts, (21, 33, 53), strict=True)] == [True] * 3
    with localcontext() as context:
        context.prec = DIGITS
        assert abs(sum(Decimal(part) for part in parts) - PI) < Decimal(2) ** -105
