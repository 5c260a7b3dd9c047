"""Whether a tracked height and a range show the same: axes, signs and units that are wrong."""

from pathlib import Path
import re

from mambo_bags.reader import read_bag
from mambo_signals import height_check
import numpy as np
import pytest

BAG = Path(__file__).parents[3] / 'bags/circle_short'
T = np.arange(0.0, 20.0, 0.05)
HEIGHT = 0.5 + 0.4 * np.sin(0.5 * T)
PLACE = np.column_stack([np.cos(0.7 * T), np.sin(0.7 * T), HEIGHT])


@pytest.mark.parametrize('order, signs, text', [
    ((0, 2, 1), (1, 1, 1), 'follows y '), ((2, 1, 0), (1, 1, 1), 'follows x '),
    ((0, 1, 2), (1, 1, -1), 'follows -z '), ((0, 2, 1), (1, -1, 1), 'follows -y '),
    ((0, 1, 2), (1, 1, 0), 'z of the motion capture is 0 m throughout, while the range')])
def test_the_axis_that_is_up_is_told_by_a_range(order, signs, text):
    assert text in height_check.other_axis(HEIGHT, PLACE[:, order] * signs)


def test_a_range_that_tells_no_other_axis_says_nothing():
    steps = HEIGHT + np.where(T % 3.0 < 1.5, 0.8, 0.0)  # over boxes
    for ranges, position in (
            (HEIGHT, PLACE), (steps, PLACE), (0.0 * T + 0.5, PLACE), (HEIGHT[:20], PLACE[:20]),
            (HEIGHT[:0], PLACE[:0]), (HEIGHT, PLACE * [0.0, 0.0, 1.0]),
            (HEIGHT, PLACE + 0.1 * np.sin(9.0 * T)[:, None])):
        assert height_check.other_axis(ranges, position) is None


@pytest.mark.parametrize('scale', [3.28084, 0.3048, 1000.0, 0.001])
def test_a_height_in_another_unit_is_told_by_the_range(scale):
    noise = np.random.default_rng(1).normal(0.0, 0.01, len(T))
    said = height_check.other_scale(HEIGHT + noise, scale * HEIGHT + 2.0)
    assert float(re.search('changes (.*) times as much as the range', said)[1]) == pytest.approx(
        scale, rel=0.02)


def test_a_height_in_metres_is_none_in_another_unit():
    noise = np.random.default_rng(1).normal(0.0, 0.01, len(T))
    steps = HEIGHT + np.where(T % 3.0 < 1.5, 0.8, 0.0)
    for ranges, height in (
            (HEIGHT + noise, HEIGHT), (1.06 * HEIGHT, HEIGHT), (steps, 3.0 * HEIGHT),
            (0.1 * HEIGHT, 3.0 * HEIGHT), (HEIGHT[:20], 3.0 * HEIGHT[:20]),
            (HEIGHT, 0.0 * HEIGHT), (HEIGHT[:0], HEIGHT[:0])):
        assert height_check.other_scale(ranges, height) is None


@pytest.mark.parametrize('change, said', [
    (lambda p: p, ''), (lambda p: 3.28084 * p, 'changes 3.2'), (lambda p: -p, 'follows -z of'),
    (lambda p: p[:, [0, 2, 1]], 'follows y of')])
def test_a_recording_is_judged_by_its_range(change, said):
    bag = read_bag(BAG, ('sonar/range', 'optitrack/pose'))
    poses = bag['optitrack/pose']
    poses._cache['pose.position'] = change(poses['pose.position'])
    found = height_check.of_bag(bag)
    assert len(found) == bool(said) and said in ''.join(found)


def test_a_recording_without_a_range_or_poses_says_nothing():
    for names in (('sonar/range',), ('optitrack/pose',)):
        assert height_check.of_bag(read_bag(BAG, names)) == []
    bag = read_bag(BAG, ('sonar/range', 'optitrack/pose'))
    bag['optitrack/pose']._cache['pose.position'] = np.full(
        (len(bag['optitrack/pose']), 3), np.nan)
    assert height_check.of_bag(bag) == []


def landed(least, noise, factor=1.0, hover=False):
    """Return times, ranges and heights of a flight of 40 s, on the floor for 4 s at each end."""
    t = np.arange(0.0, 40.0, 0.05)
    height = 0.02 + np.clip(0.5 * np.minimum(t - 4.0, 36.0 - t), 0.0, 1.1)
    if not hover:
        height += np.where(height > 1.1, 0.35 * np.sin(0.8 * (t - 6.2)), 0.0)
    ranges = np.maximum(height, least) + np.random.default_rng(1).normal(0.0, noise, len(t))
    return t, ranges, factor * height


