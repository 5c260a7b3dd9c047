"""Velocity filter against a textbook Kalman filter, itself run on shifted data, and chi-square."""

import math

from estimation_truth import DT, fly, G, vertical_circle
from mambo_estimation import gate, velocity
from mambo_estimation.measurements import optical_flow
from mambo_estimation.measurements.optical_flow import FlowParams
from mambo_estimation.velocity import Covariance, INSENSITIVE, Sensitivity, VelocityParams
from mambo_model.compiled import jit
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

V = VelocityParams().values()
FLOW = FlowParams().values()
STILL = (0.0, 0.0)
EXACT = VelocityParams(scale_noise=0.0).values()  # height and tilt are true in these flights


def rows(matrix):
    return tuple(map(tuple, np.asarray(matrix).tolist()))


def matrix(P):
    return np.block([
        [np.array(P.pp), np.array(P.pv), np.array(P.pb)],
        [np.array(P.pv).T, np.array(P.vv), np.array(P.vb)],
        [np.array(P.pb).T, np.array(P.vb).T, np.array(P.bb)]])


def covariance(P):
    return Covariance(
        rows(P[:2, :2]), rows(P[:2, 2:4]), rows(P[:2, 4:]), rows(P[2:4, 2:4]), rows(P[2:4, 4:]),
        rows(P[4:, 4:]))


def mean(f):
    return np.array([*f.position, *f.velocity, *f.accel_bias])


def filter_at(x, P, s=None):
    s = s or (INSENSITIVE,) * 3
    return velocity.Velocity(
        tuple(x[:2].tolist()), tuple(x[2:4].tolist()), tuple(x[4:].tolist()), covariance(P), *s)


def random_filter(seed):
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(6, 6)) * np.repeat([0.2, 0.1, 0.1], 2)[:, None]
    s = tuple(
        Sensitivity(*map(tuple, (0.1 * rng.normal(size=(3, 2))).tolist())) for _ in range(3))
    return rng.normal(size=6), A @ A.T, s


def stack(s):
    return np.concatenate(s)


def tilted(seed):
    return Rotation.from_rotvec(np.random.default_rng(seed).uniform(-0.4, 0.4, 3)).as_matrix()


def predict(f, force, R, yaw_std=0.0, dt=DT, held=False):
    """Predict from the specific force in body axes, gravity added here."""
    a = R @ (force - [*f.accel_bias, 0.0]) + [0.0, 0.0, G]
    return velocity.predict(f, tuple(a[:2].tolist()), rows(R), yaw_std, dt, held, V)


@pytest.mark.parametrize('dt', [DT, 0.1])
@pytest.mark.parametrize('seed', range(3))
def test_prediction_moves_mean_covariance_and_sensitivity_as_the_error_moves(seed, dt):
    x, P, s = random_filter(seed)
    R, force, eps = tilted(seed), np.array([0.5, -0.3, -9.7]), 1e-6
    after = predict(filter_at(x, P, s), force, R, dt=dt)

    def moved(d):
        return mean(predict(filter_at(x + d, P), force, R, dt=dt))

    F = np.stack([(moved(d) - moved(-d)) / (2 * eps) for d in eps * np.eye(6)], 1)
    q, eye = V.accel_noise ** 2, np.eye(2)
    Q = np.zeros((6, 6))
    Q[:4, :4] = q * np.block([
        [eye * dt ** 3 / 3, eye * dt ** 2 / 2], [eye * dt ** 2 / 2, eye * dt]])
    Q[:2, :2] += dt * V.scale_noise ** 2 * np.outer(x[2:4], x[2:4])
    Q[4:, 4:] = eye * (1 - math.exp(-2 * dt / V.accel_bias_time)) * V.accel_bias_std ** 2
    # differences of a linear function: rounding / eps, 1e-9
    np.testing.assert_allclose(matrix(after.P), F @ P @ F.T + Q, atol=1e-9)
    for old, new in zip(s, (after.scale, after.slope, after.yaw), strict=True):
        np.testing.assert_allclose(stack(new), F @ stack(old), atol=1e-9)


