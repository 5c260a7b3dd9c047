"""Truth of a flight from a motion capture: none where it lost the vehicle."""

from mambo_thesis.recordings.validate_flights import airborne, errors, joint, Odometry, seen
import numpy as np
from synthetic import loop, make_capture, rocking

LOST = (8.0, 10.0)  # s, a gap of 2 s


def test_a_gap_of_the_motion_capture_is_no_truth(tmp_path):
    truth = seen(make_capture(tmp_path / 'b', {300}, LOST))
    t = truth.stamp * 1e-9
    lost = (t > LOST[0] + 0.01) & (t < LOST[1] - 0.01)
    assert np.isnan(truth.position[lost]).all() and np.isnan(truth.velocity[lost]).all()
    position, velocity = loop(t)
    exact = Odometry(truth.stamp, position, rocking(t).inv().apply(velocity),
                     rocking(t).as_quat())
    off = errors(exact, truth)
    assert off.horizontal < 2e-3 and off.height < 2e-3  # interpolated it is 1 m and more
    assert off.velocity < 0.03 and off.tilt < 0.1


def test_errors_may_end_before_the_landing(tmp_path):
    truth = seen(make_capture(tmp_path / 'b', {300}, LOST))
    start, end = airborne(truth)
    t = truth.stamp * 1e-9
    moved = truth.position + np.where(t[:, None] > start + 3.0, 1.0, 0.0)
    off = truth._replace(position=moved)
    assert errors(off, truth, 2.0).horizontal < 1e-9 < 0.1 < errors(off, truth).horizontal
    assert errors(off, truth, 2.0).duration <= 2.0 < end - start


def test_every_crazyflie_is_told_the_same():
    told = joint()
    assert told.optical_flow.scale == 1.0 and told.sonar.min_range == 0.04
    assert not told.drag.enabled
