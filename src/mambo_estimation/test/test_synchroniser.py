"""Filter steps are a function of stamped data, whatever the order of arrival across topics."""

import math
import random

from mambo_estimation.synchroniser import Synchroniser

MS = 1_000_000
G, A = (0.1, 0.2, 0.3), (0.0, 0.0, -9.81)


def flight():
    """Return one list of calls per topic, as a sensor publishes them: 20 steps of 5 ms."""
    streams = {'imu': [], 'sonar': [], 'flow': [], 'pressure': [], 'tick': []}
    counts = [0, 0, 0, 0]
    for k in range(20):
        t = 5 * MS * k
        counts[0] += 1
        streams['imu'].append(('add_imu', t, (float(k), 0.0, 0.0), A))
        if k % 9 == 0:
            counts[1] += 1
            streams['sonar'].append(('add_sonar', t, 1.0 + k))
        if k % 5 == 1:
            counts[2] += 1
            streams['flow'].append(('add_flow', t, (0.1 * k, 0.0), 200))
        if k % 3 == 2:
            counts[3] += 1
            streams['pressure'].append(('add_pressure', t, 1e5 + k))
        streams['tick'].append(('add_tick', t, tuple(counts)))
    return streams


def play(order, streams):
    """Deliver each stream in its own order, interleaved as ``order`` says; return the steps."""
    sync, queues = Synchroniser(), {name: list(calls) for name, calls in streams.items()}
    out = []
    for name in order:
        call, *arguments = queues[name].pop(0)
        out += getattr(sync, call)(*arguments)
    return out, sync


def in_sequence(streams):
    return [name for name, calls in streams.items() for _ in calls]


def same(a, b):
    return repr(a) == repr(b)  # NaN equals NaN, floats to the last bit


def test_any_interleaving_gives_the_same_steps():
    streams = flight()
    want, _ = play(in_sequence(streams), streams)
    assert len(want) == 20
    for seed in range(50):
        order = in_sequence(streams)
        random.Random(seed).shuffle(order)
        got, sync = play(order, streams)
        assert same(got, want) and got[-1].dropped == (0, 0, 0, 0)


def test_a_step_waits_for_the_sample_that_the_watermark_announces():
    sync = Synchroniser()
    assert sync.add_imu(0, G, A) == sync.add_tick(0, (1, 1, 0, 0)) == []
    (step,) = sync.add_sonar(0, 1.5)
    assert step.sonar == 1.5 and math.isnan(step.pressure)


def test_the_time_step_is_the_difference_of_stamps():
    streams = flight()
    steps, _ = play(in_sequence(streams), streams)
    assert steps[0].dt == 0.0
    assert all(step.dt == 5 * MS * 1e-9 for step in steps[1:])


def test_each_aiding_sample_is_used_once_at_its_own_step():
    streams = flight()
    steps, _ = play(in_sequence(streams), streams)
    used = {step.t: step.sonar for step in steps if not math.isnan(step.sonar)}
    assert used == {t: r for _, t, r in streams['sonar']}
    used = {step.t: step.flow for step in steps if not math.isnan(step.flow[0])}
    assert used == {t: f for _, t, f, _ in streams['flow']}


def test_repeated_and_out_of_order_samples_are_counted_and_left_out():
    sync = Synchroniser()
    for t in (0, 5 * MS, 5 * MS, 0, 10 * MS):
        sync.add_imu(t, G, A)
    steps = sync.add_tick(10 * MS, (5, 0, 0, 0))
    assert [step.t for step in steps] == [0, 5 * MS, 10 * MS]
    assert steps[-1].dropped == (2, 0, 0, 0)


def test_a_missing_imu_sample_leaves_a_step_without_measurement():
    sync = Synchroniser()
    sync.add_imu(0, G, A)
    (first,) = sync.add_tick(0, (1, 0, 0, 0))
    (second,) = sync.add_tick(5 * MS, (1, 0, 0, 0))
    assert second.t == 5 * MS and all(map(math.isnan, second.gyro + second.accel))
    assert first.last and second.last


def test_one_who_joins_late_starts_with_the_next_watermark():
    sync = Synchroniser()
    sync.add_imu(500 * MS, G, A)
    assert [step.t for step in sync.add_tick(500 * MS, (101, 12, 20, 30))] == [500 * MS]
    assert sync.add_tick(505 * MS, (102, 12, 20, 30)) == []
    assert [step.t for step in sync.add_imu(505 * MS, G, A)] == [505 * MS]


def test_without_watermark_each_imu_sample_is_a_step_with_what_has_arrived():
    sync = Synchroniser(watermark=False)
    assert sync.add_sonar(0, 1.0) == []
    assert [step.sonar for step in sync.add_imu(0, G, A)] == [1.0]
    (step,) = sync.add_imu(5 * MS, G, A)
    assert math.isnan(step.sonar)


def test_of_two_samples_in_one_step_the_newer_wins():
    sync = Synchroniser()
    sync.add_imu(0, G, A)
    sync.add_sonar(1 * MS, 1.0)
    sync.add_sonar(2 * MS, 2.0)
    sync.add_imu(5 * MS, G, A)
    step = sync.add_tick(5 * MS, (2, 2, 0, 0))[-1]
    assert step.sonar == 2.0 and step.dropped == (0, 1, 0, 0)


