"""Drag as the accelerometer reads it."""

from joint_states import any_state, derivative
from mambo_estimation.joint import drag
from mambo_estimation.joint.state import SIZE
from mambo_model.motion.quaternion import rotate_inverse
import numpy as np
import pytest

DT, THRUST = 0.005, -10.5


def held(x, steps=20):
    """Return a window in which the state stands still, and what the accelerometer read."""
    nu, w = rotate_inverse(x.q, x.v), drag.EMPTY
    accel = (0.4, -0.3, THRUST + x.accel_bias[2])
    for _ in range(steps):
        w = drag.accumulate(w, x, x, accel, DT)
    return w, nu, accel


@pytest.mark.parametrize('seed', range(3))
def test_innovation_is_force_less_bias_and_drag(seed):
    x = any_state(seed)
    w, nu, accel = held(x)
    expected = [accel[i] - x.accel_bias[i] - x.drag[i] * THRUST * nu[i] for i in range(2)]
    np.testing.assert_allclose(drag.innovation(w, x), expected, rtol=1e-9)


@pytest.mark.parametrize('seed', range(3))
def test_jacobian_by_finite_differences(seed):
    x, H = any_state(seed), np.empty((2, SIZE))
    w, _, _ = held(x)
    drag.jacobian(w, x, H)

    def expected(y):
        nu = rotate_inverse(y.q, y.v)
        return [y.accel_bias[i] + y.drag[i] * THRUST * nu[i] for i in range(2)]
    np.testing.assert_allclose(H, derivative(expected, x), atol=1e-7)