def sonar_bag(t, ranges, height, shortest=0.0):
    """Return a recording of 8 s of these, with limits of the range from ``shortest`` to 10 m."""
    bag = read_bag(BAG, ('sonar/range', 'optitrack/pose'))
    sonar, poses = bag['sonar/range'], bag['optitrack/pose']
    sonar._cache['range'] = np.interp(5.0 * (sonar.t - sonar.t[0]), t, ranges)
    sonar._cache['min_range'] = np.full(len(sonar), shortest)
    sonar._cache['max_range'] = np.full(len(sonar), 10.0)
    path = np.zeros((len(poses), 3))
    path[:, 2] = np.interp(5.0 * (poses.t - sonar.t[0]), t, height)
    poses._cache['pose.position'] = path
    return bag


@pytest.mark.parametrize('hover', [False, True], ids=['bobs', 'hovers'])
@pytest.mark.parametrize('noise', [0.0, 0.001, 0.003])
@pytest.mark.parametrize('least', [0.2, 0.3, 0.434])
def test_readings_that_repeat_near_the_floor_are_no_other_unit(least, noise, hover):
    _, ranges, height = landed(least, noise, hover=hover)
    usual, top = height_check.repeated(ranges, height)
    assert usual == pytest.approx(least, abs=0.001 + noise)
    assert top == pytest.approx(least, abs=0.03)
    for factor in (3.28084, 0.3048, 1000.0, 0.001, 1.5):
        wrong = height_check.repeated(ranges, factor * height)
        assert wrong == pytest.approx((usual, factor * top))


@pytest.mark.parametrize('factor', [1.0, 3.28084, 0.3048])
@pytest.mark.parametrize('noise', [0.0, 0.003, 0.02])
def test_a_range_that_follows_the_height_to_the_floor_repeats_nothing(noise, factor):
    for hover in (False, True):
        _, ranges, height = landed(0.0, noise, factor, hover)
        assert height_check.repeated(ranges + 0.1, height) is None
    steps = np.where(T % 6.0 < 3.0, 1.0, 2.0)  # two heights, at which it stays
    assert height_check.repeated(steps, factor * steps) is None
    assert height_check.repeated(HEIGHT[:20], HEIGHT[:20]) is None
    assert height_check.repeated(HEIGHT, PLACE[:, 0]) is None  # of no axis that is up
    climbs = np.append([0.62, 0.62], np.linspace(0.72, 1.4, 150))  # few readings are low
    assert height_check.repeated(climbs, factor * climbs) is None


@pytest.mark.parametrize('factor, said', [(1.0, ''), (3.28084, 'changes 3.2'),
                                          (0.3048, 'changes 0.30'), (0.01, 'changes 0.0')])
@pytest.mark.parametrize('hover', [False, True])
def test_a_recording_without_the_limits_of_its_range_is_judged_above_the_floor(
        hover, factor, said):
    t, ranges, height = landed(0.434, 0.001, factor, hover)
    found = height_check.of_bag(sonar_bag(t, ranges, height))
    assert len(found) == bool(said) and said in ''.join(found)


def test_what_is_above_the_floor_is_the_same_with_and_without_the_limits():
    t, ranges, height = landed(0.434, 0.0)
    pairs = []
    for shortest in (0.0, 0.434):
        bag = sonar_bag(t, ranges, height, shortest)
        pairs.append(height_check.beside(bag, height_check.motion.read(bag, 'optitrack/pose')))
    for one, other in zip(*pairs, strict=True):
        assert len(one) > 50 and (one == other).all()


FRAMES = np.arange(-1.0, 21.0, 0.01)


def climbing(t, late=0.0, size=1.0):
    """Return the height, m, of a flight that takes off, bobs and lands."""
    rise = np.clip((t - 2.0 - late) / 1.5, 0.0, 1.0) - np.clip((t - 16.0 - late) / 2.0, 0.0, 1.0)
    return size * rise * (1.0 + 0.2 * np.sin(1.5 * (t - late)))


def ranges(late=0.0, size=1.0):
    return climbing(T, late, size) + 0.005 * np.random.default_rng(1).standard_normal(len(T))


NAMES = 'the range', 'optitrack/pose'


@pytest.mark.parametrize('change', ['none', 'floor', 'late', 'wrong echoes', 'gain', 'pause'])
def test_a_range_of_the_flight_follows_over_steps_of_the_floor(change):
    measured = ranges(0.05 if change == 'late' else 0.0, 0.7 if change == 'gain' else 1.0)
    if change == 'floor':  # boxes of 0.3 m
        measured -= 0.3 * ((T % 3.0 < 1.0) & (climbing(T) > 0.4))
    if change == 'wrong echoes':
        measured[::40] += 1.0
    if change == 'pause':
        measured[150:170] = np.nan
    assert height_check.not_followed(T, measured, FRAMES, climbing(FRAMES), NAMES) == ''


