"""Fits and their intervals: those of textbooks for white noise, honest ones for coloured noise."""

from interval_checks import assert_covers
from mambo_analysis.identify.regression import (
    at_bound, autoregression, check_columns, check_times, fit, IdentifyError, plus_minus,
    refuse_bound)
import numpy as np
import pytest
from scipy import signal, stats

N = 400
T = np.linspace(0.0, 10.0, N)


def line(theta):
    return (theta[0] * np.sin(2.0 * T) + theta[1] * T)[:, None]


def fit_line(data, **options):
    return fit(line, data, [1.0, 0.0], [-9.0, -9.0], [9.0, 9.0], ['sine', 'slope'], **options)


def test_white_noise_gives_the_intervals_of_linear_regression():
    data = line([2.0, 0.3]) + 0.1 * np.random.default_rng(3).standard_normal((N, 1))
    found = fit_line(data)
    A = np.stack([np.sin(2.0 * T), T], axis=1)
    theta, rest, *_ = np.linalg.lstsq(A, data[:, 0])
    sd = np.sqrt(rest[0] / (N - 2) * np.diag(np.linalg.inv(A.T @ A)))
    assert found.order == (0,) and found.freedom == N - 2
    np.testing.assert_allclose(found.theta, theta, rtol=1e-7)
    np.testing.assert_allclose(
        [found.half(0), found.half(1)], stats.t.ppf(0.975, N - 2) * sd, rtol=1e-5)


def test_blocks_that_disagree_widen_and_blocks_that_agree_do_not():
    noise = 0.1 * np.random.default_rng(5).standard_normal((N, 1))
    for data, low, high in ((line([2.0, 0.3]) + noise, 1.0, 2.0),
                            (line([2.0, 0.3]) * (1.0 + (T > 5.0)[:, None]) + noise, 5.0, 50.0)):
        plain, blocks = (fit_line(data, blocks=n, colour=False) for n in (0, 8))
        np.testing.assert_array_equal(plain.theta, blocks.theta)
        expected = without_blocks(data, 8)
        spread = np.sqrt(7.0 / 8.0 * np.sum((expected - expected.mean(axis=0)) ** 2, axis=0))
        wanted = np.maximum(stats.t.ppf(0.975, 7) * spread, [plain.half(0), plain.half(1)])
        if low > 1.0:
            np.testing.assert_allclose([blocks.half(0), blocks.half(1)], wanted, rtol=1e-3)
            assert blocks.half(0) > 2.0 * plain.half(0)
        else:
            assert blocks.half(0) < high * plain.half(0)


def test_what_one_block_alone_shows_has_no_interval():
    def late(theta):
        return np.where(T > 9.0, theta[0] * np.sin(9.0 * T), 0.0)[:, None]
    data = late([2.0]) + 0.1 * np.random.default_rng(6).standard_normal((N, 1))
    plain, blocks = (fit(late, data, [1.0], [-9.0], [9.0], ['wave'], blocks=n) for n in (0, 8))
    assert plain.half(0) < 0.1 and blocks.half(0) == pytest.approx(1e3 * plain.half(0), rel=0.01)


def without_blocks(data, count):
    """Return the parameters of the line, fitted without each block, (count, 2)."""
    A, out = np.stack([np.sin(2.0 * T), T], axis=1), []
    for part in np.array_split(np.arange(N), count):
        keep = np.setdiff1d(np.arange(N), part)
        out.append(np.linalg.lstsq(A[keep], data[keep, 0])[0])
    return np.array(out)


@pytest.mark.parametrize('value, half, text', [
    (0.1, 4e-4, '0.10000 +- 0.00040'), (1.234567, 0.05, '1.235 +- 0.050'),
    (56326.7, 139.7, '56326.700 +- 139.700'), (2.0, 0.0, '2 +- 0'), (1.0, np.inf, '1 +- inf')])
def test_an_interval_with_a_width_never_reads_as_none(value, half, text):
    assert plus_minus(value, half) == text


def test_nuisance_terms_are_fitted_along_in_every_channel():
    rng, basis = np.random.default_rng(4), np.stack([np.ones(N), T], axis=1)
    truth = np.hstack([line([2.0, 0.0])] * 2) + basis @ [[5.0, -3.0], [0.7, 0.0]]
    found = fit(
        lambda theta: np.hstack([line([theta[0], 0.0])] * 2),
        truth + 0.1 * rng.standard_normal((N, 2)), [1.0], [-9.0], [9.0], ['sine'], basis)
    A = np.zeros((2 * N, 5))
    A[:, 0] = np.tile(np.sin(2.0 * T), 2)
    A[:N, 1:3] = A[N:, 3:5] = basis
    # channels weigh by their own noise, which is the same here to 1/sqrt(2 N)
    sd = 0.1 * np.sqrt(np.linalg.inv(A.T @ A)[0, 0])
    assert found.theta[0] == pytest.approx(2.0, abs=4.0 * sd)
    assert found.half(0) == pytest.approx(1.96 * sd, rel=0.1)
    assert abs(found.residual.mean()) < 1e-3
    assert found.rms == pytest.approx(0.1, rel=0.1)


