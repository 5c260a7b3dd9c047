"""Within 1 ulp of the true value everywhere; the edges are those of the C standard."""

import math

from mambo_model.arithmetic.trigonometry import asin, atan, atan2, cos, sin, sin_cos
import numpy as np
import pytest
from ulps import RNG, spread, ulps

ANGLES = {
    'below an eighth of a turn': RNG.uniform(-0.8, 0.8, 4000),
    'some turns': RNG.uniform(-1e3, 1e3, 4000),
    'many turns': RNG.uniform(-5e9, 5e9, 4000),
    'next to multiples of a quarter': np.round(RNG.uniform(-1e6, 1e6, 2000)) * (np.pi / 2),
    'tiny': spread(1e-300, 1e-3)}


@pytest.mark.parametrize('name', ANGLES)
def test_sine_and_cosine(name):
    assert ulps(sin, np.sin, ANGLES[name]) < 1.0
    assert ulps(cos, np.cos, ANGLES[name]) < 1.0


def test_sine_and_cosine_at_the_edges():
    assert sin_cos(1.25) == (sin(1.25), cos(1.25))
    assert (sin(0.0), cos(0.0)) == (0.0, 1.0) and math.copysign(1.0, sin(-0.0)) == -1.0
    assert sin(1e300) == math.sin(1e300)
    assert all(math.isnan(f(x)) for f in (sin, cos) for x in (math.nan, math.inf, -math.inf))


def test_arc_functions():
    assert ulps(atan, np.arctan, np.concatenate([RNG.uniform(-3, 3, 4000), spread(1e-290, 1e290)])
                ) < 1.0
    assert ulps(asin, np.arcsin, np.concatenate([
        RNG.uniform(-1, 1, 4000), spread(1e-290, 1.0), 1.0 - abs(spread(1e-16, 0.1))])) < 1.0
    assert ulps(atan2, np.arctan2, spread(1e-5, 1.0, 4000), spread(1e-5, 1.0, 4000)) < 1.0
    assert ulps(atan2, np.arctan2, spread(1e-200, 1e200), spread(1e-200, 1e200)) < 1.0


@pytest.mark.parametrize('y', [0.0, -0.0, 1.0, -1.0, math.inf, -math.inf])
@pytest.mark.parametrize('x', [0.0, -0.0, 1.0, -1.0, math.inf, -math.inf])
def test_angles_on_the_axes_are_those_of_the_c_library(y, x):
    got, known = atan2(y, x), math.atan2(y, x)
    assert got == known and math.copysign(1.0, got) == math.copysign(1.0, known)


def test_what_has_no_angle_is_nan():
    assert math.isnan(asin(1.0 + 1e-15)) and math.isnan(asin(math.nan))
    assert asin(1.0) == math.pi / 2 and asin(-1.0) == -math.pi / 2
    assert math.isnan(atan2(math.nan, 1.0)) and math.isnan(atan2(1.0, math.nan))