@pytest.mark.parametrize('measured', [
    ranges(late=3.0), ranges(size=2.5), np.where(T < 10.0, 0.5, 0.4), -ranges()])
def test_a_range_of_another_flight_does_not_follow(measured):
    said = height_check.not_followed(T, measured, FRAMES, climbing(FRAMES), NAMES)
    assert said.startswith('the range does not follow the height of optitrack/pose (correlation')


@pytest.mark.parametrize('what', ['level', 'few', 'no capture'])
def test_where_nothing_can_be_followed_nothing_is_said(what):
    tracked = climbing(FRAMES, size=0.0 if what == 'level' else 1.0)
    t = T[:40] if what == 'few' else T
    tracked = tracked * np.nan if what == 'no capture' else tracked
    assert height_check.not_followed(
        t, ranges(late=3.0)[:len(t)], FRAMES, tracked, NAMES) == ''


def test_the_changes_of_a_ramp_are_its_rate_times_their_time():
    """Levels do not count, nor in which order samples were logged, nor those logged twice."""
    order = np.random.default_rng(3).permutation(np.repeat(np.arange(len(T)), 2))
    t, own = T[order], 5.0 - 0.2 * T[order]
    r, ours, theirs = height_check.changes(t, own, FRAMES, 0.4 * FRAMES)
    assert r == pytest.approx(-1.0)
    assert ours == pytest.approx(0.2 * height_check.CHANGE)
    assert theirs == pytest.approx(0.4 * height_check.CHANGE)


@pytest.mark.parametrize('samples, left', [(1, False), (3, False), (4, True)])
def test_a_change_is_an_edge_of_the_floor_if_it_is_over_at_once(samples, left):
    """Of 0.06 m a sample, 1.2 m/s: what lasts longer than an edge is a climb."""
    begin = 200 + np.arange(1, samples + 1)
    own = 1.0 + 0.06 * np.searchsorted(begin, np.arange(len(T)), side='right')
    _, ours, theirs = height_check.changes(T, own, FRAMES, 1.0 + 0.0 * FRAMES)
    assert theirs == 0.0 and (ours > 0.0) is left


@pytest.mark.parametrize('apart, seen', [(0.1, True), (0.25, False)])
def test_between_samples_that_are_far_apart_nothing_is_known(apart, seen):
    t = np.arange(0.0, 20.0, apart)
    _, ours, theirs = height_check.changes(t, climbing(t, 3.0), FRAMES, climbing(FRAMES))
    assert (ours > 0.0) is seen and (theirs > 0.0) is seen


@pytest.mark.parametrize('factor, said', [
    (0.6, True), (0.7, False), (1.4, False), (1.6, True)])
def test_a_range_may_change_by_another_factor_up_to_a_limit(factor, said):
    found = height_check.not_followed(T, factor * climbing(T), FRAMES, climbing(FRAMES), NAMES)
    assert bool(found) is said


def test_a_capture_that_is_lost_for_a_while_is_compared_where_it_is():
    seen = climbing(FRAMES)
    seen[(FRAMES > 6.0) & (FRAMES < 9.0)] = np.nan
    assert height_check.not_followed(T, ranges(), FRAMES, seen, NAMES) == ''
    assert height_check.not_followed(T, ranges(late=3.0), FRAMES, seen, NAMES)


@pytest.mark.parametrize('top', [0.6, 0.8, 1.2])
def test_a_range_that_stands_near_the_floor_or_out_of_reach_does_not_contradict(top):
    height, noise = climbing(T, size=top), 0.003 * np.random.default_rng(3).standard_normal(len(T))
    for measured in (np.maximum(height, 0.434) + noise, np.minimum(height + noise, 0.6 * top),
                     np.where(height > 0.6 * top, 32.7, height + noise)):
        clear = height_check.unclamped(T, measured, FRAMES, climbing(FRAMES, size=top))
        assert height_check.not_followed(
            T, clear, FRAMES, climbing(FRAMES, size=top), NAMES) == ''
        other = height_check.unclamped(T, ranges(late=3.0), FRAMES, climbing(FRAMES))
        assert height_check.not_followed(T, other, FRAMES, climbing(FRAMES), NAMES)


def test_a_range_that_follows_is_not_cut():
    assert np.isfinite(height_check.unclamped(T, ranges(), FRAMES, climbing(FRAMES))).all()
    level = np.full(len(T), 1.0)
    kept = height_check.unclamped(T, level, FRAMES, np.full(len(FRAMES), 1.0))
    assert np.isfinite(kept).all()
