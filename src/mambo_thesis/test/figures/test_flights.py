"""What figures look at in a flight: errors, integrals of the flow, lags, drifts."""

import cmath
import math

from made_flights import made, path
from mambo_thesis.figures import flights
from mambo_thesis.figures.flights import drift, harmonic, held, lag, rms, running_rms, STEP, X, Y
import numpy as np
import pytest


def test_positions_are_the_first_columns_and_the_error_is_estimate_minus_truth():
    f = made(path(1.0, 2.0, -3.0), path(1.5, 2.0, -3.25), path(9.0), seconds=1.0)
    np.testing.assert_array_equal(f.truth[0], [1.0, 2.0, -3.0])
    np.testing.assert_array_equal(f.reference[0], [9.0, 0.0, -1.5])
    np.testing.assert_array_equal(f.error, np.tile([0.5, 0.0, -0.25], (200, 1)))


def test_after_is_from_the_beginning_on_and_before_the_end():
    f = made(path(), seconds=1.0)
    assert f.t[f.after(0.5)][[0, -1]] == pytest.approx([0.5, 0.995])
    assert f.t[f.after(0.5, 0.75)][[0, -1]] == pytest.approx([0.5, 0.745])


def test_a_sample_is_held_until_the_next_and_nothing_before_the_first():
    n = np.nan
    samples = np.array([[n, n], [1.0, 2.0], [n, n], [n, n], [3.0, 4.0], [n, n]])
    np.testing.assert_array_equal(held(samples), [
        [0, 0], [1, 2], [1, 2], [1, 2], [3, 4], [3, 4]])
    assert not held(np.full((3, 2), n)).any()


def test_the_integral_of_a_flow_is_an_angle():
    f = made(path(), seconds=10.0, flow=lambda t: np.tile([0.2, -0.1], (len(t), 1)))
    np.testing.assert_allclose(f.integrated_flow()[-1], [2.0, -1.0])


def test_flow_times_height_is_a_distance_and_counts_above_0_4_m():
    f = made(path(z=lambda t: np.where(t < 5.0, -0.3, -2.0)), seconds=10.0,
             flow=lambda t: np.tile([0.2, -0.1], (len(t), 1)))
    # 5 s at 2 m and 0.2 rad/s, times the factor
    np.testing.assert_allclose(f.flow_times_height(1.06)[-1], 1.06 * np.array([2.0, -1.0]))


def test_rms_of_a_sine_is_its_amplitude_over_root_two():
    t = np.linspace(0.0, 2.0 * math.pi, 1001)[:-1]
    assert rms(3.0 * np.sin(t)) == pytest.approx(3.0 / math.sqrt(2.0))
    assert rms(np.array([[3.0, 4.0]])) == pytest.approx(math.sqrt(12.5))


def test_a_running_rms_is_that_of_all_rows_so_far_by_column():
    x = np.random.default_rng(0).normal(size=(50, 3))
    found = running_rms(x)
    for k in (0, 7, 49):
        np.testing.assert_allclose(found[k], np.sqrt((x[:k + 1]**2).mean(axis=0)))


@pytest.mark.parametrize('rate', [0.5, 1.0, 2.0])
def test_an_amplitude_is_found_beside_an_offset_and_a_drift(rate):
    t = np.arange(0.0, 60.0, STEP)
    wave = 2.5 * np.cos(rate * t + 0.7) + 4.0 + 0.3 * t
    found = harmonic(t, wave, rate)
    assert abs(found) == pytest.approx(2.5, rel=1e-6)
    assert cmath.phase(found) == pytest.approx(0.7, abs=1e-6)


def test_the_beginning_of_a_flight_is_no_part_of_the_amplitude():
    t = np.arange(0.0, 60.0, STEP)
    wave = np.where(t < 30.0, 100.0, np.cos(t))
    assert abs(harmonic(t, wave)) == pytest.approx(1.0, rel=1e-6)


def test_an_estimate_that_is_late_lags():
    f = made(path(), path(lambda t: np.cos(t - 0.5), lambda t: np.cos(t + 0.25)),
             path(np.cos, np.cos), seconds=40.0)
    assert lag(f, X) == pytest.approx(math.degrees(0.5), abs=1e-3)
    assert lag(f, Y) == pytest.approx(-math.degrees(0.25), abs=1e-3)


@pytest.mark.parametrize(('rate', 'turns'), [(1.0, 4), (2.0, 3)])
def test_a_drift_is_by_turn_over_the_last_ones(rate, turns):
    t = np.arange(0.0, 60.0, STEP)
    x = np.stack([0.01 * t + np.sin(rate * t), np.where(t < 20.0, 50.0, -0.02 * t)], axis=1)
    # a turn is cut to whole steps: 2.5 ms of a speed of at most 2 m/s
    np.testing.assert_allclose(drift(x, rate, turns), np.array([0.01, -0.02]) * (
        2.0 * math.pi / rate), atol=2.0 * STEP * rate)


def test_every_seed_is_flown_once(monkeypatch):
    flown = []
    monkeypatch.setattr(flights, 'Flight', lambda scenario: flown.append(scenario) or len(flown))
    monkeypatch.setattr(flights.scenario_file, 'load', lambda name, over: (
        name, (name, over['seed'].value if over else None)))
    monkeypatch.setattr(flights, 'replaced', lambda scenario, changes: scenario)
    monkeypatch.setattr(flights.truths, 'of', lambda name, scenario: '')
    flights._flown.cache_clear()
    flights._scenario.cache_clear()
    try:
        assert flights.seeds('a') == flights.seeds('a') == [1, 2, 3, 4, 5]
        assert flown == [('a', seed) for seed in flights.truths.SEEDS]
        flights.fly('a')
        assert flown[-1] == ('a', None)
        with flights.truths.mutated(None, (7, 8)):
            flights.seeds('b')
        assert flown[-2:] == [('b', 7), ('b', 8)]
    finally:
        flights._flown.cache_clear()
        flights._scenario.cache_clear()


@pytest.mark.parametrize(('turns', 'amplitude'), [(1, 1.0), (2, 2.0), (4, 2.5)])
def test_an_amplitude_is_the_mean_of_the_turns_asked_for(turns, amplitude):
    """The last turn has an amplitude of 1, all before it one of 3 and 2.5 on average."""
    t = np.arange(0.0, 60.0, STEP)
    before = t < t[-1] - 2.0 * math.pi
    found = harmonic(t, np.where(before, 3.0, 1.0) * np.cos(t), 1.0, turns)
    # the line beside it takes a little of the step in amplitude
    assert abs(found) == pytest.approx(amplitude, abs=0.1)
