"""IMU: signs by hand, statistics of what was asked for, resolution, range, vibration."""

import dataclasses

from mambo_model.motion import rigid_body
from mambo_model.motion.quaternion import from_euler
from mambo_model.schema import ParameterError
from mambo_model.vehicle.parameters import Vehicle
from mambo_sim import plant
from mambo_sim.sensors import imu
from mambo_sim.sensors.imu import ImuParams
import numpy as np
import pytest
from scipy.signal import welch

ZERO = (0.0, 0.0, 0.0)
VV = Vehicle().values()
QUIET = ImuParams(
    gyro_noise=ZERO, accel_noise=ZERO, gyro_vibration=ZERO, accel_vibration=ZERO, gyro_bias=ZERO,
    accel_bias=ZERO, gyro_walk=0.0, accel_walk=0.0, gyro_resolution=0.0, accel_resolution=0.0)


def record(params, n, seed=0, load=0.0, omega=ZERO, force=ZERO):
    rng, memory, p = np.random.default_rng(seed), imu.START, params.values()
    gyro, accel = np.empty((n, 3)), np.empty((n, 3))
    for k in range(n):
        memory, sample = imu.step(memory, omega, force, load, rng, True, p)
        gyro[k], accel[k] = sample
    return gyro, accel


def felt(euler, thrust):
    body = rigid_body.State((0.0, 0.0, -1.0), ZERO, from_euler(*euler), ZERO)
    state = plant.PlantState(body, (thrust / 4,) * 4, ZERO)
    return plant.specific_force(state, VV, True)


def test_specific_force_has_no_gravity_in_it():
    assert felt((0.2, 0.3, 0.1), 0.0) == ZERO  # free fall at any attitude
    assert felt((0.0, 0.2, 0.0), 0.068 * 9.81) == pytest.approx((0, 0, -9.81))  # along -b3


def test_resting_nose_up_feels_the_floor_forward():
    # at rest the floor pushes against gravity: R^T (0, 0, -g); nose up: +g sin(theta) forward
    q = from_euler(0.0, 1.2, 0.0)  # lies on its tail, beyond settling
    body = rigid_body.State(ZERO, ZERO, q, ZERO)
    force = plant.specific_force(plant.PlantState(body, (0.0,) * 4, ZERO), VV, True)
    assert force == pytest.approx((9.81 * np.sin(1.2), 0.0, -9.81 * np.cos(1.2)), abs=1e-12)


def test_without_noise_it_reads_the_truth():
    omega, force = (0.1, -0.2, 0.3), (1.0, 2.0, -9.81)
    for params in (QUIET, dataclasses.replace(
            ImuParams(), gyro_resolution=0.0, accel_resolution=0.0)):
        memory, sample = imu.step(
            imu.START, omega, force, 1.0, np.random.default_rng(0), False, params.values())
        assert sample == (omega, force) and memory == imu.START


def test_without_noise_nothing_is_drawn():
    rng = np.random.default_rng(3)
    imu.step(imu.START, ZERO, ZERO, 1.0, rng, False, ImuParams().values())
    assert rng.standard_normal() == np.random.default_rng(3).standard_normal()


def test_white_noise_has_the_standard_deviations_asked_for():
    params = dataclasses.replace(
        QUIET, gyro_noise=(0.001, 0.002, 0.003), accel_noise=(0.01, 0.02, 0.03))
    gyro, accel = record(params, 20000, load=1.0)
    # standard error of a deviation from 20000 samples: 0.5 %
    np.testing.assert_allclose(gyro.std(axis=0), params.gyro_noise, rtol=0.025)
    np.testing.assert_allclose(accel.std(axis=0), params.accel_noise, rtol=0.025)
    assert np.abs(np.corrcoef(np.c_[gyro, accel].T) - np.eye(6)).max() < 0.03
    assert abs(np.corrcoef(gyro[1:, 0], gyro[:-1, 0])[0, 1]) < 0.03


def test_defaults_at_rest_give_the_deviation_of_the_bench_recording():
    gyro, accel = record(dataclasses.replace(
        ImuParams(), gyro_bias=ZERO, accel_bias=ZERO), 20000, force=(0.0, 0.0, -9.81))
    np.testing.assert_allclose(accel.std(axis=0), [0.0165, 0.0153, 0.0216], rtol=0.03)
    np.testing.assert_allclose(gyro.std(axis=0), [0.00065, 0.00072, 0.00069], rtol=0.03)


def test_vibration_scales_with_thrust_and_is_absent_at_rest():
    params = dataclasses.replace(
        QUIET, gyro_vibration=(0.01, 0.02, 0.03), accel_vibration=(1.0, 2.0, 3.0))
    for load in (0.0, 0.5, 1.0):
        gyro, accel = record(params, 20000, load=load)
        np.testing.assert_allclose(gyro.std(axis=0), np.multiply(load, params.gyro_vibration),
                                   rtol=0.03)
        np.testing.assert_allclose(accel.std(axis=0), np.multiply(load, params.accel_vibration),
                                   rtol=0.03)


def test_vibration_lies_above_20_hertz():
    _, accel = record(dataclasses.replace(QUIET, accel_vibration=(1.0, 1.0, 1.0)), 20000, load=1.0)
    f, p = welch(accel[:, 0], 200.0, nperseg=512)
    white = 1.0 / 100.0
    assert p[(f > 2) & (f < 10)].mean() < white / 20 and p[f > 50].mean() > white


