"""Barometer: standard atmosphere, resolution, rate, noise, offset and its walk."""

import dataclasses
import math

from mambo_model.schema import ParameterError
from mambo_sim.sensors import barometer
from mambo_sim.sensors.barometer import BarometerParams, pressure_at
import numpy as np
import pytest

FINE = BarometerParams(rate=200.0, noise=0.0, offset=0.0, walk=0.0, resolution=0.0)


def record(params, n, seed=0, height=0.0, noise=True):
    rng, memory, p = np.random.default_rng(seed), barometer.START, params.values()
    out = []
    for tick in range(n):
        memory, sample = barometer.step(memory, tick, height, rng, noise, p)
        out.append(sample)
    return out


@pytest.mark.parametrize('height, pressure', [
    (0.0, 101325.0), (500.0, 95461.0), (1000.0, 89875.0), (2000.0, 79495.0)])
def test_pressure_is_that_of_the_standard_table(height, pressure):
    assert pressure_at(height, 101325.0) == pytest.approx(pressure, abs=2.0)  # table: geopotential


def test_pressure_is_that_of_the_floor_times_the_same_share_in_any_weather():
    share = pressure_at(300.0, 101325.0) / 101325.0
    assert pressure_at(0.0, 98000.0) == 98000.0
    assert pressure_at(300.0, 98000.0) == pytest.approx(98000.0 * share, rel=1e-14)


def test_a_metre_up_is_12_pascal_less():
    low, high = (record(FINE, 1, height=h)[0].pressure for h in (0.0, 1.0))
    assert high - low == pytest.approx(-12.01, abs=0.01)  # -rho g, 1.225 kg/m^3


def test_resolution_and_silence_without_noise():
    sample = record(BarometerParams(), 1, height=1.5, noise=False)[0]
    assert sample.pressure / 0.23 == pytest.approx(round(sample.pressure / 0.23), abs=1e-6)
    assert sample.pressure == pytest.approx(pressure_at(1.5, 101325.0), abs=0.12)
    rng = np.random.default_rng(2)
    barometer.step(barometer.START, 0, 0.0, rng, False, FINE.values())
    assert rng.standard_normal() == np.random.default_rng(2).standard_normal()


def test_70_values_a_second_and_only_new_ones():
    samples = record(BarometerParams(), 2000)
    ticks = [k for k, s in enumerate(samples) if s.new]
    assert len(ticks) == 700 and set(np.diff(ticks)) == {2, 3}
    assert all(math.isnan(s.pressure) for s in samples if not s.new)


def test_noise_is_that_asked_for():
    values = [s.pressure for s in record(dataclasses.replace(FINE, noise=5.0), 20000)]
    assert np.std(values) == pytest.approx(5.0, rel=0.025)  # standard error 0.5 %
    assert np.mean(values) == pytest.approx(101325.0, abs=0.15)


def test_offset_is_drawn_once_a_flight():
    params = dataclasses.replace(FINE, offset=10.0)
    flights = [[s.pressure for s in record(params, 3, seed)] for seed in range(2000)]
    assert all(len(set(values)) == 1 for values in flights)
    assert np.std([v[0] - 101325.0 for v in flights]) == pytest.approx(10.0, rel=0.06)


@pytest.mark.parametrize('rate', [200.0, 50.0])
def test_walk_does_not_depend_on_the_rate(rate):
    params = dataclasses.replace(FINE, walk=2.0, rate=rate)
    changes = []
    for seed in range(1000):
        values = [s.pressure for s in record(params, 41, seed) if s.new]
        changes.append(values[-1] - values[0])
    assert np.std(changes) == pytest.approx(2.0 * math.sqrt(0.2), rel=0.09)  # 0.2 s; error 2.2 %


def test_draws_are_those_of_numpy():
    rng = np.random.default_rng(11)
    samples = record(BarometerParams(rate=200.0, resolution=0.0), 3, seed=11)
    offset = 10.0 * rng.standard_normal()
    expected = [101325.0 + (offset + 5.0 * rng.standard_normal())]
    for _ in range(2):
        offset += 1.8 * math.sqrt(0.005) * rng.standard_normal()
        expected.append(101325.0 + (offset + 5.0 * rng.standard_normal()))
    assert [s.pressure for s in samples] == pytest.approx(expected, abs=1e-10)


def test_bad_parameter_names_itself():
    with pytest.raises(ParameterError, match='^ground_pressure = '):
        BarometerParams(ground_pressure=1013.25)
