"""Sonar: slant range by hand, its limits, rate, resolution, narrowing, noise, outliers."""

import dataclasses
import math

from mambo_model.motion.quaternion import from_euler
from mambo_model.motion.rigid_body import State
from mambo_model.schema import ParameterError
from mambo_sim.sensors import sonar
from mambo_sim.sensors.sonar import RESOLUTION, SonarParams
import numpy as np
import pytest

ZERO = (0.0, 0.0, 0.0)
FINE = SonarParams(resolution=0.0, rate=200.0)


def above(height, euler=ZERO):
    return State((3.0, -2.0, -height), ZERO, from_euler(*euler), ZERO)


def read(body, params=FINE, noise=False, seed=0, ticks=1):
    rng, p = np.random.default_rng(seed), params.values()
    return [sonar.step(tick, body, rng, noise, p) for tick in range(ticks)]


@pytest.mark.parametrize('euler', [ZERO, (0.2, 0.0, 0.5), (0.0, -0.3, 1.0), (0.25, 0.2, -2.0)])
def test_reads_the_distance_along_the_body_axis(euler):
    sample = read(above(1.5, euler))[0]
    expected = 1.5 / (math.cos(euler[0]) * math.cos(euler[1]))
    assert sample.new and sample.range == pytest.approx(expected, rel=1e-7)  # float32


def test_reads_its_limit_below_it_as_the_vehicle_does():
    floor = 338 * RESOLUTION
    for height in (0.0, 0.1, 0.43):
        assert read(above(height), SonarParams())[0].range == np.float32(floor)
    assert read(above(0.45))[0].range == pytest.approx(0.45, rel=1e-7)
    noisy = [s.range for s in read(above(0.0), noise=True, ticks=500)]
    assert min(noisy) == np.float32(floor) and np.mean(np.array(noisy) > floor) == pytest.approx(
        0.5, abs=0.07)  # the scatter stays on one side


def test_hears_nothing_from_afar_or_tilted():
    for body in (above(5.3), above(1.0, (0.8, 0.0, 0.0)), above(1.0, (0.0, 3.0, 0.0))):
        sample = read(body)[0]
        assert not sample.new and math.isnan(sample.range)
    assert read(above(5.2))[0].new


def test_new_value_each_eighth_tick():
    samples = read(above(1.0), SonarParams(), ticks=81)
    assert [k for k, s in enumerate(samples) if s.new] == list(range(0, 81, 8))
    assert all(math.isnan(s.range) for s in samples if not s.new)


@pytest.mark.parametrize('rate', [22.0, 70.0, 199.0])
def test_mean_rate_is_exact_whatever_the_grid(rate):
    samples = read(above(1.0), SonarParams(rate=rate), ticks=20000)
    ticks = [k for k, s in enumerate(samples) if s.new]
    assert len(ticks) == math.ceil(100.0 * rate)
    assert set(np.diff(ticks)) <= {int(200 // rate), int(200 // rate) + 1}


def test_values_are_multiples_of_the_resolution_narrowed_to_float32():
    for sample in read(above(1.2345), SonarParams(rate=200.0), noise=True, ticks=200):
        multiple = sample.range / RESOLUTION
        assert multiple == pytest.approx(round(multiple), abs=1e-3)  # float32: 1e-4 of one
        assert sample.range == float(np.float32(sample.range))
        assert sample.range != round(multiple) * RESOLUTION


def test_noise_and_offset_are_those_asked_for():
    values = [s.range for s in read(
        above(2.0), dataclasses.replace(FINE, noise=0.02, offset=0.1), True, ticks=20000)]
    assert np.std(values) == pytest.approx(0.02, rel=0.025)  # standard error 0.5 %
    assert np.mean(values) == pytest.approx(2.1, abs=6e-4)


def test_outliers_come_as_often_as_asked_for_from_the_whole_range():
    values = np.array([s.range for s in read(
        above(2.0), dataclasses.replace(FINE, outlier_probability=0.1), True, ticks=20000)])
    strays = values[np.abs(values - 2.0) > 0.05]
    assert len(strays) / 20000 == pytest.approx(0.1 * (1 - 0.1 / 4.83), rel=0.1)
    assert strays.min() < 0.5 and strays.max() > 5.2 and 0.43 < values.min()


def test_late_echoes_come_as_often_as_asked_for_from_beyond_the_floor():
    values = np.array([s.range for s in read(above(1.0), dataclasses.replace(
        FINE, noise=0.001, multipath_probability=0.1, multipath_excess=0.8), True, ticks=20000)])
    late = values[values > 1.005]
    # share: 2000 of 20000, standard error 2.1 %; uniform from 1.0 to 2.6 m
    assert len(late) / 20000 == pytest.approx(0.1 * (1 - 0.005 / 1.6), rel=0.09)
    assert np.mean(late) == pytest.approx(1.8, abs=0.04) and 2.55 < late.max() < 2.61
    assert values.min() > 0.99


def test_a_late_echo_from_beyond_the_range_is_none():
    samples = read(above(3.0), dataclasses.replace(
        FINE, multipath_probability=1.0, multipath_excess=0.75), True, ticks=4000)
    heard = [s.range for s in samples if s.new]
    assert len(heard) / 4000 == pytest.approx(2.26 / 4.5, rel=0.07) and max(heard) < 5.261


def test_missing_echoes_are_as_many_as_asked_for():
    params = dataclasses.replace(FINE, dropout_probability=0.2)
    samples = read(above(1.0), params, True, ticks=20000)
    missing = [s for s in samples if not s.new]
    assert len(missing) / 20000 == pytest.approx(0.2, rel=0.06)  # standard error 1.4 %
    assert all(math.isnan(s.range) for s in missing)
    heard = [s.range for s in read(above(1.0), FINE, True, ticks=20000)]
    assert all(s.range == value for s, value in zip(samples, heard) if s.new)
    assert all(s.new for s in read(above(1.0), params, False, ticks=100))


def test_what_goes_wrong_excludes_each_other():
    samples = read(above(1.0), dataclasses.replace(
        FINE, noise=0.0, outlier_probability=0.2, multipath_probability=0.3, multipath_excess=0.5,
        dropout_probability=0.4), True, ticks=20000)
    right = [s.new and abs(s.range - 1.0) < 1e-6 for s in samples]
    assert np.mean(right) == pytest.approx(0.1, rel=0.09)  # standard error 2.1 %
    assert np.mean([not s.new for s in samples]) == pytest.approx(0.4, rel=0.04)


def test_draws_do_not_depend_on_where_the_vehicle_is():
    near = read(above(1.0), noise=True, ticks=9)[-1].range
    rng, p = np.random.default_rng(0), FINE.values()
    for tick in range(8):
        sonar.step(tick, above(50.0), rng, True, p)  # no echo
    assert sonar.step(8, above(1.0), rng, True, p).range == near


def test_bad_limits_name_themselves():
    with pytest.raises(ParameterError, match='min_range'):
        SonarParams(min_range=1.0, max_range=0.6)
    with pytest.raises(ParameterError, match='sum to 1.2'):
        SonarParams(outlier_probability=0.5, multipath_probability=0.4, dropout_probability=0.3)
    with pytest.raises(ParameterError, match='^rate = '):
        SonarParams(rate=400.0)
