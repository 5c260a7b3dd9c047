"""The factor of the flow from synthetic samples of known truth, and from a flight."""

import math
from pathlib import Path

from interval_checks import assert_covers
from mambo_analysis.identify import flow, flow_doubts
from mambo_analysis.identify.flow import fit_factor, from_recording, main, Samples, samples
from mambo_analysis.identify.regression import IdentifyError
from mambo_bags.reader import read_bag
from mambo_bags.writer import BagWriter
from mambo_flight import closed_loop
from mambo_flight.scenario import load, scenario
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic import make_capture

BAG = Path(__file__).parents[4] / 'bags/circle_short'
T = np.arange(0.0, 20.0, 1.0 / 120.0)
LAWS = {'constant': lambda h: 1.06 + 0.0 * h, 'linear': lambda h: 0.92 + 0.07 * h,
        'exponential': lambda h: 0.95 + 0.011 * np.exp(h)}


def path(t, vertical=1.0):
    """Return position and velocity, (n, 3) NED, of a circle that also moves up and down."""
    position = np.stack([np.cos(t), np.sin(t), -1.5 - vertical * np.sin(0.5 * t)], axis=1)
    velocity = np.stack([-np.sin(t), np.cos(t), -0.5 * vertical * np.cos(0.5 * t)], axis=1)
    return position, velocity


def attitude(t):
    """Return rotations that tilt by up to 0.15 rad and yaw by half a turn."""
    return Rotation.from_euler('ZYX', np.stack(
        [0.15 * t, 0.15 * np.cos(t), 0.10 * np.sin(1.3 * t)], axis=1))


def measured(law, seed=0, noise=0.015, vertical=1.0, bias=(0.01, -0.02), **options):
    """Return the samples of a flight whose sensor has a factor, at 32 Hz."""
    rng, t = np.random.default_rng(seed), np.arange(0.3, 19.7, 1.0 / 32.0)
    position, velocity = path(t, vertical)
    R, h = attitude(t), -position[:, 2]
    Z = h / R.as_matrix()[:, 2, 2]
    flow = R.inv().apply(velocity)[:, :2] / (Z * LAWS[law](h))[:, None] + bias
    q = np.roll(attitude(T).as_quat(), 1, axis=1)
    return samples(
        t, flow + noise * rng.standard_normal(flow.shape), T,
        path(T, vertical)[0] + 3e-4 * rng.standard_normal((len(T), 3)), q, **options)


def test_motion_seen_by_the_cameras_is_that_of_the_body():
    data = measured('constant', noise=0.0)
    position, velocity = path(data.t)
    R = attitude(data.t)
    # 0.3 mm over 15 positions in 0.12 s: 2 mm/s; the attitude is that of the nearest frame
    np.testing.assert_allclose(data.velocity, R.inv().apply(velocity)[:, :2], atol=0.012)
    np.testing.assert_allclose(data.height, -position[:, 2], atol=1e-3)
    np.testing.assert_allclose(data.depth, data.height / R.as_matrix()[:, 2, 2], rtol=2e-3)


def test_a_constant_factor_comes_back_whatever_the_heights():
    found = fit_factor(measured('constant'))
    assert found.offset.value == pytest.approx(1.06, rel=0.005)  # 5 % asked
    assert found.bias == pytest.approx((0.01, -0.02), abs=0.003)
    level = fit_factor(measured('constant', vertical=0.0))
    assert level.offset.value == pytest.approx(1.06, rel=0.005)


@pytest.mark.parametrize('law, offset, slope', [
    ('linear', 0.92, 0.07), ('exponential', 0.95, 0.011)])
def test_a_factor_over_height_comes_back(law, offset, slope):
    data = measured(law)
    found = fit_factor(data, law)
    assert found.offset.low <= offset <= found.offset.high
    assert found.slope.low <= slope <= found.slope.high
    h = np.array([0.6, 1.5, 2.4])
    np.testing.assert_allclose(found.at(h, law), LAWS[law](h), rtol=0.02)  # 5 % asked
    assert found.fit.rms == pytest.approx(0.015, rel=0.05)
    assert fit_factor(data).fit.rms > found.fit.rms


