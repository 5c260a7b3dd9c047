"""Poses of the motion capture paired with filter steps: by watermarks, and by times of the log."""

from hypothesis import given, strategies as st
from mambo_flight import aided_replay
from mambo_ros import topics
import numpy as np
import pytest


class Topic(dict):
    """Messages of a topic: columns by name, stamps and log times as attributes."""

    def __init__(self, stamp, log_time, **columns):
        super().__init__({name: np.array(values) for name, values in columns.items()})
        self.stamp, self.log_time = np.array(stamp), np.array(log_time)
        self.position = self.get('position')
        self.orientation = self.get('orientation')


def ticks(stamp, poses, log_time=None):
    return {topics.CAPTURE_TICK.name: Topic(stamp, log_time or stamp, poses=poses)}


def capture(stamp, log_time):
    """Return poses at (k, 2, 3) m, level, in axes of ROS."""
    n = len(stamp)
    return {topics.OPTITRACK.name: Topic(
        stamp, log_time, position=[[float(k), 2.0, 3.0] for k in range(n)],
        orientation=[[0.0, 0.0, 0.0, 1.0]] * n)}


def announced(bag, t, logged=()):
    return aided_replay._announced(bag, np.array(t), np.array(logged)).tolist()


def test_a_step_waits_for_the_first_watermark_that_is_not_older():
    bag = ticks([0, 10, 20, 30], [1, 1, 2, 3])
    assert announced(bag, [0, 5, 10, 20, 30]) == [1, 1, 1, 2, 3]


def test_a_step_after_the_last_watermark_has_no_count():
    assert announced(ticks([0, 10], [0, 1]), [10, 11, 12]) == [1, -1, -1]


def test_a_recording_that_begins_in_flight_counts_the_poses_it_has():
    bag = ticks([100, 110, 120], [50, 50, 51], log_time=[101, 111, 121])
    assert announced(bag, [100, 110, 120], logged=[98, 99, 115]) == [2, 2, 3]


def test_a_recording_from_the_start_is_not_shifted():
    """One pose before the first watermark is the first pose of the flight."""
    assert announced(ticks([100, 110], [1, 2]), [100, 110], logged=[102, 103]) == [1, 2]


def test_without_watermarks_a_pose_belongs_to_the_sample_before_it_in_the_log():
    bag = {topics.IMU.name: Topic([0, 5, 10], [1, 6, 11])}
    assert announced(bag, [0, 5, 10], logged=[2, 7, 8, 99]) == [1, 3, 4]


def test_without_watermarks_a_repeated_inertial_sample_takes_no_pose():
    bag = {topics.IMU.name: Topic([0, 5, 5, 10], [1, 6, 7, 11])}
    assert announced(bag, [0, 5, 10], logged=[2, 8, 12]) == [1, 2, 3]


def test_the_newest_pose_of_a_step_is_taken_with_its_age():
    bag = {**ticks([0, 10, 20], [0, 2, 2]), **capture([3, 8], [4, 9])}
    poses, whole = aided_replay.poses(bag, np.array([0, 10, 20]))
    assert whole == 3
    np.testing.assert_allclose(poses.age, [np.nan, 2e-9, np.nan])
    np.testing.assert_allclose(poses.pose[1], [1.0, -2.0, -3.0, 1.0, 0.0, 0.0, 0.0])
    assert np.isnan(poses.pose[[0, 2]]).all()


@pytest.mark.parametrize(('counts', 'whole'), [([1, 2, 3], 2), ([1, 1, 9], 2), ([1, 3, 3], 1)])
def test_steps_whose_poses_are_not_in_the_bag_are_not_complete(counts, whole):
    bag = {**ticks([0, 10, 20], counts), **capture([0, 8], [1, 9])}
    assert aided_replay.poses(bag, np.array([0, 10, 20]))[1] == whole


def test_a_bag_without_motion_capture_has_no_pose_and_every_step():
    poses, whole = aided_replay.poses({}, np.arange(4))
    assert whole == 4 and poses.age.shape == (4,) and poses.pose.shape == (4, 7)
    assert np.isnan(poses.age).all() and np.isnan(poses.pose).all()


@given(ticked=st.lists(st.integers(0, 200), min_size=1, max_size=15, unique=True),
       counts=st.data(), steps=st.lists(st.integers(0, 250), min_size=1, max_size=20, unique=True))
def test_every_step_gets_the_count_of_the_first_watermark_not_older(ticked, counts, steps):
    stamp = sorted(ticked)
    poses = np.cumsum([counts.draw(st.integers(0, 1)) for _ in stamp[:1]]
                      + [counts.draw(st.integers(0, 3)) for _ in stamp[1:]]).tolist()
    steps = sorted(steps)
    expected = [next((n for at, n in zip(stamp, poses, strict=True) if at >= step), -1)
                for step in steps]
    assert announced(ticks(stamp, poses), steps) == expected


@given(logged=st.lists(st.integers(0, 400), max_size=12),
       delays=st.lists(st.integers(1, 20), min_size=1, max_size=12))
def test_without_watermarks_every_pose_is_counted_once_and_none_too_early(logged, delays):
    """Inertial samples every 5 ns of the clock, each logged some time after the one before."""
    log_time = np.cumsum(delays).tolist()
    t = list(range(0, 5 * len(delays), 5))
    logged = sorted(logged)
    found = announced({topics.IMU.name: Topic(t, log_time)}, t, logged)
    assert found == sorted(found) and found[-1] == len(logged)
    for k, count in enumerate(found[:-1]):
        assert count == sum(at < log_time[k + 1] for at in logged)
