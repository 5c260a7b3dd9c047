"""Of two groups of turned poses a sensor tells the right one; else both are told."""

from mambo_analysis.importers.checks import assignments
from mambo_analysis.importers.checks.assignments import of_attitude, sort_poses, Turning
from mambo_signals.derivative import body_rates
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

T = np.arange(0.0, 12.0, 0.01)
ATTITUDE = Rotation.from_euler('ZYX', np.column_stack([
    0.5 * np.sin(0.7 * T), 0.2 * np.sin(2.1 * T), 0.2 * np.cos(1.7 * T)]))
PATH = np.column_stack([np.sin(T), np.cos(T), 1.0 + 0.0 * T])
FLIP = Rotation.from_euler('z', 180.0, degrees=True)


def flipped(parts):
    """Return the attitudes, (n, 4), of which some parts, (begin, end) in s, are turned."""
    wrong = np.any([(T >= begin) & (T < end) for begin, end in parts], axis=0)
    q = ATTITUDE.as_quat()
    q[wrong] = (ATTITUDE[wrong] * FLIP).as_quat()
    return wrong, q


def gyro(seed=0):
    """Return a gyro with noise and bias, at times of its own."""
    t, rates = body_rates(T, ATTITUDE.as_quat())
    noise = 0.03 * np.random.default_rng(seed).standard_normal(rates.shape)
    return Turning('the gyro', t + 0.004, rates + [0.02, -0.01, 0.03] + noise)


MOST = [(2.0, 5.0), (5.5, 9.0), (9.6, 12.0)]  # 8.9 of 12 s
SOME = [(2.0, 3.0), (5.5, 6.0)]


@pytest.mark.parametrize('parts', [MOST, SOME, [(1.0, 12.0)]])
@pytest.mark.parametrize('sensor', ['gyro', 'attitude'])
def test_the_group_that_turns_as_a_sensor_is_right_however_many_poses_it_has(parts, sensor):
    wrong, q = flipped(parts)
    other = Rotation.from_euler('z', 1.0) * ATTITUDE  # with a north of its own
    beside = [gyro() if sensor == 'gyro' else of_attitude('the estimate', T, other.as_quat())]
    if len(parts) == 1:
        assert len(T) * assignments.SHARE > (~wrong).sum()  # too few to be a group
        wrong = ~wrong
    found = sort_poses(T, PATH, q, beside)
    np.testing.assert_array_equal(found.wrong, wrong)
    assert found.by == ('' if len(parts) == 1 else beside[0].name)


def test_a_sensor_that_shows_neither_decides_nothing_and_the_next_one_does():
    wrong, q = flipped(MOST)
    noise = np.random.default_rng(1).standard_normal((len(T), 3))
    other = Turning('noise', T, noise)
    assert sort_poses(T, PATH, q, [other]).by == sort_poses(T, PATH, q, []).by == ''
    np.testing.assert_array_equal(sort_poses(T, PATH, q, [other]).wrong, ~wrong)
    found = sort_poses(T, PATH, q, [other, gyro()])
    assert found.by == 'the gyro'
    np.testing.assert_array_equal(found.wrong, wrong)


def test_two_groups_are_told_with_turn_number_and_times():
    _, q = flipped(MOST)
    line, = assignments.describe('pose', T, sort_poses(T, PATH, q, []))
    assert line == (
        'pose: 310 poses from t = 0.00 to 9.59 s in 3 parts, left out, show the body turned by '
        '180 deg about its axis (0.00, 0.00, 1.00) against 890 poses from t = 2.00 to 11.99 s in '
        '3 parts, kept: the tracker takes symmetric markers for each other. The larger group is '
        'kept, and the other may be the right one: compare them with how the vehicle stood, and '
        'place the markers without symmetry').replace('(0.00, 0.00, 1.00)', line[
            line.index('('):line.index(')') + 1])
    assert '0.00, 0.00, 1.00)' in line or '0.00, 0.00, -1.00)' in line
    line, = assignments.describe('pose', T, sort_poses(T, PATH, q, [gyro()]))
    assert 'pose: 890 poses from t = 2.00 to 11.99 s in 3 parts, left out' in line
    assert line.endswith(': the tracker takes symmetric markers for each other. Those kept turn '
                         'as the gyro does')


