"""Altitude filter against a textbook Kalman filter, chi-square bounds and sensors that fail."""

import math

from estimation_truth import DT
from mambo_estimation import altitude, gate
from mambo_estimation.altitude import AltitudeParams, Covariance
from mambo_estimation.measurements.barometer import BarometerParams, predict as pressure_of
from mambo_estimation.measurements.sonar import SonarParams
from mambo_model.compiled import jit
import numpy as np
import pytest
from scipy.stats import chi2

V = AltitudeParams().values()
SONAR = SonarParams().values()
BARO = BarometerParams(enabled=True).values()
UPPER = np.triu_indices(4)


def matrix(P):
    full = np.zeros((4, 4))
    full[UPPER] = P
    return full + np.triu(full, 1).T


def random_filter(seed, height=1.5):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(4, 4)) * np.array([0.05, 0.1, 0.1, 1.0])[:, None]
    P = A @ A.T
    return altitude.Altitude(
        height, 0.2, 0.05, 100.0, True, Covariance(*P[UPPER].tolist()), 1.0), P


def mean(a):
    return np.array([a.height, a.velocity, a.accel_bias, a.offset])


def predict(a, specific_up, tilt_cos, dt=DT, held=False):
    """Predict from the upward acceleration as measured, bias along body z (down) included."""
    return altitude.predict(
        a, specific_up + tilt_cos * a.accel_bias, tilt_cos, dt, held, BARO.offset_walk, V)


def test_climbing_by_hand():
    a = altitude.start(1e-4, 0.1, V)
    for _ in range(200):
        a = predict(a, 2.0, 1.0)  # 2 m/s^2 upward for 1 s
    assert (a.height, a.velocity) == pytest.approx((1.0, 2.0))


@pytest.mark.parametrize('seed', range(3))
@pytest.mark.parametrize('dt', [DT, 0.1])
def test_covariance_moves_as_the_error_does(seed, dt):
    a, P = random_filter(seed)
    c, eps = 0.9, 1e-6

    def moved(d):
        return mean(predict(altitude.Altitude(
            *(mean(a) + d).tolist(), True, a.P, 1.0), 0.7, c, dt))

    F = np.stack([(moved(d) - moved(-d)) / (2 * eps) for d in eps * np.eye(4)], 1)
    q = V.accel_noise ** 2
    Q = np.zeros((4, 4))
    Q[:2, :2] = q * np.array([[dt ** 3 / 3, dt ** 2 / 2], [dt ** 2 / 2, dt]])
    Q[2, 2] = (1 - math.exp(-2 * dt / V.accel_bias_time)) * V.accel_bias_std ** 2
    Q[3, 3] = BARO.offset_walk ** 2 * dt
    # differences of a linear function: rounding of 100 m over eps, 1e-8
    np.testing.assert_allclose(
        matrix(predict(a, 0.7, c, dt).P), F @ P @ F.T + Q, rtol=1e-6, atol=1e-8)


def textbook(a, P, H, innovation, noise):
    K = P @ H / (H @ P @ H + noise)
    keep = np.eye(4) - np.outer(K, H)
    return mean(a) + K * innovation, keep @ P @ keep.T + noise * np.outer(K, K)


@pytest.mark.parametrize('seed', range(3))
def test_sonar_update_is_the_textbook_filter_with_the_range_made_upright(seed):
    a, P = random_filter(seed)
    c = math.cos(0.3)
    after, _, result = altitude.update_sonar(a, gate.OPEN, 1.6 / c, c, 0.0, SONAR, V)
    x, expected = textbook(a, P, np.array([1.0, 0, 0, 0]), 0.1, (SONAR.noise * c) ** 2)
    assert result.innovation == pytest.approx(0.1) and result.used
    np.testing.assert_allclose(mean(after), x, rtol=1e-12)
    np.testing.assert_allclose(matrix(after.P), expected, atol=1e-12)
    S = P[0, 0] + (SONAR.noise * c) ** 2
    assert result.ratio == pytest.approx(0.01 / S / SONAR.gate ** 2)


