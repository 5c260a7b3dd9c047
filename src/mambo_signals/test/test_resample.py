"""Gaps have no values, derivatives are those of the motion, flipped poses are found."""

from mambo_analysis.identify import flow
from mambo_bags.reader import read_bag
from mambo_signals import outliers, resample
from mambo_signals.derivative import body_rates, local_fit
from mambo_signals.motion import read
from mambo_thesis.recordings.validate_flights import errors, Odometry, seen
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic import Maker

LOST = (8.0, 10.0)  # s, a gap of 2 s
FLIP = Rotation.from_euler('x', 180.0, degrees=True)


def path(t):
    """Return position (n, 3) m and velocity (n, 3) m/s of a loop that starts on the floor."""
    rise = np.clip((t - 2.0) / 2.0, 0.0, 1.0)
    position = np.column_stack([np.sin(2.0 * t), np.cos(t), rise])
    return position, np.column_stack([2.0 * np.cos(2.0 * t), -np.sin(t), 0.5 * (
        (t > 2.0) & (t < 4.0))])


def attitude(t):
    """Return a tilt that rocks, and a yaw that turns."""
    return Rotation.from_euler('ZYX', np.column_stack([
        0.3 * t, 0.1 * np.sin(2.0 * t), 0.1 * np.cos(3.0 * t)]))


def recorded(target, flipped=(), lost=None, floor_flow=False):
    """Write 15 s of a motion capture, some poses upside down."""
    topics = ('optitrack/pose', 'optical_flow') if floor_flow else ('optitrack/pose',)
    maker = Maker(target, topics)
    t = np.arange(0.0, 15.0, 0.01)
    position, turns = path(t)[0], attitude(t)
    for k in range(len(t)):
        ns = round(t[k] * 1e9)
        if not (lost and lost[0] < t[k] < lost[1]):
            q = (turns[k] * FLIP if k in flipped else turns[k]).as_quat()
            maker.write('optitrack/pose', ns, pose=maker.pose(position[k], q))
        if floor_flow and k % 3 == 0:
            maker.write('optical_flow', ns, rate_x=0.1, rate_y=0.2, quality=200)
    maker.writer.close()
    return read_bag(target)


def test_nothing_is_known_inside_a_gap():
    t = np.concatenate([np.arange(0.0, 2.0, 0.01), np.arange(4.0, 6.0, 0.01)])
    at = np.arange(0.005, 6.0, 0.01)
    out = resample.columns_at(at, t, np.column_stack([t, 2.0 * t]))
    gone = np.isnan(out).any(axis=1)
    assert gone[(at > 2.0) & (at < 4.0)].all() and not gone[(at < 1.98)].any()
    np.testing.assert_allclose(out[~gone], np.column_stack([at, 2.0 * at])[~gone], atol=1e-12)
    short = np.delete(np.arange(0.0, 1.0, 0.01), [50, 51])  # two lost frames are bridged
    assert not resample.gaps(short).any()
    assert resample.gaps(np.delete(short, [50, 51])).any()


@pytest.mark.parametrize('jitter', [0.0, 0.003])
def test_the_derivative_is_that_of_the_motion_and_stops_at_a_gap(jitter):
    rng = np.random.default_rng(0)
    t = np.arange(0.0, 15.0, 0.01) + jitter * rng.uniform(size=1500)
    keep = (t < LOST[0]) | (t > LOST[1])
    at = np.arange(4.5, 14.5, 0.02)
    value, slope = local_fit(t[keep], path(t[keep])[0], at, 0.12)
    known = np.isfinite(slope).all(axis=1)
    assert not known[(at > 8.0) & (at < 10.0)].any()
    assert known[(at < 7.9) | (at > 10.1)].all()
    np.testing.assert_allclose(value[known], path(at[known])[0], atol=3e-4)
    np.testing.assert_allclose(slope[known], path(at[known])[1], atol=0.02)


def test_a_window_across_a_short_gap_has_no_derivative():
    t = np.arange(0.0, 2.0, 0.01)
    t = np.delete(t, range(100, 105))  # 60 ms, in the middle of a window of 220 ms
    _, slope = local_fit(t, t[:, None], np.array([0.5, 0.95, 1.02, 1.1, 1.5]), 0.22)
    assert np.isnan(slope[:, 0]).tolist() == [False, True, True, True, False]


