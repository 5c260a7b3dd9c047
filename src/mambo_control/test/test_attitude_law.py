"""Attitude law: hand signs, error dynamics (3.30f), evenness in q, the printed sign diverges."""

from mambo_control.attitude_law import alignment
from mambo_control.cascaded import CascadedParams, law
from mambo_control.controllers import answer
from mambo_model.motion.quaternion import angle, conjugate
from mambo_model.motion.trajectory import TRACK
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from thesis_flight import (
    control, flight, random_state, reference, runge_kutta, setup, start, unpack)

K = (0.9, 1.0, 1.1)
GAINS = CascadedParams().values()


def matrix(q):
    return Rotation([*q[1:], q[0]]).as_matrix()


def term(R, k):
    """Return sum k_i e_i x (R e_i)."""
    return sum(k[i] * np.cross(np.eye(3)[i], R[:, i]) for i in range(3))


def test_small_errors_are_pulled_back_with_the_weights_of_the_other_two_axes():
    # R_e = I + S(d): e_i x (R_e^T e_i) = -(d - e_i d_i)
    d = 1e-7
    assert alignment((1.0, d / 2, 0.0, 0.0), K) == pytest.approx((-(1.0 + 1.1) * d, 0, 0))
    assert alignment((1.0, 0.0, d / 2, 0.0), K) == pytest.approx((0, -(0.9 + 1.1) * d, 0))
    assert alignment((1.0, 0.0, 0.0, d / 2), K) == pytest.approx((0, 0, -(0.9 + 1.0) * d))


@pytest.mark.parametrize('seed', range(5))
def test_alignment_is_the_sum_of_the_thesis(seed):
    q = np.random.default_rng(seed).normal(size=4)
    q /= np.linalg.norm(q)
    np.testing.assert_allclose(alignment(tuple(q), K), term(matrix(q).T, K), atol=1e-15)


@pytest.mark.parametrize('yaw', [0.0, 1.0])
@pytest.mark.parametrize('seed', range(10))
def test_rate_error_obeys_3_30f(seed, yaw):
    rng, case = np.random.default_rng(seed), setup(yaw_amplitude=yaw)
    t, h = rng.uniform(0, 6), 1e-4
    y = random_state(rng, case, t)
    out = control(t, y, case)
    after = control(t + h, runge_kutta(t, y, h, case), case)
    before = control(t - h, runge_kutta(t, y, -h, case), case)
    slope = (np.array(after.omega_e) - before.omega_e) / (2 * h)
    wanted = -30 * np.array(out.omega_e) + 70 * term(matrix(out.q_e).T, K)
    # difference: h^2/6 times a third derivative of up to 24^3 * 100 rad/s^4: 2e-3 of 100
    np.testing.assert_allclose(slope, wanted, atol=1e-2)


@pytest.mark.parametrize('seed', range(5))
def test_errors_are_those_of_rotation_matrices(seed):
    rng, case = np.random.default_rng(seed), setup(yaw_amplitude=1.0)
    t = rng.uniform(0, 6)
    y = random_state(rng, case, t)
    ref, out = reference(t, case), control(t, y, case)
    R, R_r, R_d = matrix(y[6:10]), matrix(ref.q), matrix(out.q_d)
    R_e = R_d.T @ R_r.T @ R
    np.testing.assert_allclose(matrix(out.q_e), R_e, atol=1e-14)
    np.testing.assert_allclose(
        out.omega_e, y[10:13] - R.T @ R_r @ ref.omega - R_e.T @ out.omega_d, atol=1e-14)


@pytest.mark.parametrize('seed', range(20))
def test_q_and_minus_q_give_the_same_bits(seed):
    rng, case = np.random.default_rng(seed), setup()
    y = random_state(rng, case, 1.0)
    state, memory = unpack(y)
    ref = reference(1.0, case)
    turned = state._replace(q=tuple(-x for x in state.q))
    other = ref._replace(q=tuple(-x for x in ref.q))
    vv = case.believed
    one = law(state, ref, memory, GAINS, vv)
    for s, r in ((turned, ref), (state, other), (turned, other)):
        two = law(s, r, memory, GAINS, vv)
        assert (one.f, one.tau, one.omega_e) == (two.f, two.tau, two.omega_e)
        _, a = answer(memory, state, ref, TRACK, 0.005, GAINS, vv)
        _, b = answer(memory, s, r, TRACK, 0.005, GAINS, vv)
        assert (a.pwm, a.attitude_error) == (b.pwm, b.attitude_error)


@pytest.mark.long
def test_printed_attitude_term_diverges():
    printed = flight(start(), 3000, 1e-3, setup(printed=True))
    corrected = flight(start(), 3000, 1e-3, setup())
    angles = [angle(control(0.001 * i, printed[i], setup()).q_e) for i in range(3001)]
    assert np.degrees(angles[0]) == pytest.approx(5.4, abs=0.1)
    assert max(np.degrees(angles[:2001])) > 175
    assert np.linalg.norm(printed[-1, :3]) > 20  # m; 55 m from the reference in the audit
    assert np.linalg.norm(corrected[-1, :3] - reference(3.0, setup()).rho) < 0.7


def test_flipping_the_sign_of_the_printed_term_is_not_the_corrected_one():
    q = (np.cos(0.3), *(np.sin(0.3) * np.array([0.6, 0.0, 0.8])))
    printed = np.array(alignment(conjugate(q), K))
    assert np.abs(printed + alignment(q, K)).max() > 1e-3
