"""Error statistics against numbers by hand, delays that were put in, and pictures of signals."""

from hypothesis import given, strategies as st
from mambo_signals import metrics
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

PERIOD = 0.01  # s


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
    assert s.maximum_total == pytest.approx(np.linalg.norm(errors, axis=1).max())


def test_errors_that_are_not_finite_do_not_count():
    s = metrics.statistics(np.array([[1.0, 1.0], [np.nan, 5.0], [np.inf, 0.0]]))
    assert s.count == 1 and s.rms == (1.0, 1.0)
    nothing = metrics.statistics(np.full((3, 2), np.nan))
    assert nothing.count == 0 and np.isnan(nothing.rms_total) and len(nothing.rms) == 2


def test_missing_counts_gaps_and_not_jitter_or_repeats():
    grid = np.arange(100) * 5_000_000
    assert metrics.count_missing(grid, 5e6) == 0
    assert metrics.count_missing(np.delete(grid, [7, 8, 50]), 5e6) == 3
    assert metrics.count_missing(np.concatenate([grid, grid[:5]]), 5e6) == 0
    assert metrics.count_missing(np.random.default_rng(1).permutation(grid), 5e6) == 0
    jitter = grid + np.random.default_rng(1).integers(-500_000, 500_000, 100)
    assert metrics.count_missing(jitter, 5e6) == 0
    assert metrics.count_missing(np.array([], int), 5e6) == 0


@given(st.lists(st.integers(0, 200), unique=True, max_size=60))
def test_missing_is_what_the_grid_lacks_between_its_ends(steps):
    stamps = np.array(steps, np.int64) * 5_000_000
    want = max(steps) - min(steps) + 1 - len(steps) if steps else 0
    assert metrics.count_missing(stamps, 5e6) == want


def test_common_stamps():
    a, b = metrics.common_stamps(np.array([1, 3, 5, 7]), np.array([7, 3, 4]))
    assert (a.tolist(), b.tolist()) == ([1, 3], [1, 0])
    a, b = metrics.common_stamps(np.array([1, 2]), np.array([], int))
    assert len(a) == len(b) == 0


