"""The bound of a recording: against that of a simulated flight, and what is lost."""

from dataclasses import replace
import json
import math
from types import SimpleNamespace

from mambo_analysis.capture import recorded_bound
from mambo_analysis.capture.captured import Odometry
from mambo_estimation.joint.joint_parameters import JointParams, MotionParams
from mambo_estimation.joint.propagation import bridge
from mambo_estimation.joint.state import ATTITUDE, SIZE, VELOCITY
from mambo_flight import closed_loop, offline_replay
from mambo_flight.accuracy.bound import flight_of
from mambo_flight.accuracy.filter_error import _truth, evaluate_recording, true_noise
from mambo_flight.scenario import override
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic import make_capture

pytestmark = pytest.mark.long

DT = recorded_bound.DT
FLIP = np.array([1.0, -1.0, -1.0])


def steps(n, **changed):
    """Return samples of a hover, one step each 5 ms, flow at 50 Hz and range at 25 Hz."""
    k = np.arange(n)
    found = offline_replay.Steps(
        np.rint(k * DT * 1e9).astype(np.int64), np.full(n, DT), np.zeros((n, 3)),
        np.tile([0.0, 0.0, -9.81], (n, 1)), np.where(k % 8 == 0, 1.0, np.nan),
        np.where(k[:, None] % 4 == 0, 0.0, np.full((n, 2), np.nan)), np.full(n, 200),
        np.full(n, np.nan), np.ones(n, bool), np.zeros((n, 4), np.int64))
    return found._replace(**changed)


def hover(n):
    state = np.zeros((n, 13))
    state[:, 2], state[:, 6] = -1.0, 1.0
    return state, np.arange(n) * DT


def test_the_bound_of_a_recorded_path_is_that_of_the_same_simulated_flight():
    flight = override(flight_of('circle_rising'), {'sim_node.duration': 25.0})
    r = closed_loop.fly(flight)
    e, p, true = evaluate_recording(flight, r), true_noise(flight), _truth(flight)
    p = replace(p, drag=replace(p.drag, coefficient=true.drag), optical_flow=replace(
        p.optical_flow, scale=true.scale, slope=true.slope, latency=true.latency))
    truth = Odometry(
        r.t, r.truth[:, :3] * FLIP, r.truth[:, 3:6] * FLIP,
        np.column_stack([r.truth[:, 7:10] * FLIP, r.truth[:, 6]]))
    t = r.t[e.start:] * 1e-9
    state = recorded_bound.true_path(truth, t, math.nan)
    turn = Rotation.from_quat(state[:, [7, 8, 9, 6]])
    same = Rotation.from_quat(r.truth[e.start:][:, [7, 8, 9, 6]])
    assert np.abs(state[:, :6] - r.truth[e.start:, :6]).max() < 1e-9
    assert (turn.inv() * same).magnitude().max() < 1e-6
    sensed, held = recorded_bound.sampled(offline_replay.steps_of(r), state, t, p)
    assert not held.any()
    P = recorded_bound.covariances(sensed, held, e.made.P[e.start], p)
    for first, count in ((0, 2), (2, 1), (VELOCITY, 3), (ATTITUDE, 2)):
        ours, theirs = (np.sqrt(np.diagonal(one, axis1=1, axis2=2)[2000:, first:first + count])
                        for one in (P, e.limit[e.start:]))
        np.testing.assert_allclose(ours.mean(), theirs.mean(), rtol=0.02)


def test_samples_count_at_their_own_time_where_the_sensor_can_measure():
    state, t = hover(200)
    p = JointParams()
    found, held = recorded_bound.sampled(steps(200), state, t, p)
    np.testing.assert_array_equal(np.flatnonzero(found.sonar), np.arange(0, 200, 8))
    np.testing.assert_array_equal(np.flatnonzero(found.flow), np.arange(0, 200, 4))
    assert not found.pressure.any() and not held.any()
    np.testing.assert_allclose(found.force, np.tile([0.0, 0.0, -9.81], (200, 1)), atol=1e-9)
    state[:, 2] = -0.3  # below the shortest range and the lowest flow
    low, _ = recorded_bound.sampled(steps(200), state, t, p)
    assert not low.sonar.any() and not low.flow.any()


