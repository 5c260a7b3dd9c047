"""Bad data does no harm: of each sensor and of all at once, singly and in long runs."""

import math

from estimation_truth import (
    circle, DT, estimate, estimate_with_prior, fly, hover, NAN, QUIET, sense, TYPICAL)
from mambo_estimation import attitude, health, kalman
from mambo_estimation.estimate import STATUS_ALIGNING, STATUS_DEAD_RECKONING
from mambo_estimation.kalman import EstimatorParams
from mambo_estimation.measurements.barometer import BarometerParams
import numpy as np
import pytest

PARAMS = EstimatorParams(barometer=BarometerParams(enabled=True))
TRUTH = fly(circle(), 24.0)
CLEAN = sense(TRUTH, TYPICAL, seed=11)
SENSORS = ('gyro', 'accel', 'sonar', 'flow', 'pressure')
STATE = slice(0, 13 + 72 + 6 + 3)  # state, covariances, biases, status, height, velocity


def spoil(name, kind, where, samples=None, rng=None):
    """Return samples in which the rows ``where`` of one sensor are bad."""
    s = (samples or CLEAN).copy()
    rng = rng or np.random.default_rng(1)
    values = getattr(s, name)
    seen = where & np.isfinite(values.reshape(len(where), -1)).all(axis=1)
    if not seen.any():
        return s
    if kind == 'nan':
        values[seen] = NAN
    elif kind == 'inf':
        values[seen] = math.inf * rng.choice([-1.0, 1.0], values[seen].shape)
    elif kind == 'huge':
        values[seen] = 1e300 * rng.standard_normal(values[seen].shape)
    elif kind == 'wild':
        values[seen] += 50.0 * rng.standard_normal(values[seen].shape)
    elif kind == 'stuck':
        values[seen] = values[seen][0]
    elif kind == 'zero':
        values[seen] = 0.0
    return s


def check(run):
    """No estimate is ever NaN, no covariance asymmetric or negative."""
    assert np.isfinite(run.rows[:, STATE]).all()
    assert np.abs(np.linalg.norm(run.q, axis=1) - 1).max() < 1e-12
    for P in (run.pose_covariance, run.twist_covariance):
        assert np.array_equal(P, P.transpose(0, 2, 1))
        low, high = np.linalg.eigvalsh(P)[:, [0, -1]].T
        assert (low > -1e-12 * high).all()  # rounding of the eigenvalues themselves
        assert (np.diagonal(P, axis1=1, axis2=2) > 0).all()


def between(start, stop):
    return (TRUTH.t >= start) & (TRUTH.t < stop)


KINDS = ('nan', 'inf', 'huge', 'wild', 'stuck', 'zero')


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize('name', SENSORS)
def test_two_bad_seconds_of_one_sensor_do_no_lasting_harm(name, kind):
    run = estimate(spoil(name, kind, between(10.0, 12.0)), PARAMS)
    check(run)
    if (name, kind) == ('gyro', 'wild'):
        return  # no gate can tell a wrong rate within the range: the attitude is lost
    assert np.abs(run.nu - TRUTH.nu)[-600:].max() < 0.25
    assert np.abs(run.height - TRUTH.height)[-600:].max() < 0.06
    # a dead gyro loses the attitude it should have measured: the covariance says so
    error = run.tilt_error(TRUTH)[-600:]
    std = np.sqrt(run.pose_covariance[-600:, 3, 3] + run.pose_covariance[-600:, 4, 4])
    assert (error < np.maximum(4 * std, 0.03)).all() or kind in ('wild', 'zero')
    assert error.max() < 0.2


@pytest.mark.parametrize('name', SENSORS)
@pytest.mark.parametrize('share', [0.02, 0.3])
@pytest.mark.parametrize('kind', ['nan', 'inf', 'wild'])
def test_bad_samples_scattered_over_the_flight_do_no_harm(name, share, kind):
    rng = np.random.default_rng(5)
    if kind == 'wild' and name in ('gyro', 'accel') or share > 0.1 and name == 'gyro':
        pytest.skip('no gate can tell a wrong rate or force within its range')
    run = estimate(spoil(name, kind, rng.random(len(TRUTH.t)) < share), PARAMS)
    check(run)
    assert np.abs(run.nu - TRUTH.nu)[1000:].max() < 0.5
    assert np.abs(run.height - TRUTH.height)[1000:].max() < 0.15


