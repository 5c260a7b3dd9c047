"""The sonar's lines: outliers, limits, noise above the floor, and what is missing."""

from interval_checks import assert_covers
from mambo_analysis.identify.recording import Recording, Stream
from mambo_analysis.identify.sensors.sonar import measure, outliers
import numpy as np
import pytest

PERIOD, NOISE = 0.04, 0.005  # s, m


def ranges(seed=0, n=500, climb=0.0, height=1.2):
    t = np.arange(n) * PERIOD
    return t, height + climb * t + NOISE * np.random.default_rng(seed).standard_normal(n)


def lines(t, values, held=False):
    return {line.quantity: line for line in measure(
        Recording('r', sonar=Stream(t, values), held=held))}


def test_an_outlier_leaves_the_median_of_its_neighbours_by_a_quarter_metre():
    _, values = ranges(height=1.0)
    values[[50, 90]] = 1.0 + 0.3, 1.0 - 0.3
    values[120] = 1.0 + 0.2
    stray, level = outliers(values)
    assert np.flatnonzero(stray).tolist() == [50, 90]
    assert np.abs(level - 1.0).max() < 4.0 * NOISE


def test_a_climb_of_half_a_metre_a_second_and_a_step_of_the_floor_have_no_outliers():
    assert not outliers(ranges(climb=0.5)[1])[0].any()
    _, values = ranges()
    values[200:] -= 0.5  # a table
    assert not outliers(values)[0].any()


def test_noise_has_a_fair_interval_and_leaves_out_outliers_and_what_is_low():
    found = []
    for seed in range(60):
        t, values = ranges(seed)
        values[::31] += 2.0
        values[-100:] = 0.45  # on the floor, held
        found.append(lines(t, values)['noise'])
    assert_covers(NOISE, found, wide=1.5)
    assert 'above 0.5 m' in found[0].note


def test_the_share_of_outliers_and_by_how_much_late_ones_are_far():
    t, values = ranges(height=1.0)
    values[10:500:50] *= 1.4  # ten late ones
    values[30:430:100] *= 0.6  # four early ones
    found = lines(t, values)
    assert found['outliers'].value == pytest.approx(14 / 500)
    assert found['late of outliers'].value == pytest.approx(10 / 14)
    assert found['late of outliers'].samples == 14
    assert found['excess of late'].value == pytest.approx(0.4, abs=0.01)


def test_early_outliers_alone_have_no_excess():
    t, values = ranges()
    values[10:500:50] -= 0.5
    found = lines(t, values)
    assert found['late of outliers'].value == 0.0 and 'excess of late' not in found


def test_limits_are_the_extremes_with_how_often_they_were_said():
    t, values = ranges()
    values[:7], values[-1] = 0.434, 4.1
    found = lines(t, values)
    assert (found['smallest'].value, found['smallest'].note) == (0.434, '7 times')
    assert (found['largest'].value, found['largest'].note) == (4.1, '1 times')


def test_steps_are_found():
    t, values = ranges(n=300)
    assert lines(t, np.round(values / 0.002) * 0.002)['resolution'].value == pytest.approx(0.002)
    assert 'resolution' not in lines(t, values)


def test_missing_echoes_are_those_said_and_those_that_never_came():
    t, values = ranges(n=200)
    values[20] = np.nan
    keep = np.delete(np.arange(200), [50, 90, 91])
    found = lines(t[keep], values[keep])['dropouts']
    assert found.value * found.samples == pytest.approx(4.0)
    assert found.samples == 196 + 4 and not found.note


def test_of_a_held_signal_a_missing_echo_counts_for_as_long_as_it_lasts():
    """A gap between two new values is a repeated value; a gap after 0 is three echoes lost."""
    t, values = ranges(n=200)
    values[20] = np.nan
    keep = np.delete(np.arange(200), [21, 22, 90])
    found = lines(t[keep], values[keep], held=True)['dropouts']
    assert found.value * found.samples == pytest.approx(3.0)
    assert 'repeated values are not counted' in found.note


def test_too_few_values_tell_nothing():
    t, values = ranges(n=60)
    assert measure(Recording('r')) == []
    values[19:] = np.nan
    assert lines(t, values) == {}
    assert lines(*ranges(n=20))['outliers'].value == 0.0
