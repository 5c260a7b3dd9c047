"""What figures look at in a flight: errors, integrals of the flow, lags, drifts."""

import cmath
import math
from types import SimpleNamespace

from hypothesis import given, strategies as st
from made_flights import made, path
from mambo_thesis.figures import flights
from mambo_thesis.figures.flights import (
    drift, harmonic, hold_last_sample, lag, rms, running_rms, STEP, X, Y)
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
    np.testing.assert_array_equal(hold_last_sample(samples), [
        [0, 0], [1, 2], [1, 2], [1, 2], [3, 4], [3, 4]])
    assert not hold_last_sample(np.full((3, 2), n)).any()


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
    monkeypatch.setattr(flights.truths, 'mutation_of', lambda name, scenario: '')
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


def test_the_first_time_of_a_condition_is_infinite_if_it_never_holds():
    t = np.array([0.0, 1.0, 2.0, 3.0])
    assert flights.first_time(t, t > 1.5) == 2.0
    assert flights.first_time(t, t > 9.0) == math.inf


@pytest.mark.parametrize(('small', 'expected'), [
    ([False, True, False, True], 3.0), ([True, True, True, True], 0.0),
    ([True, True, True, False], math.inf), ([False, False, True, True], 2.0)])
def test_the_settling_time_is_when_a_condition_holds_until_the_end(small, expected):
    t = np.array([0.0, 1.0, 2.0, 3.0])
    assert flights.settling_time(t, np.array(small)) == expected


@given(small=st.lists(st.booleans(), min_size=1, max_size=30))
def test_nothing_is_violated_after_the_settling_time(small):
    t, small = np.arange(len(small), dtype=float), np.array(small)
    settled = flights.settling_time(t, small)
    assert small[t >= settled].all()
    assert settled == 0.0 or not small[t < settled][-1]


@given(amplitude=st.floats(0.1, 10.0), phase=st.floats(-3.0, 3.0), offset=st.floats(-5.0, 5.0),
       slope=st.floats(-1.0, 1.0), rate=st.sampled_from([0.5, 1.0, 2.0]))
def test_a_harmonic_is_found_beside_any_line(amplitude, phase, offset, slope, rate):
    t = np.arange(0.0, 30.0, 0.05)
    found = harmonic(t, amplitude * np.cos(rate * t + phase) + offset + slope * t, rate)
    assert found == pytest.approx(cmath.rect(amplitude, phase), abs=1e-6 * amplitude)


@given(shift=st.floats(-3.0, 3.0), factor=st.floats(0.1, 5.0))
def test_a_drift_is_linear_and_does_not_depend_on_an_offset(shift, factor):
    x = np.cumsum(np.random.default_rng(0).normal(size=(6000, 2)), axis=0)
    np.testing.assert_allclose(drift(factor * x + shift), factor * drift(x), rtol=1e-9, atol=1e-9)


@given(mask=st.lists(st.booleans(), min_size=1, max_size=40))
def test_held_samples_are_those_of_a_loop(mask):
    samples = np.array([[k, -k] if valid else [np.nan] * 2 for k, valid in enumerate(mask, 1)])
    last, expected = [0.0, 0.0], []
    for row in samples:
        last = last if np.isnan(row).any() else row.tolist()
        expected.append(last)
    np.testing.assert_array_equal(hold_last_sample(samples), expected)


def test_a_running_rms_ends_at_the_rms():
    x = np.random.default_rng(1).normal(size=(200, 3))
    np.testing.assert_allclose(running_rms(x)[-1], [rms(column) for column in x.T])


def test_a_lag_of_half_a_turn_is_180_degrees():
    f = made(path(), path(lambda t: -np.cos(t)), path(np.cos), seconds=40.0)
    assert abs(lag(f, X)) == pytest.approx(180.0, abs=1e-6)


def test_another_estimator_gets_the_recorded_samples(monkeypatch):
    f = made(path(), seconds=1.0)
    calls = []

    def estimate_again(recording, node):
        calls.append((recording, node))
        return np.tile(np.arange(13.0), (len(f.t), 1))
    monkeypatch.setattr(flights.offline_replay, 'estimate_again', estimate_again)
    other = SimpleNamespace(estimator_node='of another scenario')
    assert f.estimated_by(other)[7].tolist() == [0.0, 1.0, 2.0]
    assert calls == [(f.recording, 'of another scenario')]


def test_a_flight_is_flown_when_it_is_made(monkeypatch):
    recording = SimpleNamespace(t=np.array([0, 5_000_000, 10_000_000]))
    monkeypatch.setattr(flights.closed_loop, 'fly', {'a scenario': recording}.__getitem__)
    f = flights.Flight('a scenario')
    assert f.t.tolist() == [0.0, 0.005, 0.01] and f.recording is recording
