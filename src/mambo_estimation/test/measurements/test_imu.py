"""Inertial samples: what may be integrated, and what a dead sensor looks like."""

import math

from mambo_estimation.measurements import imu
import pytest

V = imu.ImuParams().values()
RATE, FORCE = (0.1, 0.0, 0.0), (0.0, 0.0, -9.81)


@pytest.mark.parametrize('bad', [math.nan, math.inf, -math.inf, 1e4, -1e4])
@pytest.mark.parametrize('axis', range(3))
def test_sample_with_one_impossible_number_is_refused(bad, axis):
    def spoil(x):
        return tuple(bad if i == axis else value for i, value in enumerate(x))

    assert not imu.is_within(spoil(RATE), V.gyro_range)
    assert not imu.is_within(spoil(FORCE), V.accel_range)
    assert imu.is_within(RATE, V.gyro_range) and imu.is_within(FORCE, V.accel_range)


def test_sensor_that_repeats_a_rate_is_stuck_after_twenty_samples():
    assert not imu.is_stuck(19, RATE, V) and imu.is_stuck(20, RATE, V)


def test_sensor_that_repeats_zero_rate_may_be_free_of_noise():
    assert not imu.is_stuck(1000, (0.0, 0.0, 0.0), V)


def test_zero_stuck_samples_switch_the_test_off():
    assert not imu.is_stuck(1000, RATE, imu.ImuParams(stuck_samples=0).values())


def test_equality_is_number_by_number():
    assert imu.is_equal(RATE, RATE) and not imu.is_equal(RATE, (0.1, 0.0, 1e-300))
    assert not imu.is_equal((math.nan,) * 3, (math.nan,) * 3)
