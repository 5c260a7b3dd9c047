"""Systematic errors of a bench: what shows them, and what cannot."""

from mambo_analysis.identify.thrust_terms import (
    described, one_way, repeated_drift, repeated_errors, systematic, weighted)
import numpy as np
import pytest

A, B = 4.29e-5, 1.47
RISING = np.repeat(np.arange(50.0, 351.0, 25.0), 5)
SWEEPS = np.tile(np.concatenate([RISING[::5], RISING[::-5]]), 3)


def bench(X, seed=0, noise=0.003, zero=0.0, sag=0.0):
    """Return thrusts, N, of the Mambo's map: a zero in N, a sag as a share over the bench."""
    rng = np.random.default_rng(seed)
    return A * X ** B * (1.0 - sag * np.arange(len(X)) / len(X)) * (
        1.0 + noise * rng.standard_normal(len(X))) + zero


def terms(X, T):
    """Return the systematic errors of a bench whose readings err by a share."""
    b, log_a = np.polyfit(np.log(X), np.log(T), 1)
    return systematic(X, T, np.array([log_a, b]), 0.0, 1.0)


@pytest.mark.parametrize('zero', [0.002, 0.003, -0.002, 0.004])
def test_a_wrong_zero_is_found_with_the_exponent_that_it_hides(zero):
    found = [terms(SWEEPS, bench(SWEEPS, seed, zero=zero)) for seed in range(20)]
    assert all(len(one) == 1 for one in found)
    assert all('a zero of the scale' in one[0].words for one in found)
    assert [one[0].size for one in found] == pytest.approx([zero] * 20, abs=5e-4)  # 4 sigma
    assert sum(one[0].b.low < B < one[0].b.high for one in found) >= 17  # of 20 at 95 %


def test_a_rising_bench_shows_a_wrong_zero_too_and_what_it_may_be_as_well():
    X = RISING[RISING >= 100.0]
    found = [terms(X, bench(X, seed, zero=0.003)) for seed in range(20)]
    assert all(any('a zero of the scale' in term.words for term in one) for one in found)
    assert all(one[0].variance <= one[-1].variance for one in found)


@pytest.mark.parametrize('sag', [0.10, 0.15])
def test_a_sag_while_the_commands_rise_is_found(sag):
    found = [one for seed in range(20) for one in terms(
        RISING, bench(RISING, seed, 0.005, sag=sag)) if 'a thrust that drifts by -' in one.words]
    assert len(found) == 20
    assert np.mean([one.size for one in found]) == pytest.approx(-sag, abs=0.02)
    assert np.mean([one.b.value for one in found]) == pytest.approx(B, abs=0.01)  # 1.42 without


@pytest.mark.parametrize('noise', [0.003, 0.02, 0.1])
@pytest.mark.parametrize('X', [RISING, SWEEPS])
def test_noise_shows_no_systematic_error(X, noise):
    assert sum(bool(terms(X, bench(X, seed, noise))) for seed in range(200)) <= 3  # 0.2 % each


def test_a_sag_that_up_and_down_cancels_is_none():
    assert not any(terms(SWEEPS, bench(SWEEPS, seed, 0.005, sag=0.15)) for seed in range(20))


UP_AND_DOWN = np.concatenate([RISING, RISING[::-1]])


@pytest.mark.parametrize('X', [UP_AND_DOWN, SWEEPS])
@pytest.mark.parametrize('noise', [0.005, 0.02])
def test_repeated_readings_show_a_drift_that_up_and_down_cancels(X, noise):
    found = [repeated_drift(X, bench(X, seed, noise, sag=0.1)) for seed in range(20)]
    inside = [one.interval[0] < np.log(0.9) < one.interval[1] for one in found]
    assert sum(inside) >= 15  # of 20 at 95 %; the sag is even, not exponential
    assert np.mean([one.rate for one in found]) == pytest.approx(np.log(0.9), abs=0.01)
    T = bench(X, 0, 0.0, sag=0.1)
    assert repeated_drift(X, T).removed(T) == pytest.approx(bench(X, noise=0.0), rel=0.01)


def test_a_drift_is_no_scatter_of_the_scale():
    T = bench(UP_AND_DOWN, 3, 0.005, sag=0.1)
    assert repeated_errors(UP_AND_DOWN, T)
    assert not repeated_errors(UP_AND_DOWN, repeated_drift(UP_AND_DOWN, T).removed(T))


