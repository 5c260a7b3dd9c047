"""The whole estimator on flights whose truth it does not know."""

import math

from estimation_truth import (
    circle, DT, estimate, fly, hover, NAN, Noise, QUIET, ramp, sense, TYPICAL, vertical_circle)
from mambo_estimation import kalman
from mambo_estimation.alignment import AlignmentParams
from mambo_estimation.attitude import AttitudeParams
from mambo_estimation.estimate import STATUS_ALIGNING, STATUS_DEAD_RECKONING, STATUS_NOMINAL
from mambo_estimation.kalman import EstimatorParams
from mambo_estimation.measurements.barometer import BarometerParams
from mambo_estimation.measurements.optical_flow import FlowParams
from mambo_model import schema
import numpy as np
import pytest
from scipy.stats import chi2

FLIGHTS = {
    'circle': (circle(1.0), 5.8, 0.4), 'circle at double speed': (circle(2.0), 22.0, 0.6),
    'vertical circle': (vertical_circle(), 5.8, 0.4)}


def rms(x):
    return np.sqrt(np.mean(np.square(x), axis=0))


def in_the_air(truth):
    return truth.t > 3.0


@pytest.mark.parametrize('name', FLIGHTS)
@pytest.mark.parametrize('drag', [0.0, 0.54])
def test_tilt_is_known_to_a_fraction_of_a_degree_while_the_accelerometer_shows_none_of_it(
        name, drag):
    path, tilt, bound = FLIGHTS[name]
    truth = fly(path, 40.0, drag=drag)
    true_tilt = np.degrees(np.arccos(truth.tilt_cos))
    if not drag:
        assert true_tilt[-2000:].max() == pytest.approx(tilt, abs=1.5)
        assert np.abs(truth.specific_force[:, :2]).max() < 1e-9  # thrust only
    run = estimate(sense(truth, TYPICAL, seed=1))
    error = np.degrees(run.tilt_error(truth))[in_the_air(truth)]
    # of this the share of the accelerometer bias that goes to the floor's slope is 0.15 deg
    assert rms(error) < bound and error.max() < 1.5 * bound


@pytest.mark.parametrize('path', [circle(), circle(2.0), vertical_circle(), vertical_circle(2.0)])
def test_perfect_sensors_give_the_truth(path):
    truth = fly(path, 30.0)
    run = estimate(sense(truth, QUIET))
    fly_on = in_the_air(truth)
    # height and vertical velocity: 3 cm/s are lost until the rest is left, then found again
    np.testing.assert_allclose(run.rho[fly_on], truth.p[fly_on], atol=0.01)
    np.testing.assert_allclose(run.nu[fly_on], truth.nu[fly_on], atol=0.02)
    assert run.tilt_error(truth).max() < 4e-4
    np.testing.assert_allclose(run.omega[fly_on], truth.omega[fly_on], atol=2e-4)


@pytest.mark.parametrize('name', FLIGHTS)
def test_position_and_velocity_are_good_where_the_factor_is_right(name):
    truth = fly(FLIGHTS[name][0], 40.0)
    run = estimate(sense(truth, TYPICAL, seed=2))
    fly_on = in_the_air(truth)
    assert (rms((run.nu - truth.nu)[fly_on]) < 0.05).all()
    assert (rms((run.rho - truth.p)[fly_on]) < [0.15, 0.15, 0.02]).all()


def per_period(samples, truth, params=None):
    run = estimate(samples, params)
    start, periods = 1800, 4
    stop = start + round(periods * 2 * math.pi / DT)
    error = run.rho - truth.p
    return (error[stop] - error[start]) / periods


def test_factor_that_rises_with_height_makes_the_vertical_circle_drift_as_in_the_thesis():
    truth = fly(vertical_circle(), 36.0)
    rising = sense(truth, Noise(scale=1.025, slope=0.07))
    # equations.md, drift row A: 0.233 m per period, clipped to 0.5..2.5 m as here by the path
    assert per_period(rising, truth) == pytest.approx([0.233, 0.0, 0.0], abs=0.006)
    linear = EstimatorParams(optical_flow=FlowParams(factor='linear'))
    assert per_period(rising, truth, linear) == pytest.approx([0.0, 0.0, 0.0], abs=0.006)


