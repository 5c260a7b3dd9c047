"""The support package's estimator: its constants, its signs, and what the thesis says of it."""

import math

from estimation_truth import circle, DT, estimate, fly, G, hover, NAN, Noise, QUIET, sense, TYPICAL
from mambo_estimation import health, support_package
from mambo_estimation.estimate import STATUS_ALIGNING, STATUS_DEAD_RECKONING, STATUS_NOMINAL
from mambo_estimation.support_package import ToolboxEstimatorParams
from mambo_model.schema import ParameterError
import numpy as np
import pytest
from scipy.linalg import solve_discrete_are
from scipy.signal import firwin
from scipy.spatial.transform import Rotation

PARAMS = ToolboxEstimatorParams()
V = PARAMS.values()
ZERO, REST = (0.0, 0.0, 0.0), (0.0, 0.0, -G)
NO_FLOW = (NAN, NAN)
UNCALIBRATED = ToolboxEstimatorParams(calibration_samples=0)


def advance(m, samples, params=UNCALIBRATED, gyro=ZERO, accel=REST, flow=NO_FLOW, sonar=NAN,
            pressure=NAN, quality=255, dt=DT):
    """Take so many samples that are all the same; return memory and the last estimate."""
    e = None
    for _ in range(samples):
        m, e = support_package.step(
            m, dt, gyro, accel, sonar, flow, quality, pressure, params.values())
    return m, e


def at_height(height, params=UNCALIBRATED, **changes):
    """Return the memory of an estimator that hovers at a height."""
    m = support_package.initial(params.values())
    return m._replace(altitude=m.altitude._replace(height=height), **changes)


def force_at(phi, theta, psi=0.3):
    """Return what an accelerometer reads at rest, by scipy."""
    R = Rotation.from_euler('ZYX', [psi, theta, phi])
    return tuple(R.inv().apply([0.0, 0.0, -G]))


