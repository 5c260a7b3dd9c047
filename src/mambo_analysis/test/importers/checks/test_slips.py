"""Steps of a tracked position that stay are told with their time; motion and single errors not."""

from mambo_analysis.importers.checks import slips
from mambo_analysis.importers.common import stamps_ns
from mambo_signals.motion import Motion
import numpy as np
import pytest

T = 0.01 * np.arange(600)
PATH = np.column_stack([np.sin(2.0 * T), np.cos(2.0 * T), 0.1 * T])
NOISE = 2e-4 * np.random.default_rng(3).standard_normal(PATH.shape)


@pytest.mark.parametrize('size', [0.03, 0.3])
def test_a_slip_is_told_with_time_and_size(size):
    position = PATH + NOISE
    position[300:, 0] += size
    (at, length), = slips.steps(T, position)
    assert at == pytest.approx(3.0) and length == pytest.approx(size, abs=2e-3)
    line, = slips.describe('optitrack/pose', T, position)
    assert line.startswith(f'optitrack/pose: the position moves by {length:.3f} m from one frame ')


@pytest.mark.parametrize('case', ['motion', 'once', 'small', 'lost', 'rough', 'few', 'edge'])
def test_what_does_not_stay_or_may_be_motion_is_not_told(case):
    t, position = T.copy(), PATH + NOISE
    if case == 'once':
        position[300] += 0.1
    elif case == 'small':
        position[300:] += 0.01
    elif case == 'lost':  # frames are missing: the vehicle moved on
        t, position = np.delete(t, slice(300, 310)), np.delete(position, slice(300, 310), axis=0)
    elif case == 'rough':
        position += 0.05 * np.random.default_rng(4).standard_normal(position.shape)
    elif case == 'few':
        t, position = t[:8], position[:8] + np.where(np.arange(8) > 4, 0.5, 0.0)[:, None]
    elif case == 'edge':
        position[597:] += 0.1
    assert not slips.describe('optitrack/pose', t, position)


@pytest.mark.parametrize('rate', [10.0, 12.0, 20.0, 50.0])
@pytest.mark.parametrize('begin', 0.01 * np.arange(10))
def test_a_fall_to_the_floor_is_no_slip_at_any_rate(rate, begin):
    """The motors stop 7 cm above the floor, from which a free fall takes 0.12 s."""
    t = np.arange(0.0, 6.0, 1.0 / rate)
    fallen = 0.5 * 9.81 * np.clip(t - 3.0 - begin, 0.0, None)**2
    height = np.maximum(0.07 - fallen, 0.0)
    assert not slips.steps(t, np.column_stack([0.0 * t, 0.0 * t, height]))


def test_a_long_slip_is_told_at_10_hz_too():
    t = np.arange(0.0, 6.0, 0.1)
    position = np.column_stack([0.1 * np.sin(t), 0.0 * t, 1.0 + np.where(t < 2.95, 0.0, 0.3)])
    (at, length), = slips.steps(t, position)
    assert at == pytest.approx(3.0) and length == pytest.approx(0.3, abs=2e-3)


def kept(count, share, seed):
    """Return which of so many frames arrive, if a share of them is lost at random."""
    return np.random.default_rng(seed).random(count) >= share


@pytest.mark.parametrize('share', [0.02, 0.1, 0.2])
@pytest.mark.parametrize('seed', range(5))
@pytest.mark.parametrize('lost', [0, 1, 10])
def test_a_leap_beside_lost_frames_is_told_with_time_and_size(share, seed, lost):
    """So many frames of the leap itself are lost, too."""
    there = kept(len(T), share, seed)
    there[300:300 + lost], there[[299, 300 + lost]] = False, True
    position = (PATH + NOISE + np.where(T < 3.0 - 1e-9, 0.0, 3.0)[:, None] * [0.6, 0.8, 0.0])
    (at, length), = slips.steps(T[there], position[there])
    assert at == pytest.approx(3.0 + 0.01 * lost) and length == pytest.approx(3.0, abs=0.03)