@pytest.mark.parametrize('seed', range(3))
def test_flow_update_is_the_textbook_filter(seed):
    x, P, _ = random_filter(seed)
    R, v_z, height, h_var = tilted(seed), 0.4, 1.3, 1e-4
    f = filter_at(x, P)
    nu, std = np.array([0.3, -0.2]), 0.05
    after, _, result = velocity.update_flow(
        f, gate.OPEN, (0.1, 0.1), tuple(nu.tolist()), std, height, h_var, v_z, rows(R), 0.0,
        FlowParams(gate=100.0).values(), V)
    H = np.zeros((2, 6))
    H[:, 2:4] = R.T[:2, :2]
    innovation = nu - R.T[:2] @ [*x[2:4], v_z]
    noise = std ** 2 * np.eye(2) + h_var / height ** 2 * np.outer(nu, nu)
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + noise)
    keep = np.eye(6) - K @ H
    np.testing.assert_allclose(result.innovation, innovation, atol=1e-14)
    np.testing.assert_allclose(mean(after), x + K @ innovation, atol=1e-12)
    np.testing.assert_allclose(
        matrix(after.P), keep @ P @ keep.T + K @ noise @ K.T, atol=1e-13)
    assert np.linalg.eigvalsh(matrix(after.P)).min() > 0


def test_forward_flow_of_a_vehicle_that_looks_east_is_a_velocity_to_the_east():
    f = velocity.start(1.0, 0.1, V)
    R = Rotation.from_euler('z', 90, degrees=True).as_matrix()
    after, _, _ = velocity.update_flow(
        f, gate.OPEN, (0.5, 0.0), (1.0, 0.0), 0.01, 1.5, 0.0, 0.0, rows(R), 0.0, FLOW, V)
    assert after.velocity == pytest.approx((0.0, 1.0), abs=1e-3)


def test_climb_of_a_tilted_vehicle_is_not_taken_for_horizontal_motion():
    f = velocity.start(1e-6, 0.1, V)
    R = Rotation.from_euler('y', 0.2).as_matrix()  # nose up, climbing straight: flow backward
    nu = R.T @ [0.0, 0.0, -1.0]
    assert nu[0] > 0.19  # body x points up a little
    _, _, result = velocity.update_flow(
        f, gate.OPEN, (0.1, 0.0), tuple(nu[:2].tolist()), 0.01, 1.5, 0.0, -1.0, rows(R), 0.0,
        FLOW, V)
    assert result.innovation == pytest.approx((0.0, 0.0), abs=1e-12)


@jit
def fly_velocity(f, a, R, yaw_std, nu, std, height, v_z, flow_values, v, ratios):
    """Run the filter over rows: acceleration, R, body velocity by flow (NaN: none)."""
    g = gate.OPEN
    for k in range(a.shape[0]):
        M = ((R[k, 0, 0], R[k, 0, 1], R[k, 0, 2]), (R[k, 1, 0], R[k, 1, 1], R[k, 1, 2]),
             (R[k, 2, 0], R[k, 2, 1], R[k, 2, 2]))
        b = f.accel_bias
        x = a[k, 0] - M[0][0] * b[0] - M[0][1] * b[1]
        y = a[k, 1] - M[1][0] * b[0] - M[1][1] * b[1]
        f = velocity.predict(f, (x, y), M, yaw_std, 0.005, False, v)
        g = gate.advance(g, 0.005)
        ratios[k] = np.nan
        if not np.isnan(nu[k, 0]):
            seen = (nu[k, 0], nu[k, 1])
            f, g, r = velocity.update_flow(
                f, g, seen, seen, std[k], height[k], 0.0, v_z[k], M, yaw_std, flow_values, v)
            ratios[k] = r.ratio
    return f, g


def flight(seed=0, noise=True, scale=0.0, slope=0.0, yaw=0.0, n=4000, every=5):
    """Return what the filter gets on a vertical circle, errors as given, noise as believed."""
    truth = fly(vertical_circle(), n * DT + 6.0)
    rng = np.random.default_rng(seed)
    k = np.arange(1200, 1200 + n)
    believed = Rotation.from_euler('z', -yaw) * truth.R[k]
    keep = math.exp(-DT / V.accel_bias_time)
    bias = np.empty((n, 2))
    x = V.accel_bias_std * rng.standard_normal(2)
    for i in range(n):
        x = keep * x + V.accel_bias_std * math.sqrt(1 - keep ** 2) * rng.standard_normal(2)
        bias[i] = x if noise else 0.0
    mid = (truth.a[k - 1] + truth.a[k]) / 2 - [0.0, 0.0, G]
    force = truth.R[k].inv().apply(mid) + np.pad(bias, ((0, 0), (0, 1)))
    force += noise * V.accel_noise / math.sqrt(DT) * rng.standard_normal((n, 3))
    a = believed.apply(force) + [0.0, 0.0, G]
    height = truth.height[k]
    std = FLOW.noise * height / truth.tilt_cos[k]
    factor = 1 + scale + slope * (height - FLOW.reference_height)
    nu = truth.nu[k, :2] * factor[:, None] + noise * std[:, None] * rng.standard_normal((n, 2))
    nu[np.arange(n) % every != 0] = np.nan
    data = (a, believed.as_matrix(), nu, std, height, truth.v[k, 2])
    state = np.array([*truth.p[k[0] - 1, :2], *truth.v[k[0] - 1, :2], 0.0, 0.0])
    final = np.array([*truth.p[k[-1], :2], *truth.v[k[-1], :2], *bias[-1]])
    return data, state, final