def test_level_circle_does_not_drift_with_a_wrong_factor():
    truth = fly(circle(), 36.0)
    drift = per_period(sense(truth, Noise(scale=1.025, slope=0.07)), truth)
    assert drift == pytest.approx([0.0, 0.0, 0.0], abs=0.006)


def test_rotation_left_in_by_the_sensor_is_taken_out_where_it_is_declared():
    truth = fly(vertical_circle(), 36.0)
    # times Q h: the rotation once; what is taken out is the rate without the gyro's bias
    leaking = sense(truth, Noise(leak=1.0 / 1.06, gyro_bias=(0.05, -0.05, 0.0)))
    # equations.md, drift row D1: -0.320 m per period; the accelerometer, which contradicts,
    # takes a part of it away
    assert -0.32 < per_period(leaking, truth)[0] < -0.28
    declared = EstimatorParams(optical_flow=FlowParams(rotation_leak=1.0 / 1.06))
    assert per_period(leaking, truth, declared)[0] == pytest.approx(0.0, abs=0.006)


def test_published_covariance_covers_the_drift_of_the_vertical_circle_and_is_small_on_the_level():
    truth = fly(vertical_circle(), 40.0)
    run = estimate(sense(truth, Noise(scale=1.025, slope=0.07)))
    std = np.sqrt(run.pose_covariance[:, 0, 0])
    error = np.abs(run.rho - truth.p)[:, 0]
    assert error[-1] > 1.0 and (error[2000:] < 2.0 * std[2000:]).all()
    level = estimate(sense(fly(circle(), 40.0), Noise(scale=1.025, slope=0.07)))
    assert np.sqrt(level.pose_covariance[-1, 0, 0]) < 0.2


def believed_noise(rng, params):
    """Draw sensors as bad as the parameters say."""
    flow, v = params.optical_flow, params
    return Noise(
        gyro=v.attitude.gyro_noise / math.sqrt(DT), accel=0.05, sonar=v.sonar.noise,
        flow=flow.noise, gyro_bias=tuple(0.02 * rng.standard_normal(3)),
        accel_bias=tuple(np.array([0.3, 0.3, 0.4]) * rng.standard_normal(3)),
        scale=flow.constant * (1 + flow.scale_std * rng.standard_normal()),
        slope=flow.constant * flow.slope_std * rng.standard_normal())


@pytest.mark.parametrize('name', FLIGHTS)
def test_published_covariances_are_honest(name):
    params, seeds = EstimatorParams(), 40
    truth = fly(FLIGHTS[name][0], 30.0)
    nees = {'pose': 0.0, 'velocity': 0.0}
    for seed in range(seeds):
        rng = np.random.default_rng(500 + seed)
        run = estimate(sense(truth, believed_noise(rng, params), seed))
        e = np.concatenate([(truth.p - run.rho)[-1], run.rotation_error(truth)[-1]])
        nees['pose'] += e @ np.linalg.solve(run.pose_covariance[-1], e)
        e = (truth.nu - run.nu)[-1]
        nees['velocity'] += e @ np.linalg.solve(run.twist_covariance[-1, :3, :3], e)
    # Never too sure: a consistent filter exceeds the upper bound with a probability of 0.05 %.
    # Being too careful (wide tilt, vertical noise of real flights) is allowed, by a factor 5.
    assert 6 * seeds / 5 < nees['pose'] < chi2.ppf(0.9995, 6 * seeds)
    assert 3 * seeds / 5 < nees['velocity'] < chi2.ppf(0.9995, 3 * seeds)