def test_body_rates_are_those_of_the_gyro():
    t = np.arange(0.0, 5.0, 0.01)
    spin = np.array([0.3, -0.5, 0.8])  # rad/s in the body, constant
    attitude = Rotation.from_euler('ZYX', [0.7, 0.4, -0.2]) * Rotation.from_rotvec(
        np.outer(t, spin))
    keep = (t < 2.0) | (t > 3.0)
    times, rates = body_rates(t[keep], attitude[keep].as_quat())
    assert times[0] < 0.05 and times[-1] > 4.94
    assert not ((times > 2.0) & (times < 3.0)).any()
    np.testing.assert_allclose(rates, np.tile(spin, (len(rates), 1)), atol=1e-9)


def test_a_parabola_is_differentiated_exactly():
    t = 0.01 * np.arange(200) + np.random.default_rng(1).uniform(0.0, 0.005, 200)
    _, slope = local_fit(t, (3.0 * t * t - t)[:, None], np.array([0.7, 1.1]), 0.2)
    np.testing.assert_allclose(slope[:, 0], [3.2, 5.6], rtol=1e-9)


def test_a_recording_too_short_or_too_sparse_has_no_derivative():
    t = np.array([0.0, 0.1, 0.2])
    assert np.isnan(local_fit(t, t[:, None], t, 0.1)[1]).all()
    assert len(body_rates(t, np.tile([0.0, 0.0, 0.0, 1.0], (3, 1)))[0]) == 0


@pytest.mark.parametrize('flipped', [{700}, {0}, {1499}, set(range(600, 640)), {300, 301, 900}])
def test_poses_that_the_tracker_flips_are_found(flipped):
    t = np.arange(0.0, 15.0, 0.01)
    turns = attitude(t).as_quat()
    for k in flipped:
        turns[k] = (Rotation.from_quat(turns[k]) * FLIP).as_quat()
    wrong = outliers.impossible(t, path(t)[0], turns)
    assert set(np.flatnonzero(wrong)) == flipped


def test_a_pose_elsewhere_is_found_and_fast_flight_is_not():
    t = np.arange(0.0, 15.0, 0.01)
    position, turns = path(t)[0], attitude(t).as_quat()
    position[500] += [0.0, 1.0, 0.0]
    assert np.flatnonzero(outliers.impossible(t, position, turns)).tolist() == [500]
    flip = Rotation.from_euler('x', 25.0 * t[:, None]).as_quat()  # 1400 deg/s
    assert not outliers.impossible(t, path(t)[0] * 10.0, flip).any()
    t[700:] += 3.0  # what turns during a gap is no jump
    assert not outliers.impossible(t, path(t)[0], attitude(t).as_quat()).any()


def test_a_flipped_pose_is_left_out_of_a_motion_and_counted(tmp_path):
    motion = read(recorded(tmp_path / 'b', {700, 1100}), 'optitrack/pose')
    assert motion.impossible == 2 and len(motion.stamps) == 1498
    z_up = Rotation.from_quat(motion.quaternion).as_matrix()[:, 2, 2]
    assert z_up.min() > 0.9
    assert '2 poses left out' in outliers.describe('optitrack/pose', 2)


def test_one_flipped_pose_does_not_change_the_samples_of_the_flow(tmp_path):
    found = []
    for name, flipped in (('a', ()), ('b', {700})):
        recorded(tmp_path / name, flipped, floor_flow=True)
        found.append(flow.read(tmp_path / name, 0.0, -np.inf, np.inf, 0.0, None))
    assert [one.impossible for one in found] == [0, 1]
    assert (found[1].depth > 0.0).all()
    for column in ('velocity', 'depth', 'rotation'):
        np.testing.assert_allclose(
            getattr(found[1], column), getattr(found[0], column), atol=0.02)


def test_a_gap_of_the_motion_capture_is_no_truth(tmp_path):
    truth = seen(recorded(tmp_path / 'b', {300}, LOST))
    t = truth.stamp * 1e-9
    lost = (t > LOST[0] + 0.01) & (t < LOST[1] - 0.01)
    assert np.isnan(truth.position[lost]).all() and np.isnan(truth.velocity[lost]).all()
    position, velocity = path(t)
    exact = Odometry(truth.stamp, position, attitude(t).inv().apply(velocity),
                     attitude(t).as_quat())
    off = errors(exact, truth)
    assert off.horizontal < 2e-3 and off.height < 2e-3  # interpolated it is 1 m and more
    assert off.velocity < 0.03 and off.tilt < 0.1


def test_poses_that_all_jump_are_sorted_in_bounded_time():
    rng = np.random.default_rng(0)
    count = 20_000
    wrong = outliers.impossible(
        0.01 * np.arange(count), 1e6 * rng.normal(size=(count, 3)),
        Rotation.random(count, rng=0).as_quat())
    assert wrong.sum() == count - 1
