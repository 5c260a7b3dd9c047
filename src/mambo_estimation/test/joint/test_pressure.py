"""The barometer as the joint filter predicts it."""

from joint_states import any_covariance, any_state, derivative
from mambo_estimation.joint import pressure
from mambo_estimation.joint.state import PRESSURE_OFFSET, SIZE
import numpy as np


def test_jacobian_by_finite_differences():
    x, h = any_state(1), np.empty(SIZE)
    pressure.jacobian(h)
    found = derivative(lambda y: [pressure.predict(y)], x, 1e-4)[0]
    np.testing.assert_allclose(h, found, atol=1e-7)


def test_first_sample_sets_an_offset_as_uncertain_as_height_and_sample():
    P, h = any_covariance(), np.empty(SIZE)
    height = P[2, 2]
    pressure.start(P, 0.16)
    pressure.jacobian(h)
    # offset - height is the sample: its error is the sample's noise alone
    np.testing.assert_allclose(h @ P @ h, 0.16, rtol=1e-9)
    assert np.isclose(P[PRESSURE_OFFSET, PRESSURE_OFFSET], height + 0.16)
    assert (np.linalg.eigvalsh(P) > 0.0).all()