@pytest.mark.parametrize('seed', range(6))
def test_everything_bad_at_once_never_gives_nan(seed):
    rng = np.random.default_rng(seed)
    s = CLEAN.copy()
    for _ in range(40):
        start = rng.uniform(0.0, 23.0)
        where = between(start, start + rng.exponential(0.5))
        s = spoil(rng.choice(SENSORS), rng.choice(KINDS), where, s, rng)
    s.dt[rng.integers(0, len(s.dt), 20)] = rng.choice(
        [NAN, math.inf, -1.0, 0.0, 1e-12, 0.5, 3.0, 1e9], 20)
    s.quality[rng.integers(0, len(s.dt), 200)] = 0
    check(estimate(s, PARAMS))


def test_nothing_but_garbage_never_gives_nan():
    rng = np.random.default_rng(3)
    n = 4000
    s = CLEAN.copy()
    s = type(s)(**{k: v[:n] for k, v in vars(s).items()})
    for name in SENSORS:
        values = getattr(s, name)
        values[:] = rng.choice([NAN, math.inf, -math.inf, 0.0, 1.0, -3.0, 150.0, 1e5, 1e308],
                               values.shape)
    check(estimate(s, PARAMS))


@pytest.mark.parametrize(('name', 'field'), [
    ('sonar', 'invalid_samples'), ('flow', 'invalid_samples'), ('pressure', 'invalid_samples'),
    ('gyro', 'invalid_samples'), ('accel', 'invalid_samples')])
def test_infinite_samples_are_counted(name, field):
    where = between(10.0, 11.0)
    values = getattr(CLEAN, name).reshape(len(where), -1)
    expected = (where & np.isfinite(values).all(axis=1)).sum()
    run = estimate(spoil(name, 'inf', where), PARAMS)
    assert getattr(run, field)[-1] == expected > 10


def test_one_axis_of_flow_alone_is_no_sample():
    s = CLEAN.copy()
    seen = np.flatnonzero(np.isfinite(s.flow[:, 0]))[400:500]
    s.flow[seen, 1] = NAN
    assert estimate(s).invalid_samples[-1] == 100


@pytest.mark.parametrize(('name', 'jump', 'field'), [
    ('sonar', 1.0, 'sonar_refused'), ('flow', 3.0, 'flow_refused'),
    ('pressure', 300.0, 'barometer_refused')])
def test_outliers_are_refused_counted_and_change_nothing(name, jump, field):
    clean, s = estimate(CLEAN, PARAMS), CLEAN.copy()
    values = getattr(s, name)
    seen = np.flatnonzero(np.isfinite(values.reshape(len(values), -1)).all(axis=1))
    hit = seen[seen > 2000][::20]
    values[hit] += jump
    run = estimate(s, PARAMS)
    assert getattr(run, field)[-1] - getattr(clean, field)[-1] == pytest.approx(len(hit), abs=2)
    assert np.abs(run.rho - clean.rho).max() < 0.05
    ratio = getattr(run, {'pressure': 'barometer', 'sonar': 'sonar', 'flow': 'flow'}[name]
                    + '_test_ratio')
    assert (ratio[hit] > 1).all()


def test_flow_without_texture_is_refused():
    s = CLEAN.copy()
    s.quality[2000:] = 0
    run = estimate(s)
    assert run.status[-1] == STATUS_DEAD_RECKONING
    assert run.flow_refused[-1] > 500 and np.isnan(run.flow_test_ratio[2600:]).all()


def test_missing_imu_sample_is_bridged_with_the_one_before():
    s = CLEAN.copy()
    s.gyro[2400:2404], s.accel[2400:2404] = NAN, NAN
    run, clean = estimate(s), estimate(CLEAN)
    assert run.invalid_samples[-1] == 4
    assert (run.omega[2400:2404] == run.omega[2400]).all()
    assert run.tilt_error(TRUTH)[2450] < 0.02
    assert run.pose_covariance[2404, 3, 3] > clean.pose_covariance[2404, 3, 3]


def test_missing_imu_sample_spoils_the_gravity_window_under_way():
    m = estimate(CLEAN).memory
    assert m.attitude.window.time > 0
    nothing = (NAN, (NAN, NAN), 0, NAN, PARAMS.values())
    after, _ = kalman.step(m, DT, (NAN,) * 3, m.accel, *nothing)
    assert after.attitude.window == attitude.NO_WINDOW


