"""Specific force while the accelerometer cannot be used, and what it spoilt before."""

import math

from joint_states import any_state
from mambo_estimation import health
from mambo_estimation.joint import lost_force
from mambo_estimation.joint.joint_parameters import DragParams, JointParams
from mambo_model.motion.quaternion import rotate_inverse, to_matrix
import numpy as np
import pytest

P = JointParams()
V = P.values()
NAN3 = (math.nan,) * 3
LAST = (3.0, -2.0, -15.0)


def sensor(roughness=0.0, value=LAST, fault=health.GOOD):
    return health.NEW._replace(roughness=roughness, value=value, fault=fault)


def of_hover(x, drag=True):
    nu, c = np.array(rotate_inverse(x.q, x.v)), to_matrix(x.q)[2][2]
    k = np.array([*x.drag, 0.0]) if drag else np.zeros(3)
    return np.array(x.accel_bias) + np.array([0.0, 0.0, -9.81 / c]) - k * nu * 9.81 / c


def test_a_lost_force_returns_to_that_of_hover_and_drag():
    x, last = any_state(3), LAST
    expected = lost_force.expected(x, last, sensor(), NAN3, False, 0.02, V)
    kept = math.exp(-0.02 / V.motion.held_time)
    np.testing.assert_allclose(
        expected, of_hover(x) + kept * (np.array(last) - of_hover(x)), rtol=1e-12)
    for _ in range(100):
        last = lost_force.expected(x, last, sensor(), NAN3, False, 0.02, V)
    np.testing.assert_allclose(last, of_hover(x), rtol=1e-6)


@pytest.mark.parametrize(('roughness', 'stuck'), [(0.0, True), (2000.0, False)])
def test_a_stuck_or_random_sample_says_nothing(roughness, stuck):
    x = any_state(4)
    found = lost_force.expected(x, LAST, sensor(roughness), LAST, stuck, 0.005, V)
    np.testing.assert_allclose(found, of_hover(x), rtol=1e-12)


def test_without_drag_in_the_accelerometer_none_is_expected():
    x, v = any_state(5), JointParams(drag=DragParams(enabled=False)).values()
    found = lost_force.expected(x, LAST, sensor(), LAST, True, 0.005, v)
    np.testing.assert_allclose(found, of_hover(x, False), rtol=1e-12)


def test_what_was_believed_counts_once_when_the_fault_is_found():
    stuck = lost_force.trusted(sensor(), LAST, True, 0.005, V)
    assert stuck == pytest.approx(V.motion.held_accel_noise ** 2 * 20 * 0.005)
    rough = sensor(3000.0)
    wild = lost_force.trusted(rough, LAST, False, 0.005, V)
    # 0.9 of the old mean is left after 5 of 50 ms; a sample has half the variance of a difference
    assert wild == pytest.approx(0.9 * 3000.0 / 6.0 * 0.005 * 0.05)
    late = sensor(3000.0, fault=health.IMPLAUSIBLE)
    assert lost_force.trusted(late, LAST, False, 0.005, V) == 0.0
    assert lost_force.trusted(rough, NAN3, False, 0.005, V) == 0.0  # found at once