@pytest.mark.parametrize('seed', range(3))
def test_barometer_update_is_the_textbook_filter(seed):
    a, P = random_filter(seed)
    after, _, result = altitude.update_barometer(
        a, gate.OPEN, pressure_of(1.5 + 100.0 + 0.3)[0], BARO)
    x, expected = textbook(a, P, np.array([1.0, 0, 0, 1.0]), 0.3, BARO.noise ** 2)
    assert result.innovation == pytest.approx(0.3, abs=1e-8)
    np.testing.assert_allclose(mean(after), x, rtol=1e-8)  # height by pressure and back: 1e-9 m
    np.testing.assert_allclose(matrix(after.P), expected, atol=1e-12)
    S = P[0, 0] + 2 * P[0, 3] + P[3, 3] + BARO.noise ** 2
    assert result.ratio == pytest.approx(0.09 / S / BARO.gate ** 2, rel=1e-6)


def test_first_pressure_sets_the_offset_and_its_correlation_with_the_height():
    a = altitude.start(1e-4, 0.1, V)
    after, _, _ = altitude.update_barometer(a, gate.OPEN, pressure_of(57.0)[0], BARO)
    assert after.offset == pytest.approx(57.0) and after.has_offset
    P = matrix(after.P)
    total = P[0, 0] + 2 * P[0, 3] + P[3, 3]  # variance of height plus offset: the reading alone
    assert total == pytest.approx(BARO.noise ** 2)


@jit
def fly_altitude(a, up, tilt_cos, ranges, sonar_values, v, out):
    """Run the filter; rows of out: height, velocity, bias, 10 of P, innovation, ratio, used."""
    g = gate.OPEN
    for k in range(up.shape[0]):
        a = altitude.predict(
            a, up[k] + tilt_cos[k] * a.accel_bias, tilt_cos[k], 0.005, False, 0.0, v)
        g = gate.advance(g, 0.005)
        out[k, 13:] = np.nan
        if not np.isnan(ranges[k]):
            a, g, r = altitude.update_sonar(a, g, ranges[k], tilt_cos[k], 0.0, sonar_values, v)
            out[k, 13], out[k, 14], out[k, 15] = r.innovation, r.ratio, 1.0 if r.used else 0.0
        out[k, 0], out[k, 1], out[k, 2] = a.height, a.velocity, a.accel_bias
        i = 3
        for p in a.P:
            out[k, i] = p
            i += 1
    return a, g


def simulate(seed, n=4000, amplitude=0.5):
    """Return truth (h, w, b) and measurements of a bobbing, tilting vehicle, noise as believed."""
    rng = np.random.default_rng(seed)
    t = DT * np.arange(1, n + 1)
    h, w = 1.5 - amplitude * np.cos(t), amplitude * np.sin(t)
    c = np.cos(0.3 * np.sin(0.7 * t))
    keep = math.exp(-DT / V.accel_bias_time)
    bias = np.empty(n)
    x = V.accel_bias_std * rng.standard_normal()
    for k in range(n):
        x = keep * x + V.accel_bias_std * math.sqrt(1 - keep ** 2) * rng.standard_normal()
        bias[k] = x
    mid = amplitude * np.cos(t - DT / 2)  # mean over the step to second order
    noise = V.accel_noise / math.sqrt(DT)
    up = mid - c * bias + noise * rng.standard_normal(n)
    ranges = h / c + SONAR.noise * rng.standard_normal(n)
    ranges[np.arange(n) % 9 != 4] = np.nan
    error = 0.1 * rng.standard_normal(2)
    start = altitude.Altitude(
        float(h[0] - error[0]), float(w[0] - error[1]), 0.0, 0.0, False,
        Covariance(0.01, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0, V.accel_bias_std ** 2, 0.0, 0.0), 1.0)
    return np.stack([h, w, bias], 1), up, c, ranges, start


def run(up, c, ranges, start):
    out = np.empty((len(up), 16))
    memory = fly_altitude(start, up, c, ranges, SONAR, V, out)
    return out, memory


def test_errors_and_innovations_are_as_large_as_the_filter_says():
    seeds, nees, nis, samples = 100, 0.0, 0.0, 0
    for seed in range(seeds):
        truth, up, c, ranges, start = simulate(seed)
        out, _ = run(up, c, ranges, start)
        e = truth[-1] - out[-1, :3]
        P = matrix(out[-1, 3:13])[:3, :3]
        nees += e @ np.linalg.solve(P, e)
        seen = ~np.isnan(out[:, 14])
        nis += (out[seen, 14] * SONAR.gate ** 2).sum()
        samples += seen.sum()
    # a consistent filter is outside with a probability of 0.1 % each
    low, high = chi2.ppf([0.0005, 0.9995], 3 * seeds)
    assert low < nees < high
    low, high = chi2.ppf([0.0005, 0.9995], samples)
    assert low < nis < high


