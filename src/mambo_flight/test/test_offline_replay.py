"""Recorded sensors through the filter: the same numbers as the filter called by hand."""

from dataclasses import replace
import heapq
import itertools
import math

from mambo_bags import message_definition
from mambo_bags.reader import BagError, read_bag
from mambo_bags.writer import BagWriter
from mambo_estimation import filters, kalman, support_package
from mambo_estimation.measurements.optical_flow import FlowParams
from mambo_estimation.synchroniser import Synchroniser
from mambo_flight import offline_replay
from mambo_ros import cdr, messages, topics
import numpy as np
import pytest

STEP = 5_000_000  # ns
LOW, HIGH = 0.25, 4.0  # m, limits of the sonar
NAN = math.nan
PARAMS = kalman.EstimatorParams()
SENSORS = (topics.IMU, topics.SONAR, topics.OPTICAL_FLOW, topics.BAROMETER)


def sequence(steps=600, seed=1):
    """Return made-up samples: rest for 0.6 s, then a climb and turns, [(ns, {topic: value})]."""
    rng, out = np.random.default_rng(seed), []
    for k in range(steps):
        fly = k >= 120
        wave = math.sin(0.02 * (k - 120)) if fly else 0.0
        gyro = tuple((0.3 * fly * rng.normal(size=3) + 0.001 * rng.normal(size=3)).tolist())
        accel = (0.5 * wave + 0.01 * rng.normal(), -0.3 * wave, -9.81 - wave + 0.01 * rng.normal())
        samples = {topics.IMU: (gyro, accel)}
        if k % 8 == 0:
            samples[topics.SONAR] = float(np.float32(0.5 + 0.002 * max(k - 120, 0)))
        if k % 6 == 0:
            samples[topics.OPTICAL_FLOW] = ((0.2 * wave, -0.1 * wave), 200)
        if k % 3 == 0:
            samples[topics.BAROMETER] = 101325.0 + rng.normal()
        out.append((k * STEP, samples))
    return out


ENCODE = {
    topics.IMU: lambda t, value: messages.imu(t, *value, (0.0,) * 3, (0.0,) * 3),
    topics.SONAR: lambda t, value: messages.sonar(t, value, LOW, HIGH, 1.0),
    topics.OPTICAL_FLOW: lambda t, value: messages.optical_flow(t, *value),
    topics.BAROMETER: lambda t, value: messages.pressure(t, value, 1.0)}


def write(path, samples, order=(topics.SENSOR_TICK, *SENSORS), tick_every=1, lost=-1):
    """Write a bag, a watermark after each ``tick_every`` steps; return it as read."""
    counts = dict.fromkeys(SENSORS, 0)
    with BagWriter(path) as bag:
        for topic in order:
            bag.add_topic(f'/mambo/{topic.name}', topic.type_name)
        for k, (t, values) in enumerate(samples):
            for topic, value in values.items():
                counts[topic] += 1
                if topic is not topics.IMU or k != lost:
                    bag.write(f'/mambo/{topic.name}', ENCODE[topic](t, value), t)
            if topics.SENSOR_TICK in order and (k + 1) % tick_every == 0:
                bag.write(f'/mambo/{topics.SENSOR_TICK.name}',
                          messages.sensor_tick(t, *counts.values()), t)
    return read_bag(path)


def by_hand(samples, params=PARAMS):
    """Return [(ns, estimate)] of the filter's own step, called for each IMU sample."""
    memory, values, out, before = kalman.initial(params.values()), params.values(), [], None
    for t, sample in samples:
        dt = 0.0 if before is None else (t - before) * 1e-9
        flow, quality = sample.get(topics.OPTICAL_FLOW, ((NAN, NAN), 0))
        memory, estimate = kalman.step(
            memory, dt, *sample[topics.IMU], sample.get(topics.SONAR, NAN), flow, quality,
            sample.get(topics.BAROMETER, NAN), values)
        out.append((t, estimate))
        before = t
    return out


