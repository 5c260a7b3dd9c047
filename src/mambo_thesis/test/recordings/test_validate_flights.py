"""Errors against motion capture and the onboard estimate, on flights with a known answer."""

from pathlib import Path
from types import SimpleNamespace

from hovering import hovering
from mambo_estimation.kalman import EstimatorParams
from mambo_sim.sensors.barometer import BarometerParams
from mambo_thesis.recordings import validate_flights as flights
from mambo_thesis.recordings.validate_flights import joint_params
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

def test_every_crazyflie_has_the_same_parameters():
    params = joint_params('crazyflie')
    assert params.optical_flow.scale == 1.0 and params.sonar.min_range == 0.04
    assert not params.drag.enabled


def test_every_rolling_spider_has_the_noise_that_its_own_flights_show():
    params = joint_params('rolling_spider')
    assert params.motion.accel_noise == EstimatorParams().altitude.accel_noise
    # 12.0 Pa a metre
    assert params.barometer.offset_walk == pytest.approx(BarometerParams().walk / 12.0, rel=0.01)


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


class OnboardBag(dict):
    attachments = {'scenario.yaml': '{}'}

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
