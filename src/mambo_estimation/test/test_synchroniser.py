"""Filter steps are a function of stamped data, whatever the order of arrival across topics."""

import math
import random

from mambo_estimation.synchroniser import Synchroniser

MS = 1_000_000
NAMES = ('imu', 'sonar', 'flow', 'pressure')
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


def bad_flight(seed):
    """Return the same calls with late, repeated, swapped and lost samples, all of them counted."""
    draw, streams, counts = random.Random(seed), flight(), dict.fromkeys(NAMES, 0)
    sent, ticks = {name: [] for name in NAMES}, []
    for k, (_, now, _) in enumerate(streams['tick']):
        for name in NAMES:
            for call in streams[name]:
                due, late = call[1], draw.choice((0, 0, 0, 0, 5 * MS, 20 * MS)) * (k > 0)
                if due == now:
                    sent[name].append((now + late, call))
                    if k > 0 and draw.random() < 0.1:
                        sent[name].append((now + late, call))
            out = [call for when, call in sent[name] if when <= now]
            sent[name] = [one for one in sent[name] if one[0] > now]
            draw.shuffle(out)
            counts[name] += len(out)
            out = [call for call in out if draw.random() > 0.05]
            streams[f'{name} out'] = streams.get(f'{name} out', []) + out
        ticks.append(('add_tick', now, tuple(counts.values())))
    return {**{name: streams[f'{name} out'] for name in NAMES}, 'tick': ticks}


def test_any_interleaving_of_bad_samples_gives_the_same_steps():
    dropped = [0] * 4
    for seed in range(40):
        streams = bad_flight(seed)
        want, sync = play(in_sequence(streams), streams)
        assert len(want) > 5
        for shuffled in range(15):
            order = in_sequence(streams)
            random.Random(shuffled).shuffle(order)
            got, _ = play(order, streams)
            assert same(got, want), (seed, shuffled)
        dropped = [n + m for n, m in zip(dropped, want[-1].dropped)]
    assert min(dropped) > 10


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
    assert [step.t for step in steps] == [5 * MS * k for k in range(40)]
    assert [k for k, step in enumerate(steps) if step.gyro[0] != k] == [5]
    assert steps[-1].dropped == (0, 0, 0, 0)


def without(streams, lost):
    """Return the streams without the samples {name: places} that were lost on the way."""
    return {name: [call for k, call in enumerate(calls) if k not in lost.get(name, ())]
            for name, calls in streams.items()}


def test_lost_samples_cost_no_other_ones_in_any_interleaving():
    streams = flight()
    whole, _ = play(in_sequence(streams), streams)
    lost = {'imu': (3, 4, 9, 15), 'sonar': (1,), 'flow': (0, 2), 'pressure': (1, 2, 4)}
    gone = {name: {streams[name][k][1] for k in places} for name, places in lost.items()}
    some = without(streams, lost)
    want, sync = play(in_sequence(some), some)
    for seed in range(50):
        order = in_sequence(some)
        random.Random(seed).shuffle(order)
        got, _ = play(order, some)
        assert same(got, want)
    # the last sonar and flow are of 90 and 80 ms: whether those of 45 and 5 ms are lost is known
    assert [step.t for step in want] == [step.t for step in whole]
    for one, before in zip(want, whole):
        assert same(one, before._replace(
            gyro=(math.nan,) * 3 if one.t in gone['imu'] else before.gyro,
            accel=(math.nan,) * 3 if one.t in gone['imu'] else before.accel,
            sonar=math.nan if one.t in gone['sonar'] else before.sonar,
            flow=(math.nan,) * 2 if one.t in gone['flow'] else before.flow,
            flow_quality=0 if one.t in gone['flow'] else before.flow_quality,
            pressure=math.nan if one.t in gone['pressure'] else before.pressure))


def test_hundreds_of_lost_samples_silence_no_sensor():
    sync, steps, draw = Synchroniser(), [], random.Random(1)
    used = 0
    for k in range(4000):
        if draw.random() > 0.2:
            steps += sync.add_imu(5 * MS * k, (float(k), 0.0, 0.0), A)
            used += 1
        steps += sync.add_tick(5 * MS * k, (k + 1, 0, 0, 0))
    steps += sync.add_imu(5 * MS * 4000, G, A)
    assert [step.t for step in steps] == [5 * MS * k for k in range(4000)]
    assert sum(not math.isnan(step.gyro[0]) for step in steps) == used
    assert steps[-1].dropped == (0, 0, 0, 0)


def test_after_a_gap_in_all_streams_the_steps_go_on():
    sync, steps = Synchroniser(), []
    for k in (*range(10), *range(700, 720)):
        steps += sync.add_imu(5 * MS * k, G, A)
        steps += sync.add_tick(5 * MS * k, (k + 1, 0, 0, 0))
    assert [step.t for step in steps] == [5 * MS * k for k in (*range(10), *range(700, 720))]
    assert not any(math.isnan(step.gyro[0]) for step in steps)


def test_after_a_gap_of_one_sensor_samples_look_for_the_watermarks_that_have_arrived():
    """The first sample after a gap of 1 s overtakes its watermarks at the middleware."""
    sync, steps, arrived = Synchroniser(), [], []

    def pull():
        while arrived:
            steps.extend(sync.add_tick(*arrived.pop(0)))
    sync.pull = pull
    for k in range(400):
        if not 100 <= k < 300:
            steps += sync.add_imu(5 * MS * k, (float(k), 0.0, 0.0), A)
        arrived.append((5 * MS * k, (k + 1, 0, 0, 0)))
        if not 90 <= k < 300:
            pull()
    assert [step.t for step in steps] == [5 * MS * k for k in range(400)]
    bridged = [k for k, step in enumerate(steps) if math.isnan(step.gyro[0])]
    assert bridged == list(range(100, 300)) and steps[-1].dropped == (0,) * 4


def test_a_sample_that_was_taken_for_lost_is_due_again():
    sync, steps = Synchroniser(), []
    for k in range(30):
        t = 5 * MS * k
        if k == 10:  # overtaken by the next sample
            steps += sync.add_tick(t, (k + 1, 0, 0, 0)) + sync.add_imu(t + 5 * MS, G, A)
            steps += sync.add_imu(t, G, A)
        elif k == 11:
            steps += sync.add_tick(t, (k + 1, 0, 0, 0))
        else:  # the sample after its watermark: a step must wait for it
            steps += sync.add_tick(t, (k + 1, 0, 0, 0)) + sync.add_imu(t, G, A)
    assert [step.t for step in steps] == [5 * MS * k for k in range(30)]
    empty = [k for k, step in enumerate(steps) if math.isnan(step.gyro[0])]
    assert empty == [10, 12]  # the overtaken one, and one until it is noticed
    assert steps[-1].dropped[0] == len(empty)


def test_one_who_joins_before_the_sample_of_its_first_watermark_has_all_later_ones():
    sync, steps = Synchroniser(), []
    for k in range(100, 120):
        steps += sync.add_tick(5 * MS * k, (k + 1, 0, 0, 0))
        steps += sync.add_imu(5 * MS * k, G, A)
    assert [math.isnan(step.gyro[0]) for step in steps] == [True, True, *[False] * 18]


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
