"""What contradicts an estimate, at and beside each limit, and in a flight with a wrong sensor."""

import dataclasses
from pathlib import Path
import re

from mambo_analysis.compare import estimate_checks as judge
from mambo_analysis.compare import estimate
from mambo_bags.reader import BagError, read_bag
from mambo_estimation import health
from mambo_ros import topics
import numpy as np
import pytest

PERIOD = 0.01  # s
T = np.arange(2000) * PERIOD
BAG = Path(__file__).parents[4] / 'bags/circle_short'


@pytest.mark.parametrize('state, word', [
    (health.STUCK, 'stuck'), (health.IMPLAUSIBLE, 'refused'), (health.NOT_FINITE, 'not finite'),
    (health.MISSING, ''), (health.OUT_OF_REACH, ''), (health.GOOD, '')])
@pytest.mark.parametrize('seconds', [judge.UNUSED_TIME - 0.1, judge.UNUSED_TIME + 0.1])
def test_a_sensor_whose_samples_are_unused_for_long_is_named(state, word, seconds):
    states = np.zeros((len(T), 5), int)
    states[200:201 + round(seconds / PERIOD), health.SONAR] = state
    expected = [f'sonar {word} from 2.00 to {2.0 + seconds:.2f} s']
    assert judge.unused(T, states) == (
        expected if word and seconds > judge.UNUSED_TIME else [])


@pytest.mark.parametrize('share, seconds, named', [
    (0.9, 6.0, True), (0.7, 20.0, False), (1.0, 3.0, False), (0.0, 20.0, False)])
def test_a_sensor_refused_by_a_majority_for_long_is_named(share, seconds, named):
    ratio = np.full(len(T), np.nan)
    ratio[::4] = 0.1
    inside = np.flatnonzero((T >= 2.0) & (T < 2.0 + seconds) & np.isfinite(ratio))
    ratio[inside[np.arange(len(inside)) % 10 < 10 * share]] = 7.0
    found = judge.refused('optical flow', T, ratio)
    assert bool(found) == named
    assert not named or 'of the optical flow samples refused from 2.' in found[0]