def test_rotation_left_in_the_flow_is_told_from_the_motion():
    data = measured('linear')
    R = attitude(data.t)
    step = 1e-4
    omega = (R.inv() * attitude(data.t + step)).as_rotvec() / step  # body axes
    np.testing.assert_allclose(data.rotation[:, 0], omega[:, 1], atol=2e-3)
    np.testing.assert_allclose(data.rotation[:, 1], -omega[:, 0], atol=2e-3)
    turning = leaky('linear', 0.4)
    found = fit_factor(turning, 'linear', leak=True)
    assert found.leak.low <= 0.4 <= found.leak.high
    assert found.leak.value == pytest.approx(0.4, abs=0.03)
    assert found.slope.low <= 0.07 <= found.slope.high
    assert found.fit.rms < fit_factor(turning, 'linear').fit.rms
    assert fit_factor(data).leak is None


def leaky(law, share=0.2, seed=0):
    """Return the samples of a flight whose flow holds a share of the rotation."""
    data = measured(law, seed)
    step = 1e-4
    omega = (attitude(data.t).inv() * attitude(data.t + step)).as_rotvec() / step
    return data._replace(flow=data.flow + share * np.stack([omega[:, 1], -omega[:, 0]], axis=1))


def flown(trajectory, seed, **sensor):
    """Return the samples of a simulated flight with parameters of the flow sensor."""
    return from_recording(closed_loop.fly(scenario(trajectory, seed=seed, overrides={
        f'sim_node.simulator.optical_flow.{name}': value for name, value in sensor.items()})))


LEVEL = {'factor_slope': 0.0, 'factor_offset': 1.0}


@pytest.mark.parametrize('trajectory, law, offset, slope, sensor', [
    ('vertical_circle_large', 'linear', 0.92, 0.07, {}), ('circle', 'constant', 1.0, 0.0, LEVEL)])
def test_a_clear_share_of_the_rotation_is_fitted_however_small_its_residual(
    trajectory, law, offset, slope, sensor,
):
    data = flown(trajectory, 404, leakage=0.1, **sensor)
    plain = flow.fit_laws(data)
    found = flow.with_rotation(data, plain)
    assert plain[law].fit.rms < 1.2 * found[law].fit.rms
    assert not plain[law].offset.low <= offset <= plain[law].offset.high
    assert found[law].offset.low <= offset <= found[law].offset.high
    if law == 'linear':
        assert not plain[law].slope.low <= slope <= plain[law].slope.high
        assert found[law].slope.low <= slope <= found[law].slope.high
    Q = offset + slope * data.height.mean()
    assert Q * found[law].leak.value == pytest.approx(0.1, abs=0.02)
    data = flown(trajectory, 404, **sensor)
    plain = flow.fit_laws(data)
    assert flow.with_rotation(data, plain) is plain


def test_a_clear_share_that_moves_no_factor_is_left_out():
    data, rng = measured('constant', vertical=0.0), np.random.default_rng(1)
    turning = 0.2 * rng.standard_normal(data.flow.shape)  # independent of the motion
    data = data._replace(rotation=turning, flow=data.flow + 0.02 * turning)
    plain, share = flow.fit_laws(data), fit_factor(data, leak=True).leak
    assert share.value > 2.0 * flow.CLEAR * share.half
    assert flow.with_rotation(data, plain) is plain


def test_a_late_flow_is_not_taken_for_a_share_of_the_rotation():
    data = flown('circle', 603, latency=0.01, **LEVEL)
    share = fit_factor(data, leak=True).leak
    assert share.low > 0.5 * share.half  # clear, but for the lag
    plain = flow.fit_laws(data)
    assert flow.with_rotation(data, plain) is plain


