"""Held, equal and left-out readings are told apart by their pattern, and what is open is said."""

from mambo_analysis.identify.allan import Interval
from mambo_analysis.identify.recording import Recording, Stream
from mambo_analysis.identify.sensors import barometer, repeats, sonar
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


def changes(values, period=0.04):
    """Return only the readings that differ from the one before."""
    new = np.r_[True, np.diff(values) != 0.0]
    return Stream(period * np.flatnonzero(new), values[new])


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
    assert not repeats.held(stream) and not repeats.undecided(stream)


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


def test_what_nothing_tells_is_said():
    slow = Stream(0.04 * np.arange(1000), readings(0, 0.0, motion=3.0))
    assert repeats.undecided(slow) and not repeats.held(slow)
    assert 'not to be told' in repeats.rate_note(Recording('r', sonar=slow), 'sonar')
    low = Stream(slow.t, slow.values / 100.0)
    found = {line.quantity: line for line in sonar.measure(Recording('r', sonar=low))}
    for quantity in ('dropouts', 'noise'):
        assert np.isnan(found[quantity].value) and 'not to be told' in found[quantity].note
    own = Stream(slow.t, readings(0, 0.5))
    assert not repeats.undecided(own) and not repeats.rate_note(
        Recording('r', sonar=own), 'sonar')


@pytest.mark.parametrize('noise', [0.3, 1.0, 4.0])
def test_a_stream_of_changes_is_known_by_its_readings(noise):
    values = readings(2, noise, motion=30.0)
    every = Recording('r', sonar=Stream(0.04 * np.arange(1000), values))
    assert not repeats.only_changes(every, 'sonar')
    assert repeats.only_changes(Recording('r', sonar=changes(values)), 'sonar')


def test_a_stream_of_changes_is_known_by_the_import_and_fine_readings_are_not_one():
    fine = Stream(0.04 * np.arange(200), np.random.default_rng(0).standard_normal(200))
    assert not repeats.only_changes(Recording('r', sonar=fine), 'sonar')
    told = Recording('r', sonar=fine, changes=frozenset(['sonar/range']))
    assert repeats.only_changes(told, 'sonar')
    assert 'equal readings are left out' in repeats.rate_note(told, 'sonar')
    assert repeats.only_changes(Recording('r', sonar=fine, held=True), 'sonar')


def test_dropouts_of_changes_have_no_number_but_a_bound():
    values = readings(11, 0.3) / 100.0
    line = sonar.measure(Recording('r', sonar=changes(values)))[-1]
    assert line.quantity == 'dropouts' and np.isnan(line.value)
    assert 'look like lost ones; at most 0.' in line.note


@pytest.mark.parametrize('noise', [0.5, 0.85, 1.0, 1.3, 2.0, 3.0, 4.0])
def test_the_noise_of_changes_is_right_or_not_told(noise):
    """Rounding adds a variance of 1/12; the interval may hold the noise with it or without."""
    for seed in range(10):
        stream = changes(100000.0 + readings(seed, noise))
        found = next(line for line in barometer.measure(Recording('r', barometer=stream))
                     if line.quantity == 'noise from value to value')
        if np.isnan(found.value):
            assert noise < 1.0 and 'hidden by steps of 1' in found.note
        else:
            assert found.low <= np.hypot(noise, 0.29) and noise <= found.high


def test_a_period_is_found_among_gaps():
    t = np.cumsum(np.r_[0.0, np.tile([0.04, 0.041, 0.08, 0.039, 0.12, 0.16, 0.2], 9)])
    assert repeats.period(t) == pytest.approx(0.04)
    values = np.arange(4.0)
    assert repeats.filled(np.array([0.0, 0.04, 0.16, 0.2]), values).tolist() == [
        0.0, 1.0, 1.0, 1.0, 2.0, 3.0]


def test_a_pause_of_a_day_is_not_filled():
    t = np.r_[0.04 * np.arange(50), 1e5 + 0.04 * np.arange(50)]
    assert len(repeats.filled(t, np.arange(100.0))) == 100 + repeats.MOST_EQUAL - 1


@pytest.mark.parametrize('size, full, told', [
    (0.0, None, False), (0.6, None, True), (1.2, None, True), (0.6, 0.6, False),
    (1.2, 0.6, False), (1.2, 1.2, True)])
def test_a_noise_that_steps_hide_is_not_told(size, full, told):
    found, note = repeats.shown(
        Interval(size, 0.9 * size, 1.1 * size), 1.0,
        None if full is None else Interval(full, 0.5 * full, 1.5 * full))
    assert np.isfinite(found.value) == told and ('hidden' in note) != told
    if told and full:
        assert (found.low, found.high) == (0.5 * full, 1.5 * full)


def test_equal_readings_have_no_step_and_no_noise():
    assert repeats.smallest_step(np.ones(9)) == 0.0
    assert repeats.smallest_step(np.array([3.0, 1.0, 1.5, 1.5])) == 0.5
    found, note = repeats.shown(Interval(0.0, 0.0, 0.0), 0.0)
    assert np.isnan(found.value) and 'all readings are equal' in note
