"""The filter of incremental controllers against scipy's exact zero-order hold of it."""

from mambo_control.literature.lowpass import lowpass
import numpy as np
import pytest
from scipy.signal import cont2discrete

DT = 0.005


@pytest.mark.parametrize(('omega', 'damping'), [(50.0, 0.55), (20.0, 0.9), (150.0, 0.3)])
def test_every_step_is_that_of_the_state_space(omega, damping):
    A = np.array([[0.0, 1.0], [-omega**2, -2.0 * damping * omega]])
    F, G, *_ = cont2discrete((A, np.array([[0.0], [omega**2]]), np.eye(2), np.zeros((2, 1))), DT)
    rng = np.random.default_rng(0)
    y = y_dot = (0.0, 0.0, 0.0)
    x = np.zeros((2, 3))
    for u in rng.normal(size=(100, 3)):
        y, y_dot = lowpass(y, y_dot, tuple(u), omega, damping, DT)
        x = F @ x + G @ u[None]
        np.testing.assert_allclose([y, y_dot], x, rtol=1e-9, atol=1e-9)


def test_a_held_input_is_reached_and_the_derivative_ends():
    y, y_dot = (1.0, -2.0, 0.0), (5.0, 0.0, 0.0)
    for _ in range(400):
        y, y_dot = lowpass(y, y_dot, (3.0, 3.0, 3.0), 50.0, 0.7, DT)
    np.testing.assert_allclose(y, 3.0, atol=1e-9)
    np.testing.assert_allclose(y_dot, 0.0, atol=1e-6)