def numbers(estimate):
    """Return every number of an estimate, in the order of the columns of ``Estimates``."""
    e = estimate
    return (
        (*e.state.rho, *e.state.nu, *e.state.q, *e.state.omega), e.pose_covariance,
        e.twist_covariance,
        (e.status, e.height, e.vertical_velocity, *e.gyro_bias, *e.accel_bias,
         e.barometer_offset, e.sonar_innovation, e.sonar_test_ratio, *e.flow_innovation,
         e.flow_test_ratio, e.barometer_innovation, e.barometer_test_ratio, e.sonar_refused,
         e.flow_refused, e.barometer_refused, e.invalid_samples, *itertools.chain(*e.health)))


def assert_same(got, want):
    """Compare bit for bit; NaN from NaN does not differ."""
    assert got.t.tolist() == [t for t, *_ in want]
    for column, wanted in zip(got[1:5], zip(*(numbers(e) for _, e, *_ in want)), strict=True):
        np.testing.assert_array_equal(column, np.array(wanted))


def one_by_one(bag):
    """Return the steps of a bag as a live node has them: message by message as recorded."""
    sync, counts, out = Synchroniser(), dict.fromkeys(SENSORS, 0), []
    take = {
        topics.IMU: lambda data: sync.add_imu(*messages.decode_imu(data)),
        topics.SONAR: lambda data: sync.add_sonar(*messages.decode_sonar(data)),
        topics.OPTICAL_FLOW: lambda data: sync.add_flow(*messages.decode_optical_flow(data)),
        topics.BAROMETER: lambda data: sync.add_pressure(*messages.decode_pressure(data)),
        topics.SENSOR_TICK: lambda data: sync.add_tick(*messages.decode_sensor_tick(data))}
    streams = [
        zip(bag[topic.name].log_time.tolist(), itertools.repeat(topic), bag[topic.name].raw)
        for topic in take if topic.name in bag]
    has_ticks, now = topics.SENSOR_TICK.name in bag, -1
    stamps = {topic: [] for topic in SENSORS}

    def tick():  # announces no sample of its own future, unless the stamp is far off
        for topic, known in stamps.items():
            while counts[topic] < len(known) and not 0 < known[counts[topic]] - now <= 100_000_000:
                counts[topic] += 1
        return sync.add_tick(now, tuple(counts.values()))

    for _, topic, data in heapq.merge(*streams, key=lambda entry: entry[0]):
        if topic is topics.IMU and not has_ticks and (t := cdr.stamp_ns(data)) > now:
            if now >= 0:
                out += tick()
            now = t
        if topic in counts:
            stamps[topic].append(cdr.stamp_ns(data))
        out += take[topic](data)
    return out if now < 0 else out + tick()


def assert_same_steps(got, want):
    assert len(got.t) == len(want)
    for name, column, wanted in zip(got._fields, got, zip(*want), strict=True):
        np.testing.assert_array_equal(column, np.array(wanted), err_msg=name)


def in_order(bag):
    """Tell whether the steps are found for all at once, without the Synchroniser."""
    if topics.SENSOR_TICK.name in bag:
        streams, marks = offline_replay._counted(bag)
    else:
        streams = [offline_replay._stream(bag, topic) for topic in SENSORS]
        marks = offline_replay._ticks_from_log(streams)
    return offline_replay._in_order(streams, marks.t, marks.due) is not None


@pytest.fixture(scope='module')
def samples():
    return sequence()


def test_the_made_up_flight_exercises_the_filter(samples):
    last = by_hand(samples)[-1][1]
    assert last.status == 2
    assert last.height > 0.6 and math.hypot(*last.state.rho[:2]) > 0.05


def test_offline_is_the_step_of_the_filter_to_the_bit(tmp_path, samples):
    found = offline_replay.estimate(write(tmp_path / 'bag', samples), PARAMS)
    assert_same(found, by_hand(samples))


def test_the_order_of_topics_in_the_bag_means_nothing(tmp_path, samples):
    for number, order in enumerate((
            (*SENSORS, topics.SENSOR_TICK), (topics.SENSOR_TICK, *reversed(SENSORS)))):
        bag = write(tmp_path / str(number), samples, order)
        assert_same(offline_replay.estimate(bag, PARAMS), by_hand(samples))


