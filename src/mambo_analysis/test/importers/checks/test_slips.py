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