def test_few_samples_have_no_share():
    ratio = np.full(len(T), np.nan)
    ratio[::500 // (judge.LEAST_SAMPLES - 2)] = 7.0
    assert judge.refused('sonar', T, ratio) == []
    assert judge.refused('sonar', T[:0], ratio[:0]) == []


@pytest.mark.parametrize('size, seconds, named', [
    (0.99, 10.0, False), (1.01, 3.1, True), (1.01, 2.9, False), (np.nan, 10.0, False)])
def test_a_bias_that_no_sensor_has_is_named(size, seconds, named):
    accel, gyro = np.zeros((len(T), 3)), np.zeros((len(T), 3))
    late = slice(300, 301 + round(seconds / PERIOD))
    accel[late, 2] = -size * judge.LARGEST_ACCEL_BIAS
    gyro[late, 0] = size * judge.LARGEST_GYRO_BIAS
    found = judge.biases(T, accel, gyro)
    assert len(found) == 2 * named
    assert not named or (
        found[0].startswith('accelerometer bias of -2.02 m/s^2 along z from 3.00 to 6.10 s')
        and found[1].startswith('gyro bias of 0.707 rad/s along x from 3.00 to 6.10 s'))


@pytest.mark.parametrize('axes, named', [
    ((0,), ['gyro x']), ((1, 5), ['gyro y', 'accelerometer z']), ((0, 1, 2), []),
    ((0, 1, 2, 3, 4, 5), []), ((), [])])
def test_an_axis_that_repeats_a_number_among_live_ones_is_dead(axes, named):
    samples = np.random.default_rng(1).normal(size=(len(T), 6))
    samples[700:, axes] = 0.25
    found = judge.dead_axes(T, samples[:, :3], samples[:, 3:], np.ones(6, bool))
    assert [line.split(' repeats')[0] for line in found] == named
    assert all('repeats 0.25 from 7.00 s on' in line for line in found)
    still = samples.copy()
    still[:300] = 0.0  # at rest without noise
    assert judge.dead_axes(T, still[:, :3], still[:, 3:], np.ones(6, bool)) == []
    none = judge.dead_axes(T, samples[:, :3], samples[:, 3:], np.zeros(6, bool))
    assert none == []


def column(bag, topic, field, change):
    """Change the samples of a topic from 3 s on."""
    messages = bag[topic.name]
    values = messages[field].copy()
    late = messages.stamp > messages.stamp[0] + 3_000_000_000
    values[late] = change(values[late])
    messages._cache[field] = values


@pytest.mark.long
@pytest.mark.parametrize('topic, field, change, said', [
    (topics.SONAR, 'range', lambda x: np.full_like(x, 2.5), 'sonar stuck from'),
    (topics.IMU, 'angular_velocity', lambda x: x * [0.0, 1.0, 1.0], 'gyro x repeats 0 from 3.0'),
    (topics.IMU, 'linear_acceleration', lambda x: x + [0.0, 0.0, 5.0],
     'm from the motion capture at'),
    (topics.SONAR, 'range', lambda x: x, '')])
def test_a_flight_with_a_wrong_sensor_is_contradicted(topic, field, change, said):
    bag = read_bag(BAG, estimate.READ)
    column(bag, topic, field, change)
    first = estimate.answer(bag, estimate.parameters(bag)).verdict.splitlines()[0]
    assert said in first
    assert (first == 'verdict: the estimate did not diverge') == (not said)


def swap(bag):
    """Swap the axes x and y of the inertial sensors."""
    for field in ('angular_velocity', 'linear_acceleration'):
        bag[topics.IMU.name]._cache[field] = bag[topics.IMU.name][field][:, [1, 0, 2]]


def test_a_gyro_that_turns_otherwise_than_the_motion_capture_is_named():
    bag = read_bag(BAG, estimate.READ)
    assert judge.turning(bag) == []
    swap(bag)
    line, = judge.turning(bag)
    assert re.match(r'(roll|pitch) rate: gyro and tracked attitude turn differently', line)
    assert line in estimate.answer(bag, estimate.parameters(bag)).verdict


def test_what_a_gyro_shows_on_the_floor_or_beside_points_is_no_contradiction():
    bag = read_bag(BAG, estimate.READ)
    imu, poses = bag[topics.IMU.name], bag[topics.OPTITRACK.name]
    gyro = imu['angular_velocity'].copy()
    on_floor = imu.t < poses.t[np.flatnonzero(poses['pose.position'][:, 2] > 0.01)[0]] - 0.5
    assert on_floor.sum() > 100
    gyro[on_floor] = 10.0 * np.sin(imu.t[on_floor])[:, None]  # rad/s
    gyro[::100] = 1e300  # damaged samples
    imu._cache['angular_velocity'] = gyro
    assert judge.turning(bag) == []
    swap(bag)
    assert len(judge.turning(bag)) == 1
    poses._cache['pose.orientation'] = np.tile([0.0, 0.0, 0.0, 1.0], (len(poses), 1))
    assert judge.turning(bag) == []


@pytest.mark.parametrize('topic', judge.SENSORS)
def test_a_sensor_with_another_clock_is_named_although_it_is_only_unused(topic):
    bag = read_bag(BAG, estimate.READ)
    bag[topic.name]._cache['header.stamp.sec'] = bag[topic.name]['header.stamp.sec'] + 1
    head = estimate.answer(bag, estimate.parameters(bag)).verdict.splitlines()[0]
    assert f'{topic.name}: stamped 1 s ahead of the inertial samples' in head


@pytest.mark.long
def test_a_motion_capture_with_z_down_is_named_of_any_estimator():
    bag = read_bag(BAG, estimate.READ)
    poses = bag[topics.OPTITRACK.name]
    poses._cache['pose.position'] = poses['pose.position'] * [1.0, 1.0, -1.0]
    node = estimate.parameters(bag)
    head = estimate.answer(bag, dataclasses.replace(
        node, estimator='toolbox')).verdict.splitlines()[0]
    assert 'the range follows -z of the motion capture' in head


def test_two_flights_in_one_recording_are_not_estimated(monkeypatch):
    def refuse(bag):
        raise BagError('two flights')
    monkeypatch.setattr(estimate.stamps, 'refuse_mixed', refuse)
    bag = read_bag(BAG, estimate.READ)
    with pytest.raises(BagError, match='two flights'):
        estimate.answer(bag, estimate.parameters(bag))


def test_an_estimator_without_a_covariance_is_not_held_to_it():
    bag = read_bag(BAG, estimate.READ)
    found = estimate.answer(bag, estimate.parameters(bag)).found
    found.state[:, 0] += 2.0  # m
    assert 'where the estimate states' in judge.from_capture(bag, estimate.answered(bag, found))[0]
    found.pose_covariance[:] = 0.0
    assert judge.from_capture(bag, estimate.answered(bag, found)) == []


@pytest.mark.long
def test_the_intervals_of_a_contradicted_flight_are_qualified(monkeypatch, capsys):
    bag = read_bag(BAG, estimate.READ)
    node = estimate.parameters(bag)
    estimate._smoothed(bag, node, estimate.answer(bag, node).found)
    assert 'note: ' not in capsys.readouterr().out
    column(bag, topics.SONAR, 'range', lambda x: np.full_like(x, 2.5))
    estimate._smoothed(bag, node, estimate.answer(bag, node).found)
    assert ('note: the intervals hold only if every sensor is right but for bias and noise. '
            'Against it: sonar stuck from') in capsys.readouterr().out


def test_of_an_estimator_that_never_aligned_only_the_sensors_are_judged():
    states = np.full((len(T), 5), health.NOT_FINITE)
    inner = type('State', (dict,), {'stamp': np.round(T * 1e9).astype(int)})(
        health=states, status=np.full(len(T), judge.ALIGNING))
    found = judge.contradictions({}, {'estimator/state': inner})
    assert len(found) == 5 and 'gyro not finite' in found[0]


def test_the_longest_run_of_an_unused_sensor_is_named():
    t = np.arange(0.0, 20.0, 0.005)
    states = np.full((len(t), len(health.NAMES)), health.MISSING)
    states[(t > 2.0) & (t < 4.0), health.SONAR] = health.STUCK
    assert judge.unused(t, states) == []
    states[(t > 8.0) & (t < 14.0), health.SONAR] = health.STUCK
    line, = judge.unused(t, states)
    assert line.startswith(f'{health.NAMES[health.SONAR]} stuck from 8.0') and '14.00 s' in line


@pytest.mark.parametrize('fault', [health.NOT_FINITE, health.IMPLAUSIBLE, health.STUCK])
def test_each_fault_has_its_word(fault):
    t = np.arange(0.0, 5.0, 0.005)
    states = np.full((len(t), len(health.NAMES)), fault)
    assert [line.split(' from ')[0] for line in judge.unused(t, states)] == [
        f'{name} {judge.FAULTS[fault]}' for name in health.NAMES]


@pytest.mark.parametrize('topic, field, sign, said', [
    ('optical_flow', 'rate_x', -1.0, ['optical_flow: rate_x shows the motion along -x (']),
    ('optical_flow', 'rate_y', -1.0, ['optical_flow: rate_y shows the motion along -y (']),
    ('optical_flow', 'rate_x', 1.0, []),
    ('imu/data_raw', 'linear_acceleration', -1.0, ['the vehicle is upside down in '])])
def test_a_sensor_of_the_other_sign_is_named(topic, field, sign, said):
    """Nothing diverges within a short flight, and most samples pass their gate."""
    bag = read_bag(BAG, estimate.READ)
    sensor = bag[topic]
    sensor._cache[field] = sign * sensor[field]
    verdict = estimate.answer(bag, estimate.parameters(bag)).verdict.splitlines()[0]
    assert ('contradicted' in verdict) == bool(said)
    assert all(line in verdict for line in said)