def coloured(rng, a=0.9):
    return signal.lfilter([1.0], [1.0, -a], rng.standard_normal(N + 500))[500:, None]


@pytest.mark.long
def test_intervals_hold_under_coloured_noise():
    found = [fit_line(line([2.0, 0.3]) + 0.1 * coloured(np.random.default_rng(seed)))
             for seed in range(200)]
    assert_covers(2.0, [one.value(0, '1') for one in found])


@pytest.mark.long
def test_intervals_that_take_coloured_noise_for_white_would_not_hold(monkeypatch):
    monkeypatch.setattr(
        'mambo_analysis.identify.regression.autoregression', lambda x: np.empty(0))
    found = [fit_line(line([2.0, 0.3]) + 0.1 * coloured(np.random.default_rng(seed)))
             for seed in range(200)]
    with pytest.raises(AssertionError, match='of 200'):
        assert_covers(2.0, [one.value(1, '1') for one in found])


def test_autoregression_finds_order_and_coefficients():
    rng = np.random.default_rng(5)
    x = signal.lfilter([1.0], [1.0, -1.2, 0.5], rng.standard_normal(20000))
    # standard error of a coefficient: about 1/sqrt(20000) = 0.007
    np.testing.assert_allclose(autoregression(x)[:2], [1.2, -0.5], atol=0.03)
    assert len(autoregression(rng.standard_normal(20000))) <= 1
    assert len(autoregression(np.zeros(100))) == 0


def test_what_the_data_do_not_tell_is_said():
    data = line([2.0, 0.3])
    with pytest.raises(IdentifyError, match='do not tell first from second: excite them more'):
        fit(lambda p: (p[0] + p[1]) * line([1.0, 0.0]), data, [1.0, 1.0], [0.0, 0.0],
            [9.0, 9.0], ['first', 'second'])
    with pytest.raises(IdentifyError, match='do not depend on first'):
        fit(lambda p: line([1.0, 0.0]), data, [1.0], [0.0], [9.0], ['first'])
    with pytest.raises(IdentifyError, match='2 samples are too few for 2 unknowns'):
        fit(lambda p: line(p)[:2], data[:2], [1.0, 0.0], [-9.0] * 2, [9.0] * 2, ['a', 'b'])


def test_a_parameter_between_zero_and_itself_has_an_even_interval():
    found = fit_line(line([2.0, 0.3]) + 0.1 * np.random.default_rng(1).standard_normal((N, 1)))
    wide = found._replace(theta=np.log([1e-3, 1.0]), covariance=np.diag([4.0, 0.01]))
    low, high = wide.positive(0, '1')[1:3]
    assert low == 0.0 and 4e-3 < high < 6e-3
    value = wide.positive(1, '1')
    assert value.low * value.high == pytest.approx(1.0)


@pytest.mark.parametrize('columns, message', [
    ({'a': np.zeros(9), 'b': np.zeros(8)}, 'b has 8 samples, not 9'),
    ({'a': np.zeros(9), 'b': np.r_[np.zeros(8), np.nan]}, 'b is not finite in 1 of 9'),
    ({'a': np.zeros(3)}, '3 samples, at least 5')])
def test_columns_that_do_not_belong_together_are_named(columns, message):
    with pytest.raises(IdentifyError, match=message):
        check_columns(columns, 5)


def test_time_that_stands_or_falls_is_named():
    with pytest.raises(IdentifyError, match='time does not rise after 2 s'):
        check_times(np.array([0.0, 1.0, 2.0, 2.0, 3.0]))


@pytest.mark.parametrize('half', [3e-9, 0.00047, 0.0123, 1.0, 250.0])
def test_a_printed_interval_holds_the_interval(half):
    value = 12.3456789
    middle, _, width = plus_minus(value, half).partition(' +- ')
    assert abs(float(middle) - value) <= 0.05 * half + 1e-12
    assert float(width) == pytest.approx(half, rel=0.05)


def test_a_parameter_at_an_end_of_its_range_is_told_unless_it_is_natural():
    low, high, names = (0.0, -1.0, 0.0), (1.0, 1.0, 5.0), ('lag', 'tilt', 'gain')

    def ends(*theta):
        return at_bound(np.array(theta), low, high, names, ['lag'])
    assert ends(0.5, 0.0, 1.0) == ends(0.0, 0.99, 4.9) == {}
    assert ends(1.0, -1.0, 5.0) == {'lag': 1.0, 'tilt': -1.0, 'gain': 5.0}
    assert ends(0.0, 0.0, 0.0) == {'gain': 0.0}


def test_a_fit_that_ends_at_a_bound_is_refused():
    t = np.arange(200.0)
    data = 3.0 * t[:, None] + np.random.default_rng(0).normal(size=(200, 1))
    found = fit(lambda x: x[0] * t[:, None], data, [1.0], [0.0], [2.0], ['slope'])
    with pytest.raises(IdentifyError, match='slope is at the end of its range'):
        refuse_bound(found, [0.0], [2.0], ['slope'])
    refuse_bound(found, [0.0], [4.0], ['slope'])