def test_bias_is_constant_but_for_its_walk_and_differs_by_seed():
    params = dataclasses.replace(QUIET, gyro_bias=(0.01, 0.02, 0.03), accel_bias=(0.3, 0.2, 0.1))
    first = np.array([record(params, 2, seed) for seed in range(2000)])
    assert (first[:, :, 0] == first[:, :, 1]).all()  # axes: seed, gyro or accel, sample
    # standard error of a deviation from 2000 seeds: 1.6 %
    np.testing.assert_allclose(first[:, 0, 0].std(axis=0), params.gyro_bias, rtol=0.06)
    np.testing.assert_allclose(first[:, 1, 0].std(axis=0), params.accel_bias, rtol=0.06)
    assert np.abs(first[:, 0, 0].mean(axis=0)).max() < 0.003


def test_one_drone_has_one_bias_and_a_little_of_each_flight():
    base = dataclasses.replace(
        QUIET, gyro_bias=(0.01, 0.02, 0.03), accel_bias=(0.3, 0.2, 0.1),
        gyro_turn_on=(0.001, 0.002, 0.003), accel_turn_on=(0.03, 0.02, 0.01))

    def biases(drone, flights):
        params = dataclasses.replace(base, drone=drone)
        return np.array([record(params, 1, seed) for seed in range(flights)])[:, :, 0]

    seven, again, eight = biases(7, 1000), biases(7, 1000), biases(8, 10)
    assert (seven == again).all()
    # standard error of a deviation from 1000 flights: 2.2 %, of their mean 3.2 % of it
    np.testing.assert_allclose(seven[:, 0].std(axis=0), base.gyro_turn_on, rtol=0.08)
    np.testing.assert_allclose(seven[:, 1].std(axis=0), base.accel_turn_on, rtol=0.08)
    assert (np.abs(seven.mean(axis=0) - eight.mean(axis=0)) > 2e-4).all()
    drones = np.array([biases(drone, 1)[0] for drone in range(1, 1001)])
    np.testing.assert_allclose(  # the rest is the flight's, one and the same here
        drones[:, 0].std(axis=0), base.gyro_bias, rtol=0.08)
    np.testing.assert_allclose(drones[:, 1].std(axis=0), base.accel_bias, rtol=0.08)


def test_bias_warms_up_with_its_time_constant():
    params = dataclasses.replace(
        QUIET, gyro_warm_up=(0.01, -0.02, 0.03), accel_warm_up=(0.1, 0.2, -0.3), warm_up_time=0.5)
    gyro, accel = record(params, 601)
    share = 1 - np.exp(-np.arange(601) * 0.005 / 0.5)
    np.testing.assert_allclose(gyro, share[:, None] * params.gyro_warm_up, atol=1e-14)
    np.testing.assert_allclose(accel, share[:, None] * params.accel_warm_up, atol=1e-14)


def test_bias_walks_with_the_square_root_of_time():
    params = dataclasses.replace(QUIET, gyro_walk=0.01, accel_walk=0.1)
    n = 41  # 40 steps of 5 ms: 0.2 s
    ends = np.array([[x[-1] - x[0] for x in record(params, n, seed)] for seed in range(400)])
    # 1200 values each: standard error 2 %
    assert ends[:, 0].std() == pytest.approx(0.01 * np.sqrt(0.2), rel=0.08)
    assert ends[:, 1].std() == pytest.approx(0.1 * np.sqrt(0.2), rel=0.08)


def test_values_are_multiples_of_the_resolution_nearest_to_the_truth():
    params = dataclasses.replace(QUIET, gyro_resolution=0.25, accel_resolution=0.5)
    gyro, accel = record(params, 1, omega=(0.3, -0.3, 0.13), force=(0.74, 0.76, -9.81))
    assert gyro[0].tolist() == [0.25, -0.25, 0.25]
    assert accel[0].tolist() == [0.5, 1.0, -10.0]


def test_values_end_at_the_measuring_range():
    omega, force = (100.0, -100.0, 0.0), (0.0, 50.0, -50.0)
    (gyro,), (accel,) = record(QUIET, 1, omega=omega, force=force)
    quiet = imu.step(
        imu.START, omega, force, 0.0, np.random.default_rng(0), False, QUIET.values())[1]
    for sample in (gyro, accel), quiet:
        assert sample[0] == pytest.approx([np.radians(2000), -np.radians(2000), 0.0])
        assert sample[1] == pytest.approx([0.0, 4 * 9.80665, -4 * 9.80665])


def test_draws_are_those_of_numpy():
    params = dataclasses.replace(ImuParams(), gyro_resolution=0.0, accel_resolution=0.0)
    gyro, accel = record(params, 2, seed=11, load=0.8)
    draw = np.random.default_rng(11).standard_normal((12, 3))
    # each sample: biases, white noise, vibration; gyro before accelerometer
    for out, i, name, start in (
            (gyro, 0, 'gyro', draw[0] * params.gyro_bias),
            (accel, 1, 'accel', draw[1] * params.accel_bias)):
        white, shake = getattr(params, f'{name}_noise'), getattr(params, f'{name}_vibration')
        walked = start + getattr(params, f'{name}_walk') * np.sqrt(0.005) * draw[6 + i]
        k = 0.8 * np.sqrt(0.5) * np.array(shake)
        first = start + white * draw[2 + i] + k * draw[4 + i]
        second = walked + white * draw[8 + i] + k * (draw[10 + i] - draw[4 + i])
        np.testing.assert_allclose(out, [first, second], atol=1e-14)


def test_one_seed_one_stream():
    first, second = record(ImuParams(), 50, seed=7), record(ImuParams(), 50, seed=7)
    assert (first[0] == second[0]).all() and (first[1] == second[1]).all()
    assert (first[0] != record(ImuParams(), 50, seed=8)[0]).any()


def test_out_of_range_parameter_names_itself():
    with pytest.raises(ParameterError, match='^gyro_walk = '):
        ImuParams(gyro_walk=-1.0)
