"""What holds for every quaternion, of any size, direction and sign."""

import math

from hypothesis import example, given, strategies as st
from mambo_model.motion import quaternion as quat
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

COMPONENT = st.floats(-1.0, 1.0, allow_subnormal=False)
VECTORS = st.tuples(*[st.floats(-1e3, 1e3)] * 3)
ANGLES = st.floats(-math.pi, math.pi)


@st.composite
def attitudes(draw):
    """Draw a unit quaternion: any direction, exact axes and tiny rotations among them."""
    q = draw(st.tuples(*[COMPONENT] * 4).filter(lambda q: quat.norm(q) > 1e-3))
    return quat.normalise(q)


def close(a, b, scale=1.0):
    """Return whether two tuples agree to some ten roundings of numbers of this size."""
    return np.abs(np.subtract(a, b)).max() <= 1e-14 * max(scale, 1.0)


def opposite(q):
    return tuple(-c for c in q)


@given(st.tuples(*[st.floats(-1e100, 1e100)] * 4), st.floats(1e-3, 1e3))
def test_the_norm_is_a_norm(q, factor):
    length = quat.norm(q)
    assert length >= max(map(abs, q)) * (1.0 - 1e-15) or max(map(abs, q)) < 1e-150  # underflow
    assert quat.norm(opposite(q)) == length == quat.norm(quat.conjugate(q))
    scaled = quat.norm(tuple(factor * c for c in q))
    assert scaled == pytest.approx(factor * length, rel=1e-14, abs=1e-150)


@given(attitudes())
def test_unit_quaternions_stay_unit(q):
    assert abs(quat.norm(q) - 1.0) < 4e-16
    assert abs(quat.norm(quat.multiply(q, q)) - 1.0) < 2e-15
    assert close(quat.normalise(q), q) and close(quat.inverse(q), quat.conjugate(q))


@given(attitudes(), attitudes(), attitudes())
def test_the_product_is_associative_and_has_inverses(p, q, r):
    assert close(quat.multiply(quat.multiply(p, q), r), quat.multiply(p, quat.multiply(q, r)))
    assert close(quat.multiply(q, quat.conjugate(q)), quat.IDENTITY)
    assert close(quat.conjugate(quat.multiply(p, q)),
                 quat.multiply(quat.conjugate(q), quat.conjugate(p)))


@given(attitudes(), attitudes(), VECTORS)
def test_rotations_compose_and_undo_each_other(p, q, v):
    size = quat.vector_norm(v)
    turned = quat.rotate(q, v)
    assert close(quat.rotate(p, turned), quat.rotate(quat.multiply(p, q), v), size)
    assert close(quat.rotate_inverse(q, turned), v, size)
    assert close(quat.rotate(quat.conjugate(q), v), quat.rotate_inverse(q, v), size)
    assert math.isclose(quat.vector_norm(turned), size, rel_tol=1e-13, abs_tol=1e-150)
    assert close(np.array(quat.to_matrix(q)) @ v, turned, size)


@given(attitudes(), VECTORS)
def test_q_and_its_opposite_are_one_attitude(q, v):
    other = opposite(q)
    assert quat.rotate(other, v) == quat.rotate(q, v)
    assert quat.to_matrix(other) == quat.to_matrix(q)
    assert quat.angle(other) == quat.angle(q)
    # the derivative is odd in q: both stay opposite while the body turns
    assert quat.derivative(other, v) == opposite(quat.derivative(q, v))


@given(attitudes(), attitudes())
def test_the_angle_is_a_distance_of_attitudes(p, q):
    apart = quat.angle(quat.multiply(quat.conjugate(p), q))
    assert 0.0 <= apart <= math.pi
    assert apart == pytest.approx(
        quat.angle(quat.multiply(quat.conjugate(q), p)), abs=1e-14)
    assert quat.angle(quat.multiply(p, q)) <= quat.angle(p) + quat.angle(q) + 1e-14
    theirs = Rotation.from_quat(np.roll(q, -1)).magnitude()
    assert quat.angle(q) == pytest.approx(theirs, abs=1e-14)


@given(st.tuples(*[st.floats(-1.8, 1.8)] * 3))
@example((0.0, 0.0, 0.0))
@example((5e-324, 0.0, 0.0))
@example((1e-160, -1e-160, 1e-170))
def test_the_exponential_of_a_rotation_vector_has_its_axis_and_angle(v):
    q = quat.exp_map(v)
    size = math.hypot(*v)  # below pi: at most 1.8 sqrt(3) = 3.12
    assert abs(quat.norm(q) - 1.0) < 4e-16
    assert quat.angle(q) == pytest.approx(size, rel=1e-12, abs=1e-150)
    assert close(quat.rotate(q, v), v, size)
    assert close(quat.multiply(quat.exp_map(v), quat.exp_map(opposite(v))), quat.IDENTITY)
    half = quat.exp_map(tuple(0.5 * x for x in v))
    assert close(quat.multiply(half, half), q)


@given(ANGLES, st.floats(-1.57, 1.57), ANGLES)
def test_euler_angles_give_back_the_attitude(phi, theta, psi):
    q = quat.from_euler(phi, theta, psi)
    again = quat.from_euler(*quat.to_euler(q))
    # near a pitch of 90 degrees roll and yaw lose digits as 1/cos(pitch); the attitude does not
    assert min(np.abs(np.subtract(again, q)).max(), np.abs(np.add(again, q)).max()) < 1e-7
    if abs(theta) < 1.5:
        assert quat.to_euler(q)[1] == pytest.approx(theta, abs=1e-13)


@given(attitudes(), st.tuples(*[st.floats(-40.0, 40.0)] * 3))
def test_a_body_rate_does_not_change_the_length(q, omega):
    rate = quat.derivative(q, omega)
    assert abs(np.dot(q, rate)) < 1e-14 * 40.0 * 2.0
    assert quat.norm(rate) == pytest.approx(0.5 * quat.vector_norm(omega), rel=1e-13, abs=1e-150)
    assert np.dot(q, quat.norm_control(tuple(1.1 * c for c in q), 3.0)) < 0.0
    assert np.dot(q, quat.norm_control(tuple(0.9 * c for c in q), 3.0)) > 0.0