def test_an_error_of_the_yaw_turns_the_path_as_the_covariance_says():
    truth = fly(
        lambda t: np.stack([4 * ramp(t, 6, 8), 0 * t, -1.5 * ramp(t, 1, 3)], axis=-1), 14.0)
    samples = sense(truth, QUIET)
    samples.gyro[150:, 2] += 0.01  # turns right in belief alone
    run = estimate(samples)
    position, yaw = (truth.p - run.rho)[-1], run.rotation_error(truth)[-1, 2]
    P = run.pose_covariance[-1]
    assert yaw == pytest.approx(-0.01 * 13.25, rel=0.01)
    assert position[1] < -0.3
    # the filter expects noise besides a bias, hence more of the error earlier
    assert P[1, 5] / P[5, 5] * yaw == pytest.approx(position[1], rel=0.25)


def test_covariances_are_in_the_axes_that_odometry_wants():
    # Nose to the east, flown to the north and back: the flow's scale error is along body -y and
    # inertial x.
    truth = fly(
        lambda t: np.stack([2 * ramp(t, 6, 8), 0 * t, -1.5 * ramp(t, 1, 3)], axis=-1), 10.5,
        yaw=lambda t: 0.5 * math.pi * ramp(t, 3, 3))
    run = estimate(sense(truth, QUIET))
    pose, twist = run.pose_covariance[-1], run.twist_covariance[-1]
    assert run.nu[-1, 1] == pytest.approx(-truth.v[-1, 0], abs=0.02)
    assert twist[1, 1] > 1.5 * twist[0, 0]
    assert pose[0, 0] > 1.2 * pose[1, 1]


def test_rotation_block_is_about_inertial_axes():
    # Only the gyro about body z is uncertain; held nose up by 90 degrees it turns about north.
    params = EstimatorParams(
        alignment=AlignmentParams(samples=0), attitude=AttitudeParams(initial_gyro_bias_std=1e-6))
    m = kalman.initial(params.values())
    q = (math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0)
    att = m.attitude._replace(
        q=q, P_bb=((1e-12, 0.0, 0.0), (0.0, 1e-12, 0.0), (0.0, 0.0, 1.0)),
        P_rr=((1e-8, 0.0, 0.0), (0.0, 1e-8, 0.0), (0.0, 0.0, 1e-8)), hidden=0.0)
    m = m._replace(aligning=False, attitude=att)
    _, e = kalman.step(
        m, 0.01, (0.0, 0.0, 0.0), (9.81, 0.0, 0.0), NAN, (NAN, NAN), 0, NAN, params.values())
    P = np.reshape(e.pose_covariance, (6, 6))
    assert P[3, 3] == pytest.approx(1e-4, rel=0.01)  # body z is along north
    assert P[4, 4] < 1e-6 and P[5, 5] < 1e-6


@pytest.mark.parametrize('name', FLIGHTS)
def test_covariances_are_symmetric_and_positive_at_every_step(name):
    run = estimate(sense(fly(FLIGHTS[name][0], 20.0), TYPICAL, seed=4))
    for P in (run.pose_covariance, run.twist_covariance):
        assert np.array_equal(P, P.transpose(0, 2, 1))
        low, high = np.linalg.eigvalsh(P)[:, [0, -1]].T
        assert (low > -1e-13 * high).all()  # rounding of the eigenvalues themselves


def test_estimate_is_the_initial_one_while_aligning_and_the_status_follows_the_sensors():
    truth = fly(hover(), 12.0)
    samples = sense(truth, TYPICAL)
    k = np.arange(len(truth.t))
    samples.flow[(k > 1400) & (k < 1900)] = NAN
    run = estimate(samples)
    status = run.status
    assert (status[:99] == STATUS_ALIGNING).all()
    assert (run.rows[:99, :6] == 0.0).all() and (run.omega[:99] == 0.0).all()
    assert (status[99:400] == STATUS_DEAD_RECKONING).all()  # below 0.4 m
    assert (status[800:1400] == STATUS_NOMINAL).all()
    assert (status[1510:1900] == STATUS_DEAD_RECKONING).all()  # 0.5 s later
    assert status[1910] == STATUS_NOMINAL
    std = np.sqrt(run.twist_covariance[:, 0, 0])
    assert std[1900] > 4 * std[1400] > 0 and std[1950] < 2 * std[1400]