def test_a_late_sample_is_dropped_whenever_it_arrives():
    calls = [
        ('add_imu', 0, G, A), ('add_tick', 0, (1, 0, 0, 0)), ('add_imu', 5 * MS, G, A),
        ('add_tick', 5 * MS, (2, 0, 0, 0)), ('add_sonar', 0, 1.0), ('add_imu', 10 * MS, G, A),
        ('add_tick', 10 * MS, (3, 1, 0, 0))]
    sonar = calls.pop(4)
    for place in range(len(calls) + 1):  # overtaking ticks that do not announce it, or overtaken
        sync, steps = Synchroniser(), []
        for call, *arguments in calls[:place] + [sonar] + calls[place:]:
            steps += getattr(sync, call)(*arguments)
        assert [step.t for step in steps] == [0, 5 * MS, 10 * MS]
        assert all(math.isnan(step.sonar) for step in steps)
        assert [step.dropped for step in steps] == [(0,) * 4, (0,) * 4, (0, 1, 0, 0)]


def test_a_late_inertial_sample_never_turns_time_back():
    sync = Synchroniser()
    steps = sync.add_imu(0, G, A) + sync.add_tick(0, (1, 0, 0, 0))
    steps += sync.add_tick(5 * MS, (1, 0, 0, 0))  # that of 5 ms is on its way
    steps += sync.add_imu(5 * MS, G, A) + sync.add_imu(10 * MS, G, A)
    steps += sync.add_tick(10 * MS, (3, 0, 0, 0))
    assert [step.t for step in steps] == [0, 5 * MS, 10 * MS]
    assert [step.dt for step in steps] == [0.0, 5 * MS * 1e-9, 5 * MS * 1e-9]
    assert steps[-1].dropped == (1, 0, 0, 0) and math.isnan(steps[1].gyro[0])


def test_without_watermark_a_driver_may_be_a_little_late():
    sync = Synchroniser(watermark=False)
    for t in (0, 5 * MS, 10 * MS, 15 * MS, 100 * MS):
        sync.add_imu(t, G, A)
    sync.add_sonar(60 * MS, 1.0)
    (step,) = sync.add_imu(105 * MS, G, A)
    assert step.sonar == 1.0 and step.dropped == (0, 0, 0, 0)
    sync.add_sonar(54 * MS, 2.0)
    sync.add_pressure(54 * MS, 1e5)
    (step,) = sync.add_imu(110 * MS, G, A)
    assert math.isnan(step.sonar) and math.isnan(step.pressure)
    assert step.dropped == (0, 1, 0, 1)


def test_samples_of_the_future_are_dropped_and_silence_nothing():
    streams = flight()
    want, _ = play(in_sequence(streams), streams)
    sync, got = Synchroniser(), []
    far = {'add_imu': (10**18, G, A), 'add_sonar': (10**18, 9.0), 'add_pressure': (10**18, 9e4)}
    for k in range(20):
        if k == 10:
            for name, sample in far.items():
                got += getattr(sync, name)(*sample)
        for calls in streams.values():
            for name, t, *values in calls:
                if t == 5 * MS * k:
                    if name == 'add_tick' and k >= 10:
                        values = [tuple(n + m for n, m in zip(values[0], (1, 1, 0, 1)))]
                    got += getattr(sync, name)(t, *values)
    assert same([step._replace(dropped=()) for step in got],
                [step._replace(dropped=()) for step in want])
    assert got[-1].dropped == (1, 1, 0, 1)


def test_a_sample_that_cannot_be_read_is_waited_for_no_longer():
    sync = Synchroniser()
    assert sync.add_imu(0, G, A) == sync.add_tick(0, (1, 1, 0, 0)) == []
    (step,) = sync.skip(1)
    assert math.isnan(step.sonar) and step.dropped == (0, 1, 0, 0)


def test_samples_that_follow_a_lost_one_wait_for_their_own_step():
    sync, steps = Synchroniser(), []
    for k in range(40):
        if k != 5:
            steps += sync.add_imu(5 * MS * k, (float(k), 0.0, 0.0), A)
        steps += sync.add_tick(5 * MS * k, (k + 1, 0, 0, 0))
    assert [step.t for step in steps] == [5 * MS * k for k in range(39)]  # the last one waits
    assert [k for k, step in enumerate(steps) if step.gyro[0] != k] == [5]
    assert steps[-1].dropped == (0, 0, 0, 0)


def test_an_inertial_sample_of_the_far_future_is_dropped_alone():
    sync = Synchroniser()
    steps = sync.add_imu(0, G, A) + sync.add_tick(0, (1, 0, 0, 0))
    steps += sync.add_imu(10_000 * MS, G, A) + sync.add_imu(5 * MS, G, A)
    steps += sync.add_tick(5 * MS, (3, 0, 0, 0))
    assert [step.t for step in steps] == [0, 5 * MS] and steps[-1].gyro == G
    assert steps[-1].dropped == (1, 0, 0, 0)


def test_what_a_publisher_sent_that_left_before_the_first_step_is_forgotten():
    streams = flight()
    want, _ = play(in_sequence(streams), streams)
    sync = Synchroniser()
    sync.add_flow(0, (9.0, 9.0), 255)
    sync.add_flow(5_000_000, (9.0, 9.0), 255)
    sync.skip(2)
    sync.forget(2)
    got = []
    for calls in streams.values():
        for call, *arguments in calls:
            got += getattr(sync, call)(*arguments)
    assert same(got, want)
    sync.forget(2)  # in flight nothing is: the watermark counts on
    more = sync.add_imu(10**9, (0.0,) * 3, (0.0,) * 3)
    assert more == [] and len(sync.add_tick(10**9, (21, *got[-1].dropped[1:]))) == 1
