"""Held and equal readings are told apart by their pattern."""

from mambo_analysis.identify.recording import Recording, Stream
from mambo_analysis.identify.sensors import repeats
from mambo_bags.mcap_reader import BagError
import numpy as np
import pytest

ROW = 0.01  # s


def readings(seed, noise, n=1000, motion=0.0, correlation=0.0):
    """Return readings each 40 ms in steps of 1, with a noise in steps."""
    rng = np.random.default_rng(seed)
    error = rng.standard_normal(n)
    for k in range(1, n):
        error[k] = correlation * error[k - 1] + np.sqrt(1.0 - correlation**2) * error[k]
    swing = motion * np.sin(0.8 * 0.04 * np.arange(n))
    return np.round(100.0 + rng.uniform() + swing + noise * error)


def in_rows(values, rate, jitter=0.0, seed=0):
    """Return readings of a rate [Hz] as a table holds them, whose rows are 10 ms apart."""
    due = np.arange(len(values)) / rate + jitter * np.random.default_rng(seed).uniform(
        size=len(values))
    t = np.arange(due[0], due[-1], ROW) + 1e-9
    return Stream(t, values[np.searchsorted(due, t, side='right') - 1])


@pytest.mark.parametrize('rate', [10.0, 22.0, 25.0, 31.0, 50.0])
@pytest.mark.parametrize('noise', [0.3, 1.0, 4.0])
@pytest.mark.parametrize('motion', [0.0, 30.0])
def test_a_held_reading_is_told_at_every_noise(rate, noise, motion):
    assert repeats.held(in_rows(readings(1, noise, motion=motion), rate))


def test_a_held_reading_is_told_where_its_rows_vary_and_where_it_is_a_little_slower():
    assert repeats.held(in_rows(readings(1, 4.0), 25.0, jitter=0.015))
    assert repeats.held(in_rows(readings(1, 4.0), 70.0))  # three of ten rows repeat


@pytest.mark.parametrize('noise', [0.0, 0.1, 0.3, 0.5, 1.0, 3.0, 10.0])
@pytest.mark.parametrize('motion', [0.0, 3.0, 30.0, 300.0])
@pytest.mark.parametrize('correlation', [0.0, 0.8])
def test_a_coarse_sensor_at_its_own_rate_is_not_refused(noise, motion, correlation):
    for seed in range(3):
        values = readings(seed, noise, motion=motion, correlation=correlation)
        assert not repeats.held(Stream(0.04 * np.arange(len(values)), values))


def test_a_sensor_that_is_on_the_floor_for_half_of_the_time_is_not_refused():
    values = readings(0, 4.0)
    values[:500] = 80.0
    stream = Stream(0.04 * np.arange(1000), values)
    assert not repeats.held(stream)


def test_a_flow_of_zeros_between_motion_is_not_held_but_one_that_repeats_motion_is():
    rng = np.random.default_rng(0)
    rate = rng.standard_normal((400, 2))
    t = 0.02 * np.arange(800)
    zeros = np.repeat(rate, 2, axis=0)
    zeros[1::2] = 0.0
    zeros[2::8] = 0.0  # two and more in a row
    assert not repeats.held(Stream(t, zeros))
    assert repeats.held(Stream(t, np.repeat(rate, 2, axis=0)))


@pytest.mark.parametrize('sensor, topic', sorted(repeats.TOPICS.items()))
def test_a_held_sensor_is_refused_with_the_remedy(sensor, topic):
    stream = in_rows(readings(0, 4.0), 25.0)
    if sensor == 'flow':
        stream = Stream(stream.t, np.stack([stream.values, 0.0 * stream.t], axis=1))
    with pytest.raises(BagError, match=f'r: {topic}: 7. % of the readings repeat .*only_changes'):
        repeats.check(Recording('r', **{sensor: stream}))
    repeats.check(Recording('r'))
    repeats.check(Recording('r', **{sensor: Stream(stream.t[:39], stream.values[:39])}))


def test_marks_of_missing_echoes_do_not_hide_a_held_sonar():
    stream = in_rows(readings(0, 4.0), 25.0)
    stream.values[::50] = np.nan
    assert repeats.held(stream)