def test_lost_inertial_samples_are_held():
    state, t = hover(100)
    s, p = steps(100), JointParams()
    accel = s.accel.copy()
    accel[20] = np.nan
    kept = np.r_[0:51, 60:100]  # a gap of 50 ms
    s = s._replace(accel=accel)
    gone = s._replace(**{name: getattr(s, name)[kept] for name in s._fields})
    gone = gone._replace(dt=np.diff(gone.t, prepend=gone.t[0] - 5_000_000) * 1e-9)
    _, held = recorded_bound.sampled(gone, state, t, p)
    assert held[20].tolist() == [0.0, 1.0] and held[21].tolist() == [0.0, 0.0]
    share = 1.0 - bridge(0.05, p.motion.held_time)
    np.testing.assert_allclose(held[51:61], share)
    assert not held[:20].any() and not held[61:].any()


def test_a_lost_force_widens_the_bound_by_the_noise_of_held_ones():
    state, t = hover(400)
    p = replace(JointParams(), motion=MotionParams(gyro_noise=1e-7, accel_noise=1e-5))
    found, held = recorded_bound.sampled(steps(400), state, t, p)
    blind = found._replace(flow=np.zeros(400, bool), sonar=np.zeros(400, bool))
    known = np.zeros((SIZE, SIZE))
    assert recorded_bound.covariances(blind, held, known, p)[-1, 3, 3] < 1e-6
    held[100:300, 1] = 1.0
    lost = recorded_bound.covariances(blind, held, known, p)
    assert lost[99, 3, 3] < 1e-6
    assert lost[299, 3, 3] == pytest.approx(p.motion.held_accel_noise ** 2 * 200 * DT, rel=0.01)
    assert lost[399, 3, 3] == pytest.approx(lost[299, 3, 3], rel=0.01)


def test_a_table_has_the_ratio_of_each_quantity():
    lines = [recorded_bound.Line('height', 'm', 0.004, 0.006)]
    assert recorded_bound.table('bag', 12.34, lines).splitlines() == [
        'bag, 12.3 s in the air', f'{"":<27}     bound   reached   ratio',
        'height [m]                      0.004     0.006    1.50']


@pytest.mark.parametrize(('options', 'message'), [
    (['--vary', '--beside', 'kalman'], 'has been flown: leave out --vary, --beside'),
    (['--seeds', '3'], 'a recording has been flown: leave out --seeds'),
    ([], 'b: no topic /mambo/imu/data_raw; it has /mambo/optitrack/pose')])
def test_a_recording_that_cannot_be_bounded_is_one_line(options, message, tmp_path, capsys):
    make_capture(tmp_path / 'b')
    assert recorded_bound.main([str(tmp_path / 'b'), *options]) in (1, 2)
    error = capsys.readouterr().err
    assert message in error and error.count('\n') == 1


def test_parameters_are_for_recordings_alone(tmp_path, capsys):
    (tmp_path / 'p.yaml').write_text('')
    assert recorded_bound.main(['circle', '--parameters', str(tmp_path / 'p.yaml')]) == 2
    assert 'circle: --parameters is for a real recording with motion capture' in (
        capsys.readouterr().err)


def test_the_command_prints_bound_and_errors_of_a_recording(monkeypatch, tmp_path, capsys):
    make_capture(tmp_path / 'b')
    monkeypatch.setattr(recorded_bound, 'of_bag', lambda bag, p: (
        15.0, [recorded_bound.Line('tilt', 'deg', 0.3, 0.6)]))
    assert recorded_bound.main([str(tmp_path / 'b')]) == 0
    out = capsys.readouterr().out
    assert 'tilt [deg]' in out
    assert 'parameters of the simulated Mambo, as the bag holds none' in out
    assert 'no sonar/range, optical_flow, barometer/pressure in the bag' in out
    assert 'is not chance' not in out
    assert recorded_bound.main([str(tmp_path / 'b'), '--json']) == 0
    assert json.loads(capsys.readouterr().out)['quantities'][0]['reached'] == 0.6
    monkeypatch.setattr(recorded_bound, 'of_bag', lambda bag, p: (
        15.0, [recorded_bound.Line('tilt', 'deg', 0.3, 1.6)]))
    assert recorded_bound.main([str(tmp_path / 'b')]) == 0
    assert 'more than 5 times a bound is not chance' in capsys.readouterr().out