@pytest.mark.parametrize('seed', range(5))
def test_a_leap_that_fills_two_steps_is_told_beside_lost_frames(seed):
    """One axis of the position is of another packet than the others, or between two of them."""
    position = PATH + NOISE + np.where(T < 3.0 - 1e-9, 0.0, 4.0)[:, None] * [0.6, 0.8, 0.0]
    position[300] -= [0.0, 3.2, 0.0]
    there = kept(len(T), 0.1, seed)
    there[298:303] = True
    assert max(length for _, length in slips.steps(T[there], position[there])) > 2.3


@pytest.mark.parametrize('share', [0.1, 0.3])
@pytest.mark.parametrize('rate', [10.0, 20.0, 100.0])
@pytest.mark.parametrize('case', ['turns', 'falls', 'bounces', 'sways'])
def test_motion_beside_lost_frames_is_not_told(share, rate, case):
    """Up to 3 g, a fall to the floor, a bump at a wall; whichever frames are lost."""
    t = np.arange(0.0, 6.0, 1.0 / rate)
    x = {'turns': 0.9 * np.sin(5.0 * t), 'falls': -np.clip(t - 3.02, 0.0, 0.45)**2 * 4.9,
         'bounces': 4.0 * np.abs(t - 3.02), 'sways': 0.3 * np.sin(9.9 * t)}[case]
    position = np.column_stack([x, 0.3 * t, 0.0 * t])
    for seed in range(20):
        there = kept(len(t), share, seed)
        assert not slips.steps(t[there], position[there])


CIRCLE = np.arange(0.0, 8.0, 1.0 / 120.0)
FAST = 1.2 * np.column_stack([np.sin(3.3 * CIRCLE), np.cos(3.3 * CIRCLE), 0.2 * CIRCLE])  # 4 m/s


def held_rows(rows, position):
    """Return positions of which each is held for the next number of rows."""
    first = np.r_[0, np.cumsum(np.resize(rows, len(position)))]
    return position[np.repeat(first[:-1], np.diff(first))[:len(position)]]


RUNS = {'two': [2], 'three': [3], 'irregular': [1, 2, 3, 2, 1, 1, 3, 2, 3, 3, 1, 2, 2],
        'seldom': [1, 1, 1, 2, 1, 1, 1, 2, 2, 1]}


@pytest.mark.parametrize('rows', RUNS)
def test_rows_that_hold_a_position_are_no_slip_and_hide_none(rows):
    noise = 2e-4 * np.random.default_rng(3).standard_normal(FAST.shape)
    assert not slips.steps(CIRCLE, held_rows(RUNS[rows], FAST + noise))
    slipped = 0.25 * FAST + noise + np.where(CIRCLE < 4.0, 0.0, 0.1)[:, None] * [0.0, 0.0, 1.0]
    (at, length), = slips.steps(CIRCLE, held_rows(RUNS[rows], slipped))
    assert at == pytest.approx(4.0, abs=0.02) and length == pytest.approx(0.1, abs=0.03)


@pytest.mark.parametrize('rate', [100.0, 75.0, 60.0, 50.0, 42.0])
@pytest.mark.parametrize('changes', [False, True])
def test_a_capture_that_a_faster_table_holds_is_no_slip(rate, changes):
    """With ``only_changes`` the rows that are left are late by up to one row of the table."""
    frames = np.floor(CIRCLE * rate + 0.3) / rate
    x = 1.2 * np.column_stack([np.sin(3.3 * frames), np.cos(3.3 * frames), 0.2 * frames])
    new = np.r_[True, np.diff(frames) > 0.0] if changes else np.ones(len(frames), bool)
    assert not slips.steps(CIRCLE[new], x[new])


def test_a_leap_of_an_estimate_is_told_from_half_a_metre_on():
    for size, told in ((0.45, 0), (0.55, 1)):
        position = PATH + np.where(T < 3.0 - 1e-9, 0.0, size)[:, None] * [1.0, 0.0, 0.0]
        there = kept(len(T), 0.1, 1)
        lines = slips.leap(Motion('onboard/odom', stamps_ns(T[there]), position[there],
                                  np.full((there.sum(), 4), np.nan)))
        assert len(lines) == told
        assert all('leaps by 0.55 m at t = 3.0' in line for line in lines)