@given(st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=400), st.integers(4, 60))
def test_an_envelope_keeps_the_extremes_and_the_order(values, points):
    t, values = np.arange(len(values)) * 0.5, np.array(values)
    at, drawn = metrics.envelope(t, values, points)
    assert len(at) <= max(points + len(t) // points + 2, 4)
    assert (np.diff(at) >= 0.0).all()
    assert (drawn.min(), drawn.max()) == (values.min(), values.max())
    assert (values[(at / 0.5).astype(int)] == drawn).all()  # samples, not means of them


def test_an_envelope_shows_each_peak_and_where_nothing_is():
    t = np.arange(10_000.0)
    values = np.zeros(10_000)
    values[[1234, 7777]] = 5.0, -3.0
    values[4000:6000] = np.nan
    at, drawn = metrics.envelope(t, values, 100)
    assert len(at) < 110
    assert drawn[at == 1234.0] == 5.0 and drawn[at == 7777.0] == -3.0
    assert np.isnan(drawn[(at > 4200) & (at < 5800)]).all() and np.isnan(drawn).sum() > 10
    same = metrics.envelope(t[:100], values[:100], 100)
    np.testing.assert_array_equal(same[0], t[:100])


def test_a_running_rms_ends_with_its_data():
    errors = np.array([[np.nan], [3.0], [np.nan], [4.0], [np.nan], [np.nan]])
    found = metrics.running_rms(np.arange(6) * 10, errors)
    np.testing.assert_allclose(found, [np.nan, 3.0, 3.0, np.sqrt(12.5), np.nan, np.nan])
    assert np.isnan(metrics.running_rms(np.arange(2), np.full((2, 1), np.nan))).all()


def test_a_running_rms_weighs_by_time():
    """1 for a second and 2 for a second, whatever the rate of each: the root of 2.5."""
    stamps = np.concatenate([np.arange(100) * 10_000_000, 10**9 + np.arange(10) * 100_000_000])
    errors = np.where(np.arange(110) < 100, 1.0, 2.0)[:, None]
    found = metrics.running_rms(stamps, errors)
    assert found[99] == pytest.approx(1.0) and found[-1] == pytest.approx(np.sqrt(2.5))
    even = metrics.running_rms(np.arange(50), np.random.default_rng(0).normal(size=(50, 3)))
    assert len(even) == 50 and np.isfinite(even).all()


def test_a_running_rms_at_an_even_rate_ends_at_the_rms():
    errors = np.random.default_rng(2).normal(size=(300, 3))
    found = metrics.running_rms(np.arange(300) * 7, errors)
    assert found[-1] == pytest.approx(metrics.statistics(errors).rms_total)
    assert found[9] == pytest.approx(metrics.statistics(errors[:10]).rms_total)


def test_the_drift_is_the_last_error_there_is():
    errors = np.array([[1.0, 2.0], [3.0, 4.0], [5.0, np.nan]])
    assert metrics.drift(errors).tolist() == [3.0, 4.0]
    assert np.isnan(metrics.drift(errors[2:])).all() and metrics.drift(errors[2:]).shape == (2,)


def test_the_variance_at_every_shift_is_that_of_the_difference():
    rng = np.random.default_rng(4)
    a, b, weight = rng.normal(size=50) + 3.0, rng.normal(size=70) - 1.0, rng.random(50) < 0.8
    got = metrics._variances(np.where(weight, a, 0.0), b, weight.astype(float))
    want = [np.var((a - b[k:k + 50])[weight]) for k in range(21)]
    # differences of some 16 in squares that sum up 50 of them lose four digits at most
    np.testing.assert_allclose(got, want, rtol=1e-12)


def wandering(seed):
    """Return a random signal of up to 2 Hz, a function of time [s] without repetition."""
    rng = np.random.default_rng(seed)
    frequency, phase = rng.uniform(0.1, 2.0, 25), rng.uniform(0.0, 2.0 * np.pi, 25)
    return lambda t: np.sin(2.0 * np.pi * np.outer(t, frequency) + phase).sum(axis=1)


AT = PERIOD * np.arange(1500)


@pytest.mark.parametrize('late', [-0.5, -0.1234, 0.0, 0.0037, 0.25, 0.9])
def test_a_delay_that_was_put_in_is_found_between_the_samples(late):
    x = wandering(0)
    found = metrics.delay(x(AT - late), x(AT) + 3.0, PERIOD)  # another zero
    # a parabola through a smooth minimum: good to some hundredths of a period
    assert found == pytest.approx(late, abs=0.03 * PERIOD)


def test_no_signal_is_behind_itself_whatever_jumps_at_the_ends_of_its_middle():
    x = wandering(5)(AT)
    for at in (100, len(x) - 100):  # the middle is all but a second at either end
        jumping = x.copy()
        jumping[at:] += 30.0 * x.std()
        assert metrics.delay(jumping, jumping.copy(), PERIOD) == 0.0
        other = jumping + 0.1 * wandering(6)(AT)
        assert metrics.delay(jumping, other, PERIOD) == -metrics.delay(other, jumping, PERIOD)


def test_the_delay_knows_gaps_and_little_noise():
    x, rng = wandering(1), np.random.default_rng(1)
    a, b = x(AT - 0.175), x(AT) + 0.02 * x(AT).std() * rng.standard_normal(1500)
    a[300:350] = np.nan
    assert metrics.delay(a, b, PERIOD) == pytest.approx(0.175, abs=0.2 * PERIOD)
    # a hole in the other signal covers a second either way: too much, and that is said
    b[200:1300:150] = np.nan
    assert np.isnan(metrics.delay(a, b, PERIOD))


@pytest.mark.parametrize('case', [
    'short', 'still', 'strangers', 'beyond', 'nothing', 'drifting'])
def test_a_delay_that_the_signals_do_not_determine_is_nan(case):
    x, other = wandering(2)(AT), wandering(3)(AT)
    a, b = {
        'short': (x[:399], x[:399]), 'still': (np.ones(1500), np.ones(1500)),
        'strangers': (x, other), 'beyond': (wandering(2)(AT - 1.5), x),
        'nothing': (np.full(1500, np.nan), x),
        # a slow way whose difference drifts: 0.3 s would be the best shift
        'drifting': (np.sin(0.5 * AT) - 0.15 * np.cos(0.5 * AT) + 0.1 * np.sin(0.8 * AT),
                     np.sin(0.5 * AT))}[case]
    assert np.isnan(metrics.delay(a, b, PERIOD))


def test_series_that_change_slowly_have_few_independent_pairs():
    white, slow = np.random.default_rng(1).standard_normal((2, 1000)), np.arange(1000.0)
    assert metrics.independent(*white) > 900.0
    both = gaussian_filter1d(white, 10.0, axis=1)  # 2 sqrt(pi) 10 = 35 samples each
    assert 15.0 < metrics.independent(*both) < 45.0
    assert metrics.independent(slow, slow) < 8.0
    assert metrics.independent(slow, 0.0 * slow) == 0.0