def test_specific_force_is_integrated_by_the_trapezoidal_rule():
    m = kalman.initial(EstimatorParams(alignment=AlignmentParams(samples=0)).values())
    m = m._replace(aligning=False)
    nothing = (NAN, (NAN, NAN), 0, NAN, EstimatorParams().values())
    _, e = kalman.step(m, 0.01, (0.0, 0.0, 0.0), (1.0, 0.0, -11.81), *nothing)
    assert e.state.nu == pytest.approx((0.005, 0.0, -0.01), abs=1e-15)
    assert e.state.rho == pytest.approx((0.000025, 0.0, -0.00005), abs=1e-15)


def test_gyro_bias_is_that_of_the_first_samples():
    truth = fly(hover(), 5.0)
    run = estimate(sense(truth, TYPICAL))
    # mean of 100 samples: 2e-4 rad/s, four of them
    np.testing.assert_allclose(run.gyro_bias[150], TYPICAL.gyro_bias, atol=8e-4)
    np.testing.assert_allclose(run.accel_bias[150], TYPICAL.accel_bias, atol=0.05)


def test_gyro_bias_that_changes_in_flight_is_recovered_about_the_horizontal_axes():
    truth = fly(circle(), 60.0)
    samples = sense(truth, TYPICAL, seed=3)
    samples.gyro[2000:] += [0.005, -0.004, 0.0]
    params = EstimatorParams(attitude=AttitudeParams(gyro_bias_walk=2e-4))
    run = estimate(samples, params)
    np.testing.assert_allclose(
        run.gyro_bias[-1, :2], np.array(TYPICAL.gyro_bias[:2]) + [0.005, -0.004], atol=1.5e-3)
    assert np.degrees(run.tilt_error(truth)[-2000:]).max() < 1.0


def test_vehicle_that_moves_while_aligning_starts_with_the_defaults_and_converges():
    def path(t):  # up within a second, at once
        height = np.stack([0.0 * t, 0.0 * t, ramp(t, 1.0, 3.0) - ramp(t, 0.05, 0.8)], axis=-1)
        return circle()(t) + 1.5 * height

    truth = fly(path, 30.0)
    impatient = EstimatorParams(alignment=AlignmentParams(patience=0.2))
    calibrated = EstimatorParams(alignment=AlignmentParams(
        patience=0.2, gyro_bias=(0.021, -0.009, 0.016), accel_bias=(0.28, -0.12, 0.35)))
    for params, tilt in ((impatient, 2.5), (calibrated, 0.7)):
        run = estimate(sense(truth, TYPICAL, seed=3), params)
        aligning = run.status == STATUS_ALIGNING
        assert 10 < aligning.sum() < 100
        assert np.degrees(np.sqrt(run.pose_covariance[aligning.sum(), 3, 3])) > 5
        # what stays is the accelerometer bias over g: 2 deg, or what calibration left of it
        assert np.degrees(run.tilt_error(truth)[-1]) < tilt
        np.testing.assert_allclose(run.gyro_bias[-1, :2], TYPICAL.gyro_bias[:2], atol=3e-3)
        assert np.abs(run.nu[-1] - truth.nu[-1]).max() < 0.1  # tilt times speed in nu_3


def test_resting_vehicle_does_not_drift():
    truth = fly(hover(takeoff=70.0), 60.0)
    run = estimate(sense(truth, TYPICAL, seed=5))
    assert np.abs(run.rho).max() < 0.01 and np.abs(run.nu).max() < 0.01
    assert np.degrees(np.sqrt(run.pose_covariance[-1, 5, 5])) < 1.0


