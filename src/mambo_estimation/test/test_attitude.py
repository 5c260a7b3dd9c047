"""Attitude filter against scipy rotations, a textbook Kalman filter and flown accelerations."""

import math

from estimation_truth import circle, DT, fly, G
from mambo_estimation import attitude
from mambo_estimation.attitude import AttitudeParams
from mambo_estimation.measurements import optical_flow
from mambo_model.compiled import jit
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

V = AttitudeParams().values()
ZERO = (0.0, 0.0, 0.0)


def quat(R):
    x, y, z, w = R.as_quat()
    return (w, x, y, z)


def rotation(q):
    return Rotation.from_quat([*q[1:], q[0]])


def rows(matrix):
    return tuple(map(tuple, np.asarray(matrix).tolist()))


def random_filter(seed, q=None):
    """Return a filter with a full random covariance (6, 6), and that covariance."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(6, 6)) * np.repeat([0.1, 0.02], 3)[:, None]
    P = A @ A.T
    q = q or quat(Rotation.from_rotvec(rng.normal(size=3)))
    bias = tuple(0.01 * rng.normal(size=3))
    return attitude.Attitude(
        q, bias, rows(P[:3, :3]), rows(P[:3, 3:]), rows(P[3:, 3:]), 0.0,
        attitude.NO_WINDOW, 1.0), P


def covariance(a):
    P = np.empty((6, 6))
    P[:3, :3], P[:3, 3:], P[3:, 3:] = a.P_rr, a.P_rb, a.P_bb
    P[3:, :3] = P[:3, 3:].T
    return P


def test_gyro_is_integrated_like_scipy_composes_rotations():
    rng = np.random.default_rng(2)
    a, _ = random_filter(2)
    R = rotation(a.q)
    for _ in range(200):
        rate = rng.normal(size=3) * 3
        a = attitude.predict(a, tuple(rate + a.bias), DT, False, V)
        R = R * Rotation.from_rotvec(rate * DT)
    assert (rotation(a.q) * R.inv()).magnitude() < 1e-13  # 200 roundings


def test_positive_rates_turn_the_right_way():
    a = attitude.start((1.0, 0.0, 0.0, 0.0), ZERO, 1e-4, 1e-6, 0.0, V)
    for axis, angle in ((0, 'roll'), (1, 'pitch'), (2, 'yaw')):
        rate = tuple(0.2 * np.eye(3)[axis])
        turned = rotation(attitude.predict(a, rate, 1.0, False, V).q).as_euler('ZYX')[::-1]
        assert turned[axis] == pytest.approx(0.2), angle


@pytest.mark.parametrize('seed', range(5))
def test_covariance_moves_as_the_error_does(seed):
    a, P = random_filter(seed)
    rng, eps = np.random.default_rng(seed + 50), 1e-6
    rate = tuple(rng.normal(size=3))
    after = attitude.predict(a, rate, DT, False, V)

    def error_after(x):  # the truth, off by x = (delta, bias error), integrated exactly
        true = Rotation.from_rotvec(x[:3]) * rotation(a.q)
        true = true * Rotation.from_rotvec((np.array(rate) - a.bias - x[3:]) * DT)
        return np.concatenate([(true * rotation(after.q).inv()).as_rotvec(), x[3:]])

    F = np.stack([(error_after(d) - error_after(-d)) / (2 * eps) for d in eps * np.eye(6)], 1)
    Q = np.diag(np.repeat([V.gyro_noise ** 2, V.gyro_bias_walk ** 2], 3)) * DT
    # the filter takes R at the start of the step: relative error |rate| dt / 2, 0.5 % of dt
    np.testing.assert_allclose(covariance(after), F @ P @ F.T + Q, rtol=1e-4, atol=2e-8)


def test_held_rate_makes_the_attitude_uncertain():
    a, _ = random_filter(1)
    sure, unsure = (attitude.predict(a, ZERO, DT, held, V) for held in (False, True))
    gain = np.diag(covariance(unsure) - covariance(sure))
    assert gain[:3] == pytest.approx((V.held_gyro_noise ** 2 - V.gyro_noise ** 2) * DT)


def schmidt(a, P, innovation, variance, length):
    """Return correction and covariance of the textbook filter that considers yaw and z bias."""
    H = np.hstack([np.eye(3), 0.5 * length * rotation(a.q).as_matrix()])[:2]
    S = H @ P @ H.T + variance * np.eye(2)
    K = P @ H.T @ np.linalg.inv(S)
    K[[2, 5]] = 0.0
    keep = np.eye(6) - K @ H
    return K @ innovation, keep @ P @ keep.T + variance * K @ K.T


@pytest.mark.parametrize('seed', range(5))
def test_tilt_update_is_schmidts_filter(seed):
    a, P = random_filter(seed)
    variance = 1e-3
    innovation = np.linalg.cholesky(P[:2, :2] + variance * np.eye(2)) @ [0.3, -0.5]
    after = attitude.update_tilt(a, tuple(innovation), variance, 0.8, 3.0)
    step, expected = schmidt(a, P, innovation, variance, 0.8)
    turned = (rotation(after.q) * rotation(a.q).inv()).as_rotvec()
    np.testing.assert_allclose(turned, step[:3], atol=1e-12)
    np.testing.assert_allclose(np.array(after.bias) - a.bias, step[3:], atol=1e-12)
    np.testing.assert_allclose(covariance(after), expected, atol=1e-12)
    assert np.linalg.eigvalsh(covariance(after)).min() > 0


@pytest.mark.parametrize('scale', [10.0, 1e3])
def test_outlying_tilt_moves_the_filter_no_farther_than_the_gate(scale):
    a, P = random_filter(3)
    variance = 1e-3
    S = P[:2, :2] + variance * np.eye(2)
    innovation = scale * np.linalg.cholesky(S) @ [0.6, 0.8]
    after = attitude.update_tilt(a, tuple(innovation), variance, 0.0, 3.0)
    bend = scale ** 2 / 9.0  # S grows until the innovation lies on the gate
    K = P[:, :2] @ np.linalg.inv(S * bend)
    turned = (rotation(after.q) * rotation(a.q).inv()).as_rotvec()
    np.testing.assert_allclose(turned[:2], (K @ innovation)[:2], rtol=1e-9)
    assert np.linalg.eigvalsh(covariance(after)).min() > 0


def window_of(truth, error, start, steps):
    """Integrate a gravity window of a flight as a filter off by ``error`` (delta) would."""
    believed = Rotation.from_rotvec(-np.array(error)) * truth.R
    a = believed.apply(truth.specific_force) + [0.0, 0.0, G]

    def by_flow(k):  # what perfect flow and perfect vertical velocity give that filter
        nu = truth.nu[k]
        R = believed[k].as_matrix()
        return optical_flow.inertial_velocity(tuple(nu[:2]), float((R @ nu)[2]), rows(R))

    window = attitude.restart(by_flow(start), 0.0)
    for k in range(start + 1, start + steps + 1):
        window = attitude.accumulate(window, tuple((a[k - 1] + a[k]) / 2), ZERO, DT)
    return window, by_flow(start + steps)


def error_of(down):
    """Return the tilt error (x, y) that makes the vertical look like ``down``: down = e3 + ..."""
    return down[1], -down[0]


@pytest.mark.parametrize('rate', [1.0, 2.0])
@pytest.mark.parametrize('error', [(0.02, 0.0, 0.0), (0.0, -0.02, 0.0), (0.01, 0.015, 0.3)])
def test_flow_shows_the_tilt_error_whatever_the_acceleration_and_the_heading(rate, error):
    truth = fly(circle(rate), 12)
    window, end = window_of(truth, error, 1800, 200)
    found, _ = attitude.aided_tilt(window, end, 0.0, 0.0, G, V)
    down = Rotation.from_rotvec(error).inv().apply([0.0, 0.0, 1.0])  # as the filter sees it
    np.testing.assert_allclose(found, error_of(down), atol=1e-4)  # trapezoidal rule, flow at 5 ms


def test_naive_accelerometer_takes_the_acceleration_of_the_circle_for_tilt():
    truth = fly(circle(1.0), 12)
    window, _ = window_of(truth, (0.0, 0.0, 0.0), 1800, 20)  # 0.1 s
    found, _ = attitude.unaided_tilt(window, True, G, V)
    assert math.degrees(math.hypot(*found)) == pytest.approx(5.8, abs=0.1)  # a / g of 1 m/s^2


def rest(pitch, seconds=1.0):
    """Return the window of a vehicle at rest, nose up by ``pitch``, that believes to be level."""
    force = Rotation.from_euler('y', pitch).inv().apply([0.0, 0.0, -G])
    window = attitude.NO_WINDOW
    for _ in range(round(seconds / DT)):
        window = attitude.accumulate(window, tuple(force + [0.0, 0.0, G]), ZERO, DT)
    return window


def test_nose_up_at_rest_is_found_by_hand():
    found, _ = attitude.unaided_tilt(rest(0.02), True, G, V)
    assert found == pytest.approx((0.0, 0.02), abs=1e-5)


def test_unaided_gravity_counts_little_and_less_where_force_or_rate_betray_acceleration():
    def deviation(window, resting=False):
        return math.sqrt(attitude.unaided_tilt(window, resting, G, V)[1])

    still, turning, pulled = rest(0.0), attitude.NO_WINDOW, attitude.NO_WINDOW
    for _ in range(200):
        turning = attitude.accumulate(turning, ZERO, (0.0, 0.5, 0.0), DT)
        pulled = attitude.accumulate(pulled, (0.0, 0.0, -3.0), ZERO, DT)
    assert deviation(still, resting=True) == pytest.approx(V.window_accel_noise / G)
    assert deviation(still) == pytest.approx(
        math.hypot(V.window_accel_noise, V.unaided_acceleration) / G)
    assert deviation(turning) == pytest.approx(math.hypot(
        V.window_accel_noise, V.unaided_acceleration, 0.5 * V.unaided_rate_factor) / G)
    assert deviation(pulled) == pytest.approx(math.hypot(
        V.window_accel_noise, V.unaided_acceleration, 3.0) / G)


@jit
def at_rest(a, gyro, accel, v):
    """Run the filter at rest with gravity windows; return the last memory."""
    for k in range(gyro.shape[0]):
        rate = (gyro[k, 0], gyro[k, 1], gyro[k, 2])
        a = attitude.predict(a, rate, 0.005, False, v)
        R = attitude.to_matrix(a.q)
        s = (accel[k, 0], accel[k, 1], accel[k, 2])
        force = (
            R[0][0] * s[0] + R[0][1] * s[1] + R[0][2] * s[2],
            R[1][0] * s[0] + R[1][1] * s[1] + R[1][2] * s[2],
            R[2][0] * s[0] + R[2][1] * s[1] + R[2][2] * s[2] + 9.81)
        window = attitude.accumulate(a.window, force, rate, 0.005)
        a = attitude.with_window(a, window)
        if window.time >= v.window:
            tilt, variance = attitude.unaided_tilt(window, True, 9.81, v)
            a = attitude.with_window(
                attitude.update_tilt(a, tilt, variance, window.time, v.gate), attitude.NO_WINDOW)
    return a


def test_mean_tilt_of_a_window_is_the_tilt_now_and_half_a_window_of_bias():
    R, bias = Rotation.from_rotvec([0.1, -0.2, 0.5]), np.array([0.004, -0.003, 0.0])
    a = attitude.start(quat(R), ZERO, 1e-2, 1e-4, 0.0, V)
    window = attitude.NO_WINDOW
    for _ in range(200):  # the vehicle does not turn, the filter believes that it does
        a = attitude.predict(a, tuple(bias), DT, False, V)
        seen = rotation(a.q).apply(R.inv().apply([0.0, 0.0, -G]))
        window = attitude.accumulate(window, tuple(seen + [0.0, 0.0, G]), ZERO, DT)
    found, _ = attitude.unaided_tilt(window, True, G, V)
    now = (R * rotation(a.q).inv()).as_rotvec()[:2]
    lever = 0.5 * window.time * rotation(a.q).as_matrix() @ bias
    # half a step of the sum (0.5 % of the lever), second order in 4 mrad
    np.testing.assert_allclose(found, now + lever[:2], atol=3e-5)
    assert np.abs(lever[:2]).max() > 1e-3


def test_filter_at_rest_finds_tilt_and_gyro_bias_and_knows_how_well():
    n, seeds = 4000, 100
    # noise of the mean force of a window as believed, from white noise of its 200 samples
    noise = V.window_accel_noise * math.sqrt(200)
    nees, before, after = [], [], []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        tilt, bias = 0.05 * rng.standard_normal(2), 0.01 * rng.standard_normal(3)
        walk = V.gyro_bias_walk * math.sqrt(DT) * rng.standard_normal((n, 3)).cumsum(axis=0)
        gyro = bias + walk + V.gyro_noise / math.sqrt(DT) * rng.standard_normal((n, 3))
        R = Rotation.from_rotvec([*tilt, 0.0])
        accel = R.inv().apply([0.0, 0.0, -G]) + noise * rng.standard_normal((n, 3))
        a = attitude.start((1.0, 0.0, 0.0, 0.0), ZERO, 0.05 ** 2, 0.01 ** 2, 0.0, V)
        a = at_rest(a, gyro, accel, V)
        delta, off = (R * rotation(a.q).inv()).as_rotvec(), bias + walk[-1] - a.bias
        x = np.array([delta[0], delta[1], off[0], off[1]])
        P = covariance(a)[np.ix_([0, 1, 3, 4], [0, 1, 3, 4])]
        nees.append(x @ np.linalg.solve(P, x))
        before.append(bias[:2])
        after.append(off[:2])
    # a consistent filter's sum lies outside these bounds with a probability of 0.1 %
    low, high = chi2.ppf([0.0005, 0.9995], 4 * seeds)
    assert low < sum(nees) < high
    assert np.std(after) < 0.1 * np.std(before)  # 20 s of gravity: bias known 19 times better


@pytest.mark.parametrize(('fit', 'scale'), [(0.25, 0.25), (1e-6, attitude.LEAST_FIT), (2.0, 2.0)])
def test_published_covariance_is_that_which_the_windows_show(fit, scale):
    a, P = random_filter(3)
    a = a._replace(fit=fit, hidden=0.01)
    expected = P[:3, :3].copy()
    expected[:2, :2] *= scale
    expected[:2, 2] *= math.sqrt(scale)
    expected[2, :2] *= math.sqrt(scale)
    expected += np.diag([1e-4, 1e-4, 0.0])  # no innovation shows what is hidden
    np.testing.assert_allclose(attitude.published_covariance(a, 0.0), expected)
    expected = P[:3, :3] + np.diag([1e-4, 1e-4, 0.0])  # no windows: no word of theirs
    np.testing.assert_allclose(attitude.published_covariance(a, math.inf), expected)
