"""Samples that are no numbers are counted by sensor, poses by topic."""

from pathlib import Path
from types import SimpleNamespace

from mambo_bags.reader import read_bag
from mambo_signals import damaged
from mambo_signals.motion import MOTIONS
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


def poses(topic, type_name='nav_msgs/msg/Odometry'):
    """Return a bag with ten poses of a topic, 5 ms apart."""
    return Bag({topic: SimpleNamespace(
        topic=f'/mambo/{topic}', type_name=type_name, t=0.005 * np.arange(10),
        position=np.ones((10, 3)), orientation=np.ones((10, 4)))})


@pytest.mark.parametrize('value', [np.nan, np.inf])
@pytest.mark.parametrize('topic', MOTIONS)
def test_poses_that_are_not_finite_are_counted_with_the_first_time(topic, value):
    recording = poses(topic)
    recording[topic].position[[3, 4, 6], [0, 0, 2]] = value
    assert damaged.poses_not_finite(recording) == [
        f'/mambo/{topic}: 3 of 10 positions are not finite, the first at 0.015 s: they are not '
        'compared']


def test_the_time_from_which_on_no_pose_is_finite_is_told():
    recording = poses('estimate/odom')
    recording['estimate/odom'].position[4:, 1] = np.nan
    recording['estimate/odom'].orientation[[2, 9]] = np.nan
    assert damaged.poses_not_finite(recording) == [
        '/mambo/estimate/odom: 6 of 10 positions are not finite, the first at 0.020 s: they are '
        'not compared. None of the last 0.030 s is: the last one that counts is at 0.015 s',
        '/mambo/estimate/odom: 2 of 10 attitudes are not finite, the first at 0.010 s: they are '
        'not compared. None of the last 0.005 s is: the last one that counts is at 0.040 s']


def test_positions_none_of_which_is_whole_have_no_last_one():
    recording = poses('onboard/odom')
    recording['onboard/odom'].position[:5, 0] = np.nan
    recording['onboard/odom'].position[5:, 1] = np.nan
    assert damaged.poses_not_finite(recording) == [
        '/mambo/onboard/odom: 10 of 10 positions are not finite, the first at 0.000 s: they are '
        'not compared']


def test_poses_that_are_whole_or_never_measured_say_nothing():
    recording = poses('onboard/odom')
    assert not damaged.poses_not_finite(recording) and not damaged.poses_not_finite(Bag())
    recording['onboard/odom'].orientation[:] = np.nan
    assert not damaged.poses_not_finite(recording)
    assert not damaged.poses_not_finite(read_bag(CIRCLE))
    other = poses('estimate/map', 'sensor_msgs/msg/JointState')
    other['estimate/map'].position[3] = np.nan
    assert not damaged.poses_not_finite(other)