def test_gap_in_time_is_integrated_and_makes_the_estimate_uncertain():
    s = CLEAN.copy()
    keep = np.r_[0:2400, 2420:len(s.dt)]  # 0.1 s without any IMU sample
    s = type(s)(**{k: v[keep] for k, v in vars(s).items()})
    s.dt[2400] = 21 * DT
    run, clean = estimate(s), estimate(CLEAN)
    check(run)
    assert np.abs(run.rho[2400] - TRUTH.p[2420])[:2].max() < 0.2
    assert run.twist_covariance[2400, 0, 0] > clean.twist_covariance[2420, 0, 0]
    turned = run.pose_covariance[2400, 3, 3] - run.pose_covariance[2399, 3, 3]
    assert turned > 0.9 * PARAMS.attitude.held_gyro_noise ** 2 * 21 * DT
    assert np.abs(run.nu[-1] - TRUTH.nu[-1]).max() < 0.2


@pytest.mark.parametrize('dt', [NAN, math.inf, -math.inf, -0.005])
def test_step_with_an_impossible_interval_is_ignored_and_counted(dt):
    values = PARAMS.values()
    m = estimate(CLEAN, PARAMS).memory
    sample = ((0.1, 0.2, 0.3), (0.0, 0.0, -9.0), 1.0, (0.3, 0.3), 255, 1e5)
    after, e = kalman.step(m, dt, *sample, values)
    assert after == m._replace(counts=m.counts._replace(invalid=m.counts.invalid + 1))
    assert e.invalid_samples == m.counts.invalid + 1


def test_interval_longer_than_the_longest_gap_moves_the_estimate_only_so_far():
    values = PARAMS.values()
    m = estimate(CLEAN, PARAMS).memory
    sample = (m.gyro, m.accel, NAN, (NAN, NAN), 0, NAN)
    _, far = kalman.step(m, 3600.0, *sample, values)
    _, gap = kalman.step(m, 1.0, *sample, values)
    assert far.state == gap.state and far.invalid_samples == gap.invalid_samples + 1


def test_stuck_imu_is_noticed_in_flight():
    run = estimate(spoil('gyro', 'stuck', between(10.0, 12.0)))
    stuck = run.invalid_samples[2400 - 1]
    assert stuck == pytest.approx(400 - 20, abs=1)
    assert np.degrees(np.sqrt(run.pose_covariance[2399, 3, 3])) > 10


def test_sensors_without_noise_in_hover_are_not_taken_for_stuck():
    run = estimate(sense(fly(hover(), 20.0), QUIET))
    assert run.invalid_samples[-1] == 0


def test_dead_imu_from_the_start_keeps_aligning():
    s = CLEAN.copy()
    s.gyro[:], s.accel[:] = NAN, NAN
    run = estimate(s)
    check(run)
    assert (run.status == STATUS_ALIGNING).all()
    assert run.invalid_samples[-1] == len(s.dt)


def test_estimate_never_jumps_by_more_than_its_covariance_admits():
    s = CLEAN
    for name in ('sonar', 'flow'):
        s = spoil(name, 'nan', between(10.0, 14.0), s)
    run = estimate(s)
    jump = np.abs(np.diff(run.rho, axis=0))
    moved = np.abs(TRUTH.v[1:]) * DT
    std = np.sqrt(np.diagonal(run.pose_covariance, axis1=1, axis2=2)[:-1, :3])
    assert (jump < 5 * std + 2 * moved + 0.01).all()


def corrections(samples):
    """
    Return by how many deviations the aiding samples move position, velocity and attitude.

    What a step would have said without them is the prediction; the deviation is that of its
    covariance, along each inertial axis.
    """
    run, prior = estimate_with_prior(samples, PARAMS)
    check(run)
    R, axes = prior.R.as_matrix(), np.arange(3)
    in_body = prior.twist_covariance[:, :3, :3]
    velocity = np.einsum('nij,njk,nlk->nil', R, in_body, R)[:, axes, axes]
    pose = np.diagonal(prior.pose_covariance, axis1=1, axis2=2)
    turned = (run.R * prior.R.inv()).as_rotvec()
    moved = (run.rho - prior.rho, run.R.apply(run.nu) - prior.R.apply(prior.nu), turned)
    variances = (pose[:, :3], velocity, pose[:, 3:])
    return run, [np.abs(x) / np.sqrt(v) for x, v in zip(moved, variances, strict=True)]