def test_the_report_fits_a_clear_share_and_says_what_the_factor_is_without():
    data = leaky('linear')
    plain = fit_factor(data, 'linear')
    report = flow._report(Path('bag'), data, False, flow.SLOWEST)
    slope, share = (report.values[name] for name in ('Q linear, slope', 'share of the rotation'))
    assert slope.low <= 0.07 <= slope.high and share.low <= 0.2 <= share.high
    line, = (note for note in report.notes if 'follows the rotation' in note)
    assert f'a share of {share.value:.2g} of it is clear, and all values above are fitted' in line
    assert line.endswith(f'without it Q would be {plain.offset.value:.3g} + '
                         f'{plain.slope.value:.2g} h')
    assert f'rotation_leak: {share.value}' in report.files['estimator.yaml']
    offset = report.facts['offset of the flow x, y, body FLU [rad/s]'].split(', ')
    # of data in body FRD: (0.01, -0.02)
    assert [float(number) for number in offset] == pytest.approx([0.01, 0.02], abs=0.003)
    for asked in (False, True):
        report = flow._report(Path('bag'), measured('linear'), asked, flow.SLOWEST)
        assert ('share of the rotation' in report.values) is asked
        assert not any('follows the rotation' in note for note in report.notes)


@pytest.mark.long
def test_intervals_cover_over_60_seeds():
    data = [measured('linear', seed) for seed in range(60)]
    found = [fit_factor(one, 'linear') for one in data]
    assert_covers(0.92, [one.offset for one in found])
    assert_covers(0.07, [one.slope for one in found])
    data = [measured('constant', seed, vertical=0.0) for seed in range(60)]
    assert_covers(1.06, [fit_factor(one).offset for one in data])
    data = [leaky('linear', seed=seed) for seed in range(60)]
    found = [flow.with_rotation(one, flow.fit_laws(one))['linear'] for one in data]
    assert_covers(0.92, [one.offset for one in found])
    assert_covers(0.07, [one.slope for one in found])
    assert_covers(0.2, [one.leak for one in found])


def test_a_flight_with_all_its_sensors_shows_the_factor():
    data = from_recording(closed_loop.fly(scenario(
        'vertical_circle_large', duration=25.0, land=False, seed=3)), start=3.0)
    found = fit_factor(data, 'linear')
    np.testing.assert_allclose(found.at(np.array([0.8, 1.5, 2.2]), 'linear'),
                               LAWS['linear'](np.array([0.8, 1.5, 2.2])), rtol=0.03)  # 5 % asked
    assert found.slope.low <= 0.07 <= found.slope.high


def test_floor_and_missing_frames_are_taken_into_account():
    raised = measured('linear', floor=-0.5)
    assert raised.height.max() == pytest.approx(3.0, abs=0.01)
    data = measured('linear', start=5.0, end=10.0)
    assert data.t[0] >= 5.0 and data.t[-1] <= 10.0
    t, keep = np.array([4.0, 5.0, 6.0]), np.abs(T - 5.0) > 0.05
    q = np.roll(attitude(T).as_quat(), 1, axis=1)
    seen = samples(t, np.full((3, 2), 0.3), T[keep], path(T)[0][keep], q[keep])
    assert seen.t.tolist() == [4.0, 6.0]
    some = samples(t, np.array([[0.3, 0.3], [np.nan, 0.3], [0.3, 0.3]]), T, path(T)[0], q)
    assert some.t.tolist() == [4.0, 6.0]


def turned(vectors, degrees):
    """Return (n, 2) vectors turned by an angle."""
    return vectors @ Rotation.from_euler('z', degrees, degrees=True).as_matrix()[:2, :2].T


def change(**columns):
    return lambda data: data._replace(**{name: f(data) for name, f in columns.items()})


