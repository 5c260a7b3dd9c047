"""A gyro and a tracked attitude of one motion agree; another unit, axis or clock is told."""

from mambo_signals import gyro_check
from mambo_signals.time_offset import AlignError
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

STEP = 0.01


def turning(seed=0, seconds=20.0, size=0.1):
    """Return times, gyro and attitude of a random motion, with noise of both."""
    rng = np.random.default_rng(seed)
    n = round(seconds / STEP)
    wobble = gaussian_filter1d(rng.standard_normal((n, 3)), 0.3 / STEP, axis=0)
    turn = Rotation.from_euler('ZYX', size * wobble / wobble.std(axis=0))
    steps = (turn[:-1].inv() * turn[1:]).as_rotvec() / STEP
    gyro = steps + [0.02, -0.01, 0.03] + 0.02 * rng.standard_normal(steps.shape)
    seen = turn * Rotation.from_rotvec(1e-3 * rng.standard_normal((n, 3)))
    t = np.arange(n) * STEP
    return t[:-1] + 0.5 * STEP, gyro, t, seen.as_quat()


def test_one_motion_agrees():
    found = gyro_check.compare(*turning())
    gyro_check.refuse(found)
    assert found.late == 0.0 and (found.correlation > 0.99).all()
    assert found.gyro == pytest.approx(found.tracked, rel=0.05)


@pytest.mark.parametrize('late', [-0.25, 0.1])
def test_an_attitude_that_is_late_is_measured(late):
    t, gyro, times, q = turning()
    found = gyro_check.compare(t, gyro, times + late, q)
    gyro_check.refuse(found)
    assert found.late == pytest.approx(late, abs=0.6 * STEP)


@pytest.mark.parametrize('change, message', [
    (np.pi / 180.0, 'not in SI units'), (180.0 / np.pi, 'not in SI units'),
    (2.0, 'more than 1.5 times apart'), (0.5, 'more than 1.5 times apart'),
    ([1.0, 0.0, 1.0], 'pitch rate: the gyro turns by 0 rad/s'),
    ([1.0, 1.0, -1.0], 'yaw rate: gyro and tracked attitude turn differently')])
def test_another_unit_and_another_axis_are_told(change, message):
    t, gyro, times, q = turning()
    with pytest.raises(AlignError, match=message):
        gyro_check.refuse(gyro_check.compare(t, gyro * change, times, q))


def test_what_hardly_turns_shows_nothing_wrong():
    """A hover: what a tracked attitude shows then is its noise."""
    t, gyro, times, q = turning(size=1e-3)
    found = gyro_check.compare(t, gyro, times, q)
    assert found.late == 0.0
    gyro_check.refuse(found)
    assert gyro_check.compare(t, gyro, times + 100.0, q) is None
    gyro_check.refuse(None)
