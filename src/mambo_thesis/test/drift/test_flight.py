"""A flight as evidence: motion by Optitrack at each sample of the flow, gaps left out."""

from pathlib import Path
from types import SimpleNamespace

from drift_flights import experiments_of, flown, TRUE, write
from hypothesis import given, settings, strategies as st
from mambo_analysis.identify.recording import Stream
from mambo_bags.mcap_reader import BagError
from mambo_thesis.drift import flight as drift_flight, identify_drift
from mambo_thesis.drift.flight import read
from mambo_thesis.drift.mechanisms import dead_reckoned, flow
from mambo_thesis.drift.paths import DRAG_RATE, PATHS, perfect
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

@pytest.mark.long
def test_poses_upside_down_are_counted_and_change_nothing(tmp_path, capsys):
    bags = [write(tmp_path / name, {'slope': 0.07}, flipped=where)
            for name, where in (('whole', ()), ('flipped', range(900, 912)))]
    (whole, flipped), _ = read(bags, lag=0.03)
    assert (whole.impossible, flipped.impossible) == (0, 12)
    assert len(flipped.flow) > len(whole.flow) - 20
    assert np.abs(flipped.track.omega).max() < 1.01 * np.abs(whole.track.omega).max()
    assert identify_drift.main([str(bags[1])]) == 0
    assert 'optitrack/pose: 12 impossible poses left out' in capsys.readouterr().out


def test_the_lag_is_found_behind_a_flow_that_is_not_linear(tmp_path):
    # 3 sigma of eight seeds
    assert read([write(tmp_path / 'bag', {'cubic': 0.1})])[1] == pytest.approx(0.03, abs=0.004)


def posed(rate=120.0, seconds=10.0, noise=0.0, lost=None, path='C.4'):
    """Return poses along a path, some of them lost."""
    t = np.arange(0.0, seconds, 1.0 / rate)
    if lost is not None:
        t = t[(t < lost[0]) | (t > lost[1])]
    track = perfect(PATHS[path], t, drag_rate=DRAG_RATE)
    rng = np.random.default_rng(0)
    return drift_flight.Poses(t, track.position + noise * rng.normal(size=(len(t), 3)),
                              Rotation.from_matrix(track.R))


def sensed(t, lag=0.0):
    track = perfect(PATHS['C.4'], t - lag, drag_rate=DRAG_RATE)
    return track, Stream(t, flow(track, track.height, {}))


def test_velocity_is_the_derivative_and_does_not_shift_in_time():
    found = drift_flight.smoothed(posed())
    exact = perfect(PATHS['C.4'], found.t, drag_rate=DRAG_RATE)
    np.testing.assert_allclose(found.velocity[found.known], exact.velocity[found.known], atol=2e-4)
    np.testing.assert_allclose(found.position[found.known], exact.position[found.known], atol=1e-5)


def test_the_velocity_noise_follows_from_the_residuals_of_the_cubic():
    found = drift_flight.smoothed(posed(noise=1e-3))
    exact = perfect(PATHS['C.4'], found.t, drag_rate=DRAG_RATE)
    error = (found.velocity - exact.velocity)[found.known]
    assert found.noise == pytest.approx(error.std(), rel=0.25)


def test_a_gap_of_the_poses_has_no_velocity():
    found = drift_flight.smoothed(posed(lost=(4.0, 6.0)))
    inside = (found.t > 4.1) & (found.t < 5.9)
    assert not found.known[inside].any() and found.known[~inside].mean() > 0.9


@pytest.mark.parametrize(('poses', 'wanted'), [
    (posed(seconds=0.5), 'only 60 Optitrack poses: at least 1 s and 30 poses are needed'),
    (posed(rate=10.0, seconds=2.0), 'only 20 Optitrack poses')])