def test_height_of_a_tilting_vehicle_is_upright():
    truth, up, c, ranges, start = simulate(7)
    out, _ = run(up, c, ranges, start)
    assert np.abs(out[1000:, 0] - truth[1000:, 0]).max() < 0.05
    slanted = np.abs(1.5 / c - 1.5).max()
    assert slanted > 0.06  # what ignoring the tilt would cost


def test_outliers_are_refused_and_leave_no_trace():
    truth, up, c, ranges, start = simulate(1)
    clean, _ = run(up, c, ranges, start)
    spoilt = ranges.copy()
    hit = np.flatnonzero(~np.isnan(ranges))[50::10]
    spoilt[hit] += 1.0
    out, (_, g) = run(up, c, spoilt, start)
    assert g.refused == len(hit) and not out[hit, 15].any()
    assert np.abs(out[:, 0] - truth[:, 0])[1000:].max() < 0.06


def test_step_of_the_floor_is_followed_after_the_recovery_time():
    _, up, c, ranges, start = simulate(1, amplitude=0.0)
    ranges[2000:] += 0.8 / c[2000:]
    out, _ = run(up, c, ranges, start)
    assert np.abs(out[2080, 0] - 1.5) < 0.1  # still refused after 0.4 s
    assert np.abs(out[2200:, 0] - 2.3).max() < 0.1
    assert (out[:, 3] > 0).all()


@pytest.mark.parametrize('velocity', [-15.0, 15.0])
def test_a_velocity_that_is_far_off_comes_back_to_the_sonar(velocity):
    truth, up, c, ranges, start = simulate(1)
    out, _ = run(up, c, ranges, start._replace(velocity=velocity))
    # refused for half a second, as the height runs away by 0.6 m from range to range
    assert np.abs(out[90, 0] - truth[90, 0]) > 5.0
    assert np.abs(out[600:, 0] - truth[600:, 0]).max() < 0.15
    assert np.abs(out[2000:, 1] - truth[2000:, 1]).max() < 0.5


def test_stuck_sonar_is_not_followed():
    truth, up, c, ranges, start = simulate(1)
    seen = np.flatnonzero(~np.isnan(ranges))
    ranges[seen[seen > 2000]] = 3.0
    out, (_, g) = run(up, c, ranges, start)
    assert g.refused > 200
    assert (np.abs(out[2000:, 0] - truth[2000:, 0]) < 4 * np.sqrt(out[2000:, 3])).all()


def test_near_readings_keep_the_height_between_floor_and_shortest_range():
    a = altitude.start(1e-4, 0.1, V)
    for start, expected in ((0.2, 0.2), (1.0, SONAR.min_range), (-0.5, 0.0)):
        b = altitude.Altitude(start, 0.0, 0.0, 0.0, False, a.P._replace(hh=1.0), 1.0)
        after, g, result = altitude.update_sonar(b, gate.OPEN, 0.44, 1.0, 0.0, SONAR, V)
        assert after.height == pytest.approx(expected, abs=2e-3) and result.used
        assert g.refused == 0


def test_barometer_carries_the_height_where_the_sonar_is_lost():
    rng = np.random.default_rng(3)
    errors = {}
    for used in (True, False):
        a, g = altitude.start(1e-4, 0.1, V), (gate.OPEN, gate.OPEN)
        rng = np.random.default_rng(3)
        h, bias = 1.0, 0.05
        a = altitude.Altitude(h, 0.0, 0.0, 0.0, False, a.P, 1.0)
        for k in range(6000):
            noise = V.accel_noise / math.sqrt(DT) * rng.standard_normal()
            a = predict(a, -bias + 0.1 * noise, 1.0)
            if k % 9 == 0 and k < 2000:
                a, g0, _ = altitude.update_sonar(
                    a, g[0], h + SONAR.noise * rng.standard_normal(), 1.0, 0.0, SONAR, V)
                g = (g0, g[1])
            if used and k % 3 == 0:
                p = pressure_of(h + 42.0 + BARO.noise * rng.standard_normal())[0]
                a, g1, _ = altitude.update_barometer(a, g[1], p, BARO)
                g = (g[0], g1)
        errors[used] = abs(a.height - h)
        if used:
            assert a.offset == pytest.approx(42.0, abs=1.0)
    assert errors[True] < 1.0 < errors[False]  # 20 s without sonar


