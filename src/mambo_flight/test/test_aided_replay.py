"""Poses of the motion capture paired with filter steps: by watermarks, and by times of the log."""

from hypothesis import given, strategies as st
from mambo_estimation.capture.pose_queue import PoseQueue
from mambo_estimation.synchroniser import Step
from mambo_flight import aided_replay
from mambo_ros import topics
import numpy as np
import pytest


class Topic(dict):
    """Messages of a topic: columns by name, stamps and log times as attributes."""

    def __init__(self, stamp, log_time, **columns):
        super().__init__({name: np.array(values) for name, values in columns.items()})
        self.stamp, self.log_time = np.array(stamp), np.array(log_time)
        self.position = self.get('position', np.zeros((len(self.stamp), 3)))
        self.orientation = self.get('orientation', np.zeros((len(self.stamp), 4)))
        self.topic, self.type_name = 'the topic', topics.CAPTURE_TICK.type_name
        self.raw = [b'%d' % k for k in range(len(self.stamp))]


def ticks(stamp, poses, log_time=None):
    return {topics.CAPTURE_TICK.name: Topic(stamp, log_time or stamp, poses=poses)}


def capture(stamp, log_time):
    """Return poses at (k, 2, 3) m, level, in axes of ROS."""
    n = len(stamp)
    return {topics.OPTITRACK.name: Topic(
        stamp, log_time, position=[[float(k), 2.0, 3.0] for k in range(n)],
        orientation=[[0.0, 0.0, 0.0, 1.0]] * n)}


def announced(bag, t, logged=(), stamp=None):
    """Return the poses that each step has at most; their stamps are old unless given."""
    seen = Topic(np.zeros(len(logged)) if stamp is None else stamp, logged)
    bag = {topics.OPTITRACK.name: seen, **bag}
    return aided_replay._announced(bag, *aided_replay._read(bag), np.array(t)).tolist()


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


def test_without_watermarks_a_pose_that_is_ahead_belongs_to_the_step_of_its_stamp():
    bag = {topics.IMU.name: Topic([0, 5, 10], [1, 6, 11])}
    assert announced(bag, [0, 5, 10], logged=[2, 3, 7], stamp=[0, 7, 6]) == [1, 1, 3]


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


def live(t, stamps, logged, ticked, counts):
    """Return what a live node pairs, message by message as logged: the pose of each step."""
    queue, out, step = PoseQueue(), [], 0
    events = sorted([(at, 0, k) for k, at in enumerate(logged)]
                    + [(at, 1, k) for k, at in enumerate(ticked)])
    for _, is_tick, k in events:
        if is_tick:
            while step < len(t) and t[step] <= ticked[k]:
                out += queue.add_steps([Step(t[step], *[None] * 9)])
                step += 1
            out += queue.add_tick(ticked[k], counts[k])
        else:
            out += queue.add_pose(stamps[k], (float(k),) * 3, (1.0, 0.0, 0.0, 0.0))
    return [None if pose is None else int(pose.rho[0]) for _, pose in out]


@given(lost=st.sets(st.integers(0, 39)), latency=st.integers(0, 12), period=st.integers(4, 9))
def test_poses_that_are_lost_cost_no_other_ones(lost, latency, period):
    """Steps of 5 ms; exposures of another period, published after a latency."""
    t = [5_000_000 * k for k in range(60)]
    exposed = [1_000_000 * period * k for k in range(40)]
    published = [stamp + 1_000_000 * latency for stamp in exposed]
    counts = [sum(at <= now for at in published) for now in t]
    kept = [k for k in range(40) if k not in lost]
    stamps, logged = [exposed[k] for k in kept], [published[k] for k in kept]
    want = live(t, stamps, logged, t, counts)
    bag = {**ticks(t, counts), **capture(stamps, logged)}
    poses, whole = aided_replay.poses(bag, np.array(t))
    assert whole == len(want)
    assert [None if np.isnan(x) else int(x) for x in poses.pose[:whole, 0]] == want
    assert not (poses.age[:whole] < 0.0).any()  # none is from after its step


def test_a_lost_pose_costs_no_other_one():
    t = list(range(0, 200, 5))
    kept = [k for k in range(40) if k not in (7, 8, 20)]
    bag = {**ticks(t, [k + 1 for k in range(40)]),
           **capture([5 * k for k in kept], [5 * k for k in kept])}
    poses, whole = aided_replay.poses(bag, np.array(t))
    assert whole == 40
    assert np.flatnonzero(np.isnan(poses.age)).tolist() == [7, 8, 20]
    assert np.nanmax(np.abs(poses.age)) == 0.0


def test_repeated_poses_that_no_watermark_counts_are_left_out():
    t = list(range(0, 200, 5))
    rows = sorted([*range(40), 7, 8, 8, 20])
    bag = {**ticks(t, [k + 1 for k in range(40)]), **capture([5 * k for k in rows],
                                                             [5 * k for k in rows])}
    bag[topics.OPTITRACK.name].raw = [b'%d' % k for k in rows]
    poses, whole = aided_replay.poses(bag, np.array(t))
    assert whole == 40 and not poses.age.any()
    assert aided_replay.poses_announced(bag) == (40, 40)
    counted = {**bag, **ticks(t, [sum(row <= k for row in rows) for k in range(40)])}
    assert not aided_replay.poses(counted, np.array(t))[0].age.any()
    assert aided_replay.poses_announced(counted) == (44, 44)


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
