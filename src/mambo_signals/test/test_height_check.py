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
