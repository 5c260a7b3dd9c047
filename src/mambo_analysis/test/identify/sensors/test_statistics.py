"""Intervals of proportions, medians and noise: they cover as often as they promise, no more."""

from interval_checks import assert_covers
from mambo_analysis.identify.sensors.statistics import (
    jackknife, median, proportion, repeating, resolution, robust_sigma, white_sigma)
import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter


@pytest.mark.parametrize(('k', 'n'), [(0, 10), (1, 10), (5, 10), (10, 10), (37, 1000)])
def test_a_proportion_has_the_interval_of_scipys_exact_test(k, n):
    theirs = stats.binomtest(k, n).proportion_ci(0.95, method='exact')
    found = proportion(k, n)
    assert found.value == k / n
    assert (found.low, found.high) == pytest.approx((theirs.low, theirs.high), abs=1e-12)


@pytest.mark.parametrize('share', [0.02, 0.3])
def test_the_interval_of_a_proportion_covers_by_the_sum_of_binomials(share):
    """Exactly, over every outcome of 60: at least 95 %, and not for being everything."""
    k = np.arange(61)
    chance = stats.binom.pmf(k, 60, share)
    inside = np.array([proportion(i, 60).low <= share <= proportion(i, 60).high for i in k])
    width = np.array([proportion(i, 60).high - proportion(i, 60).low for i in k])
    assert 0.95 <= (chance * inside).sum() < 0.995
    wald = 2.0 * 1.96 * np.sqrt(share * (1.0 - share) / 60)
    assert (chance * width).sum() < 1.5 * wald


def test_the_interval_of_a_median_covers_by_order_statistics():
    found = [median(np.random.default_rng(seed).exponential(size=51)) for seed in range(400)]
    truth = np.log(2.0)
    covered = np.mean([one.low <= truth <= one.high for one in found])
    # exact for any distribution: that of the ranks, between 0.95 and what a rank more gives
    ordered = np.sort(np.arange(51.0))
    one = median(ordered)
    exact = 1.0 - 2.0 * stats.binom.cdf(one.low, 51, 0.5)
    assert 0.95 <= exact < 0.98
    assert covered == pytest.approx(exact, abs=4.0 * np.sqrt(0.05 * 0.95 / 400))
    assert (one.value, one.low + one.high) == (25.0, 50.0)


def test_the_median_of_few_is_between_the_extremes():
    assert median(np.array([3.0, 1.0])) == (2.0, 1.0, 3.0)
    assert median(np.array([4.0])) == (4.0, 4.0, 4.0)


def test_a_jackknife_of_a_mean_is_that_of_the_textbook():
    """Of independent stretches of one length it is the t interval of their means."""
    x = np.random.default_rng(0).normal(3.0, 2.0, 1000)
    means = x.reshape(10, 100).mean(axis=1)
    found = jackknife(lambda keep: float(x[keep].mean()), 1000)
    half = stats.t.ppf(0.975, 9) * means.std(ddof=1) / np.sqrt(10)
    assert found.value == pytest.approx(x.mean())
    assert found.high - found.value == pytest.approx(half, rel=1e-9)
    assert found.value - found.low == pytest.approx(half, rel=1e-9)


def test_a_jackknife_knows_that_neighbours_depend_on_each_other():
    """Of a signal that wanders the interval is wider than that of independent samples."""
    found, naive = [], []
    for seed in range(60):
        x = lfilter([1.0], [1.0, -0.9], np.random.default_rng(seed).standard_normal(2000))
        one = jackknife(lambda keep, x=x: float(x[keep].mean()), 2000)
        found.append(one.low <= 0.0 <= one.high)
        naive.append(abs(x.mean()) < 1.96 * x.std() / np.sqrt(2000))
    assert np.mean(found) > 0.85 and np.mean(naive) < 0.6