def test_a_drift_shows_beside_a_scale_that_errs_by_newtons():
    rng = np.random.default_rng(0)
    T = bench(UP_AND_DOWN, 0, 0.005, sag=0.1) + 0.002 * rng.standard_normal(len(UP_AND_DOWN))
    found = repeated_drift(UP_AND_DOWN, T)
    assert found.rate == pytest.approx(-0.105, abs=0.03) and found.half < 0.04
    assert repeated_errors(UP_AND_DOWN, found.removed(T))[0] == pytest.approx(0.002, rel=0.2)


@pytest.mark.parametrize('X', [UP_AND_DOWN, SWEEPS])
def test_repeated_readings_of_a_steady_bench_show_no_drift(X):
    assert sum(repeated_drift(X, bench(X, seed, 0.01)) is not None
               for seed in range(60)) <= 1  # 0.1 % each


def test_one_sweep_or_few_repeated_readings_show_no_drift_by_themselves():
    assert repeated_drift(RISING, bench(RISING, sag=0.1)) is None
    few = np.array([50.0, 100.0, 150.0, 200.0, 150.0, 100.0, 50.0])
    assert repeated_drift(few, bench(few, sag=0.1)) is None


def test_what_a_rotor_does_beside_a_power_law_is_scatter():
    wave = 1.0 + 0.01 * np.sin(RISING / 12.0)
    assert not any(terms(RISING, wave * bench(RISING, seed, 0.001)) for seed in range(20))


@pytest.mark.parametrize('X', [RISING[::5], np.repeat([50.0, 100.0, 150.0], 9)])
def test_too_few_readings_show_nothing(X):
    assert not terms(X, bench(X, zero=0.01))


def test_errors_are_named_with_size_exponent_and_remedy():
    assert not described([])
    zero, = terms(SWEEPS, bench(SWEEPS, zero=0.003))
    line = described([zero])
    assert line.startswith('the power law fits clearly better with a zero of the scale that is '
                           'wrong by +2.9 mN (b = 1.4')
    assert line.endswith('the interval of b holds only without it; read the scale with the motor '
                         'at rest, before and after')
    drift = terms(RISING, bench(RISING, noise=0.005, sag=0.1))[0]
    both = described([drift, zero])
    assert 'to the last (b = 1.4' in both and '), or with a zero of the scale' in both
    assert 'only without them; measure up and down at a steady supply, and read' in both


def test_known_errors_weigh_readings_and_their_means():
    X = np.arange(50.0, 351.0, 10.0)
    law = np.column_stack([np.ones(len(X)), np.log(X)])
    T, start = A * X ** B + 0.002, np.array([-9.0, 1.2])
    theta, covariance, variance = weighted(law, T, start, 0.001, 0.01, zero=True)
    assert theta == pytest.approx([np.log(A), B, 0.002]) and covariance.shape == (3, 3)
    assert variance == pytest.approx(0.0, abs=1e-12)
    T = T + 0.001 * np.cos(X)
    one, four = (weighted(law, T, start, 0.001, 0.01, counts)[2] for counts in (1.0, 4.0))
    assert four == pytest.approx(4.0 * one)


def test_commands_that_only_rise_or_fall_hide_a_drift():
    line = one_way(RISING, 0.004)
    assert 'after another one, and they rise: a supply' in line
    assert 'holds without a drift only' in line
    assert 'drifts by 1 % from the first reading to the last moves b by 0.0049' in line
    assert 'and they fall: ' in one_way(RISING[::-1], 0.004)
    drift = np.polyfit(np.log(RISING), np.log(bench(RISING, noise=0.0, sag=0.01)), 1)[0] - B
    assert drift == pytest.approx(-0.0049, abs=1e-4)


def test_a_drift_that_is_seen_or_is_small_beside_the_interval_is_no_doubt():
    assert not one_way(SWEEPS, 0.001)  # commands come back
    assert not one_way(RISING, 0.04)   # 5 % move b by less
    order = np.array([200.0, 50.0, 350.0, 125.0, 275.0, 75.0, 300.0, 175.0, 100.0, 250.0])
    assert not one_way(np.repeat(order, 5), 0.004)
