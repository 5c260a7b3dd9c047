"""Errors against motion capture and the onboard estimate, on flights with a known answer."""

from pathlib import Path
from types import SimpleNamespace

from mambo_estimation.kalman import EstimatorParams
from mambo_sim.sensors.barometer import BarometerParams
from mambo_thesis.recordings import validate_flights as flights
from mambo_thesis.recordings.validate_flights import (
    airborne, errors, joint_params, mocap_truth, Odometry)
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic import loop, make_capture, rocking

LOST = (8.0, 10.0)  # s, a gap of 2 s


def test_a_gap_of_the_motion_capture_is_no_truth(tmp_path):
    truth = mocap_truth(make_capture(tmp_path / 'b', {300}, LOST))
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
    truth = mocap_truth(make_capture(tmp_path / 'b', {300}, LOST))
    start, end = airborne(truth)
    t = truth.stamp * 1e-9
    moved = truth.position + np.where(t[:, None] > start + 3.0, 1.0, 0.0)
    off = truth._replace(position=moved)
    assert errors(off, truth, 2.0).horizontal < 1e-9 < 0.1 < errors(off, truth).horizontal
    assert errors(off, truth, 2.0).duration <= 2.0 < end - start


def test_every_crazyflie_has_the_same_parameters():
    params = joint_params('crazyflie')
    assert params.optical_flow.scale == 1.0 and params.sonar.min_range == 0.04
    assert not params.drag.enabled


def test_every_rolling_spider_has_the_noise_that_its_own_flights_show():
    params = joint_params('rolling_spider')
    assert params.motion.accel_noise == EstimatorParams().altitude.accel_noise
    # 12.0 Pa a metre
    assert params.barometer.offset_walk == pytest.approx(BarometerParams().walk / 12.0, rel=0.01)


STEP = 10_000_000  # ns


def hovering(seconds=20.0, position=(0.0, 0.0, 1.0), velocity=(0.0, 0.0, 0.0), rotation=None):
    """Return a flight that stands for 2 s, hovers and stands again for 2 s; z up, no yaw."""
    stamp = np.arange(round(seconds * 100)) * STEP
    t = stamp * 1e-9
    high = np.clip(np.minimum(t - 2.0, seconds - 2.0 - t) / 0.5, 0.0, 1.0)[:, None]
    q = (rotation or Rotation.identity()).as_quat()
    return Odometry(stamp, high * np.array(position), high * np.array(velocity),
                    np.tile(q, (len(t), 1)))


def test_take_off_and_landing_are_those_of_the_height():
    start, end = airborne(hovering())
    assert start == pytest.approx(2.0, abs=0.1) and end == pytest.approx(18.0, abs=0.1)
    aloft = hovering()
    part = Odometry(*(column[500:1500] for column in aloft))
    cut = part._replace(position=part.position + [[0.0, 0.0, 1.0]] * np.sin(
        part.stamp[:, None] * 1e-9))
    assert airborne(cut) == (5.0, 14.99)  # in the air throughout: the ends of the recording


def test_a_constant_offset_and_a_yaw_are_no_errors():
    """Position and yaw are aligned at take-off."""
    truth = hovering()
    t = truth.stamp[:, None] * 1e-9
    path = truth.position + np.hstack([np.sin(t), 0.5 * np.sin(2.0 * t), 0.0 * t]) * (t > 3.0)
    truth = truth._replace(position=path)
    yaw = Rotation.from_euler('z', 1.2)
    moved = Odometry(truth.stamp, yaw.apply(path) + [5.0, -3.0, 0.7], truth.velocity,
                     np.tile(yaw.as_quat(), (len(t), 1)))
    off = errors(moved, truth)
    assert max(off.horizontal, off.drift, off.height, off.velocity, off.tilt) < 1e-6
    assert off.duration == pytest.approx(16.0, abs=0.2)