def test_parameters_are_those_asked_for(tmp_path, samples):
    bag = write(tmp_path / 'bag', samples)
    other = replace(PARAMS, optical_flow=FlowParams(constant=2.0))
    assert_same(offline_replay.estimate(bag, other), by_hand(samples, other))
    assert repr(by_hand(samples, other)[-1]) != repr(by_hand(samples)[-1])


def test_an_echo_out_of_the_limits_is_no_echo(tmp_path, samples):
    def with_echo(distance):
        return [(t, {**s, topics.SONAR: distance} if t == 320 * STEP else s) for t, s in samples]
    without = [(t, {k: v for k, v in s.items() if k is not topics.SONAR or t != 320 * STEP})
               for t, s in samples]
    for number, distance in enumerate((0.2, 4.5, math.inf, NAN)):
        bag = write(tmp_path / str(number), with_echo(distance))
        assert_same(offline_replay.estimate(bag, PARAMS), by_hand(without))
    assert repr(by_hand(without)[-1]) != repr(by_hand(samples)[-1])


def test_a_flight_without_aiding_sensors_is_estimated_too(tmp_path, samples):
    alone = [(t, {topics.IMU: s[topics.IMU]}) for t, s in samples[:200]]
    bag = write(tmp_path / 'bag', alone, (topics.IMU, topics.SENSOR_TICK))
    assert_same(offline_replay.estimate(bag, PARAMS), by_hand(alone))


def test_of_several_imu_samples_in_a_tick_the_last_answers(tmp_path, samples):
    bag = write(tmp_path / 'bag', samples, tick_every=2)
    assert len(offline_replay.steps(bag).t) == len(samples)
    assert_same(offline_replay.estimate(bag, PARAMS), by_hand(samples)[1::2])


def test_what_came_after_the_last_watermark_is_left_out(tmp_path, samples):
    bag = write(tmp_path / 'bag', samples[:11], tick_every=5)
    assert offline_replay.estimate(bag, PARAMS).t.tolist() == [4 * STEP, 9 * STEP]


def test_a_sample_that_the_bag_has_lost_is_bridged_as_by_the_live_estimator(tmp_path, samples):
    bag = write(tmp_path / 'bag', samples[:200], lost=150)
    nothing = {**samples[150][1], topics.IMU: ((NAN,) * 3, (NAN,) * 3)}
    bridged = by_hand([*samples[:150], (150 * STEP, nothing), *samples[151:200]])
    assert_same(offline_replay.estimate(bag, PARAMS), bridged)


def test_without_watermarks_it_is_as_if_replayed(tmp_path, samples):
    bag = write(tmp_path / 'bag', samples, SENSORS)
    assert_same(offline_replay.estimate(bag, PARAMS), by_hand(samples))


def test_without_inertial_samples_there_is_one_line(tmp_path, samples):
    ranges = [(t, {topics.SONAR: 1.0}) for t, _ in samples[:5]]
    bag = write(tmp_path / 'bag', ranges, (topics.SONAR,))
    with pytest.raises(BagError, match='imu/data_raw') as why:
        offline_replay.estimate(bag, PARAMS)
    assert '\n' not in str(why.value)


FAULTS = (
    'none', 'late', 'repeated', 'early', 'missing', 'lost', 'two', 'not finite', 'joined', 'boast')
VALUES = {
    topics.IMU: lambda x: ((x, 2.0 * x, -x), (0.1 * x, 0.0, -9.81)), topics.SONAR: lambda x: 1 + x,
    topics.OPTICAL_FLOW: lambda x: ((x, -x), 200), topics.BAROMETER: lambda x: 101325.0 + x}


