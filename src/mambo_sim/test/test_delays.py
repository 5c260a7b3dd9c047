"""Quantiles of delays, against the sorted delays themselves."""

import math

from mambo_sim.delays import Delays
import numpy as np
import pytest

BIN = 1e-5  # s


@pytest.mark.parametrize('share', [0.01, 0.5, 0.99, 1.0])
def test_a_quantile_is_that_of_the_sorted_delays(share):
    delays, times = Delays(), np.random.default_rng(1).gamma(2.0, 5e-4, 5000)
    for time in times:
        delays.add(time)
    exact = np.sort(times)[math.ceil(share * len(times)) - 1]
    assert exact <= delays.quantile(share) <= exact + BIN
    assert (delays.count, delays.longest) == (5000, times.max())


def test_very_long_delays_count_and_the_longest_is_kept():
    delays = Delays()
    for time in (0.001, 0.3, 2.5):
        delays.add(time)
    assert delays.quantile(0.5) == delays.quantile(0.99) == delays.longest == 2.5
    assert delays.values() == {'p50': '2500.00', 'p99': '2500.00', 'max': '2500.00'}


def test_without_delays_there_is_no_quantile():
    assert math.isnan(Delays().quantile(0.5))
    assert Delays().values()['p50'] == 'nan'
