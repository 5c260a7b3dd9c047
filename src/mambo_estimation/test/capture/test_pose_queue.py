"""Which step gets which pose is a function of stamped data, whatever the order of arrival."""

import random

from mambo_estimation.capture.pose_queue import PoseQueue
from mambo_estimation.synchroniser import NAN, NAN2, NAN3, Step
import pytest

MS = 1_000_000
Q = (1.0, 0.0, 0.0, 0.0)


def step(t):
    return Step(t, 0.005, NAN3, NAN3, NAN, NAN2, 0, NAN, True, (0, 0, 0, 0))


def flight():
    """Return one list of calls per topic: 30 steps of 5 ms, poses of 120 Hz that are 10 ms old."""
    streams = {'step': [], 'pose': [], 'tick': []}
    count = 0
    for k in range(30):
        t = 5 * MS * k
        streams['step'].append(('add_steps', [step(t)]))
        exposure = (t - 10 * MS) * 120 // 1_000_000_000
        if exposure >= count and not 10 <= k < 16:  # the body is lost for a while
            count += 1
            streams['pose'].append(('add_pose', t - 10 * MS, (float(k), 0.0, 0.0), Q))
        streams['tick'].append(('add_tick', t, count))
    return streams


def play(order, streams):
    """Deliver each stream in its own order, interleaved as ``order`` says; return the pairs."""
    queue, queues = PoseQueue(), {name: list(calls) for name, calls in streams.items()}
    out = []
    for name in order:
        call, *arguments = queues[name].pop(0)
        out += getattr(queue, call)(*arguments)
    return [(s.t, pose) for s, pose in out]


def test_any_interleaving_gives_the_same_pairs():
    streams = flight()
    order = [name for name, calls in streams.items() for _ in calls]
    want = play(order, streams)
    assert [t for t, _ in want] == [5 * MS * k for k in range(30)]
    poses = [pose.t for _, pose in want if pose is not None]
    assert poses == [call[1] for call in streams['pose']]  # each once, at the step it came with
    for seed in range(50):
        random.Random(seed).shuffle(order)
        assert play(order, streams) == want


def test_a_step_waits_for_the_watermark_and_for_the_poses_it_announces():
    queue = PoseQueue()
    assert queue.add_tick(0, 0) == []
    assert [pose for _, pose in queue.add_steps([step(0)])] == [None]
    assert queue.add_steps([step(5 * MS)]) == []
    assert queue.add_tick(5 * MS, 1) == []
    (_, pose), = queue.add_pose(4 * MS, (1.0, 2.0, 3.0), Q)
    assert pose == (4 * MS, (1.0, 2.0, 3.0), Q)


def test_the_newest_of_several_poses_is_used():
    queue = PoseQueue()
    for t in (1, 2):
        queue.add_pose(t * MS, (float(t), 0.0, 0.0), Q)
    queue.add_tick(0, 0)
    queue.add_tick(5 * MS, 2)
    pairs = queue.add_steps([step(0), step(5 * MS)])
    assert [pose and pose.rho[0] for _, pose in pairs] == [None, 2.0]


@pytest.mark.parametrize('readable', [True, False])
def test_a_pose_that_cannot_be_read_still_counts(readable):
    queue = PoseQueue()
    queue.add_tick(0, 1)
    queue.add_steps([step(0)])
    pairs = queue.add_pose(0, (0.0, 0.0, 0.0), Q) if readable else queue.skip()
    assert [pose is not None for _, pose in pairs] == [readable]


def test_who_joins_late_takes_what_is_there_as_complete():
    queue = PoseQueue()
    queue.add_pose(0, (0.0, 0.0, 0.0), Q)
    queue.add_steps([step(5 * MS)])
    (_, pose), = queue.add_tick(5 * MS, 700)
    assert pose.t == 0
    queue.add_tick(10 * MS, 701)
    assert queue.add_steps([step(10 * MS)]) == []


def test_without_watermark_a_step_has_what_has_arrived():
    queue = PoseQueue(watermark=False)
    assert [pose for _, pose in queue.add_steps([step(0)])] == [None]
    queue.add_pose(1 * MS, (1.0, 0.0, 0.0), Q)
    (_, pose), = queue.add_steps([step(5 * MS)])
    assert pose.t == 1 * MS
    assert [pose for _, pose in queue.add_steps([step(10 * MS)])] == [None]


def test_after_a_gap_a_pose_looks_for_the_watermarks_that_have_arrived():
    """The first pose after a gap of 1 s overtakes its watermarks at the middleware."""
    queue, pairs, arrived = PoseQueue(), [], []

    def pull():
        while arrived:
            pairs.extend(queue.add_tick(*arrived.pop(0)))
    queue.pull = pull
    for k in range(400):
        pairs += queue.add_steps([step(5 * MS * k)])
        if not 100 <= k < 300:
            pairs += queue.add_pose(5 * MS * k, (float(k), 0.0, 0.0), Q)
        arrived.append((5 * MS * k, k + 1))
        if not 90 <= k < 300:
            pull()
    assert [s.t for s, _ in pairs] == [5 * MS * k for k in range(400)]
    assert [k for k, (_, pose) in enumerate(pairs) if pose is None] == list(range(100, 300))
    assert all(pose is None or pose.t == s.t for s, pose in pairs)


def test_a_pose_with_a_stamp_of_the_future_is_not_used():
    for ahead in (200 * MS, 3_000 * MS, 10**18):
        queue, pairs = PoseQueue(), []
        for k in range(1000):
            t = 5 * MS * k
            pairs += queue.add_steps([step(t)]) + queue.add_tick(t, k + 1)
            pairs += queue.add_pose(t + ahead * (k in (50, 51, 600)), (0.0, 0.0, 0.0), Q)
            assert len(pairs) == k + 1
        assert [k for k, (_, pose) in enumerate(pairs) if pose is None] == [50, 51, 600]
