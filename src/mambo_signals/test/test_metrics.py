"""Error statistics and interpolation against numbers by hand and against scipy."""

from mambo_signals import metrics, resample
import numpy as np
import pytest
from scipy.interpolate import interp1d


def test_statistics_by_hand():
    s = metrics.statistics(np.array([[3.0, 0.0, 0.0], [-3.0, 4.0, 0.0]]))
    assert s.count == 2
    assert s.rms == pytest.approx((3.0, np.sqrt(8.0), 0.0))
    assert s.maximum == (3.0, 4.0, 0.0)
    assert s.rms_total == pytest.approx(np.sqrt((9.0 + 25.0) / 2.0))
    assert s.maximum_total == 5.0


def test_total_is_the_root_of_the_summed_squares_of_the_axes():
    errors = np.random.default_rng(1).normal(size=(500, 3)) * [1.0, 2.0, 3.0] + 0.5
    s = metrics.statistics(errors)
    assert s.rms_total == pytest.approx(np.sqrt(np.sum(np.square(s.rms))))
    assert s.rms == pytest.approx(np.sqrt(errors.var(axis=0) + errors.mean(axis=0) ** 2))


def test_errors_that_are_not_finite_do_not_count():
    s = metrics.statistics(np.array([[1.0, 1.0], [np.nan, 5.0], [np.inf, 0.0]]))
    assert s.count == 1 and s.rms == (1.0, 1.0)
    nothing = metrics.statistics(np.full((3, 2), np.nan))
    assert nothing.count == 0 and np.isnan(nothing.rms_total) and len(nothing.rms) == 2


def test_interpolation_equals_scipys_inside():
    rng = np.random.default_rng(2)
    source = np.cumsum(rng.integers(1, 10, 200)) * 1_000_000
    values = rng.normal(size=(200, 3))
    stamps = rng.integers(source[0], source[-1], 500)
    ours = resample.interpolate(stamps, source, values, 10**9)
    np.testing.assert_allclose(ours, interp1d(source, values, axis=0)(stamps), atol=1e-12)


def test_a_sample_at_the_very_stamp_is_returned_to_the_bit():
    values = np.array([[0.1], [0.2], [0.3]])
    out = resample.interpolate(np.array([10, 20, 30]), np.array([10, 20, 30]), values, 1)
    np.testing.assert_array_equal(out, values)


def test_nothing_is_made_up_outside_and_in_gaps():
    out = resample.interpolate(
        np.array([5, 10, 15, 60, 100, 105]), np.array([10, 20, 100]),
        np.array([[1.0], [2.0], [10.0]]), gap=20)
    np.testing.assert_array_equal(out[:, 0], [np.nan, 1.0, 1.5, np.nan, 10.0, np.nan])
    empty = resample.interpolate(np.array([1, 2]), np.array([], int), np.empty((0, 3)), 1)
    assert empty.shape == (2, 3) and np.isnan(empty).all()


def test_unsorted_source_is_sorted_first():
    out = resample.interpolate(np.array([15]), np.array([20, 10]), np.array([[2.0], [1.0]]), 99)
    assert out[0, 0] == 1.5


def test_missing_counts_gaps_and_not_jitter_or_repeats():
    grid = np.arange(100) * 5_000_000
    assert metrics.missing(grid, 5e6) == 0
    assert metrics.missing(np.delete(grid, [7, 8, 50]), 5e6) == 3
    assert metrics.missing(np.concatenate([grid, grid[:5]]), 5e6) == 0
    assert metrics.missing(np.random.default_rng(1).permutation(grid), 5e6) == 0
    jitter = grid + np.random.default_rng(1).integers(-500_000, 500_000, 100)
    assert metrics.missing(jitter, 5e6) == 0
    assert metrics.missing(np.array([], int), 5e6) == 0


def test_usual_period_is_that_of_most_gaps():
    frames = np.delete(np.arange(50) * 8_333_333, [10, 11, 30])
    assert resample.usual_period(frames) == 8_333_333
    assert np.isnan(resample.usual_period(np.array([5])))


def test_common_stamps():
    a, b = metrics.common(np.array([1, 3, 5, 7]), np.array([7, 3, 4]))
    assert (a.tolist(), b.tolist()) == ([1, 3], [1, 0])


def test_the_variance_at_every_shift_is_that_of_the_difference():
    rng = np.random.default_rng(4)
    a, b, weight = rng.normal(size=50) + 3.0, rng.normal(size=70) - 1.0, rng.random(50) < 0.8
    got = metrics._variances(np.where(weight, a, 0.0), b, weight.astype(float))
    want = [np.var((a - b[k:k + 50])[weight]) for k in range(21)]
    # differences of some 16 in squares that sum up 50 of them lose four digits at most
    np.testing.assert_allclose(got, want, rtol=1e-12)


def test_a_running_rms_ends_with_its_data():
    errors = np.array([[np.nan], [3.0], [np.nan], [4.0], [np.nan], [np.nan]])
    found = metrics.running_rms(np.arange(6) * 10, errors)
    np.testing.assert_allclose(found, [np.nan, 3.0, 3.0, np.sqrt(12.5), np.nan, np.nan])
    assert np.isnan(metrics.running_rms(np.arange(2), np.full((2, 1), np.nan))).all()
