"""When a sample is due on the grid of 5 ms, and what resolution and limits make of a value."""

import math

from hypothesis import given, strategies as st
from mambo_sim.sensors.sampling import (
    clamp, due, due_in_bursts, period_ns, quantise, STEP_NS, tilt_cosine)
import numpy as np
import pytest
from scipy.spatial.transform import Rotation


@pytest.mark.parametrize('rate', [200.0, 120.0, 70.0, 41.7, 22.0, 1.0])
def test_samples_come_at_the_mean_rate_from_the_first_tick_on(rate):
    ticks = [k for k in range(4000) if due(k, period_ns(rate))]
    assert ticks[0] == 0
    assert len(ticks) == pytest.approx(20.0 * rate, abs=1.0)
    gaps = np.diff(ticks)
    assert gaps.max() - gaps.min() <= 1


@given(st.integers(STEP_NS, 10**9), st.integers(0, 5000))
def test_a_sample_is_delivered_at_the_first_tick_at_or_after_its_instant(period, number):
    instant = number * period
    tick = -(-instant // STEP_NS)
    assert due(tick, period)
    between = range(tick + 1, -(-(instant + period) // STEP_NS))
    assert not any(due(k, period) for k in between)


def test_a_burst_pauses_after_its_samples():
    period, burst, pause = 30_000_000, 15, 110_000_000
    at = [k * 0.005 for k in range(2000) if due_in_bursts(k, period, burst, pause)]
    gaps = np.round(np.diff(at), 6)
    long = np.flatnonzero(gaps > 0.1)
    assert long[0] == burst - 1 and (np.diff(long) == burst).all()
    assert set(gaps[long]) == {0.11} and set(np.delete(gaps, long)) == {0.03}


@given(st.integers(STEP_NS, 10**8), st.integers(1, 20), st.integers(0, 2000))
def test_without_a_pause_bursts_are_an_even_rate(period, burst, tick):
    assert due_in_bursts(tick, period, burst, period) == due(tick, period)


@given(st.floats(-1e3, 1e3), st.floats(1e-3, 10.0))
def test_a_quantised_value_is_the_nearest_step(x, resolution):
    found = quantise(x, resolution)
    assert abs(found - x) <= 0.5 * resolution * (1.0 + 1e-9)
    assert found / resolution == pytest.approx(round(found / resolution), abs=1e-6)


def test_no_resolution_leaves_a_value_as_it_is_and_limits_keep_nan():
    assert quantise(0.1234, 0.0) == 0.1234
    assert [clamp(x, -1.0, 2.0) for x in (-3.0, 0.5, 9.0)] == [-1.0, 0.5, 2.0]
    assert math.isnan(clamp(math.nan, -1.0, 2.0))


def test_the_tilt_is_the_cosine_of_roll_times_that_of_pitch():
    for yaw, pitch, roll in np.random.default_rng(0).uniform(-1.2, 1.2, (20, 3)):
        x, y, z, w = Rotation.from_euler('ZYX', (yaw, pitch, roll)).as_quat()
        assert tilt_cosine((w, x, y, z)) == pytest.approx(math.cos(roll) * math.cos(pitch))
