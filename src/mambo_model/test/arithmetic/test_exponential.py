"""Within 1 ulp of the true value; the edges are those of the C standard."""

import math

from mambo_model.arithmetic.exponential import exp, expm1, log, log1p, power
import numpy as np
import pytest
from ulps import RNG, spread, ulps

NEAR_1 = 1.0 + spread(1e-16, 0.1, 4000)
CASES = {
    'exp': (exp, np.exp, [RNG.uniform(-1, 1, 4000), RNG.uniform(-740, 709.7, 4000)]),
    'expm1': (expm1, np.expm1, [RNG.uniform(-1, 1, 4000), RNG.uniform(-60, 700, 4000),
                                spread(1e-300, 1.0)]),
    'log': (log, np.log, [NEAR_1, RNG.uniform(0.3, 3.0, 4000), abs(spread(1e-320, 1e300))]),
    'log1p': (log1p, np.log1p, [NEAR_1 - 1.0, RNG.uniform(-0.99, 1.0, 4000),
                                abs(spread(1e-3, 1e300))]),
}


@pytest.mark.parametrize('name', CASES)
def test_functions_of_one_number(name):
    function, reference, columns = CASES[name]
    for column in columns:
        assert ulps(function, reference, column) < 1.0


def test_powers():
    assert ulps(power, np.power, RNG.uniform(0.01, 5, 4000), RNG.uniform(-5, 5, 4000)) < 1.0
    assert ulps(power, np.power, RNG.uniform(0.5, 2, 4000), RNG.uniform(-300, 300, 4000)) < 1.0
    assert ulps(power, np.power, NEAR_1, RNG.uniform(-1e3, 1e3, 4000)) < 1.0
    assert ulps(power, np.power, abs(spread(1e-300, 1e300)), RNG.uniform(-1, 1, 2000)) < 1.0
    assert ulps(power, np.power, abs(spread(1e-322, 1e-308)), RNG.uniform(-0.9, 0.9, 2000)) < 2.0


EDGES = [-math.inf, -1.0, -0.0, 0.0, 0.5, 1.0, 2.0, math.inf, math.nan, 1e-310]


@pytest.mark.parametrize('x', [x for x in EDGES if not x < 0.0])
@pytest.mark.parametrize('y', [*EDGES, -1e200, 1e200, 1e-200, 700.0, -2000.0])
def test_powers_at_the_edges_are_those_of_the_c_library(x, y):
    with np.errstate(all='ignore'):
        np.testing.assert_equal(power(x, y), float(np.power(abs(x), y)))


def test_a_negative_base_has_no_power():
    assert math.isnan(power(-2.0, 2.0)) and power(-2.0, 0.0) == 1.0


@pytest.mark.parametrize('function,reference', [
    (exp, np.exp), (expm1, np.expm1), (log, np.log), (log1p, np.log1p)])
@pytest.mark.parametrize('x', [0.0, math.inf, -math.inf, math.nan, -1.0, 710.0, -746.0, 5e-324])
def test_edges_are_those_of_the_c_library(function, reference, x):
    with np.errstate(all='ignore'):
        np.testing.assert_allclose(function(x), reference(x), rtol=2e-16)