def test_the_bound_begins_in_the_air(monkeypatch, tmp_path):
    bag = make_capture(tmp_path / 'b')
    found = steps(3000)
    monkeypatch.setattr(recorded_bound.offline_replay, 'steps', lambda bag: found)
    monkeypatch.setattr(recorded_bound.captured, 'airborne', lambda truth: (2.0, 12.0))
    monkeypatch.setattr(recorded_bound.captured, 'replayed', lambda bag, p: None)
    monkeypatch.setattr(recorded_bound.captured, 'errors', lambda *_, **__: SimpleNamespace(
        duration=10.0, horizontal=1.0, drift=2.0, height=3.0, velocity=4.0, tilt=5.0))
    duration, lines = recorded_bound.of_bag(bag, JointParams())
    assert duration == 10.0 and [line.reached for line in lines] == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert all(0.0 < line.bound < 1.0 for line in lines)
    monkeypatch.setattr(recorded_bound.captured, 'airborne', lambda truth: (2.0, 2.5))
    with pytest.raises(recorded_bound.BagError, match='share 0.5 s in the air; 1 to 600 s'):
        recorded_bound.of_bag(bag, JointParams())


def test_a_true_path_is_that_of_the_sensor_below_the_markers():
    stamp = np.arange(300) * 10_000_000
    t = stamp * 1e-9
    turned = Rotation.from_euler('z', 0.5 * t[:, None])
    truth = Odometry(
        stamp, np.column_stack([t, 0.0 * t, 1.07 + 0.0 * t]),
        turned.inv().apply(np.tile([1.0, 0.0, 0.0], (300, 1))), turned.as_quat())
    at = np.arange(0.0, 2.9, DT)
    found = recorded_bound.true_path(truth, at, 0.07)
    np.testing.assert_allclose(found[:, 0], at, atol=1e-9)
    np.testing.assert_allclose(found[:, 2], -1.0, atol=1e-9)  # z down
    np.testing.assert_allclose(found[:-1, 12], -0.5, atol=1e-3)  # the other way round, seen so
    np.testing.assert_allclose(np.linalg.norm(found[:, 3:6], axis=1), 1.0, atol=1e-4)
    truth.position[100:200] = np.nan  # a gap is bridged
    np.testing.assert_allclose(
        recorded_bound.true_path(truth, at, math.nan)[:, :3],
        np.column_stack([at, 0.0 * at, -1.07 + 0.0 * at]), atol=1e-9)


def test_only_a_bag_with_motion_capture_and_without_truth_is_a_recording(tmp_path, monkeypatch):
    make_capture(tmp_path / 'b')
    assert recorded_bound.is_recording(str(tmp_path / 'b'))
    assert not recorded_bound.is_recording('circle')
    monkeypatch.setattr(recorded_bound, 'read_bag', lambda path, namespace: {
        'ground_truth/odom': None, 'optitrack/pose': None})
    assert not recorded_bound.is_recording(str(tmp_path / 'b'))


def test_poses_that_are_hours_apart_are_refused(monkeypatch):
    monkeypatch.setattr(recorded_bound.offline_replay, 'steps', lambda bag: steps(10))

    class Far(dict):
        path = 'far'
    bag = Far({'optitrack/pose': SimpleNamespace(stamp=np.array([0, 10 ** 18]))})
    with pytest.raises(recorded_bound.BagError, match='fewer than 2 poses, or lasts longer than'):
        recorded_bound.of_bag(bag, JointParams())


def test_runs_of_equal_shares_overlap_by_one_row_and_cover_all():
    held = np.zeros((10, 2))
    held[4:6, 1], held[9, 0] = 1.0, 0.5
    found = list(recorded_bound._runs(held))
    assert [(one.start, one.stop) for one in found] == [(0, 4), (3, 6), (5, 9), (8, 10)]
    assert [(one.start, one.stop) for one in recorded_bound._runs(np.zeros((5, 2)))] == [(0, 5)]