def test_too_few_poses_are_refused(poses, wanted):
    with pytest.raises(BagError, match=wanted):
        drift_flight.smoothed(poses)
    with pytest.raises(BagError, match=f'^flight_1: {wanted}'):
        drift_flight.assemble('flight_1', poses, sensed(TIMES)[1])


def test_the_white_noise_of_rates_is_separated_from_motion():
    t = np.arange(4000) * 0.005
    slow = np.column_stack([np.sin(3.0 * t), np.cos(2.0 * t), t])
    noise = 0.01 * np.random.default_rng(0).standard_normal((4000, 3))
    assert drift_flight.rate_noise(slow + noise) == pytest.approx(0.01, rel=0.05)
    assert drift_flight.rate_noise(slow) < 1e-5


def test_a_bias_of_the_gyro_is_taken_from_the_poses():
    t = np.arange(0.0, 9.9, 1.0 / 32.0)
    track, seen = sensed(t)
    fine = np.arange(0.0, 9.9, 0.005)
    gyro = Stream(fine, perfect(PATHS['C.4'], fine, drag_rate=DRAG_RATE).omega + [
        0.05, -0.03, 0.02])
    found = drift_flight.assemble('f', posed(), seen, gyro)
    exact = perfect(PATHS['C.4'], found.track.t, drag_rate=DRAG_RATE)
    np.testing.assert_allclose(found.track.omega[:, :2], exact.omega[:, :2], atol=2e-3)


def test_the_motion_is_that_at_the_sample_or_its_lag_before():
    t = np.arange(0.0, 9.9, 1.0 / 32.0)
    found = drift_flight.assemble('f', posed(), Stream(t, sensed(t, 0.05)[1].values), lag=0.05)
    np.testing.assert_allclose(found.flow, flow(found.track, found.track.height, {}), atol=1e-3)
    late = drift_flight.assemble('f', posed(), Stream(t, sensed(t, 0.05)[1].values))
    assert np.abs(late.flow - flow(late.track, late.track.height, {})).max() > 0.02


def test_samples_without_a_value_low_or_in_a_gap_are_left_out():
    t = np.arange(0.0, 9.9, 1.0 / 32.0)
    values = sensed(t)[1].values.copy()
    values[::10] = np.nan
    found = drift_flight.assemble('f', posed(lost=(4.0, 5.0)), Stream(t, values), min_height=1.0)
    assert found.track.height.min() > 1.0
    assert not ((found.track.t > 4.0) & (found.track.t < 5.0)).any()
    assert not np.isin(found.track.t, t[::10]).any()
    flow_samples = 'f: only [0-9]+ samples of optical flow'
    with pytest.raises(BagError, match=f'{flow_samples} are above 9 m and not tilted too far'):
        drift_flight.assemble('f', posed(), Stream(t, values), min_height=9.0)
    with pytest.raises(BagError, match=f'{flow_samples} have an Optitrack pose; 100 are needed'):
        drift_flight.assemble('f', posed(), Stream(t[:50], values[:50]))


def test_height_before_is_the_height_so_much_earlier():
    f = flown('C.4', {}, 0)
    expected = perfect(PATHS['C.4'], f.track.t - 0.1, drag_rate=DRAG_RATE).height
    np.testing.assert_allclose(f.height_before(0.1), expected, atol=1e-4)
    assert f.height_before(0.0) is f.track.height or (
        f.height_before(0.0) == f.track.height).all()


TIMES = np.arange(0.0, 9.9, 1.0 / 32.0)