def test_each_error_is_that_of_its_quantity():
    truth = hovering()
    t = truth.stamp * 1e-9
    late = (t > 3.0)[:, None]
    estimate = truth._replace(position=truth.position + late * [0.03, 0.04, 0.2],
                              velocity=truth.velocity + [0.3, 0.0, 9.0])
    off = errors(estimate, truth)
    share = np.sqrt(np.mean(late[(t >= airborne(truth)[0]) & (t <= airborne(truth)[1])]))
    assert off.horizontal == pytest.approx(0.05 * share, rel=1e-6)
    assert off.drift == pytest.approx(0.05) and off.height == pytest.approx(0.2 * share)
    assert off.velocity == pytest.approx(0.3)  # the vertical component does not count


def test_a_constant_tilt_of_the_markers_is_no_error_but_a_change_is():
    truth = hovering()
    tilted = truth._replace(orientation=np.tile(
        Rotation.from_euler('y', 3.0, degrees=True).as_quat(), (len(truth.stamp), 1)))
    assert errors(tilted, truth).tilt == pytest.approx(0.0, abs=1e-6)
    half = tilted.orientation.copy()
    half[:1000] = truth.orientation[:1000]
    t = truth.stamp * 1e-9
    inside = (t >= airborne(truth)[0]) & (t <= airborne(truth)[1])
    expected = 3.0 * np.sqrt(np.mean(t[inside] >= 10.0))
    found = errors(truth._replace(orientation=half), truth).tilt
    assert found == pytest.approx(expected, rel=0.01)


def test_the_missing_force_is_the_acceleration_of_the_vehicle():
    """A sine of 0.5 Hz along x, level: its amplitude over sqrt 2 is the RMS of window means."""
    truth = hovering(60.0)
    t = truth.stamp * 1e-9
    amplitude, w = 0.05, 2.0 * np.pi * 0.25
    speed = amplitude / w * np.sin(w * t)
    truth = truth._replace(velocity=np.stack([speed, 0.0 * t, 0.0 * t], axis=1))
    density, mean = flights.missing_force(truth)
    # the mean of a second takes sin(pi f)/(pi f) of the amplitude; x alone of two axes
    window = np.sin(np.pi * 0.25) / (np.pi * 0.25)
    assert mean == pytest.approx(amplitude * window / 2.0, rel=0.1)
    assert density > 0.0
    assert flights.missing_force(truth._replace(velocity=2.0 * truth.velocity)) == (
        pytest.approx((2.0 * density, 2.0 * mean), rel=1e-6))


def test_a_tilt_of_the_markers_is_no_missing_force():
    truth = hovering(60.0, rotation=Rotation.from_euler('y', 3.0, degrees=True))
    assert flights.missing_force(truth) == pytest.approx((0.0, 0.0), abs=1e-9)


def identified():
    factor = SimpleNamespace(
        offset=SimpleNamespace(value=0.8), leak=SimpleNamespace(value=0.3),
        fit=SimpleNamespace(rms=0.25))
    return flights.Identified(factor, 0.5, 0.02, 0.004, 0.02, 0.05)


def test_the_identified_sensors_are_those_of_the_estimator():
    params = flights.calibrated_params(identified())
    assert (params.optical_flow.constant, params.optical_flow.rotation_leak) == (0.8, 0.3)
    assert (params.optical_flow.noise, params.sonar.noise) == (0.25, 0.004)
    assert (params.velocity.accel_noise, params.attitude.window_accel_noise) == (0.02, 0.05)
    assert params.optical_flow.min_height == flights.MIN_FLOW_HEIGHT
    assert params.sonar.min_range == flights.MIN_RANGE


def test_the_compared_estimators_differ_as_their_names_say():
    found = flights.variants(identified())
    flow = {name: params.optical_flow for name, params in found.items()}
    assert found['as for the Mambo'] == EstimatorParams()
    assert (flow['Q = 1'].constant, flow['Q = 1'].rotation_leak) == (1.0, 0.0)
    assert (flow['identified Q'].constant, flow['identified Q'].rotation_leak) == (0.8, 0.0)
    assert flow['identified Q and rotation'].rotation_leak == 0.3
    without = flow['the same without height']
    assert without.constant == pytest.approx(0.8 * 0.5) and not without.height_scaling