def untidy(path, faults, seed=0, ticks=True, shifted=None, by=0):
    """
    Write 60 steps whose samples have the faults at random; return the bag as read.

    One sample of the topic ``shifted`` has its stamp moved ``by`` ns.
    """
    rng, period = np.random.default_rng(seed), {
        topics.IMU: 1, topics.SONAR: 8, topics.OPTICAL_FLOW: 6, topics.BAROMETER: 3}
    counts = dict.fromkeys(SENSORS, 40 * ('joined' in faults))
    with BagWriter(path) as bag:
        for topic in (*SENSORS, *([topics.SENSOR_TICK] if ticks else ())):
            bag.add_topic(f'/mambo/{topic.name}', topic.type_name)

        def say(topic, t, now):
            counts[topic] += 1
            x = NAN if 'not finite' in faults and rng.random() < 0.1 else rng.normal()
            if 'lost' in faults and (rng.random() < 0.05 or now == STEP):
                return
            bag.write(f'/mambo/{topic.name}', ENCODE[topic](t, VALUES[topic](x)), now)

        for now in range(STEP, 61 * STEP, STEP):
            for topic in SENSORS:
                happens = rng.random(5) < 0.1
                if now // STEP % period[topic] or 'missing' in faults and happens[0]:
                    continue
                late = STEP // 2 * rng.integers(1, 5) * ('late' in faults and happens[1])
                early = 'early' in faults and happens[2]
                late -= by * (topic is shifted and now == 24 * STEP)
                say(topic, max(now - late, 0) + STEP // 2 * early, now)
                if 'repeated' in faults and happens[3]:
                    say(topic, now, now)
                if 'two' in faults and happens[4]:
                    say(topic, now + 1, now)
            if ticks and not ('missing' in faults and rng.random() < 0.1):
                bag.write(f'/mambo/{topics.SENSOR_TICK.name}',
                          messages.sensor_tick(now, *counts.values()), now)
            if ticks and 'boast' in faults and now == 50 * STEP:
                bag.write(f'/mambo/{topics.SENSOR_TICK.name}',
                          messages.sensor_tick(now + 1, 999, 0, 0, 0), now)
    return read_bag(path)


@pytest.mark.parametrize('ticks', [True, False], ids=['watermarks', 'none'])
@pytest.mark.parametrize('faults', [
    *((fault,) for fault in FAULTS), ('late', 'repeated'), ('missing', 'two'), FAULTS],
    ids='+'.join)
def test_the_steps_of_any_bag_are_those_of_the_live_node(tmp_path, faults, ticks):
    for seed in range(5):
        bag = untidy(tmp_path / str(seed), faults, seed, ticks)
        assert_same_steps(offline_replay.steps(bag), one_by_one(bag))


@pytest.mark.parametrize('by', [-2 * STEP, -STEP, -STEP + 1, -1, 1, STEP - 1, STEP])
def test_one_sample_with_another_stamp_is_taken_as_by_the_live_node(tmp_path, by):
    for number, topic in enumerate(SENSORS):
        bag = untidy(tmp_path / str(number), ('none',), shifted=topic, by=by)
        assert_same_steps(offline_replay.steps(bag), one_by_one(bag))


def test_only_what_is_out_of_order_is_taken_one_by_one(tmp_path):
    for fault, tidy in (('none', True), ('not finite', True), ('late', False),
                        ('repeated', False), ('early', False), ('two', False)):
        assert in_order(untidy(tmp_path / fault, (fault,), 1, True)) is tidy, fault


@pytest.mark.parametrize('params', [PARAMS, support_package.ToolboxEstimatorParams()],
                         ids=['kalman', 'toolbox'])
def test_every_number_is_that_of_the_filter_called_step_by_step(tmp_path, samples, params):
    for name, bag in (('tidy', write(tmp_path / 'tidy', samples[:300])),
                      ('untidy', untidy(tmp_path / 'untidy', FAULTS, 3, True))):
        memory, values, want = filters.initial(params.values()), params.values(), []
        for s in one_by_one(bag):
            memory, e = filters.step(memory, s.dt, s.gyro, s.accel, s.sonar, s.flow,
                                     s.flow_quality, s.pressure, values)
            if s.last:
                want.append((s.t, e, s.dropped))
        got = offline_replay.estimate(bag, params)
        assert_same(got, want)
        assert got.dropped.tolist() == [list(dropped) for _, _, dropped in want], name


def test_a_sensor_of_another_type_is_named_in_one_line(tmp_path):
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic('/mambo/imu/data_raw', topics.SONAR.type_name)
        bag.write('/mambo/imu/data_raw', ENCODE[topics.SONAR](0, 1.0), 0)
    with pytest.raises(BagError, match='imu/data_raw has the type sensor_msgs/msg/Range'):
        offline_replay.steps(read_bag(tmp_path / 'bag'))


def test_a_topic_without_inertial_samples_gives_no_step_but_where_a_watermark_asks(tmp_path):
    ranges = [(0, {topics.SONAR: 1.0})]
    bag = write(tmp_path / 'bag', ranges, (topics.IMU, topics.SONAR))
    assert len(offline_replay.steps(bag).t) == 0
    asked = write(tmp_path / 'asked', ranges)
    assert_same_steps(offline_replay.steps(asked), one_by_one(asked))


def test_a_sensor_that_lacks_a_field_is_named_in_one_line(tmp_path):
    kind = topics.BAROMETER.type_name
    other = message_definition.full_text(kind).replace('fluid_pressure', 'height')
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic('/mambo/imu/data_raw', topics.IMU.type_name)
        bag.add_topic('/mambo/barometer/pressure', kind, schema=other.encode())
        bag.write('/mambo/barometer/pressure', ENCODE[topics.BAROMETER](0, 1e5), 0)
    with pytest.raises(BagError, match='barometer/pressure .* has no field fluid_pressure'):
        offline_replay.steps(read_bag(tmp_path / 'bag'))


def test_repeated_samples_that_no_watermark_counts_are_left_out(tmp_path, samples):
    def written(path, again, counted):
        counts = dict.fromkeys(SENSORS, 0)
        with BagWriter(path) as bag:
            for topic in (*SENSORS, topics.SENSOR_TICK):
                bag.add_topic(f'/mambo/{topic.name}', topic.type_name)
            for k, (t, values) in enumerate(samples[:200]):
                for topic, value in values.items():
                    times = 1 + again * (k % 12 == 0)
                    counts[topic] += times if counted else 1
                    for _ in range(times):
                        bag.write(f'/mambo/{topic.name}', ENCODE[topic](t, value), t)
                bag.write(f'/mambo/{topics.SENSOR_TICK.name}', messages.sensor_tick(
                    t, *counts.values()), t)
        return read_bag(path)
    clean = offline_replay.steps(written(tmp_path / 'clean', 0, True))
    uncounted = written(tmp_path / 'uncounted', 2, False)
    for name, column, wanted in zip(clean._fields, offline_replay.steps(uncounted), clean):
        np.testing.assert_array_equal(column, wanted, err_msg=name)
    assert offline_replay.missing(uncounted) == {}
    sent = offline_replay.steps(written(tmp_path / 'counted', 1, True))
    assert sent.dropped[-1].tolist() == [17, 9, 17, 17]  # the sensor itself repeated them
    np.testing.assert_array_equal(sent.gyro, clean.gyro)


def test_a_watermark_that_is_not_newer_is_no_step(tmp_path, samples):
    def written(path, again):
        with BagWriter(path) as bag:
            for topic in (topics.IMU, topics.SENSOR_TICK):
                bag.add_topic(f'/mambo/{topic.name}', topic.type_name)
            for k, (t, values) in enumerate(samples[:100]):
                bag.write(f'/mambo/{topics.IMU.name}', ENCODE[topics.IMU](
                    t, values[topics.IMU]), t)
                for back in again.get(k, (0,)):
                    bag.write(f'/mambo/{topics.SENSOR_TICK.name}', messages.sensor_tick(
                        t - back * STEP, k + 1 - back, 0, 0, 0), t)
        return read_bag(path)
    clean = offline_replay.steps(written(tmp_path / 'clean', {}))
    twice = offline_replay.steps(written(tmp_path / 'twice', {40: (0, 0), 70: (0, 1, 2)}))
    for name, column, wanted in zip(clean._fields, twice, clean, strict=True):
        np.testing.assert_array_equal(column, wanted, err_msg=name)
