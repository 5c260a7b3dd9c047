"""A pose as the joint filter predicts it, at the time of its exposure, and its derivative."""

from joint_states import any_covariance, any_state, derivative
from mambo_estimation.capture import pose
from mambo_estimation.capture.pose_parameters import PoseParams
from mambo_estimation.joint import flow, propagation
from mambo_estimation.joint.state import SIZE
from mambo_model.motion.quaternion import conjugate, exp_map, multiply
import numpy as np
import pytest

G, DT = 9.81, 0.005


def flown(seed, steps=40):
    """Return a ring of inertial samples, where its next one goes, the state and those before."""
    x, ring, at, states = any_state(seed), np.zeros((flow.RING, 7)), 0, []
    for k in range(steps):
        states.append(x)
        gyro = tuple(0.5 * np.sin([0.03 * k, 0.05 * k + 1.0, 0.04 * k]) + x.gyro_bias)
        accel = tuple(np.array([0.3, -0.2, -9.81 - np.sin(0.1 * k)]) + x.accel_bias)
        at = flow.remember(ring, at, gyro, accel, DT)
        x = propagation.move(x, gyro, accel, DT, G)
    return ring, at, x, states


@pytest.mark.parametrize('age', [0.0, 0.01, 0.1])
def test_state_of_the_exposure_is_found_again(age):
    ring, at, x, states = flown(0)
    past = pose.state_at(x, ring, at, age, G)
    then = states[len(states) - round(age / DT)] if age else x
    assert past.age == pytest.approx(age)
    np.testing.assert_allclose(past.x.p, then.p, atol=1e-4)
    np.testing.assert_allclose(past.x.q, then.q, atol=1e-9)


def test_the_ring_says_how_far_back_it_reaches():
    ring, at, x, _ = flown(0, steps=10)
    assert pose.state_at(x, ring, at, 0.2, G).age == pytest.approx(10 * DT)


@pytest.mark.parametrize('seed', range(3))
@pytest.mark.parametrize('age', [0.0, 0.0325, 0.1025])  # between two inertial samples
def test_jacobian_by_finite_differences(seed, age):
    ring, at, x, _ = flown(seed)
    past, H = pose.state_at(x, ring, at, age, G), np.empty((6, SIZE))
    pose.jacobian(past, x.p, G, H)

    def expected(y):
        then = pose.state_at(y, ring, at, age, G).x
        return (*then.p, *pose.turn_between(then.q, past.x.q))
    found = derivative(expected, x, 1e-5)
    # left out: the third power of the age, of which gravity makes most
    np.testing.assert_allclose(H, found, atol=1e-6 + G * age ** 3)
    assert np.abs(H[:, :9]).max() >= 1.0


def test_one_number_after_the_other_is_all_at_once():
    rng, P = np.random.default_rng(1), any_covariance(3)
    H, y = rng.standard_normal((6, SIZE)), rng.standard_normal(6)
    noise = (4e-6, 2.5e-5)
    R = np.diag([noise[0]] * 3 + [noise[1]] * 3)
    S = H @ P @ H.T + R
    K = np.linalg.solve(S, H @ P).T
    after, d = P.copy(), np.zeros(SIZE)
    fit = pose.compare(after, H, (tuple(y[:3]), tuple(y[3:])), noise, d)
    np.testing.assert_allclose(d, K @ y, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(after, P - K @ S @ K.T, atol=1e-9)
    assert fit.position + fit.attitude == pytest.approx(y @ np.linalg.solve(S, y), rel=1e-9)
    assert fit.position == pytest.approx(y[:3] @ np.linalg.solve(S[:3, :3], y[:3]), rel=1e-9)


@pytest.mark.parametrize('angle', [0.0, 1e-12, 1e-3, 1.0, 3.1])
@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_turn_between_two_attitudes_whatever_the_sign_of_the_quaternion(angle, sign):
    turn = angle * np.array([0.6, 0.0, -0.8])
    q = any_state(2).q
    found = pose.turn_between(tuple(sign * np.array(multiply(exp_map(tuple(turn)), q))), q)
    np.testing.assert_allclose(found, turn, atol=1e-9)
    assert multiply(q, conjugate(q))[0] == pytest.approx(1.0)


def test_an_old_pose_is_less_certain():
    ring, at, x, _ = flown(1)
    p = PoseParams().values()
    young, old = (
        pose.noise_of(pose.state_at(x, ring, at, age, G), 0.3, p)[0] for age in (0.0, 0.1))
    assert young == p.position_noise ** 2
    assert old == pytest.approx(young + 0.1 ** 3 / 3 * 0.09)
