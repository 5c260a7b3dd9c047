"""Samples that are no numbers are counted by sensor."""

from pathlib import Path

from mambo_bags.reader import read_bag
from mambo_signals import damaged
import numpy as np
import pytest

CIRCLE = Path(__file__).parents[3] / 'bags/circle_short'


class Bag(dict):
    """Topics with arrays for fields."""


class Messages(dict):
    """Arrays by field."""

    topic = '/mambo/imu/data_raw'

    @property
    def stamp(self):
        return 5_000_000 * np.arange(10)


def bag():
    return Bag({'imu/data_raw': Messages(
        angular_velocity=np.ones((10, 3)), linear_acceleration=np.ones((10, 3)))})


def test_a_whole_recording_says_nothing():
    assert not damaged.not_finite(read_bag(CIRCLE))
    assert not damaged.not_finite(bag()) and not damaged.not_finite(Bag())


@pytest.mark.parametrize('value', [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize('field, name', [
    ('angular_velocity', 'gyro'), ('linear_acceleration', 'accelerometer')])
def test_samples_are_counted_by_sensor_with_the_first_time(value, field, name):
    recording = bag()
    recording['imu/data_raw'][field][[3, 4, 9], [0, 0, 2]] = value
    assert damaged.not_finite(recording) == [
        f'/mambo/imu/data_raw: 3 of 10 samples of the {name} are not finite, the first at '
        '0.015 s: no estimator uses them']


def test_an_axis_that_was_never_measured_does_not_count():
    recording = bag()
    recording['imu/data_raw']['linear_acceleration'][:, :2] = np.nan
    assert not damaged.not_finite(recording)
    recording['imu/data_raw']['linear_acceleration'][2, 2] = np.nan
    assert ' 1 of 10 samples' in damaged.not_finite(recording)[0]


def test_a_topic_of_another_type_says_nothing():
    recording = bag()
    del recording['imu/data_raw']['angular_velocity']
    assert not damaged.not_finite(recording)
