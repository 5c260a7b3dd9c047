"""Propagation of the joint filter against finite differences and the matrix form."""

from joint_states import any_covariance, any_state, difference
from mambo_estimation.joint import propagation, state
from mambo_estimation.joint.joint_parameters import JointParams
from mambo_estimation.joint.state import SIZE
from mambo_model.motion.quaternion import to_matrix
from mambo_model.motion.vector import add, scale
import numpy as np
import pytest

G, DT = 9.81, 1e-3
GYRO, ACCEL = (0.7, -1.1, 0.9), (1.5, -0.8, -11.0)
VALUES = JointParams().values()


def transition(x, dt):
    """Return F = d(error after) / d(error before) by central differences."""
    def after(error):
        return propagation.move(state.inject(x, error), GYRO, ACCEL, dt, G)
    nominal, size, columns = propagation.move(x, GYRO, ACCEL, dt, G), 1e-6, []
    for i in range(SIZE):
        d = np.zeros(SIZE)
        d[i] = size
        columns.append(
            (difference(after(d), nominal) - difference(after(-d), nominal)) / (2.0 * size))
    return np.array(columns).T


@pytest.mark.parametrize('seed', range(4))
def test_covariance_follows_the_transition_of_the_errors(seed):
    x, P = any_state(seed), any_covariance(seed)
    F = transition(x, DT)
    expected = F @ P @ F.T
    later = propagation.move(x, GYRO, ACCEL, DT, G)
    middle = scale(0.5, add(x.v, later.v))
    nothing = JointParams().values()
    walk = P.copy()
    propagation.spread(walk, middle, to_matrix(x.q), DT, 0.0, 0.0, nothing)
    walk[np.diag_indices(SIZE)] -= walks(nothing) * DT
    # of the change itself, A dt, F = I + A dt leaves out the square
    change = np.abs(expected - P).max()
    np.testing.assert_allclose(walk, expected, atol=6e-3 * change)
    np.testing.assert_array_equal(walk, walk.T)


def walks(v):
    """Return the variances that grow by time alone, (SIZE,) 1/s."""
    out = np.zeros(SIZE)
    out[9:12], out[12:15] = v.motion.gyro_bias_walk ** 2, v.motion.accel_bias_walk ** 2
    out[state.SCALE] = v.optical_flow.scale_walk ** 2
    out[state.PRESSURE_OFFSET] = v.barometer.offset_walk ** 2
    return out


def test_at_rest_only_what_walks_becomes_less_known():
    P = any_covariance()
    before = P.copy()
    propagation.wander(P, 10.0, VALUES)
    np.testing.assert_allclose(P - before, np.diag(10.0 * walks(VALUES)), atol=1e-15)


def test_noise_of_the_inertial_sensors_spreads_as_drawn():
    rng, n, dt = np.random.default_rng(3), 20000, 0.005
    x, gyro, accel = any_state(1), 0.02, 0.3   # densities
    nominal, errors = propagation.move(x, GYRO, ACCEL, dt, G), []
    for turn, push in rng.standard_normal((n, 2, 3)) / np.sqrt(dt):
        noisy = propagation.move(
            x, tuple(GYRO + gyro * turn), tuple(ACCEL + accel * push), dt, G)
        errors.append(difference(noisy, nominal)[:9])
    P = np.zeros((SIZE, SIZE))
    propagation.spread(
        P, scale(0.5, add(x.v, nominal.v)), to_matrix(x.q), dt, gyro, accel, VALUES)
    drawn = np.cov(np.array(errors).T)
    scale_of = np.sqrt(np.outer(np.diag(drawn), np.diag(drawn)))
    velocity_and_attitude = slice(3, 9)
    off = ((P[:9, :9] - drawn) / scale_of)[velocity_and_attitude, velocity_and_attitude]
    # 5 deviations of a correlation out of so many draws
    assert np.abs(off).max() < 5.0 / np.sqrt(n) + 0.02


def test_yaw_error_reaches_no_velocity_and_no_height():
    x, P = any_state(2), np.zeros((SIZE, SIZE))
    P[8, 8] = 1.0
    for _ in range(200):
        x = propagation.predict(x, P, GYRO, ACCEL, 0.005, (0.0, 0.0), VALUES)
    P[8, 8] = 0.0
    free = np.zeros((SIZE, SIZE))
    x = any_state(2)
    for _ in range(200):
        x = propagation.predict(x, free, GYRO, ACCEL, 0.005, (0.0, 0.0), VALUES)
    np.testing.assert_array_equal(P[2:6, 2:6], free[2:6, 2:6])
    assert P[0, 0] > free[0, 0] + 1e-3


def test_held_samples_count_for_less():
    still, lost = np.zeros((SIZE, SIZE)), np.zeros((SIZE, SIZE))
    x = any_state(0)
    propagation.predict(x, still, GYRO, ACCEL, 0.005, (0.0, 0.0), VALUES)
    propagation.predict(x, lost, GYRO, ACCEL, 0.005, (1.0, 1.0), VALUES)
    assert (np.diag(lost)[3:9] > 1e4 * np.diag(still)[3:9]).all()


def test_a_lost_thrust_is_unknown_along_the_vertical():
    x, m, grown = any_state(0), VALUES.motion, []
    for share in (0.0, 0.5, 1.0):
        P = np.zeros((SIZE, SIZE))
        propagation.predict(x, P, GYRO, ACCEL, 0.005, (0.0, share), VALUES)
        grown.append(np.diag(P)[3:6] / 0.005)
    np.testing.assert_allclose(np.diff(grown, axis=0), 0.5 * np.array(
        [m.held_accel_noise ** 2] * 2 + [m.held_accel_noise ** 2 + m.held_thrust_noise ** 2])[
            None].repeat(2, 0), rtol=1e-6)


@pytest.mark.parametrize('dt', [0.02, 0.1, 0.5])
def test_over_a_gap_the_mean_and_the_noise_are_those_of_an_ornstein_uhlenbeck_process(dt):
    time, sigma, n = 0.1, 0.4, 2000
    # the integral of the process and its two ends are Gaussian: covariance by summation
    t = (np.arange(n) + 0.5) * dt / n
    ends = np.array([[1.0, np.exp(-dt / time)], [np.exp(-dt / time), 1.0]])
    cross = np.array([np.exp(-t / time).sum(), np.exp(-(dt - t) / time).sum()]) * dt / n
    whole = np.exp(-np.abs(t[:, None] - t) / time).sum() * (dt / n) ** 2
    gain = np.linalg.solve(ends, cross)
    share = propagation.bridge(dt, time)
    np.testing.assert_allclose(gain, 0.5 * share * dt, rtol=1e-3)
    left = sigma ** 2 * (whole - cross @ gain)
    assert 2.0 * sigma ** 2 * time * (1.0 - share) * dt == pytest.approx(left, rel=0.02)


def test_a_share_of_the_noise_of_held_samples_counts():
    x, m = any_state(), VALUES.motion
    grown = []
    for share in (0.0, 0.25, 1.0):
        P = np.zeros((SIZE, SIZE))
        propagation.predict(x, P, GYRO, ACCEL, 0.005, (share, 0.0), VALUES)
        grown.append(P[6, 6] / 0.005)
    assert grown[0] == pytest.approx(m.gyro_noise ** 2)
    assert np.diff(grown) == pytest.approx(
        [0.25 * m.held_gyro_noise ** 2, 0.75 * m.held_gyro_noise ** 2])
