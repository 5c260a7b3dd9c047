"""The error state, and the update written out against its matrix form."""

from joint_states import any_covariance, any_state, difference
from mambo_estimation.joint import state
from mambo_estimation.joint.state import SIZE
import numpy as np
import pytest


@pytest.mark.parametrize('seed', range(3))
def test_an_error_taken_in_is_the_difference_to_the_truth(seed):
    x, d = any_state(seed), 1e-4 * np.random.default_rng(seed).standard_normal(SIZE)
    np.testing.assert_allclose(difference(state.inject(x, d), x), d, atol=1e-11)


@pytest.mark.parametrize('seed', range(3))
def test_update_equals_its_matrix_form(seed):
    rng = np.random.default_rng(seed)
    P, h, R, y = any_covariance(seed), rng.standard_normal(SIZE), 0.3, 0.7
    h[rng.integers(0, SIZE, 8)] = 0.0
    S = h @ P @ h + R
    K = P @ h / S
    expected = P - np.outer(K, K) * S
    column, d, before = np.empty(SIZE), np.zeros(SIZE), P.copy()
    explained = state.covariance_with(P, h, column)
    assert explained == pytest.approx(h @ before @ h)
    np.testing.assert_allclose(column, before @ h, rtol=1e-12)
    state.correct(P, column, y, explained + R, d)
    np.testing.assert_allclose(P, expected, atol=1e-12)
    np.testing.assert_array_equal(P, P.T)
    np.testing.assert_allclose(d, K * y, rtol=1e-12)


def test_what_is_forgotten_depends_on_nothing_else():
    P = any_covariance()
    rest = np.delete(np.delete(P, 3, 0), 3, 1)
    state.forget(P, 3, 2.5)
    assert P[3, 3] == 2.5
    assert not np.delete(P[3], 3).any() and not np.delete(P[:, 3], 3).any()
    np.testing.assert_array_equal(np.delete(np.delete(P, 3, 0), 3, 1), rest)


def explained(P):
    """Return the largest deviation of the yaw that one other error explains, rad."""
    others = [j for j in range(SIZE) if j > 1 and j != state.YAW]
    return max(abs(P[state.YAW, others]) / np.sqrt(P[others, others]))


def test_yaw_and_position_depend_on_nothing_else_before_a_correction_turns_far():
    P, T = any_covariance(), np.eye(SIZE)
    P *= (0.1 / explained(P)) ** 2 if explained(P) > 0.1 else 1.0
    before = P.copy()
    state.forget_heading(P)
    np.testing.assert_array_equal(P, before)
    T[state.YAW, state.DRAG] = 1.1 * state.LARGEST_TURN / np.sqrt(P[state.DRAG, state.DRAG])
    P = T @ P @ T.T
    before, kept = P.copy(), [0, 1, state.YAW]
    rest = np.delete(np.arange(SIZE), kept)
    state.forget_heading(P)
    assert not P[np.ix_(kept, rest)].any() and not P[np.ix_(rest, kept)].any()
    for block in (kept, rest):
        np.testing.assert_array_equal(P[np.ix_(block, block)], before[np.ix_(block, block)])
