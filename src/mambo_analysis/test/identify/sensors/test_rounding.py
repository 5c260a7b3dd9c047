"""Rounding adds step^2 / 12 to a noise; what may be rounding alone has no number."""

from mambo_analysis.identify.allan import Interval
from mambo_analysis.identify.sensors.rounding import (
    fast_deviation, NONE, Rounding, rounding, SIZES, without)
import numpy as np
import pytest
from scipy.stats import norm

RATE = 200.0


def rounded_variance(size, offset):
    """Return the exact variance of a rounded normal variable, in steps^2."""
    k = np.arange(-40, 41)
    chance = np.diff(norm.cdf((np.r_[k - 0.5, 40.5] - offset) / size))
    return (chance * k * k).sum() - (chance * k).sum()**2


@pytest.mark.parametrize('size', [0.42, 0.5, 0.6, 0.8, 1.0])
def test_the_error_of_a_twelfth_of_a_step_squared_is_at_most_the_one_told(size):
    """Exactly, wherever between two steps the mean is; it is reached half-way."""
    errors = [abs(rounded_variance(size, offset) - size**2 - 1.0 / 12.0)
              for offset in np.linspace(0.0, 0.5, 51)]
    assert errors[-1] == max(errors)
    x = 3.0 * np.round(0.5 + size * np.random.default_rng(0).standard_normal(400000))
    found = rounding(x, RATE, 3.0)
    assert found.variance == pytest.approx(9.0 / 12.0)
    # that of the smallest noise that may have given these readings, which are known to 0.4 %
    assert 0.98 * 9.0 * errors[-1] < found.error < 1.15 * 9.0 * errors[-1]


@pytest.mark.parametrize('offset', [0.0, 0.25, 0.5])
@pytest.mark.parametrize('size', [0.0, 0.1, 0.2, 0.3])
def test_what_may_be_rounding_alone_is_hidden(size, offset):
    x = np.round(offset + size * np.random.default_rng(1).standard_normal(4000))
    if size == 0.0:  # half-way: noise of no size at all
        x = np.random.default_rng(1).integers(0, 2, 4000).astype(float)
    assert rounding(x, RATE, 1.0) is None


def test_a_bias_that_walks_over_many_steps_shows_no_noise():
    x = np.round(np.linspace(0.0, 50.0, 20000) + 0.1 * np.random.default_rng(2).normal(size=20000))
    assert x.std() > 10.0 and rounding(x, RATE, 1.0) is None


def test_the_fast_deviation_is_that_within_a_tenth_of_a_second():
    t = np.arange(8000) / RATE
    x = 0.3 * np.random.default_rng(3).standard_normal(8000) + np.sin(0.1 * t)
    found = fast_deviation(x, RATE)
    assert found.low < 0.3 < found.high and found.high / found.low < 1.05
    assert fast_deviation(np.tile([0.0, 1.0], 40), 2.0).value == pytest.approx(np.sqrt(0.5))


def test_without_resolution_nothing_is_taken():
    assert rounding(np.zeros(40), RATE, 0.0) == NONE
    assert without(Interval(2.0, 1.0, 3.0), NONE) == (2.0, 1.0, 3.0)


def test_variances_are_subtracted_and_their_error_widens():
    found = without(Interval(5.0, 4.0, 6.0), Rounding(18.0, 4.0), 0.5)
    assert found == pytest.approx((4.0, np.sqrt(16.0 - 11.0), np.sqrt(36.0 - 7.0)))
    assert without(Interval(1.0, 0.5, 4.0), Rounding(4.0, 1.0)) == pytest.approx(
        (0.0, 0.0, np.sqrt(13.0)))


def test_a_noise_beyond_the_table_has_no_error():
    x = np.round(5.0 * np.random.default_rng(4).standard_normal(4000))
    assert SIZES[-1] < 5.0 and rounding(x, RATE, 1.0).error < 1e-15