def test_rest_ends_with_the_take_off_and_little_is_lost_by_noticing_late():
    truth = fly(hover(takeoff=3.0), 6.0)
    run = estimate(sense(truth, TYPICAL, seed=5))
    before_sonar = (truth.t > 3.2) & (truth.height < 0.4)
    assert np.abs(run.height - truth.height)[before_sonar].max() < 0.05


def test_attitude_without_flow_survives_on_the_gyro_and_a_little_gravity():
    truth = fly(circle(2.0), 60.0)
    samples = sense(truth, TYPICAL, seed=6)
    samples.flow[:] = NAN
    error = np.degrees(estimate(samples).tilt_error(truth))[in_the_air(truth)]
    assert rms(error) < 1.0


def test_large_tilt_error_is_found_and_forgotten():
    truth = fly(circle(), 30.0)
    params = EstimatorParams(alignment=AlignmentParams(samples=0, gyro_bias=TYPICAL.gyro_bias))
    samples = sense(truth, TYPICAL, seed=7)
    start = kalman.initial(params.values())
    wrong = start.attitude._replace(q=(math.cos(0.15), math.sin(0.15), 0.0, 0.0))  # 17 deg
    memory = start._replace(aligning=False, attitude=wrong)
    run = estimate(samples, params, memory)
    error = np.degrees(run.tilt_error(truth))
    assert error[10] > 16 and error[-2000:].max() < 3.0


@pytest.mark.parametrize(('factor', 'law'), [
    ('constant', lambda h: 1.06), ('linear', lambda h: 0.92 + 0.07 * h),
    ('exponential', lambda h: 0.95 + 0.011 * math.exp(h))])
@pytest.mark.parametrize('height', [0.75, 1.5, 2.5])
def test_each_law_of_the_factor_measures_the_speed_at_each_height(factor, law, height):
    def path(t):
        return np.stack([0.8 * (t - 6) * ramp(t, 6, 2), 0 * t, -height * ramp(t, 1, 3)], axis=-1)

    truth = fly(path, 14.0)
    params = EstimatorParams(optical_flow=FlowParams(factor=factor))
    run = estimate(sense(truth, Noise(scale=law(height))), params)
    assert run.nu[-1, 0] == pytest.approx(truth.nu[-1, 0], abs=0.01)


def test_barometer_is_used_where_it_is_enabled():
    truth = fly(hover(), 20.0)
    samples = sense(truth, TYPICAL, seed=8)
    off = estimate(samples)
    assert np.isnan(off.barometer_offset).all() and np.isnan(off.barometer_innovation).all()
    on = estimate(samples, EstimatorParams(barometer=BarometerParams(enabled=True)))
    assert on.barometer_offset[-1] == pytest.approx(120.0, abs=0.5)
    seen = ~np.isnan(on.barometer_innovation)
    assert seen.sum() > 1000 and (on.barometer_test_ratio[seen] >= 0).all()


def test_height_scaling_can_be_switched_off():
    truth = fly(circle(), 20.0)
    samples = sense(truth, QUIET)
    params = EstimatorParams(optical_flow=FlowParams(height_scaling=False, constant=1.59))
    run = estimate(samples, params)  # at 1.5 m the multiplier of the thesis is h Q = 1.59
    level = truth.t > 9
    assert rms((run.nu - truth.nu)[level, :2]).max() < 0.02


def test_parameters_nest_and_refuse_a_wrong_one_by_name():
    values = EstimatorParams().values()
    assert values.optical_flow.constant == 1.06 and values.attitude.window == 1.0
    flat = schema.flatten(EstimatorParams())
    assert flat['sonar.max_range'] == 4.0
    built = schema.build(EstimatorParams, {'optical_flow': {'factor': 'linear'}})
    assert built.values().optical_flow.factor == 1
    with pytest.raises(schema.ParameterError, match='altitude.*accel_noise'):
        schema.build(EstimatorParams, {'altitude': {'accel_noise': -1.0}})
