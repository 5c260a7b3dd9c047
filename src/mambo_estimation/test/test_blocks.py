"""Small matrices against numpy."""

from mambo_estimation import blocks
import numpy as np
import pytest

RNG = np.random.default_rng(1)
A2, B2 = RNG.normal(size=(2, 2, 2))
A3, B3 = RNG.normal(size=(2, 3, 3))
V2, W2 = RNG.normal(size=(2, 2))
V3, W3 = RNG.normal(size=(2, 3))


def rows(matrix):
    """Return a numpy array as the tuples that compiled code takes."""
    return tuple(map(tuple, matrix.tolist())) if matrix.ndim == 2 else tuple(matrix.tolist())


@pytest.mark.parametrize(('function', 'arguments', 'expected'), [
    (blocks.add2, (A2, B2), A2 + B2),
    (blocks.sub2, (A2, B2), A2 - B2),
    (blocks.mul2, (A2, B2), A2 @ B2),
    (blocks.mul2_t, (A2, B2), A2 @ B2.T),
    (blocks.transpose2, (A2,), A2.T),
    (blocks.apply2, (A2, V2), A2 @ V2),
    (blocks.outer2, (V2, W2), np.outer(V2, W2)),
    (blocks.symmetric2, (A2,), (A2 + A2.T) / 2),
    (blocks.inverse2, (A2,), np.linalg.inv(A2)),
    (blocks.sub3, (A3, B3), A3 - B3),
    (blocks.mul3, (A3, B3), A3 @ B3),
    (blocks.transpose3, (A3,), A3.T),
    (blocks.symmetric3, (A3,), (A3 + A3.T) / 2),
])
def test_equals_numpy(function, arguments, expected):
    # a few roundings each; the inverse of this matrix has condition 2
    np.testing.assert_allclose(function(*map(rows, arguments)), expected, rtol=1e-13, atol=1e-14)


def test_scaled_and_diagonal_matrices_equal_numpy():
    np.testing.assert_array_equal(blocks.scale2(3.0, rows(A2)), 3.0 * A2)
    np.testing.assert_array_equal(blocks.scale3(3.0, rows(A3)), 3.0 * A3)
    np.testing.assert_array_equal(blocks.diagonal2(3.0), 3.0 * np.eye(2))
    np.testing.assert_array_equal(blocks.diagonal3(1.0, 2.0, 3.0), np.diag([1.0, 2.0, 3.0]))


def test_less_outer_takes_away_a_scaled_outer_product():
    np.testing.assert_allclose(
        blocks.less_outer3(rows(A3), rows(V3), rows(W3), 2.5), A3 - np.outer(V3, W3) / 2.5,
        rtol=1e-13, atol=1e-14)