def read_made(tmp_path, monkeypatch, quaternion=True, sonar=None, odom=None, **options):
    """Read a bag whose streams are those of formulas."""
    t = np.arange(0.0, 10.0, 1.0 / 120.0)
    track = perfect(PATHS['C.4'], t, drag_rate=DRAG_RATE)
    x, y, z, w = Rotation.from_matrix(track.R).as_quat().T
    q = np.column_stack([x, -y, -z, w])
    pose = SimpleNamespace(
        t=t, position=track.position * [1.0, -1.0, -1.0], impossible=2,
        quaternion=q if quaternion else np.full(q.shape, np.nan))
    motions = {'optitrack/pose': pose, 'estimate/odom': odom}
    sensors = SimpleNamespace(flow=sensed(TIMES)[1], gyro=None, sonar=sonar)
    monkeypatch.setattr(drift_flight, 'read_bag', lambda path, topics, namespace: set(topics))
    monkeypatch.setattr(drift_flight.flow_doubts, 'refuse', lambda bag: None)
    monkeypatch.setattr(drift_flight, 'read_sensors', lambda path, namespace: sensors)
    monkeypatch.setattr(drift_flight.motion, 'read', lambda bag, topic: motions[topic])
    return read([tmp_path / 'bag'], lag=0.0, **options)


def test_a_bag_becomes_a_flight_in_ned(tmp_path, monkeypatch):
    (found,), lag = read_made(tmp_path, monkeypatch)
    exact = perfect(PATHS['C.4'], found.track.t, drag_rate=DRAG_RATE)
    assert lag == 0.0 and found.impossible == 2 and found.name == 'bag'
    np.testing.assert_allclose(found.track.position, exact.position, atol=1e-4)
    np.testing.assert_allclose(found.track.velocity, exact.velocity, atol=1e-3)
    np.testing.assert_allclose(found.track.R, exact.R, atol=1e-3)


def test_poses_without_an_attitude_are_refused(tmp_path, monkeypatch):
    with pytest.raises(BagError, match='optitrack/pose has no attitude; record'):
        read_made(tmp_path, monkeypatch, quaternion=False)


def test_the_height_of_the_sonar_is_its_range_times_the_cosine(tmp_path, monkeypatch):
    track = perfect(PATHS['C.4'], TIMES, drag_rate=DRAG_RATE)
    sonar = Stream(TIMES, track.depth + 0.1)  # reads 10 cm too much along its beam
    (found,), _ = read_made(tmp_path, monkeypatch, sonar=sonar, height='sonar')
    exact = perfect(PATHS['C.4'], found.track.t, drag_rate=DRAG_RATE)
    np.testing.assert_allclose(
        found.track.height, exact.height + 0.1 * exact.R[:, 2, 2], atol=2e-3)


def test_without_a_sonar_its_height_is_refused(tmp_path, monkeypatch):
    with pytest.raises(BagError, match='no topic sonar/range; use --height optitrack'):
        read_made(tmp_path, monkeypatch, height='sonar')


def test_an_estimate_replaces_the_flow_by_its_equivalent(tmp_path, monkeypatch):
    """An estimate that is 10 % too fast is a flow that is 10 % too large."""
    t = np.arange(0.0, 10.0, 0.005)
    position = perfect(PATHS['C.4'], t, drag_rate=DRAG_RATE).position * [1.1, -1.1, -1.0]
    estimate = SimpleNamespace(t=t, position=position)
    (found,), _ = read_made(tmp_path, monkeypatch, odom=estimate, estimate='estimate/odom')
    exact = flow(found.track, found.track.height, {})
    faster = drift_flight.flow_of(found.track, 1.1 * found.track.velocity[:, :2])
    np.testing.assert_allclose(found.flow, faster, atol=2e-3)
    assert np.abs(found.flow - exact).max() > 0.03


@pytest.mark.parametrize('lag', [-0.01, 0.067])
def test_the_lag_with_the_least_residual_is_found_between_the_steps(lag):
    t = np.arange(0.5, 7.0, 1.0 / 32.0)
    source = drift_flight.Source('f', posed(seconds=8.0), Stream(t, sensed(t, lag)[1].values),
                                 None)
    assert drift_flight.flow_lag([source]) == pytest.approx(lag, abs=1e-3)


