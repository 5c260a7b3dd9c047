"""The barometer's lines: rate, steps and noise, in flight and at rest."""

from interval_checks import assert_covers
from mambo_analysis.identify.recording import Recording, Stream
from mambo_analysis.identify.sensors.barometer import measure
import numpy as np
import pytest

RATE, NOISE = 50.0, 3.0  # Hz, Pa


def pressure(seed=0, n=600, drift=0.0, round_to=None, noise=NOISE):
    t = np.arange(n) / RATE
    values = 101325.0 + drift * t + noise * np.random.default_rng(seed).standard_normal(n)
    return Stream(t, values if round_to is None else np.round(values / round_to) * round_to)


def lines(recording):
    return {line.quantity: line for line in measure(recording)}


def resting(seconds):
    """Return gyro and accelerometer of a vehicle at rest."""
    t = np.arange(round(seconds * 200.0)) / 200.0
    return Stream(t, np.zeros((len(t), 3))), Stream(t, np.tile([0.0, 0.0, -9.81], (len(t), 1)))


def test_noise_from_value_to_value_is_that_of_the_samples_and_its_interval_is_fair():
    found = [lines(Recording('r', barometer=pressure(seed)))['noise from value to value']
             for seed in range(60)]
    assert_covers(NOISE, found, wide=1.5)  # the interval of a median size, cautious where tied
    assert found[0].unit == 'Pa' and found[0].samples == 600


def test_a_climb_is_no_noise():
    """At 1 m/s the pressure falls by 12 Pa/s: a line in time, which second differences leave."""
    still, climbing = (lines(Recording('r', barometer=pressure(drift=drift)))[
        'noise from value to value'].value for drift in (0.0, -12.0))
    assert climbing == pytest.approx(still, rel=1e-6)


def test_rate_and_the_smallest_change():
    found = lines(Recording('r', barometer=pressure(round_to=0.5)))
    assert found['rate'].value == pytest.approx(RATE)
    assert found['interval'].value == pytest.approx(20.0)
    assert found['smallest change'].value == pytest.approx(0.5)
    assert found['smallest change'].low == found['smallest change'].high


def test_at_rest_only_what_was_measured_then_counts():
    stream = pressure(n=1000)
    loud = Stream(stream.t, np.where(stream.t > 10.0, 10.0, 1.0) * (stream.values - 101325.0))
    found = lines(Recording('r', *resting(10.0), barometer=loud))
    noise = found['noise at rest']
    assert noise.low < NOISE < noise.high and noise.samples == 500
    assert 'noise at rest' not in lines(Recording('r', barometer=loud))
    short = resting(2.5)  # 125 values there, but 40 in the next
    assert 'noise at rest' in lines(Recording('r', *short, barometer=loud))
    early = Stream(loud.t + 1.8, loud.values)
    assert 'noise at rest' not in lines(Recording('r', *short, barometer=early))


def test_a_constant_value_has_no_smallest_change():
    assert 'smallest change' not in lines(Recording('r', barometer=pressure(noise=0.0)))


def test_too_few_values_tell_nothing():
    assert measure(Recording('r')) == []
    assert measure(Recording('r', barometer=pressure(n=39))) == []
    assert measure(Recording('r', barometer=pressure(n=40)))