def run(data, start, yaw_std=0.0, params=FLOW, v=V):
    a, R, nu, std, height, v_z = data
    ratios = np.empty(len(a))
    f, g = fly_velocity(start, a, R, yaw_std, nu, std, height, v_z, params, v, ratios)
    return f, ratios, g


P0 = np.diag(np.repeat([0.1 ** 2, 0.1 ** 2, V.accel_bias_std ** 2], 2))
OPEN_GATE = FlowParams(gate=100.0).values()


@pytest.mark.parametrize('what', ['scale', 'slope', 'yaw'])
def test_sensitivity_is_how_the_estimate_moves_with_the_parameter(what):
    yaw_std, eps = 0.05, 1e-3
    unit = {'scale': FLOW.scale_std, 'slope': FLOW.slope_std, 'yaw': yaw_std}[what]
    ends = []
    for sign in (1, -1):
        data, x0, _ = flight(noise=False, **{what: sign * eps * unit})
        ends.append(mean(run(data, filter_at(x0, P0), yaw_std, OPEN_GATE)[0]))
    data, x0, _ = flight(noise=False)
    f = run(data, filter_at(x0, P0), yaw_std, OPEN_GATE)[0]
    moved = (ends[0] - ends[1]) / (2 * eps)
    found = stack({'scale': f.scale, 'slope': f.slope, 'yaw': f.yaw}[what])
    assert np.abs(moved[:2]).max() > 0.01
    # yaw: the filter uses its own velocity in place of the true one, equal without noise but for
    # the trapezoidal rule; second order in eps
    np.testing.assert_allclose(found, moved, atol=2e-4)


def total_covariance(f):
    return matrix(f.P) + sum(np.outer(stack(s), stack(s)) for s in (f.scale, f.slope, f.yaw))


@pytest.mark.long
def test_errors_are_as_large_as_the_filter_says_with_factor_and_yaw_wrong_too():
    seeds, yaw_std, nees, naive = 60, 0.02, 0.0, 0.0
    for seed in range(seeds):
        rng = np.random.default_rng(1000 + seed)
        data, x0, final = flight(
            seed, scale=FLOW.scale_std * rng.standard_normal(),
            slope=FLOW.slope_std * rng.standard_normal(), yaw=yaw_std * rng.standard_normal())
        x0[:4] += 0.1 * rng.standard_normal(4)
        f, _, _ = run(data, filter_at(x0, P0), yaw_std, v=EXACT)
        e = mean(f) - final
        nees += e @ np.linalg.solve(total_covariance(f), e)
        naive += e @ np.linalg.solve(matrix(f.P), e)
    # a consistent filter is outside with a probability of 0.1 %
    low, high = chi2.ppf([0.0005, 0.9995], 6 * seeds)
    assert low < nees < high
    assert naive > 5 * high  # what a filter would claim that believes in its factor


def test_innovations_are_as_large_as_the_filter_says():
    total, samples = 0.0, 0
    for seed in range(20):
        data, x0, _ = flight(seed)
        _, ratios, _ = run(data, filter_at(x0, P0), params=FlowParams(
            scale_std=0.0, slope_std=0.0).values())
        seen = ~np.isnan(ratios)
        total += (ratios[seen] * FLOW.gate ** 2).sum()
        samples += 2 * seen.sum()
    low, high = chi2.ppf([0.0005, 0.9995], samples)  # outside with a probability of 0.1 %
    assert low < total < high


def test_position_covariance_grows_between_samples_and_with_the_drift_of_a_vertical_circle():
    data, x0, _ = flight(noise=False, n=6284)  # five periods
    grown = []
    for periods in range(1, 6):
        part = tuple(d[:1257 * periods] for d in data)
        f = run(part, filter_at(x0, P0 * 1e-4))[0]
        grown.append(math.sqrt(velocity.position_covariance(f)[0][0]))
    # sec. 10.1: drift per period pi A B Q'/Q, here in deviations of Q'/Q: pi * 0.07 m
    assert np.diff(grown) == pytest.approx(math.pi * FLOW.slope_std, rel=0.15)
    f = filter_at(x0, P0)
    last = 0.0
    for _ in range(200):
        f = predict(f, np.array([0.0, 0.0, -G]), np.eye(3))
        now = velocity.position_covariance(f)[0][0]
        assert now > last
        last = now


