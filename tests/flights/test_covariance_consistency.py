"""What the estimator says of its own errors is true in flight: neither too sure nor too unsure."""

from mambo_control.safety import REASON_ALIGNMENT, REASON_NONE
from mambo_estimation.alignment import AlignmentParams
from mambo_flight.closed_loop import fly
from mambo_flight.scenario import override, scenario
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

SEEDS = 20
PRIOR = AlignmentParams()
FLOWN = slice(1300, 4200, 100)  # in the air, each 0.5 s


def sloping(path, seed):
    """Return a flight from a floor that slopes as the estimator expects floors to."""
    slope = PRIOR.floor_slope_std * np.random.default_rng(seed).standard_normal(2)
    return override(scenario(path, 'kalman', seed=seed, duration=21.0, land=False), {
        'sim_node.simulator.plant.floor_slope': tuple(slope.tolist())})


def rotation(states):
    return Rotation.from_quat(states[:, [7, 8, 9, 6]])


def nees(flight):
    """Return {quantity: squared error over what is stated for it, mean of a component}."""
    truth, estimate = flight.truth[FLOWN], flight.estimate[FLOWN]
    pose = flight.inner.pose_covariance[FLOWN].reshape(-1, 6, 6)
    twist = flight.inner.twist_covariance[FLOWN].reshape(-1, 6, 6)
    turn = (rotation(truth) * rotation(estimate).inv()).as_rotvec()
    errors = {
        'position': (truth[:, :2] - estimate[:, :2], pose[:, :2, :2]),
        'height': (truth[:, 2:3] - estimate[:, 2:3], pose[:, 2:3, 2:3]),
        'tilt': (turn[:, :2], pose[:, 3:5, 3:5]),
        'velocity': (truth[:, 3:5] - estimate[:, 3:5], twist[:, :2, :2]),
        'climb': (truth[:, 5:6] - estimate[:, 5:6], twist[:, 2:3, 2:3]),
        'rate': (truth[:, 10:] - estimate[:, 10:], twist[:, 3:, 3:])}
    return {name: float(np.mean(np.einsum('ni,nij,nj->n', e, np.linalg.inv(C), e)) / e.shape[1])
            for name, (e, C) in errors.items()}


# 1 is the truth. Of tilt a flight has two independent numbers, slope and bias about each axis:
# the mean of 40 has a deviation of sqrt(2 / 40) = 0.22, and three of them are 0.67. The others
# have more of them, but what is stated of some holds more than these flights show:
BOUNDS = {
    'position': (0.1, 1.67),  # unknown scale and slope of the flow, of which they have one value
    'height': (0.33, 1.67),
    'tilt': (0.33, 1.67),
    'velocity': (0.2, 1.67),  # the same scale and slope
    'climb': (0.1, 1.67),  # accelerations at low frequency of real flights, which here are not
    'rate': (0.4, 1.2)}  # the vibration's differences are 1.5 times those of white noise


@pytest.mark.parametrize('path', ['hover', 'circle', 'vertical_circle'])
@pytest.mark.long
def test_stated_covariances_are_neither_too_small_nor_too_large(path):
    found = [nees(fly(sloping(path, seed), inner=True)) for seed in range(1, SEEDS + 1)]
    for name, (low, high) in BOUNDS.items():
        assert low < np.mean([one[name] for one in found]) < high, name


def noisy(accel, gyro, seed):
    """Return a short flight whose inertial sensors have so much white noise, m/s^2 and rad/s."""
    return override(scenario('circle', 'kalman', seed=seed, duration=8.0, land=False), {
        'sim_node.simulator.imu.accel_noise': (accel,) * 3,
        'sim_node.simulator.imu.gyro_noise': (gyro,) * 3})


@pytest.mark.parametrize('seed', range(1, 21))
def test_ordinary_noise_keeps_no_vehicle_from_aligning_and_flying(seed):
    flight = fly(noisy(0.15, 0.005, seed), inner=True)
    assert flight.status[100] > 0  # 100 samples, none of them in vain
    assert not flight.stopped.any() and (flight.reason == REASON_NONE).all()
    assert np.linalg.norm(flight.truth[:, :3] - flight.estimate[:, :3], axis=1).max() < 0.15


def test_a_vehicle_that_is_shaken_throughout_does_not_take_off():
    flight = fly(noisy(3.0, 0.3, 1), inner=True)
    assert flight.stopped[-1] and flight.reason[-1] == REASON_ALIGNMENT
    assert not flight.pwm[flight.phase > 0].any() and abs(flight.truth[:, 2]).max() < 0.01
