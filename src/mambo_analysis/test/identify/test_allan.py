"""Allan deviation, white noise and random walk against theory, and their intervals over seeds."""

from mambo_analysis.identify import allan
from mambo_analysis.identify.allan import degrees_of_freedom
import numpy as np
import pytest
from scipy.stats import binom

RATE, STEP = 200.0, 0.005
SEEDS = 60
FEWEST = int(binom.ppf(0.005, SEEDS, 0.95))  # of 60 intervals at 95 %: 51, but for 1 in 200 tries


def white(seed, n, sigma=1.0):
    return sigma * np.random.default_rng(seed).standard_normal(n)


def walk(seed, n, density):
    return np.cumsum(white(seed, n, density * np.sqrt(STEP)))


def covered(intervals, truth):
    return sum(low <= truth <= high for _, low, high in intervals)


def test_deviation_by_hand():
    x = np.array([1.0, 2.0, 4.0, 3.0])  # differences of neighbours 1, 2, -1; of pairs' means 2
    assert allan.deviation(x, 1) == pytest.approx(np.sqrt((1 + 4 + 1) / 3 / 2))
    assert allan.deviation(x, 2) == pytest.approx(np.sqrt(2.0**2 / 2))


@pytest.mark.parametrize('m', [1, 4, 32, 128])
def test_white_noise_falls_with_the_root_of_time(m):
    # standard error of the deviation: one over the root of twice its degrees of freedom
    error = 1 / np.sqrt(2 * degrees_of_freedom(200000, m, 'white'))
    assert allan.deviation(white(1, 200000, 0.3), m) == pytest.approx(
        0.3 / np.sqrt(m), rel=4 * error)


@pytest.mark.parametrize('m', [4, 32, 128])
def test_random_walk_rises_with_the_root_of_time(m):
    n, K = 200000, 0.01
    error = 1 / np.sqrt(2 * degrees_of_freedom(n, m, 'walk'))
    tau = m * STEP
    discrete = 1 + 1 / (2 * m**2)  # sums instead of integrals
    assert allan.deviation(walk(2, n, K), m) == pytest.approx(
        K * np.sqrt(tau / 3 * discrete), rel=4 * error)


def flicker(seed, n):
    """Return noise of spectrum 1/f: white noise through the filter (1 - z^-1)^(-1/2)."""
    k = np.arange(1, n)
    response = np.cumprod(np.r_[1.0, (k - 0.5) / k])
    return np.convolve(white(seed, n), response)[:n]


@pytest.mark.parametrize('noise, make', [
    ('white', white), ('flicker', flicker), ('walk', lambda s, n: walk(s, n, 1.0))])
@pytest.mark.parametrize('m', [1, 8, 64])
def test_degrees_of_freedom_are_those_of_the_scatter(noise, make, m):
    n, seeds = 512, 600
    variances = np.array([allan.deviation(make(seed, n), m)**2 for seed in range(seeds)])
    seen = 2 * variances.mean()**2 / variances.var()  # of a chi2 variable
    # relative error of a variance from 600: 6 %, more with its tails at few degrees
    assert degrees_of_freedom(n, m, noise) == pytest.approx(seen, rel=0.25)


def test_white_density_covers_the_truth():
    none = allan.Interval(0.0, 0.0, 0.0)
    found = [allan.white_density(white(seed, 2000, 0.02), RATE, none) for seed in range(SEEDS)]
    assert covered(found, 0.02 * np.sqrt(STEP)) >= FEWEST
    assert np.mean([f.high / f.low for f in found]) < 1.35