@pytest.mark.parametrize('spoil, law, message', [
    (lambda d: Samples(*(c[:50] for c in d[:6])), 'constant', '50 samples, at least 100'),
    (change(flow=lambda d: np.where(d.flow == d.flow[3], np.nan, d.flow)), 'constant',
     'flow is not finite in 1 of'),
    (change(flow=lambda d: np.zeros_like(d.flow)), 'constant', 'flow is constant'),
    (change(flow=lambda d: np.rad2deg(d.flow)), 'constant', 'it must be in rad/s'),
    (change(flow=lambda d: -d.flow), 'constant', "with the vehicle's sign"),
    (change(velocity=lambda d: 0.01 * d.velocity), 'constant',
     r'slower than 0.1 m/s .* or admit it with --slowest'),
    (change(depth=lambda d: -d.depth), 'constant', 'is the floor where z is 0'),
    (change(height=lambda d: 1.5 + 0.0 * d.height), 'linear', 'heights differ by 0.00 m'),
    (change(flow=lambda d: d.flow * [1.0, 0.0]), 'constant', 'the flow along y is constant'),
    (change(flow=lambda d: d.flow * [1.0, -0.3]), 'linear', 'the flow along y is -0.3'),
    (change(flow=lambda d: d.flow * [1.0, 0.5]), 'constant', 'flow along x is 2 times that along'),
    (change(velocity=lambda d: turned(d.velocity, 30.0)), 'linear', 'turned by -30 deg against'),
    (change(velocity=lambda d: turned(d.velocity, -60.0)), 'constant', 'turned by 60 deg against'),
    (lambda d: d, 'cubic', "law 'cubic' is not one of constant, linear, exponential")])
def test_what_shows_no_factor_is_refused(spoil, law, message):
    with pytest.raises(IdentifyError, match=message):
        fit_factor(spoil(measured('linear')), law)


def test_a_factor_at_the_limit_of_its_search_is_no_estimate(monkeypatch):
    data = measured('constant')
    monkeypatch.setattr(flow, '_check', lambda *_: None)
    with pytest.raises(IdentifyError, match='the best offset is 5, the limit of its search'):
        fit_factor(data._replace(flow=0.1 * data.flow))


@pytest.mark.parametrize('axis', [0, 1])
def test_a_flight_along_one_axis_says_nothing_of_the_other(axis):
    data, rng = measured('constant'), np.random.default_rng(0)
    swing = np.zeros_like(data.velocity)
    swing[:, axis] = np.sin(data.t)
    seen = swing / (1.06 * data.depth[:, None]) + 0.015 * rng.standard_normal(swing.shape)
    one = data._replace(velocity=swing, flow=seen)
    assert fit_factor(one).offset.value == pytest.approx(1.06, rel=0.01)
    with pytest.raises(IdentifyError, match='turned by 30 deg'):
        fit_factor(one._replace(flow=turned(seen, 30.0)))
    small = one._replace(flow=turned(seen, 8.0))  # as a careful hand aligns a nose: 1 % of Q
    assert fit_factor(small).offset.value == pytest.approx(1.06, rel=0.02)


def test_the_command_reads_a_bag_and_writes_parameters_of_the_estimator(tmp_path, capsys):
    assert main([str(BAG), '--out', str(tmp_path)]) == 0
    assert 'Q constant' in capsys.readouterr().out
    flow = load(tmp_path / 'estimator.yaml').estimator_node.kalman.optical_flow
    assert flow.constant == pytest.approx(0.92 + 0.07 * 1.5, rel=0.01)  # the sensor at 1.5 m
    assert flow.factor == 'constant'  # most of the flight is at one height
    assert math.isfinite(flow.linear_slope)
    assert (tmp_path / 'identify_flow.png').stat().st_size > 10000
    assert not (tmp_path / 'identify_flow.yaml').exists()


@pytest.mark.parametrize('options, message', [
    (['--leak', '--start', '100'], '0 samples, at least 100'),
    (['--floor', '2'], '0 samples, at least 100'),
    (['--namespace', 'other'], 'nothing in the namespace /other')])
