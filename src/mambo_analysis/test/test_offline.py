"""Recorded sensors through the filter: the same numbers as the filter called by hand."""

from dataclasses import replace
import math

from mambo_analysis import offline
from mambo_analysis.bag import BagError, read_bag
from mambo_estimation import kalman
from mambo_estimation.measurements.optical_flow import FlowParams
from mambo_ros import messages, topics
from mambo_sim.bag_writer import BagWriter
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


def write(path, samples, order=(topics.SENSOR_TICK, *SENSORS), tick_every=1):
    """Write a bag, a watermark after each ``tick_every`` steps; return it as read."""
    counts = dict.fromkeys(SENSORS, 0)
    with BagWriter(path) as bag:
        for topic in order:
            bag.add_topic(f'/mambo/{topic.name}', topic.type_name)
        for k, (t, values) in enumerate(samples):
            for topic, value in values.items():
                counts[topic] += 1
                bag.write(f'/mambo/{topic.name}', ENCODE[topic](t, value), t)
            if topics.SENSOR_TICK in order and (k + 1) % tick_every == 0:
                bag.write(f'/mambo/{topics.SENSOR_TICK.name}',
                          messages.sensor_tick(t, *counts.values()), t)
    return read_bag(path)


def by_hand(samples, params=PARAMS):
    """Return [(ns, estimate)] of the filter's own step, called for each IMU sample."""
    memory, values, out, before = kalman.initial(params), params.values(), [], None
    for t, sample in samples:
        dt = 0.0 if before is None else (t - before) * 1e-9
        flow, quality = sample.get(topics.OPTICAL_FLOW, ((NAN, NAN), 0))
        memory, estimate = kalman.step(
            memory, dt, *sample[topics.IMU], sample.get(topics.SONAR, NAN), flow, quality,
            sample.get(topics.BAROMETER, NAN), values)
        out.append((t, estimate))
        before = t
    return out


def assert_same(got, want):
    """Compare bit for bit; repr tells every bit of a float, and NaN from NaN does not differ."""
    got = list(got)
    assert len(got) == len(want)
    for (t, estimate, *_), (t_want, wanted) in zip(got, want, strict=True):
        assert (t, repr(estimate)) == (t_want, repr(wanted))


@pytest.fixture(scope='module')
def samples():
    return sequence()


def test_the_made_up_flight_exercises_the_filter(samples):
    last = by_hand(samples)[-1][1]
    assert last.status == 2
    assert last.height > 0.6 and math.hypot(*last.state.rho[:2]) > 0.05


def test_offline_is_the_step_of_the_filter_to_the_bit(tmp_path, samples):
    assert_same(offline.estimate(write(tmp_path / 'bag', samples), PARAMS), by_hand(samples))


def test_the_order_of_topics_in_the_bag_means_nothing(tmp_path, samples):
    for number, order in enumerate((
            (*SENSORS, topics.SENSOR_TICK), (topics.SENSOR_TICK, *reversed(SENSORS)))):
        bag = write(tmp_path / str(number), samples, order)
        assert_same(offline.estimate(bag, PARAMS), by_hand(samples))


def test_parameters_are_those_asked_for(tmp_path, samples):
    bag = write(tmp_path / 'bag', samples)
    other = replace(PARAMS, optical_flow=FlowParams(constant=2.0))
    assert_same(offline.estimate(bag, other), by_hand(samples, other))
    assert repr(by_hand(samples, other)[-1]) != repr(by_hand(samples)[-1])


def test_an_echo_out_of_the_limits_is_no_echo(tmp_path, samples):
    def with_echo(distance):
        return [(t, {**s, topics.SONAR: distance} if t == 320 * STEP else s) for t, s in samples]
    without = [(t, {k: v for k, v in s.items() if k is not topics.SONAR or t != 320 * STEP})
               for t, s in samples]
    for number, distance in enumerate((0.2, 4.5, math.inf, NAN)):
        bag = write(tmp_path / str(number), with_echo(distance))
        assert_same(offline.estimate(bag, PARAMS), by_hand(without))
    assert repr(by_hand(without)[-1]) != repr(by_hand(samples)[-1])


def test_a_flight_without_aiding_sensors_is_estimated_too(tmp_path, samples):
    alone = [(t, {topics.IMU: s[topics.IMU]}) for t, s in samples[:200]]
    bag = write(tmp_path / 'bag', alone, (topics.IMU, topics.SENSOR_TICK))
    assert_same(offline.estimate(bag, PARAMS), by_hand(alone))


def test_of_several_imu_samples_in_a_tick_the_last_answers(tmp_path, samples):
    bag = write(tmp_path / 'bag', samples, tick_every=2)
    assert len(list(offline.steps(bag))) == len(samples)
    assert_same(offline.estimate(bag, PARAMS), by_hand(samples)[1::2])


def test_what_came_after_the_last_watermark_is_left_out(tmp_path, samples):
    bag = write(tmp_path / 'bag', samples[:11], tick_every=5)
    assert [t for t, *_ in offline.estimate(bag, PARAMS)] == [4 * STEP, 9 * STEP]


def test_a_sample_that_the_bag_has_lost_is_bridged_as_by_the_live_estimator(tmp_path, samples):
    bag = write(tmp_path / 'bag', samples[:200])
    stream = bag[topics.IMU.name]
    del stream.raw[150]
    stream.log_time = np.delete(stream.log_time, 150)
    nothing = {**samples[150][1], topics.IMU: ((NAN,) * 3, (NAN,) * 3)}
    bridged = by_hand([*samples[:150], (150 * STEP, nothing), *samples[151:200]])
    # each step waits for as many samples as were counted: the last one for ever
    assert_same(offline.estimate(bag, PARAMS), bridged[:-1])


def test_without_watermarks_it_is_as_if_replayed(tmp_path, samples):
    bag = write(tmp_path / 'bag', samples, SENSORS)
    assert_same(offline.estimate(bag, PARAMS), by_hand(samples))


def test_without_inertial_samples_there_is_one_line(tmp_path, samples):
    ranges = [(t, {topics.SONAR: 1.0}) for t, _ in samples[:5]]
    bag = write(tmp_path / 'bag', ranges, (topics.SONAR,))
    with pytest.raises(BagError, match='imu/data_raw') as why:
        list(offline.estimate(bag, PARAMS))
    assert '\n' not in str(why.value)
