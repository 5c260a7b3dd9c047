"""The sonar as the joint filter predicts it."""

from joint_states import any_state, derivative
from mambo_estimation.joint import slant_range
from mambo_estimation.joint.state import SIZE
import numpy as np
import pytest


@pytest.mark.parametrize('seed', range(3))
def test_jacobian_by_finite_differences(seed):
    x, h = any_state(seed), np.empty(SIZE)
    slant_range.jacobian(x, h)
    np.testing.assert_allclose(h, derivative(lambda y: [slant_range.predict(y)], x)[0], atol=1e-7)


def test_slant_range_of_a_level_vehicle_is_its_height_and_the_offset():
    x = any_state(0)._replace(q=(1.0, 0.0, 0.0, 0.0), p=(3.0, 4.0, -1.5), range_offset=0.02)
    assert slant_range.predict(x) == pytest.approx(1.52)