def test_wrong_use_is_one_line(capsys, options, message):
    assert main([str(BAG), *options]) == 2
    error = capsys.readouterr().err
    assert message in error and error.count('\n') == 1 and error.startswith('identify_flow: ')


def test_a_slow_flight_is_refused_with_the_option_that_admits_it(capsys):
    assert main([str(BAG), '--slowest', '2']) == 2
    error = capsys.readouterr().err.strip()
    assert 'is slower than 2 m/s' in error and '--slowest' in error and '\n' not in error
    assert main([str(BAG), '--slowest', '0.01']) == 0


def test_a_topic_without_messages_is_one_line(tmp_path, capsys):
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic('/mambo/optical_flow', 'mambo_interfaces/msg/OpticalFlow')
        bag.add_topic('/mambo/optitrack/pose', 'geometry_msgs/msg/PoseStamped')
        pose = read_bag(BAG)['optitrack/pose']
        for stamp, data in zip(pose.stamp.tolist(), pose.raw):
            bag.write('/mambo/optitrack/pose', data, stamp)
    assert main([str(tmp_path / 'bag')]) == 2
    assert '/mambo/optical_flow has no messages\n' in capsys.readouterr().err


def test_one_flipped_pose_does_not_change_the_samples_of_the_flow(tmp_path):
    found = []
    for name, flipped in (('a', ()), ('b', {700})):
        make_capture(tmp_path / name, flipped, floor_flow=True)
        found.append(flow.read(tmp_path / name, 0.0, -np.inf, np.inf, 0.0, None))
    assert [one.impossible for one in found] == [0, 1]
    assert (found[1].depth > 0.0).all()
    for column in ('velocity', 'depth', 'rotation'):
        np.testing.assert_allclose(
            getattr(found[1], column), getattr(found[0], column), atol=0.02)


def axes(matrix, n=800, noise=0.02):
    """Return samples of a hand's motion whose flow is a matrix times velocity over depth."""
    rng = np.random.default_rng(5)
    t, depth = np.arange(n) * 0.02, np.full(n, 1.2)
    velocity = np.stack([0.6 * np.sin(1.1 * t), 0.5 * np.sin(1.7 * t + 0.4)], axis=1)
    seen = velocity / 1.2 @ np.array(matrix).T + noise * rng.standard_normal((n, 2))
    return Samples(t, seen, velocity, depth, depth, np.zeros((n, 2)))


def rotation(degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return [[c, -s], [s, c]]


@pytest.mark.parametrize('matrix', [
    np.eye(2), np.diag([0.5, 0.5]), np.diag([1.1, 0.9]), rotation(10.0), rotation(-10.0)])
def test_axes_of_a_sensor_that_is_mounted_nearly_right_are_its_own(matrix):
    flow.check_axes(axes(matrix), leak=False)


@pytest.mark.parametrize('matrix, message', [
    (rotation(30.0), 'turned by 30 deg'), (rotation(-60.0), 'turned by -60 deg'),
    (np.diag([1.0, 0.4]), 'along x is 2.5 times that along y'),
    (np.diag([1.0, 0.0]), 'flow along y'), (np.diag([-1.0, 1.0]), 'flow along x')])
def test_axes_of_another_frame_are_told(matrix, message):
    with pytest.raises(IdentifyError, match=message):
        flow.check_axes(axes(matrix), leak=False)


def test_a_height_that_contradicts_the_range_is_refused(monkeypatch):
    monkeypatch.setattr(flow_doubts.height_check, 'of_bag', lambda bag: ['in feet'] * (
        'sonar/range' in bag and 'optitrack/pose' in bag))
    with pytest.raises(IdentifyError, match='circle_short: in feet'):
        flow.read(BAG, 0.0, -np.inf, np.inf, 0.0, None)