def test_poses_full_of_gaps_have_no_velocity_at_all():
    t = np.concatenate([k + np.arange(0.0, 0.05, 0.01) for k in range(40)])
    poses = drift_flight.Poses(t, np.zeros((len(t), 3)), Rotation.identity(len(t)))
    with pytest.raises(BagError, match='too many gaps: 0.13 s without a gap are needed'):
        drift_flight.smoothed(poses)


def test_without_a_gyro_the_rates_are_those_of_the_poses():
    found = drift_flight.assemble('f', posed(), sensed(TIMES)[1])
    exact = perfect(PATHS['C.4'], found.track.t, drag_rate=DRAG_RATE)
    np.testing.assert_allclose(found.track.omega[:, :2], exact.omega[:, :2], atol=5e-3)


@given(scale=st.floats(0.5, 2.0), seed=st.integers(0, 100))
@settings(max_examples=20, deadline=None)
def test_flow_and_velocity_are_inverse_to_each_other(scale, seed):
    f = flown('(5.4)', {'scale': scale}, seed, duration=2.0)
    velocity = dead_reckoned(f.track, f.flow)
    np.testing.assert_allclose(
        dead_reckoned(f.track, drift_flight.flow_of(f.track, velocity)), velocity, atol=0.2)
    level = f.track._replace(R=np.tile(np.eye(3), (len(f.flow), 1, 1)))
    np.testing.assert_allclose(
        drift_flight.flow_of(level, dead_reckoned(level, f.flow)), f.flow, atol=1e-12)


def rotated(f, degrees):
    """Return a flight whose flow is turned against the body."""
    turn = Rotation.from_euler('z', degrees, degrees=True).as_matrix()[:2, :2]
    return f._replace(flow=f.flow @ turn.T)


@pytest.mark.parametrize(('spoil', 'says'), [
    (lambda f: f._replace(flow=np.full_like(f.flow, 0.1)), 'the flow along x is constant'),
    (lambda f: f._replace(flow=-f.flow), 'the flow along x is -1.0. times'),
    (lambda f: f._replace(flow=2.0 * f.flow), 'the flow is 2.0. times velocity over height'),
    (lambda f: f._replace(flow=0.5 * f.flow), 'the flow is 0.5. times velocity over height'),
    (lambda f: rotated(f, 30.0), 'the flow is turned by 30 deg against the motion'),
    (lambda f: rotated(f, -60.0), 'the flow is turned by -60 deg')])
def test_a_flow_of_another_motion_unit_or_axis_is_refused(spoil, says):
    with pytest.raises(BagError, match=f'^C.4: {says}'):
        drift_flight.check(spoil(flown('C.4', {'slope': 0.07}, 0)))


@pytest.mark.parametrize('letter', TRUE)
def test_a_mechanism_is_not_taken_for_another_motion(letter):
    for one in experiments_of(TRUE[letter]):
        drift_flight.check(one)


def test_a_flow_later_than_the_search_is_refused_and_a_slow_one_is_not(tmp_path):
    bag = write(tmp_path / 'bag', {'slope': 0.07}, lag=0.25)
    with pytest.raises(BagError, match='bag: the flow lags by 150 ms or more, the end of the sea'):
        read([bag])
    assert read([bag], lag=0.25)[1] == 0.25


def test_a_height_that_contradicts_the_range_is_refused(monkeypatch):
    check = drift_flight.flow_doubts.height_check
    monkeypatch.setattr(check, 'of_bag', lambda bag: ['in feet'] * (
        'sonar/range' in bag and 'optitrack/pose' in bag))
    with pytest.raises(BagError, match='circle_short: in feet'):
        read([Path(__file__).parents[4] / 'bags/circle_short'])


def test_a_flight_that_is_given_twice_is_refused(tmp_path):
    bag = write(tmp_path / 'bag', {'slope': 0.07})
    copy = write(tmp_path / 'copy', {'slope': 0.07})
    with pytest.raises(BagError, match='copy: the same flight as .*bag: each is evidence once'):
        read([bag, copy])