def test_gains_are_those_of_the_kalman_filters_of_the_package():
    A, C = np.array([[1.0, DT], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    P = solve_discrete_are(A.T, C.T, np.diag([0.0, 0.0005]), np.array([[0.1]]))
    gain = (P @ C.T / (C @ P @ C.T + 0.1))[:, 0]
    # rel: the parameters are given to five digits
    assert (PARAMS.height_gain, PARAMS.climb_gain) == pytest.approx(gain, rel=2e-5)
    P = solve_discrete_are(np.eye(1), np.eye(1), [[0.09]], [[5.0]])[0, 0]
    assert PARAMS.flow_gain == pytest.approx(P / (P + 5.0), rel=2e-5)


def test_accelerometer_filter_is_the_window_design_of_the_package():
    assert support_package.TAPS == pytest.approx(firwin(6, 0.1), abs=1e-15)
    forces = np.random.default_rng(1).standard_normal((6, 3))
    got = support_package.filtered(tuple(map(tuple, forces)))
    assert got == pytest.approx(firwin(6, 0.1) @ forces, abs=1e-15)


def test_mean_of_the_first_samples_is_the_bias_and_gravity_is_none_of_it():
    rng = np.random.default_rng(2)
    m = support_package.initial(PARAMS.values())
    gyro = [0.02, -0.01, 0.015] + 0.001 * rng.standard_normal((100, 3))
    accel = [0.3, -0.15, 0.4 - G] + 0.02 * rng.standard_normal((100, 3))
    for k in range(100):
        assert m.rest.count == k
        m, e = support_package.step(
            m, DT, tuple(gyro[k]), tuple(accel[k]), NAN, NO_FLOW, 0, NAN, V)
        assert (e.status == STATUS_ALIGNING) == (k < 99)
        assert k == 99 or e.state.omega == ZERO
        assert (e.state.rho, e.state.nu, e.state.q) == (ZERO, ZERO, (1.0, 0.0, 0.0, 0.0))
    assert e.gyro_bias == pytest.approx(gyro.mean(axis=0), abs=1e-15)
    assert e.accel_bias == pytest.approx(accel.mean(axis=0) - REST, abs=1e-13)
    _, e = support_package.step(m, DT, tuple(gyro[0]), tuple(accel[0]), NAN, NO_FLOW, 0, NAN, V)
    assert e.state.omega == pytest.approx(gyro[0] - gyro.mean(axis=0), abs=1e-15)


@pytest.mark.parametrize(('axis', 'rate'), [(0, 0.4), (1, -0.3), (2, 0.5)])
def test_each_rate_turns_its_own_angle(axis, rate):
    omega = tuple(rate if i == axis else 0.0 for i in range(3))
    euler = support_package.turned(ZERO, omega, ZERO, 0.01, V)
    assert euler == pytest.approx(tuple(0.01 * x for x in omega), abs=1e-15)


def test_angles_follow_the_body_rate_at_any_attitude():
    euler, omega, dt = (0.4, -0.6, 2.0), (0.7, -0.5, 0.9), 1e-6
    R = Rotation.from_euler('ZYX', euler[::-1]) * Rotation.from_rotvec(np.multiply(dt, omega))
    got = np.subtract(support_package.turned(euler, omega, ZERO, dt, V), euler) / dt
    want = (R.as_euler('ZYX')[::-1] - euler) / dt
    np.testing.assert_allclose(got, want, atol=1e-5)  # the second derivative times dt


@pytest.mark.parametrize(('phi', 'theta'), [(0.3, 0.0), (0.0, 0.3), (-0.2, 0.4)])
def test_specific_force_at_rest_draws_the_angles_to_the_true_ones(phi, theta):
    one = support_package.turned((0.0, 0.0, 0.3), ZERO, force_at(phi, theta), DT, V)
    assert one == pytest.approx((0.001 * phi, 0.001 * theta, 0.3), abs=1e-12)
    euler = (0.0, 0.0, 0.3)
    for _ in range(3000):
        euler = support_package.turned(euler, ZERO, force_at(phi, theta), DT, V)
    # exp(-3) of the error is left: a time constant of 5 s
    assert euler[:2] == pytest.approx((phi * (1 - math.exp(-3)), theta * (1 - math.exp(-3))),
                                      abs=3e-4)


@pytest.mark.parametrize('factor', [0.997, 1.003, 0.0, 3.0])
def test_specific_force_of_another_length_than_gravity_is_not_asked_for_the_attitude(factor):
    force = tuple(factor * x for x in force_at(0.3, -0.2))
    assert support_package.turned((0.1, 0.2, 0.3), ZERO, force, DT, V) == (0.1, 0.2, 0.3)


def test_thrust_in_the_air_is_taken_for_gravity_and_the_tilt_fades():
    # The accelerometer feels thrust and drag only: along b3, whatever the tilt.
    euler = support_package.turned((0.2, 0.0, 0.0), ZERO, REST, DT, V)
    assert euler[0] == pytest.approx(0.2 * (1 - 0.001))


@pytest.mark.parametrize('pitch', [0.5 * math.pi, -0.5 * math.pi, 1.57, 2.0])
def test_nose_straight_up_stays_finite(pitch):
    euler = support_package.turned((0.1, pitch, 0.2), (1.0, 1.0, 1.0), REST, DT, V)
    assert np.isfinite(euler).all() and abs(euler[2] - 0.2) < DT * 2.0 / support_package.NOSE_UP


def test_acceleration_lifts_and_lowers():
    up, _ = advance(at_height(1.0), 200, accel=(0.0, 0.0, -G - 0.5))
    # 1 s at 0.5 m/s^2 by explicit Euler steps; the filter delays by 2.5 samples
    assert up.altitude.climb == pytest.approx(0.5, abs=0.01)
    assert up.altitude.height == pytest.approx(1.25, abs=0.01)
    down, e = advance(at_height(1.0), 100, accel=(0.0, 0.0, -G + 0.5))
    assert down.altitude.climb < -0.2 and e.state.nu[2] > 0.2 and e.state.rho[2] > -1.0
    assert (e.height, e.vertical_velocity) == (down.altitude.height, down.altitude.climb)


def test_one_range_corrects_height_and_climb_by_the_gains():
    m, e = advance(at_height(1.0), 1, sonar=1.1)
    assert m.altitude.height == pytest.approx(1.0 + 0.026241 * 0.1)
    assert m.altitude.climb == pytest.approx(0.069777 * 0.1)
    assert e.sonar_innovation == pytest.approx(0.1)
    assert e.sonar_test_ratio == pytest.approx((0.1 / 0.3) ** 2)


def test_range_is_used_again_until_it_is_too_old():
    m, _ = advance(at_height(1.0), 1, sonar=1.1)
    for k in range(40):
        before = m.altitude
        m, e = advance(m, 1)
        used = m.altitude.height > before.height + DT * before.climb + 1e-6
        assert k == 19 or used == (k < 19)  # 0.1 s, up to rounding
        assert math.isnan(e.sonar_innovation) and math.isnan(e.sonar_test_ratio)


def test_ranges_near_the_floor_and_outliers_are_not_used_and_counted():
    m, _ = advance(at_height(0.3), 5, sonar=0.434)
    assert (m.altitude.height, m.altitude.refused) == (0.3, 5)
    m, e = advance(at_height(1.0), 5, sonar=1.31)
    assert (m.altitude.height, e.sonar_refused) == (1.0, 5) and e.sonar_test_ratio > 1
    m, e = advance(at_height(9.9), 5, sonar=10.1)
    assert (m.altitude.height, e.sonar_refused) == (9.9, 5)


@pytest.mark.parametrize('pressure_too', [True, False])
def test_lost_height_is_found_again_if_sonar_and_pressure_agree_that_it_is_lost(pressure_too):
    params = ToolboxEstimatorParams(calibration_samples=10)
    m, _ = advance(support_package.initial(params.values()), 10, params, pressure=101325.0)
    m = m._replace(altitude=m.altitude._replace(height=3.0))
    m, _ = advance(m, 600, params, sonar=1.5,  # 18 Pa less is 1.5 m
                   pressure=101325.0 - 18.0 if pressure_too else NAN)
    assert m.altitude.height == pytest.approx(1.5 if pressure_too else 3.0, abs=0.05)


def test_pressure_alone_changes_nothing():
    params = ToolboxEstimatorParams(calibration_samples=10)
    m, _ = advance(support_package.initial(params.values()), 10, params, pressure=101325.0)
    m, e = advance(m, 400, params, pressure=101000.0)
    # the specific force, turned by an attitude, is off by its rounding
    assert abs(e.height) < 1e-12 and math.isnan(e.barometer_offset)
    assert math.isnan(e.barometer_innovation) and e.barometer_refused == 0


@pytest.mark.parametrize('height', [0.75, 1.5, 2.5])
def test_flow_is_taken_for_a_velocity_whatever_the_height(height):
    true_speed = 0.6
    flow = (true_speed / height, -true_speed / height)
    m, e = advance(at_height(height), 400, flow=flow)
    assert e.state.nu == pytest.approx((*flow, 0.0), abs=1e-9)
    # too slow by the height, forward and right having their signs
    assert e.state.rho[0] == pytest.approx(2.0 * true_speed / height, rel=0.03)
    assert e.state.rho[1] == -e.state.rho[0]


def test_one_flow_sample_corrects_the_velocity_by_the_gain():
    m, e = advance(at_height(1.0), 1, flow=(0.4, -0.2))
    assert m.velocity.nu == pytest.approx((0.125466 * 0.4, -0.125466 * 0.2))
    assert e.flow_innovation == pytest.approx((0.4, -0.2))
    assert e.flow_test_ratio == pytest.approx((0.4 / 5.0) ** 2)


def test_flow_is_used_again_until_it_is_too_old():
    m, _ = advance(at_height(1.0), 1, flow=(0.4, 0.0))
    for k in range(40):
        before = m.velocity.nu[0]
        m, e = advance(m, 1)
        assert k == 19 or (m.velocity.nu[0] > before) == (k < 19)  # 0.1 s, up to rounding
        assert math.isnan(e.flow_test_ratio)


def test_no_flow_below_the_height_the_thesis_names():
    m, e = advance(at_height(0.39), 50, flow=(1.0, 1.0))
    assert (m.velocity.nu, m.velocity.refused) == ((0.0, 0.0), 50)
    m, e = advance(at_height(0.41), 50, flow=(1.0, 1.0))
    assert m.velocity.nu[0] > 0.9 and e.flow_refused == 0


def test_below_it_the_accelerometer_is_integrated_and_above_a_fifth_of_it():
    push = (1.0, -0.5, -G)
    low, high = advance(at_height(0.3), 200, accel=push), advance(at_height(1.0), 200, accel=push)
    # 1 s at 1 and -0.5 m/s^2, less the 2.5 samples of the filter's delay
    assert low[0].velocity.nu == pytest.approx((1.0, -0.5), rel=0.02)
    assert high[0].velocity.nu == pytest.approx((0.2, -0.1), rel=0.02)
    off = ToolboxEstimatorParams(calibration_samples=0, low_acceleration_gain=0.0)
    assert advance(at_height(0.3, off), 200, off, accel=push)[0].velocity.nu == (0.0, 0.0)


@pytest.mark.parametrize(('phi', 'theta'), [(0.3, 0.0), (0.0, 0.3), (-0.2, 0.4)])
def test_gravity_is_taken_out_of_the_specific_force_at_any_attitude(phi, theta):
    m = at_height(1.0, euler=(phi, theta, 0.3), window=(force_at(phi, theta),) * 6)
    after, e = advance(m, 1, accel=force_at(phi, theta))
    assert after.velocity.nu == pytest.approx((0.0, 0.0), abs=1e-12)
    assert after.altitude.climb == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(('turned', 'used'), [
    ({'gyro': (0.6, 0.0, 0.0)}, True), ({'gyro': (7.5, 0.0, 0.0)}, False),
    ({'gyro': (0.0, -7.5, 0.0)}, False), ({'euler': (0.65, 0.0, 0.0)}, True),
    ({'euler': (0.65, 0.0, 0.0), 'gyro': (0.6, 0.0, 0.0)}, False),
    ({'euler': (0.0, -0.65, 0.0), 'gyro': (0.0, 0.6, 0.0)}, False),
    ({'flow': (5.1, 0.0)}, False), ({'flow': (0.0, -5.1)}, False), ({'quality': 0}, False)])
def test_flow_is_used_when_level_or_calm_and_plausible(turned, used):
    m = at_height(1.0, euler=turned.pop('euler', ZERO))
    accel = force_at(*m.euler)
    m = m._replace(window=(accel,) * 6)
    m, e = advance(m, 1, accel=accel, **{'flow': (0.3, 0.3), **turned})
    assert (m.velocity.nu[0] > 0.03) == used and e.flow_refused == (not used)


def test_nose_to_the_east_flight_ahead_goes_east():
    m, e = advance(at_height(1.0, euler=(0.0, 0.0, 0.5 * math.pi)), 400, flow=(0.5, 0.0))
    assert e.state.rho[:2] == pytest.approx((0.0, e.state.rho[1]), abs=1e-9)
    assert e.state.rho[1] > 0.9


def test_velocity_along_z_belongs_to_climb_and_tilt():
    euler = (0.2, -0.3, 0.7)
    m = at_height(1.0, euler=euler, window=(force_at(*euler),) * 6)
    m = m._replace(altitude=m.altitude._replace(climb=0.4),
                   velocity=m.velocity._replace(nu=(0.5, -0.6)))
    m, e = advance(m, 1, accel=force_at(*euler))
    v = Rotation.from_quat(np.roll(e.state.q, -1)).apply(e.state.nu)
    assert v[2] == pytest.approx(-0.4, abs=1e-9)
    assert m.velocity.position == pytest.approx(DT * v[:2], abs=1e-9)


def test_altitude_and_attitude_are_good_on_a_flight_and_the_circle_is_too_small():
    truth = fly(circle(), 40.0)
    run = estimate(sense(truth, QUIET), PARAMS)
    fly_on = truth.t > 8.0
    # the slant of 5.8 degrees is not taken out: 1.5 m (1/cos - 1) = 8 mm
    assert np.abs(run.height - truth.height)[fly_on].max() < 0.012
    # thrust taken for gravity: 5.8 degrees times weight 0.001 per 5 ms over the angle's 1 rad/s
    # would be 1.2 degrees, were the length of the thrust ever right on the circle
    assert np.degrees(run.tilt_error(truth)[fly_on].max()) < 0.3
    size = [np.ptp(rows[fly_on, i]) for rows in (run.rho, truth.p) for i in (0, 1)]
    factor = 1.5 * 1.06  # h Q of the sensor
    assert np.divide(size[:2], size[2:]) == pytest.approx([1 / factor] * 2, rel=0.01)  # lag


def test_with_the_right_factor_at_one_height_the_estimate_is_good_there():
    params = ToolboxEstimatorParams(flow_to_velocity=1.5 * 1.06)
    truth = fly(circle(), 40.0)
    run = estimate(sense(truth, QUIET), params)
    # 40 ms of lag at 1 m/s, and the slant
    assert np.abs(run.rho - truth.p)[:, :2].max() < 0.06


def test_floor_that_slopes_is_taken_for_a_bias_and_costs_decimetres():
    # Calibrated on a slope of one degree, in the air level: an acceleration that is not there,
    # integrated until there is flow, which takes 40 ms to stop what has become of it.
    truth = fly(hover(), 30.0)
    s = sense(truth, QUIET)
    s.accel[truth.t < 0.5, 0] += G * math.sin(math.radians(1.0))
    run = estimate(s, PARAMS)
    T = truth.t[np.argmax(truth.height > 0.4)] - 0.5
    error = -G * math.sin(math.radians(1.0)) * (0.5 * T * T + 0.04 * T)
    assert error < -0.2
    found = (run.rho - truth.p)[truth.t > 4.0]
    # a fifth of it goes on against the flow: 1.4 mm/s
    np.testing.assert_allclose(found[0, 0], error, rtol=0.1)
    np.testing.assert_allclose(found[:, 0], error, rtol=0.2)
    assert np.abs(found[:, 2]).max() < 0.01
    level = estimate(sense(truth, QUIET), PARAMS)
    assert np.abs(level.rho - truth.p)[:, :2].max() < 1e-3


def test_status_follows_the_sensors():
    truth = fly(hover(), 12.0)
    samples = sense(truth, TYPICAL)
    k = np.arange(len(truth.t))
    samples.flow[(k > 1400) & (k < 1900)] = NAN
    status = estimate(samples, PARAMS).status
    assert (status[:99] == STATUS_ALIGNING).all()
    assert (status[99:400] == STATUS_DEAD_RECKONING).all()  # below 0.4 m
    assert (status[800:1400] == STATUS_NOMINAL).all()
    assert (status[1530:1900] == STATUS_DEAD_RECKONING).all()  # held 0.1 s, then 0.5 s
    assert status[1910] == STATUS_NOMINAL


def garbage(seed, n=3000):
    s = sense(fly(circle(), n * DT), TYPICAL, seed)
    rng = np.random.default_rng(seed)
    for name in ('gyro', 'accel', 'sonar', 'flow', 'pressure'):
        values = getattr(s, name)
        bad = rng.random(values.shape) < rng.choice([0.02, 0.5, 1.0])
        values[bad] = rng.choice(
            [NAN, math.inf, -math.inf, 0.0, 1.0, -3.0, 33.0, -150.0, 1e5, 1e308], bad.sum())
    s.dt[rng.integers(0, n, 20)] = rng.choice(
        [NAN, math.inf, -1.0, 0.0, 1e-12, 0.5, 3.0, 1e9], 20)
    return s


@pytest.mark.parametrize('seed', range(8))
def test_garbage_never_gives_nan(seed):
    run = estimate(garbage(seed), PARAMS)
    assert np.isfinite(run.rows[:, :13 + 72 + 6 + 3]).all()
    assert np.abs(np.linalg.norm(run.q, axis=1) - 1).max() < 1e-12
    assert run.invalid_samples[-1] > 20


@pytest.mark.parametrize('name', ['gyro', 'accel', 'sonar', 'flow', 'pressure'])
@pytest.mark.parametrize('value', [math.inf, NAN])
def test_unreadable_samples_are_counted_and_do_no_harm(name, value):
    truth = fly(circle(), 15.0)
    s = sense(truth, TYPICAL)
    clean = estimate(s, PARAMS)
    values = getattr(s, name)
    seen = np.flatnonzero(np.isfinite(values.reshape(len(values), -1)).all(axis=1))
    hit = seen[seen > 1600][::7]
    values[hit] = value
    run = estimate(s, PARAMS)
    counted = math.isinf(value) or name in ('gyro', 'accel')  # NaN of others: no sample
    assert run.invalid_samples[-1] == (len(hit) if counted else 0)
    assert np.abs(run.rho - clean.rho).max() < 0.05
    assert clean.invalid_samples[-1] == 0


def test_half_a_flow_sample_is_none():
    m, e = advance(at_height(1.0), 3, flow=(0.3, NAN))
    assert (m.velocity.nu, e.invalid_samples) == ((0.0, 0.0), 3)


@pytest.mark.parametrize('dt', [NAN, math.inf, -math.inf, -0.005])
def test_step_with_an_impossible_interval_is_ignored_and_counted(dt):
    m, _ = advance(at_height(1.0), 50, flow=(0.4, 0.1), sonar=1.02)
    after, e = advance(m, 1, gyro=(1.0, 1.0, 1.0), flow=(9.0, 9.0), sonar=2.0, dt=dt)
    assert repr(after) == repr(m._replace(invalid=1)) and e.invalid_samples == 1


def test_long_interval_is_integrated_only_so_far_and_counted():
    m, _ = advance(at_height(1.0), 50, flow=(0.4, 0.1))
    _, far = advance(m, 1, dt=3600.0)
    _, gap = advance(m, 1, dt=1.0)
    assert far.state == gap.state and far.invalid_samples == gap.invalid_samples + 1


def test_missing_imu_sample_is_bridged_with_the_one_before():
    m, _ = advance(at_height(1.0), 5, gyro=(0.1, 0.0, 0.0))
    good, _ = advance(m, 1, gyro=(0.1, 0.0, 0.0))
    held, e = advance(m, 1, gyro=(NAN, 0.0, 0.0))
    assert repr(held._replace(sensors=good.sensors)) == repr(good._replace(invalid=1))
    assert e.state.omega == (0.1, 0.0, 0.0)


def test_nothing_is_claimed_about_the_error():
    run = estimate(sense(fly(hover(), 5.0), TYPICAL), PARAMS)
    assert (run.pose_covariance == 0).all() and (run.twist_covariance == 0).all()


def test_one_step_has_the_same_bits_alone_and_in_a_compiled_loop():
    s = sense(fly(circle(), 8.0), TYPICAL, 3)
    inside = estimate(s, PARAMS)
    m, rows = support_package.initial(PARAMS.values()), []
    for k in range(len(s.dt)):
        m, e = support_package.step(
            m, s.dt[k], tuple(s.gyro[k]), tuple(s.accel[k]), s.sonar[k], tuple(s.flow[k]),
            int(s.quality[k]), s.pressure[k], V)
        rows.append([*e.state.rho, *e.state.nu, *e.state.q, *e.state.omega])
    np.testing.assert_array_equal(rows, inside.rows[:, :13])
    assert repr(m) == repr(inside.memory)


def test_whole_numbers_as_parameters_compile_nothing_anew():
    advance(support_package.initial(UNCALIBRATED.values()), 1)
    known = len(support_package.step.for_python.signatures)
    whole = ToolboxEstimatorParams(calibration_samples=0, flow_to_velocity=2, hold=1)
    advance(support_package.initial(whole.values()), 1, whole)
    assert len(support_package.step.for_python.signatures) == known


@pytest.mark.parametrize(('name', 'value'), [
    ('flow_gain', 1.5), ('attitude_weight', -0.1), ('sonar_gate', 0.0), ('hold', math.nan)])
def test_wrong_parameters_are_named(name, value):
    with pytest.raises(ParameterError, match=name):
        ToolboxEstimatorParams(**{name: value})


def test_noise_of_the_sensors_is_what_the_position_wanders_by():
    truth = fly(hover(), 40.0)
    error = np.array([
        estimate(sense(truth, Noise(flow=0.015), seed), PARAMS).rho[-1, 0] for seed in range(40)])
    # 0.015 m/s, held 25 ms, for 38 s: 0.015 sqrt(38 * 0.025) = 1.5 cm
    assert np.std(error) == pytest.approx(0.0146, rel=0.3)  # 40 flights: 11 % for one sigma


@pytest.mark.parametrize('name, kind, unhealthy', [
    ('gyro', NAN, health.NOT_FINITE), ('accel', math.inf, health.NOT_FINITE),
    ('sonar', NAN, health.MISSING), ('sonar', 3.9, health.IMPLAUSIBLE),
    ('flow', math.inf, health.NOT_FINITE), ('flow', 1e300, health.IMPLAUSIBLE),
    ('pressure', 1e300, health.IMPLAUSIBLE), ('pressure', NAN, health.MISSING)])
def test_it_says_which_sensor_is_unhealthy_and_is_finite_and_well_again(name, kind, unhealthy):
    truth = fly(circle(), 20.0)
    s = sense(truth, TYPICAL, 3)
    values = getattr(s, name)
    struck = (truth.t >= 10.0) & (truth.t < 12.0)
    seen = struck & np.isfinite(values.reshape(len(struck), -1)).all(axis=1)
    values[seen] = kind
    run = estimate(s, PARAMS)
    which = ('gyro', 'accel', 'sonar', 'flow', 'pressure').index(name)
    assert np.isfinite(run.rows[:, :13]).all()
    assert (run.health[(truth.t >= 11.2) & struck, which] == unhealthy).all()
    assert (run.health[truth.t >= 13.0] == health.GOOD).all()


def test_garbage_of_every_sensor_leaves_it_finite():
    rng, s = np.random.default_rng(3), sense(fly(hover(), 10.0), TYPICAL, 3)
    garbage = [NAN, math.inf, -math.inf, 0.0, 1.0, -3.0, 150.0, 1e5, 1e308, -1e308]
    for name in ('gyro', 'accel', 'sonar', 'flow', 'pressure'):
        values = getattr(s, name)
        struck = rng.random(len(values)) < 0.5
        values[struck] = rng.choice(garbage, values[struck].shape)
    run = estimate(s, PARAMS)
    assert np.isfinite(run.rows[:, :13]).all()
    assert math.isfinite(run.memory.rest.pressure)