WIDEST = 5.0  # sigma: the widest gate, of the sonar; a gain never exceeds one


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize('name', SENSORS)
def test_no_sample_moves_the_estimate_by_more_than_its_covariance_admits(name, kind):
    _, ratios = corrections(spoil(name, kind, between(10.0, 12.0)))
    for what, ratio in zip(('position', 'velocity', 'attitude'), ratios, strict=True):
        assert ratio.max() <= WIDEST, (what, ratio.max())


@pytest.mark.parametrize('seed', range(8))
def test_nor_do_samples_of_all_sensors_bad_at_once(seed):
    rng, s = np.random.default_rng(seed), CLEAN.copy()
    for _ in range(12):
        start = rng.uniform(2.0, 22.0)
        where = between(start, start + rng.exponential(1.0))
        s = spoil(rng.choice(SENSORS), rng.choice(KINDS), where, s, rng)
    _, ratios = corrections(s)
    assert max(ratio.max() for ratio in ratios) <= WIDEST


ILL = {
    'nan': health.MISSING, 'inf': health.NOT_FINITE, 'huge': health.IMPLAUSIBLE,
    'wild': health.IMPLAUSIBLE, 'stuck': health.STUCK, 'zero': health.IMPLAUSIBLE}
# s: limit of the age, twenty (flow: eight) samples to know a stuck one, and one sample
KNOWN_AFTER = {'gyro': 0.22, 'accel': 0.22, 'sonar': 1.95, 'flow': 0.75, 'pressure': 1.35}
# A rate of zero is what a perfect gyro reads in hover; some wild pressures lie within its noise.
UNKNOWN = {('gyro', 'zero'), ('pressure', 'wild')}


def sick(name, kind):
    """Return what is to be said of a sensor."""
    if name in ('gyro', 'accel') and kind == 'nan':
        return health.NOT_FINITE  # the other half of the message is there
    if kind == 'zero' and name in ('accel', 'pressure'):
        return health.STUCK
    return ILL[kind]


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize('name', SENSORS)
def test_the_estimator_says_which_sensor_is_ill_and_when_it_is_well_again(name, kind):
    run = estimate(spoil(name, kind, between(10.0, 12.0)), PARAMS)
    which, known = SENSORS.index(name), between(10.0 + KNOWN_AFTER[name], 12.0)
    assert np.isin(run.health[between(5.0, 10.0)], health.GOOD).all()
    if (name, kind) not in UNKNOWN:
        assert (run.health[known, which] == sick(name, kind)).all()
    if name not in ('gyro', 'accel'):  # an attitude that is lost makes good flow implausible
        others = [k for k in range(5) if k != which]
        assert (run.health[between(5.0, 24.0)][:, others] <= health.OUT_OF_REACH).all()
    assert (run.health[between(13.2, 24.0), which] == health.GOOD).all()
    if (name, kind) != ('gyro', 'wild'):  # which loses the attitude for longer
        assert (run.health[between(14.0, 24.0)] == health.GOOD).all()


@pytest.mark.parametrize('seed', range(4))
def test_a_sonar_that_reads_anything_within_its_range_moves_the_height_little(seed):
    s, rng = CLEAN.copy(), np.random.default_rng(seed)
    seen = between(10.0, 12.0) & np.isfinite(s.sonar)
    s.sonar[seen] = rng.uniform(0.434, 4.0, seen.sum())
    run = estimate(s, EstimatorParams())
    # three echoes may fit before the sonar is doubted, each off by the gate of 0.16 m at most
    assert np.abs(run.height - TRUTH.height)[between(10.0, 24.0)].max() < 0.5
    assert np.abs(run.nu - TRUTH.nu)[between(14.0, 24.0)].max() < 0.25
    assert run.health[between(11.9, 12.0), health.SONAR].min() == health.IMPLAUSIBLE


@pytest.mark.parametrize('seed', range(4))
def test_a_clean_flight_raises_no_alarm(seed):
    run = estimate(sense(TRUTH, TYPICAL, seed=seed), PARAMS)
    assert (run.health <= health.OUT_OF_REACH).all()
    assert (run.health[:, [0, 1, 2, 4]] == health.GOOD).all()
    assert (run.not_finite == 0).all()