@pytest.mark.parametrize(('K', 'share'), [(0.0, 0.0), (0.01, 0.14), (0.0245, 0.5)])
def test_white_density_is_without_what_the_bias_walks(K, share):
    """Of the Allan variance at 0.1 s a share of K^2 tau / 3 is that of the walk."""
    N, tau, found = 0.02 * np.sqrt(STEP), 0.1, []
    assert K**2 * tau / 3 / (K**2 * tau / 3 + N**2 / tau) == pytest.approx(share, abs=0.01)
    for seed in range(20):
        x = white(seed, 4000, 0.02) + walk(seed + 999, 4000, K)
        found.append(allan.white_density(x, RATE, allan.random_walk(x, RATE)))
    assert covered(found, N) >= binom.ppf(0.005, 20, 0.95)
    # standard error of the median of 20 with 300 degrees of freedom: 1 %, more with the walk taken
    assert np.median([f.value for f in found]) == pytest.approx(N, rel=0.05)


@pytest.mark.long
def test_random_walk_covers_the_truth_below_and_above_the_noise():
    for K in (0.001, 0.01):
        found = [allan.random_walk(white(seed, 4000, 0.02) + walk(seed + 999, 4000, K), RATE)
                 for seed in range(SEEDS)]
        assert covered(found, K) >= FEWEST
        assert np.median([f.value for f in found]) == pytest.approx(K, rel=0.15)


def test_no_random_walk_is_seen_where_there_is_none():
    found = [allan.random_walk(white(seed, 4000, 0.02), RATE) for seed in range(SEEDS)]
    assert covered(found, 0.0) >= FEWEST
    # a walk that would show within the 20 s is excluded
    assert max(f.high for f in found) < 0.005


def test_random_walk_does_not_mistake_filtered_noise_for_a_walk():
    smooth = np.ones(5) / 5  # a filter of 25 ms
    found = [allan.random_walk(np.convolve(white(seed, 4000, 0.02), smooth, 'valid'), RATE)
             for seed in range(SEEDS)]
    assert covered(found, 0.0) >= FEWEST


def test_standard_deviation_covers_the_truth_though_samples_depend_on_each_other():
    plain = [allan.deviation_at_rest(white(seed, 2000, 0.5)) for seed in range(SEEDS)]
    assert covered(plain, 0.5) >= FEWEST
    smooth = np.ones(10) / np.sqrt(10)
    filtered = [allan.deviation_at_rest(np.convolve(white(seed, 2009, 0.5), smooth, 'valid'))
                for seed in range(SEEDS)]
    assert covered(filtered, 0.5) >= FEWEST
    assert np.mean([f.high - f.low for f in filtered]) > 1.8 * np.mean(
        [f.high - f.low for f in plain])  # ten in a row: 6.7 times fewer degrees of freedom


def test_a_signal_of_one_level_has_no_walk():
    x = np.tile([0.0, 1.0], 2000)  # every mean over 0.1 s is the same
    assert allan.random_walk(x, RATE) == (0.0, 0.0, 0.0)


def test_bias_instability_is_a_bound_until_the_curve_rises():
    value, reached, share = allan.bias_instability(allan.allan(white(0, 4000), RATE))
    assert not reached and share < 0.01
    rising = white(0, 4000, 0.02) + walk(1, 4000, 0.02)
    curve = allan.allan(rising, RATE)
    value, reached, share = allan.bias_instability(curve)
    m = 2**np.argmin(curve.deviation)  # samples averaged there
    assert share == pytest.approx(1.0 / (0.664 * 0.664 * m), rel=0.01)
    # lowest point of white noise N and walk K: sqrt(2 N K / sqrt(3)), over 0.664
    lowest = np.sqrt(2 * 0.02 * np.sqrt(STEP) * 0.02 / np.sqrt(3)) / 0.664
    assert reached and value.low < lowest * 1.1 and lowest * 0.9 < value.high


def test_curve_has_octaves_and_intervals_around_it():
    curve = allan.allan(white(3, 2001), RATE)
    np.testing.assert_allclose(curve.tau, STEP * 2.0**np.arange(10))
    assert (curve.low < curve.deviation).all() and (curve.deviation < curve.high).all()
    assert curve.high[0] / curve.low[0] < 1.1 < 2 < curve.high[-1] / curve.low[-1]
    assert (curve.tau[-1] / STEP) * 3 <= 2001