def test_jump_of_the_pressure_moves_the_offset_not_the_height():
    a, g = altitude.start(1e-4, 0.1, V), gate.OPEN
    rng, before = np.random.default_rng(0), 0.0
    a = altitude.Altitude(1.0, 0.0, 0.0, 0.0, False, a.P, 1.0)
    s = gate.OPEN
    for k in range(4000):
        a = predict(a, 0.0, 1.0)
        g, s = gate.advance(g, DT), gate.advance(s, DT)
        if k % 9 == 0:
            a, s, _ = altitude.update_sonar(a, s, 1.0, 1.0, 0.0, SONAR, V)
        if k % 3 == 0:
            jump = 15.0 if k >= 2000 else 0.0
            p = pressure_of(1.0 + jump + BARO.noise * rng.standard_normal())[0]
            a, g, _ = altitude.update_barometer(a, g, p, BARO)
        if k == 1999:
            before = a.offset
    assert a.height == pytest.approx(1.0, abs=0.03)
    assert a.offset - before == pytest.approx(15.0, abs=0.5) and g.refused > 50


def test_held_still_on_the_floor_the_velocity_is_zero():
    a = altitude.start(0.25, 0.1, V)._replace(velocity=0.3)
    after = altitude.hold_still(a, 1e-4)
    assert abs(after.velocity) < 1e-3 and after.P.ww == pytest.approx(1e-4, rel=1e-3)


@pytest.mark.parametrize('seed', range(3))
def test_a_height_that_runs_away_comes_back_to_a_sonar_that_scatters(seed):
    # Upwards; downwards it is the floor that holds it, which this loop has not.
    # As in four flights of a Rolling Spider: successive ranges 0.3 m apart, every tenth too far.
    rng = np.random.default_rng(seed)
    n = 4000
    up = np.where(np.arange(n) < 400, 3.0, 0.0)
    ranges = 0.8 + 0.25 * rng.standard_normal(n)
    ranges[rng.random(n) < 0.1] += 1.5
    ranges[np.arange(n) % 8 != 4] = np.nan
    a = altitude.start(1e-4, V.initial_accel_bias_std, V)
    out, _ = run(up, np.ones(n), np.abs(ranges), a)
    assert (np.abs(out[1200:, 0] - 0.8) < 0.7).mean() > 0.95 and np.abs(out[1200:, 0]).max() < 2.5


def test_no_height_is_below_the_floor_and_no_bias_larger_than_there_is():
    a = altitude.start(1e-4, 0.1, V)._replace(height=-3.0, velocity=-2.0, accel_bias=-9.0)
    after = altitude.bounded(a, V)
    assert (after.height, after.velocity, after.accel_bias) == (-0.1, 0.0, -1.2)
    assert after.P == a.P  # no surer than before
    rising = altitude.bounded(a._replace(velocity=0.5, accel_bias=0.3), V)
    assert (rising.velocity, rising.accel_bias) == (0.5, 0.3)


@pytest.mark.parametrize(('fit', 'scale'), [(0.25, 0.25), (1e-6, altitude.LEAST_FIT), (2.0, 2.0)])
def test_published_variances_are_those_that_the_innovations_show(fit, scale):
    a, P = random_filter(3)
    a = a._replace(fit=fit)
    np.testing.assert_allclose(
        altitude.published_variances(a, 0.0), [scale * P[0, 0], scale * P[1, 1]])
    np.testing.assert_allclose(altitude.published_variances(a, np.inf), [P[0, 0], P[1, 1]])


def test_an_accepted_range_tells_how_well_the_covariance_fits():
    a, P = random_filter(4)
    noise = SONAR.noise ** 2
    for sigmas in (0.0, 1.0, 2.0):
        ranged = a.height + sigmas * math.sqrt(P[0, 0] + noise)
        after, _, result = altitude.update_sonar(a, gate.OPEN, ranged, 1.0, 0.0, SONAR, V)
        assert result.used
        assert after.fit == pytest.approx(1.0 + altitude.FIT_WEIGHT * (sigmas ** 2 - 1.0))