def test_flow_is_expected_only_where_the_floor_is_far_enough():
    run = estimate(CLEAN, PARAMS)
    low = run.height < PARAMS.optical_flow.min_height - 0.05
    assert (run.health[low, health.OPTICAL_FLOW] == health.OUT_OF_REACH).all()
    assert (run.health[between(5.0, 24.0), health.OPTICAL_FLOW] == health.GOOD).all()


def test_a_sensor_that_never_speaks_is_missing():
    s = CLEAN.copy()
    s.sonar[:] = NAN
    run = estimate(s, PARAMS)
    assert (run.health[between(1.1, 24.0), health.SONAR] == health.MISSING).all()
    assert run.age[-1, health.SONAR] == pytest.approx(TRUTH.t[-1], abs=0.01)


def test_inertial_samples_that_do_not_come_are_missing_and_counted_of_both_halves():
    s = spoil('accel', 'nan', between(10.0, 12.0), spoil('gyro', 'nan', between(10.0, 12.0)))
    run = estimate(s, PARAMS)
    assert (run.health[between(10.2, 12.0)][:, :2] == health.MISSING).all()
    assert (run.not_finite[-1] == 0).all()


def test_single_outliers_are_no_illness():
    s = CLEAN.copy()
    seen = np.flatnonzero(np.isfinite(s.sonar))
    s.sonar[seen[::10]] += 2.0
    run = estimate(s, PARAMS)
    assert (run.health[:, health.SONAR] == health.GOOD).all() and run.sonar_refused[-1] > 30


@pytest.mark.parametrize('kind', ['nan', 'stuck'])
def test_the_covariance_grows_while_a_sensor_is_lost(kind):
    clean = estimate(CLEAN, PARAMS)
    last = np.flatnonzero(between(0.0, 14.0))[-1]
    for name, axis in (('flow', 0), ('flow', 1), ('sonar', 2)):
        # the barometer alone holds the height to its own noise: without it
        params = PARAMS if name == 'flow' else EstimatorParams()
        run = estimate(spoil(name, kind, between(10.0, 14.0)), params)
        for P, Q in ((run.pose_covariance, clean.pose_covariance),
                     (run.twist_covariance, clean.twist_covariance)):
            assert P[last, axis, axis] > 4.0 * Q[last, axis, axis]


@pytest.mark.parametrize('h, new, lost, expected_text', [
    (((0,) * 5, (0.0,) * 5, (0,) * 5), (0,) * 5, (0,) * 4, []),
    (((0, 0, 5, 1, 0), (0.0, 0.0, 2.04, 3.0, 0.0), (0,) * 5), (0,) * 5, (0,) * 4,
     ['sonar stuck for 2.0 s']),
    (((0, 0, 0, 2, 0), (0.0, 0.0, 0.0, 3.1, 0.0), (0,) * 5), (0,) * 5, (0,) * 4,
     ['no optical flow for 3.1 s']),
    (((3, 0, 0, 0, 4), (0.5, 0.0, 0.0, 0.0, 1.5), (0,) * 5), (12, 0, 0, 0, 0), (0, 7, 0, 0),
     ['gyro not finite for 0.5 s', 'barometer implausible for 1.5 s',
      'gyro: 12 samples not finite', 'sonar: 7 samples late, repeated or out of order'])])
def test_complaints_name_the_sensor_and_its_trouble(h, new, lost, expected_text):
    assert health.complaints(health.Health(*h), new, lost) == expected_text


def test_without_a_gyro_the_body_rate_becomes_unknown():
    bad = spoil('gyro', 'nan', between(10.0, 10.5))
    variance = estimate(bad, PARAMS).twist_covariance[:, 3, 3]
    t, clean = TRUTH.t, estimate(CLEAN, PARAMS).twist_covariance[:, 3, 3]
    during = (t > 10.0) & (t < 10.5)
    # 20 rad/s^2 times its age
    np.testing.assert_allclose(
        np.sqrt(variance[during]), 20.0 * (t[during] - 10.0 + DT), rtol=0.01, atol=0.03)
    np.testing.assert_array_equal(variance[t < 10.0], clean[t < 10.0])
    assert variance[t > 10.55].max() < 0.01
