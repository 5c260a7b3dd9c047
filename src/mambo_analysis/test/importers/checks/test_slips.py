"""Steps of a tracked position that stay are told with their time; motion and single errors not."""

from mambo_analysis.importers.checks import slips
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