def test_a_robust_deviation_covers_and_outliers_do_not_move_it():
    found = []
    for seed in range(120):
        x = np.random.default_rng(seed).normal(0.0, 0.3, 500)
        found.append(robust_sigma(x))
        x[::50] = 100.0  # one in fifty: a few per cent of the median size
        assert robust_sigma(x).value == pytest.approx(found[-1].value, rel=0.15)
    # Student's t of nine degrees instead of a normal: 15 % wider, and not even in every stretch
    assert_covers(0.3, found, wide=1.4)


def test_the_deviation_of_rounded_samples_covers_the_truth():
    """In steps of half a sigma the median size is one of few: no stretch shows its error."""
    covered = []
    for seed in range(100):
        x = np.round(np.random.default_rng(seed).normal(0.0, 1.0, 800) / 0.5) * 0.5
        one = robust_sigma(x)
        covered.append(one.low <= 1.0 <= one.high)
        # a stretch that moves the median by a step makes it wide, but no deviation is negative
        assert 0.0 <= one.low <= one.value <= one.high < 3.5
    assert np.mean(covered) > 0.9


def test_white_noise_on_a_slow_signal_is_that_of_its_second_differences():
    t = np.linspace(0.0, 20.0, 4000)
    x = 5.0 * np.sin(t) + np.random.default_rng(1).normal(0.0, 0.02, 4000)
    found = white_sigma(x)
    assert found.low < 0.02 < found.high and found.high < 1.3 * found.low
    assert found.value == pytest.approx(np.std(np.diff(x, 2)) / np.sqrt(6.0), rel=0.1)


@pytest.mark.parametrize('step', [0.01, 0.0048828125, 1.7])
def test_the_step_of_rounded_values_is_found(step):
    rng = np.random.default_rng(2)
    x = step * np.round(rng.normal(0.0, 20.0, 3000)) + 0.3 * step
    x[::100] = np.nan
    found = resolution(x)
    assert found.value == pytest.approx(step, rel=1e-9)
    assert found.low <= found.value <= found.high
    noisy = resolution(x + 0.005 * step * rng.standard_normal(3000))
    assert noisy is None or noisy.low <= step <= noisy.high


@pytest.mark.parametrize(('levels', 'step'), [
    ([0, 1], np.pi / 180), ([-1, 0, 1], np.pi / 180), ([0, 1, 3], 0.2), ([0, 1, 2, 3], 9.80665)])
def test_few_levels_that_are_read_often_show_the_step(levels, step):
    x = np.random.default_rng(4).choice(levels, 400) * step + 9.81
    assert resolution(x).value == pytest.approx(step, rel=1e-9)
    assert resolution(x, fewest=5) is None and resolution(x[:9 * len(levels)]) is None


@pytest.mark.parametrize('levels', [[0.0, 1.0, 2.4], [0.0, 1.0, 2.0, 3.5]])
def test_few_levels_that_lie_anywhere_have_no_step(levels):
    assert resolution(np.random.default_rng(4).choice(levels, 400)) is None


@pytest.mark.parametrize('count', [3, 60])
def test_values_apart_by_the_error_of_float32_are_one_level(count):
    """As where deg or g were converted in float32, and a bias was taken off before or after."""
    rng = np.random.default_rng(5)
    k = rng.integers(-(count // 2), count // 2 + 1, 4000)
    exact = np.pi / 180 * k + 9.81
    noisy = exact * (1.0 + rng.choice([-1.0, 0.0, 1.0], 4000) * 2.0**-24)
    assert len(np.unique(noisy)) > len(np.unique(exact))
    assert resolution(noisy).value == pytest.approx(np.pi / 180, rel=1e-5)


@pytest.mark.parametrize('x', [
    np.random.default_rng(3).normal(size=500), np.ones(100), np.arange(4.0), np.full(10, np.nan)])
def test_values_that_lie_anywhere_have_no_step(x):
    assert resolution(x) is None


def test_a_row_repeats_if_all_of_its_values_do():
    rows = np.array([[1.0, 2.0], [1.0, 2.0], [1.0, 3.0], [1.0, 3.0], [np.nan, 3.0], [np.nan, 3.0]])
    assert repeating(rows) == 0.4
    assert repeating(rows[:2]) == 1.0 and repeating(rows[1:3]) == 0.0