@pytest.mark.parametrize('parts, words', [
    ([(9.0, 12.0)], 'the recording jumps there; was it cut, or is it of two takes?'),
    ([(2.0, 3.0), (9.0, 12.0)], ''), ([(0.0, 1.0), (9.0, 12.0)], ''), ([(3.0, 6.0)], '')])
def test_of_a_cut_only_poses_speak_that_do_not_return(parts, words):
    _, q = flipped(parts)
    lines = assignments.describe('pose', T, sort_poses(T, PATH, q, []))
    assert 'symmetric markers' in lines[0]
    assert [line.partition('among them: ')[2] for line in lines[1:]] == [words] * bool(words)


def test_poses_elsewhere_for_long_are_told_with_their_times():
    for begin, end, words in (
            (4.0, 7.0, 'the tracker had lost the body, or mixed up its markers, for so long'),
            (9.0, 12.0, 'the recording jumps there; was it cut, or is it of two takes?')):
        away = PATH + 3.0 * ((T >= begin) & (T < end))[:, None]
        found = sort_poses(T, away, ATTITUDE.as_quat(), [])
        assert assignments.describe('pose', T, found) == [
            f'pose: all poses from t = {begin:.2f} to {end - 0.01:.2f} s are among them: {words}']
    assert assignments.describe('pose', T, sort_poses(T, PATH, ATTITUDE.as_quat(), [])) == []


@pytest.mark.parametrize('gap', [0.2, 1.0])
@pytest.mark.parametrize('end', [9.0, 12.0])
def test_a_sensor_tells_a_flip_behind_a_gap(gap, end):
    wrong, q = flipped([(5.0, end)])
    there = (T < 5.0) | (T >= 5.0 + gap)
    poses = T[there], PATH[there], q[there]
    found = sort_poses(*poses, [gyro()])
    np.testing.assert_array_equal(found.wrong, wrong[there])
    dead = Turning('the gyro', T, 0.001 * np.ones((len(T), 3)))
    without = sort_poses(*poses, [dead])
    assert without.wrong.any() == (end == 9.0)
    if end == 12.0:
        assert assignments.describe('pose', poses[0], without) == [
            'pose: the body turns or moves farther in a gap of the poses than its speed before '
            f'and after tells, from t = 4.99 to {5.0 + gap:.2f} s. A maneuver, or the tracker '
            'found it with other markers: all are kept; compare the yaw on both sides']


def test_a_maneuver_in_a_gap_that_a_sensor_shows_is_none():
    yaw = 0.5 * np.pi * (1.0 + np.tanh(8.0 * (T - 5.3)))  # half a turn in half a second
    turned = Rotation.from_euler('z', yaw[:, None]) * ATTITUDE
    there = (T < 5.05) | (T >= 5.55)
    poses = T[there], PATH[there], turned[there].as_quat()
    t, rates = body_rates(T, turned.as_quat())
    assert len(sort_poses(*poses, []).doubtful) == 1
    found = sort_poses(*poses, [Turning('the gyro', t, rates)])
    assert not found.wrong.any() and not len(found.doubtful)
    for k in (0, 1):  # one that ends before the gap, and one that begins after it, know nothing
        half = (t < 5.2) if k else (t > 5.4)
        assert len(sort_poses(*poses, [Turning('the gyro', t[half], rates[half])]).doubtful) == 1


@pytest.mark.parametrize('wrong', ['sign', 'unit', 'axes', 'late', 'noise'])
def test_a_sensor_that_turns_otherwise_tells_no_flip(wrong):
    """The vehicle yaws by 60 deg/s, also in the gap; without a sensor nothing is left out."""
    turned = Rotation.from_euler('z', 1.0 * T[:, None]) * ATTITUDE
    there = (T < 5.0) | (T >= 5.9)
    poses = T[there], PATH[there], turned[there].as_quat()
    t, rates = body_rates(T, turned.as_quat())
    rates = {'sign': rates * [1, 1, -1], 'unit': np.degrees(rates), 'axes': rates[:, [2, 0, 1]],
             'late': rates, 'noise': np.random.default_rng(2).normal(size=rates.shape)}[wrong]
    found = sort_poses(*poses, [Turning('the gyro', t + 2.0 * (wrong == 'late'), rates)])
    assert not found.wrong.any() and not len(found.doubtful)
