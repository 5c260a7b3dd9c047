"""Paired differences of two estimators: their interval, and what they decide."""

import math

from mambo_thesis.estimators.paired_rows import (
    ALL_FLIGHTS, BETTER, pooled, ratio, Row, UNDECIDED, WORSE)
import numpy as np
import pytest


def row(kalman, joint, bound=math.nan, case='a', quantity='q'):
    return Row(case, quantity, bound, np.square(kalman), np.square(joint), {'toolbox': 1.0})


def test_the_ratio_is_the_geometric_mean_of_those_of_the_flights():
    a, b = np.array([1.0, 4.0, 9.0]), np.array([4.0, 4.0, 36.0])
    found = ratio(a, b)
    assert found.value == pytest.approx(4.0 ** (1.0 / 3.0) - 1.0)
    # by hand: ln 2, 0, ln 2: mean 0.46210, deviation 0.40019, t(0.975, 2) = 4.3027
    half = 4.3027 * 0.40019 / math.sqrt(3.0)
    assert math.log1p(found.high) == pytest.approx(0.46210 + half, rel=1e-4)
    assert math.log1p(found.low) == pytest.approx(0.46210 - half, rel=1e-4)


def test_the_interval_holds_the_true_ratio_in_95_of_100_cases():
    rng, inside = np.random.default_rng(1), 0
    for _ in range(400):
        shared = rng.normal(size=20)
        a, b = ((shared + 0.5 * rng.normal(size=20)) ** 2 for _ in range(2))
        found = ratio(a, b)
        inside += found.low <= 0.0 <= found.high
    assert 0.92 < inside / 400 < 0.98


def test_what_is_hard_for_both_does_not_widen_the_interval():
    hard = np.array([1.0, 5.0, 25.0, 0.1])
    found = ratio(hard, 1.21 * hard)
    assert found.low == pytest.approx(0.1) and found.high == pytest.approx(0.1)


def test_one_bad_flight_does_not_hide_that_all_others_are_better():
    kalman = np.array([1.0, 1.2, 0.9, 1.1, 1.0, 0.8])
    assert row(kalman, 3.0 * kalman).verdict == WORSE
    assert row(kalman * [1, 1, 1, 1, 1, 3.0], 0.5 * kalman).verdict == BETTER


def test_an_error_of_zero_has_a_ratio():
    assert ratio(np.zeros(3), np.zeros(3)).value == 0.0
    found = ratio(np.array([1.0, 1.0]), np.array([0.0, 1.0]))
    assert found.low < 0.0 < found.high and math.isfinite(found.high)


def test_what_is_equal_in_three_digits_is_undecided():
    assert row([1.0, 1.0, 1.0], [1.0001, 1.0001, 1.0001]).verdict == UNDECIDED
    assert not row([1.0], [1.0001]).larger and row([1.0], [1.01]).larger


def test_a_row_is_decided_by_its_interval():
    assert row([1.0, 1.1, 0.9], [0.1, 0.12, 0.09]).verdict == BETTER
    assert row([0.1, 0.12, 0.09], [1.0, 1.1, 0.9]).verdict == WORSE
    assert row([1.0, 1.2, 0.9], [1.1, 1.0, 1.0]).verdict == UNDECIDED
    assert row([0.0, 0.0], [0.0, 0.0]).verdict == UNDECIDED


def test_a_single_number_is_decided_unless_the_difference_is_below_the_bound():
    assert row([1.0], [1.1]).verdict == WORSE and row([1.1], [1.0]).verdict == BETTER
    assert row([1.0], [1.1], bound=0.2).verdict == UNDECIDED
    assert row([1.0], [1.1], bound=0.05).verdict == WORSE
    assert math.isnan(row([1.0], [1.1]).ratio.low)


def test_recordings_of_a_vehicle_are_one_row_for_each_quantity():
    found = pooled([row([1.0, 3.0], [2.0, 2.0], 3.0), row([2.0], [1.0], 4.0, 'b'),
                    row([1.0], [1.0], quantity='alone')])
    assert [(one.case, one.quantity) for one in found] == [(ALL_FLIGHTS, 'q')]
    np.testing.assert_allclose(found[0].kalman, [5.0, 4.0])  # one number for each flight
    np.testing.assert_allclose(found[0].joint, [4.0, 1.0])
    assert found[0].bound == pytest.approx(math.sqrt(12.5))