def test_outliers_are_refused_and_leave_no_trace():
    data, x0, final = flight(3)
    nu = data[2]
    hit = np.flatnonzero(~np.isnan(nu[:, 0]))[40::7]
    nu[hit] += [2.0, -1.0]
    f, _, g = run(data, filter_at(x0, P0))
    assert g.refused >= len(hit)
    e = mean(f) - final
    assert e @ np.linalg.solve(total_covariance(f), e) < chi2.ppf(0.999, 6)


def test_filter_that_is_wrong_jumps_to_the_flow_and_its_covariance_covers_the_jump():
    data, x0, final = flight(4)
    lost = x0.copy()
    lost[2:4] += [3.0, -2.0]  # 30 deviations
    believes_in_its_factor = FlowParams(scale_std=0.0, slope_std=0.0).values()
    f, _, g = run(data, filter_at(lost, P0), params=believes_in_its_factor, v=EXACT)
    assert 10 < g.refused < 40
    e = mean(f) - final
    assert np.abs(e[2:4]).max() < 0.2
    assert np.abs(e[:2]).max() > 0.5  # the position lost meanwhile stays lost, and is known to be
    assert np.abs(e[:2]).max() < 3.5 * math.sqrt(total_covariance(f)[0, 0])


def test_stuck_flow_is_not_followed():
    data, x0, _ = flight(5)
    nu = data[2]
    later = np.flatnonzero(~np.isnan(nu[:, 0]))[100:]
    nu[later] = [5.0, 5.0]
    f, _, g = run(data, filter_at(x0, P0))
    assert g.refused == len(later)


def test_body_velocity_covariance_is_the_turned_covariance():
    x, P, s = random_filter(8)
    f, R = filter_at(x, P, s), tilted(8)
    yaw_std = 0.03
    total = np.zeros((3, 3))
    total[:2, :2] = P[2:4, 2:4] + sum(np.outer(t.v, t.v) for t in s[:2])
    yaw = np.array([*s[2].v, 0.0]) + yaw_std * np.cross([0.0, 0.0, 1.0], [*x[2:4], 0.0])
    total += np.outer(yaw, yaw) * np.outer([1, 1, 0], [1, 1, 0])
    total[2, 2] = 0.01
    rotation = np.diag([1e-4, 4e-4, yaw_std ** 2])
    found = np.array(velocity.body_velocity_covariance(f, 0.01, rows(R), rows(rotation)))
    expected = R.T @ total @ R
    np.testing.assert_allclose(found.ravel()[:8], expected.ravel()[:8], atol=1e-14)
    # nu_3 = (v_z - (R nu_xy)_z) / R_33 of a filter off by delta: differences of that by delta
    nu, eps, by_tilt = R.T @ [*x[2:4], 0.3], 1e-6, []

    def nu_3(delta):
        turned = Rotation.from_rotvec(delta).as_matrix() @ R
        return (0.3 - turned[2, :2] @ nu[:2]) / turned[2, 2]

    for i in range(2):
        d = eps * np.eye(3)[i]
        by_tilt.append((nu_3(d) - nu_3(-d)) / (2 * eps))
    more = found[2, 2] - expected[2, 2]
    # the filter leaves out the climb, v_z delta sin(tilt)
    assert more == pytest.approx(np.square(by_tilt) @ [1e-4, 4e-4], rel=0.3)


def test_unknown_yaw_does_not_make_the_body_velocity_unknown():
    data, x0, _ = flight(noise=False)
    f = run(data, filter_at(x0, P0), yaw_std=0.3)[0]
    inertial = math.sqrt(total_covariance(f)[3, 3])
    body = velocity.body_velocity_covariance(
        f, 1e-4, rows(data[1][-1]), rows(np.diag([0.0, 0.0, 0.09])))
    speed = math.hypot(*f.velocity)
    assert inertial > 0.25 * speed and math.sqrt(body[1][1]) < 0.1 * speed


def test_held_still_on_the_floor_the_velocity_is_zero():
    f = velocity.start(0.25, 0.1, V)
    f = velocity.Velocity((0.0, 0.0), (0.3, -0.2), STILL, f.P, *(INSENSITIVE,) * 3)
    after = velocity.hold_still(f, 1e-4)
    assert np.abs(after.velocity).max() < 1e-3
    np.testing.assert_allclose(after.P.vv, 1e-4 * np.eye(2), rtol=1e-3)


def test_prediction_of_flow_and_update_agree_on_signs():
    truth = fly(vertical_circle(), 10.0)
    k = 1900
    nu = truth.nu[k]
    found = optical_flow.inertial_velocity(
        tuple(nu[:2].tolist()), float(truth.v[k, 2]), rows(truth.R[k].as_matrix()))
    np.testing.assert_allclose(found, truth.v[k, :2], atol=1e-12)