@pytest.mark.parametrize(('name', 'expected'), [
    ('crazyflie-client_lab02_square__abc.json', 'lab02_square'), ('a__b__c.mat', 'a__b'),
    ('plain.json', 'plain')])
def test_the_name_of_a_recording_lacks_its_repository(name, expected):
    assert flights.recording_name(Path(name)) == expected


def test_the_height_of_the_markers_is_that_of_the_import():
    bag = SimpleNamespace(metadata={'import': {'range_minus_mocap_z_m': '-0.12'}})
    assert flights.range_offset(bag) == 0.12


def test_logs_are_imported_once_each_under_their_names(monkeypatch, tmp_path):
    calls = []
    monkeypatch.setattr(flights, 'import_crazyflie', lambda *args, **options: calls.append(
        (args, options)))
    logs = [Path('crazyflie-client_one__x.json'), Path('two__x.json')]
    found = flights.import_crazyflies(logs, tmp_path, 'zero', 409.0)
    assert found == {'one': tmp_path / 'one_zero_409', 'two': tmp_path / 'two_zero_409'}
    assert [args for args, _ in calls] == [
        (logs[0], found['one'], 409.0), (logs[1], found['two'], 409.0)]
    assert all(options == {'level': True, 'repeated_flow': 'zero'} for _, options in calls)


def test_the_height_error_is_against_the_median_of_the_ranges(monkeypatch):
    """A hover at 1 m with one wild range; the estimate is 5 cm too high, then 2 m at the end."""
    n = 200
    steps = SimpleNamespace(t=np.arange(n) * 10_000_000, sonar=np.full(n, 1.0))
    steps.sonar[100], steps.sonar[:5] = 1.4, 0.0  # an outlier; nothing heard at first
    state = np.zeros((n, 13))
    state[:, 6] = 1.0
    estimator = np.full((n, 2), 1.05)
    estimator[:5, 1] = 2.0  # not compared: no valid range
    monkeypatch.setattr(flights.offline_replay, 'run', lambda found, params: SimpleNamespace(
        state=state, estimator=estimator))
    found = flights._height(steps, None)
    assert found.rms_error == pytest.approx(0.05)
    assert (found.lowest, found.highest) == (1.05, 2.0)


def test_a_replayed_estimate_is_z_up(monkeypatch):
    state = np.array([[1.0, 2.0, -3.0, 0.1, 0.2, -0.3, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]])
    monkeypatch.setattr(flights.offline_replay, 'estimate', lambda bag, params: SimpleNamespace(
        t=np.array([7]), state=state))
    found = flights.replayed(None, None)
    assert found.stamp.tolist() == [7]
    np.testing.assert_allclose(found.position, [[1.0, -2.0, 3.0]])
    np.testing.assert_allclose(found.velocity, [[0.1, -0.2, 0.3]])
    np.testing.assert_allclose(np.abs(found.orientation), [[0.0, 0.0, 0.0, 1.0]])


class OnboardBag(dict):
    attachments = {}

    def __missing__(self, key):
        return key


def test_the_comparison_with_the_onboard_estimate_is_by_quantity(monkeypatch, tmp_path):
    error = SimpleNamespace(
        stamps=np.array([0, 30_000_000_000]), position=np.array([[0.3, 0.4, 0.1]] * 2),
        velocity=np.array([[0.6, 0.8, 9.0]] * 2), attitude=np.array([[3.0, 4.0, 7.0]] * 2))
    monkeypatch.setattr(flights, 'import_minidrone', lambda *args: None)
    monkeypatch.setattr(flights, 'replayed', lambda bag, params: 'ours')
    monkeypatch.setattr(flights, 'align', lambda ours, theirs: error)
    monkeypatch.setattr(flights, 'read_bag', lambda path: OnboardBag())
    assert flights.against_onboard(Path('a.mat'), tmp_path, 20.0) == pytest.approx(
        [30.0, 0.5, 0.1, 1.0, 5.0, 7.0])


def test_a_log_without_a_calibration_has_the_default_parameters():
    assert flights._calibrated_kalman(OnboardBag()) == EstimatorParams()
