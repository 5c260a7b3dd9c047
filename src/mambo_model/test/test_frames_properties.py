"""Half a turn about x, whatever the numbers: to the bit, and its own inverse."""

import struct

from hypothesis import given, strategies as st
from mambo_model import frames
from mambo_model.motion import quaternion as quat
import numpy as np
import pytest

NUMBERS = st.floats()  # NaN, infinities, -0.0 and subnormal numbers too
VECTORS = st.tuples(*[NUMBERS] * 3)
QUATS = st.tuples(*[NUMBERS] * 4)
SMALL = st.tuples(*[st.floats(-10.0, 10.0)] * 3)
TURN = (0.0, 1.0, 0.0, 0.0)  # half a turn about x


def bits(numbers):
    """Return the bytes of numbers, NaNs of any sign being one."""
    return [struct.pack('<d', x) if x == x else b'nan' for x in numbers]


def wire(q):
    """Return the attitude on the wire, w x y z."""
    x, y, z, w = frames.wire_quaternion(q)
    return (w, x, y, z)


@given(VECTORS, QUATS)
def test_two_flips_give_back_every_bit(v, q):
    assert bits(frames.flip_vector(frames.flip_vector(v))) == bits(v)
    assert bits(frames.body_quaternion(*frames.wire_quaternion(q))) == bits(q)


@given(st.sampled_from([9, 36]).flatmap(lambda n: st.tuples(*[NUMBERS] * n)))
def test_a_covariance_flips_back(c):
    assert bits(frames.flip_covariance(frames.flip_covariance(c))) == bits(c)


@given(st.integers(0, 50).filter(lambda n: n not in (9, 36)))
def test_a_covariance_of_another_size_is_refused(count):
    with pytest.raises(ValueError, match=f'has {count} numbers'):
        frames.flip_covariance((1.0,) * count)


@given(SMALL, SMALL, SMALL)
def test_a_flip_is_a_rotation_by_half_a_turn(v, rotvec, rate):
    """NED to z up is a rotation of the axes: lengths, products and handedness stay."""
    assert np.array_equal(frames.flip_vector(v), quat.rotate(TURN, v))
    np.testing.assert_allclose(
        np.cross(frames.flip_vector(v), frames.flip_vector(rate)),
        frames.flip_vector(tuple(np.cross(v, rate))), atol=1e-12)
    q = quat.exp_map(rotvec)
    # the attitude of the flipped body in the flipped world: turn q turn*
    there = quat.multiply(quat.multiply(TURN, q), quat.conjugate(TURN))
    np.testing.assert_allclose(wire(q), there, atol=1e-15)
    # a body vector, flipped and then turned, is the turned one flipped
    np.testing.assert_allclose(
        quat.rotate(wire(q), frames.flip_vector(v)),
        frames.flip_vector(quat.rotate(q, v)), atol=1e-13)


@given(st.lists(st.floats(-3.0, 3.0), min_size=36, max_size=36))
def test_a_covariance_flips_as_its_vectors_do(root):
    """P = A A' of error vectors A e: flipped errors have the flipped covariance."""
    A = np.reshape(root, (6, 6))
    signs = np.array([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])[:, None]
    flipped = frames.flip_covariance(tuple((A @ A.T).reshape(-1)))
    np.testing.assert_array_equal(
        flipped, ((signs * A) @ (signs * A).T).reshape(-1))
