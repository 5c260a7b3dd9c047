"""sigma: bounded, isotropic, and its derivatives those of a path."""

from mambo_control.saturation import sigma, sigma_ddot, sigma_dot
import numpy as np
import pytest
from scipy.spatial.transform import Rotation


def path(t):
    """Return a curve and its first two derivatives by t."""
    return (
        (np.sin(2 * t), 3 * np.cos(t), t**2), (2 * np.cos(2 * t), -3 * np.sin(t), 2 * t),
        (-4 * np.sin(2 * t), -3 * np.cos(t), 2.0))


def as_floats(rows):
    return tuple(tuple(float(x) for x in row) for row in rows)


def test_by_hand():
    assert sigma((3.0, 0.0, 4.0)) == pytest.approx(np.array([3.0, 0.0, 4.0]) / np.sqrt(26))


def test_small_is_unchanged_and_large_is_a_direction():
    # x/sqrt(1 + x^2) = x (1 - x^2/2 ...) and 1 - 1/(2 x^2)
    assert sigma((1e-6, 0.0, 0.0))[0] == pytest.approx(1e-6, rel=1e-11)
    assert sigma((0.0, -1e6, 0.0))[1] == pytest.approx(-1.0, rel=1e-11)


def test_commutes_with_rotations():
    turn = Rotation.from_rotvec([0.3, -1.2, 0.8])
    x = np.array([0.4, -2.0, 1.0])
    assert sigma(tuple(turn.apply(x))) == pytest.approx(turn.apply(sigma(tuple(x))), abs=1e-15)


@pytest.mark.parametrize('t', np.linspace(-2, 2, 9))
def test_derivatives_match_central_differences(t):
    h = 1e-5  # truncation O(h^2) = 1e-10 times third derivatives of order 10
    x, x1, x2 = as_floats(path(t))
    before, after = (as_floats(path(t + k * h)) for k in (-1, 1))
    first = (np.array(sigma(after[0])) - sigma(before[0])) / (2 * h)
    second = (np.array(sigma_dot(*after[:2])) - sigma_dot(*before[:2])) / (2 * h)
    np.testing.assert_allclose(sigma_dot(x, x1), first, atol=1e-8)
    np.testing.assert_allclose(sigma_ddot(x, x1, x2), second, atol=1e-8)
