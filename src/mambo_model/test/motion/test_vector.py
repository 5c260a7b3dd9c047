"""Tuple vectors against numpy; the moving direction against finite differences."""

from mambo_model.motion import vector
import numpy as np
import pytest


def pair(seed):
    return (tuple(v) for v in np.random.default_rng(seed).normal(size=(2, 3)).tolist())


@pytest.mark.parametrize('seed', range(5))
def test_every_operation_equals_numpy(seed):
    a, b = pair(seed)
    # numpy sums in another order: a few units in the last place of numbers of size 1
    np.testing.assert_allclose(vector.add(a, b), np.add(a, b), rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(vector.sub(a, b), np.subtract(a, b), rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(vector.mul(a, b), np.multiply(a, b), rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(vector.scale(2.5, a), 2.5 * np.array(a), rtol=0.0, atol=1e-15)
    np.testing.assert_allclose(vector.cross(a, b), np.cross(a, b), rtol=0.0, atol=2e-15)
    assert vector.dot(a, b) == pytest.approx(np.dot(a, b), abs=2e-15)
    assert vector.norm(a) == pytest.approx(np.linalg.norm(a), rel=1e-15)


def test_cross_product_is_right_handed():
    assert vector.cross((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)) == (0.0, 0.0, 1.0)


@pytest.mark.parametrize('seed', range(5))
def test_derivatives_of_a_direction_match_central_differences(seed):
    x0, x1, x2 = np.random.default_rng(seed).normal(size=(3, 3))
    x0 += (0.0, 0.0, 3.0)  # away from zero
    h = 1e-4

    def at(t):
        x = x0 + x1 * t + 0.5 * x2 * t * t
        return vector.direction(
            tuple(x.tolist()), tuple((x1 + x2 * t).tolist()), tuple(x2.tolist()))

    length, u, u_dot, u_ddot = at(0.0)
    before, after = at(-h), at(h)
    assert length == pytest.approx(np.linalg.norm(x0), rel=1e-15)
    np.testing.assert_allclose(np.array(u) * length, x0, rtol=0.0, atol=1e-15)
    # central difference: h^2/6 times a third derivative of size 1
    np.testing.assert_allclose(u_dot, np.subtract(after[1], before[1]) / (2 * h), atol=1e-7)
    np.testing.assert_allclose(u_ddot, np.subtract(after[2], before[2]) / (2 * h), atol=1e-7)


def test_zero_vector_has_no_direction():
    zero = (0.0, 0.0, 0.0)
    assert np.isnan(vector.direction(zero, zero, zero)[1]).all()
