"""The half turn about x: exact, its own inverse, and the same rotation as scipy sees it."""

import math
import struct

from mambo_model import frames
from mambo_model.motion import quaternion
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

HALF_TURN = Rotation.from_rotvec([math.pi, 0.0, 0.0])
AWKWARD = (0.1, -0.0, math.nan, 5e-324, -math.inf, 1.0 + 2**-52)


def bits(numbers):
    return struct.pack(f'{len(numbers)}d', *numbers)


def test_height_becomes_positive_and_right_becomes_negative_left():
    assert frames.flip_vector((1.0, 2.0, -1.5)) == (1.0, -2.0, 1.5)


def test_turning_right_seen_from_above_is_a_negative_yaw_on_the_wire():
    right = quaternion.from_euler(0.0, 0.0, 0.3)
    x, y, z, w = frames.wire_quaternion(right)
    assert Rotation.from_quat([x, y, z, w]).as_euler('ZYX')[0] == pytest.approx(-0.3, abs=1e-15)


def test_two_flips_give_back_every_bit():
    for i in range(len(AWKWARD)):
        v = tuple(AWKWARD[(i + k) % len(AWKWARD)] for k in range(3))
        q = tuple(AWKWARD[(i + k) % len(AWKWARD)] for k in range(4))
        assert bits(frames.flip_vector(frames.flip_vector(v))) == bits(v)
        assert bits(frames.body_quaternion(*frames.wire_quaternion(q))) == bits(q)
    c = tuple(AWKWARD * 6)
    assert bits(frames.flip_covariance(frames.flip_covariance(c))) == bits(c)


def test_only_signs_change_and_nan_stays_in_place():
    v = (math.nan, 0.1, math.nan)
    assert [math.isnan(x) for x in frames.flip_vector(v)] == [True, False, True]
    assert [abs(x) for x in frames.wire_quaternion((0.1, 0.2, -0.3, 0.4))] == [0.2, 0.3, 0.4, 0.1]
    assert math.copysign(1.0, frames.flip_vector((0.0, 0.0, 0.0))[2]) == -1.0
    covariance = [0.0] * 36
    covariance[7] = math.nan
    assert [i for i, x in enumerate(frames.flip_covariance(covariance)) if x != x] == [7]


def test_wire_order_is_x_y_z_w():
    q = (0.1, 0.2, 0.3, 0.4)
    assert frames.wire_quaternion(q) == (0.2, -0.3, -0.4, 0.1)
    assert frames.body_quaternion(0.2, -0.3, -0.4, 0.1) == q


@pytest.mark.parametrize('seed', range(10))
def test_rotating_then_flipping_equals_flipping_then_rotating(seed):
    rng = np.random.default_rng(seed)
    inside = Rotation.random(rng=rng)
    v = rng.normal(size=3)
    wire = Rotation.from_quat(frames.wire_quaternion(tuple(np.roll(inside.as_quat(), 1).tolist())))
    flipped = frames.flip_vector(tuple(v.tolist()))
    # scipy normalises and rounds: a few units in the last place
    np.testing.assert_allclose(
        wire.apply(flipped), frames.flip_vector(tuple(inside.apply(v).tolist())), atol=2e-15)
    np.testing.assert_allclose(flipped, HALF_TURN.apply(v), atol=1e-15)
    np.testing.assert_allclose(
        wire.as_matrix(), (HALF_TURN * inside * HALF_TURN.inv()).as_matrix(), atol=2e-15)


@pytest.mark.parametrize('size', [3, 6])
def test_covariance_is_that_of_the_flipped_vectors(size):
    rng = np.random.default_rng(size)
    samples = rng.normal(size=(20, size)) @ rng.normal(size=(size, size))
    flipped = np.array([
        [c for k in range(0, size, 3) for c in frames.flip_vector(tuple(row[k:k + 3].tolist()))]
        for row in samples])
    covariance = frames.flip_covariance(np.cov(samples.T).ravel().tolist())
    np.testing.assert_allclose(covariance, np.cov(flipped.T).ravel(), rtol=0.0, atol=1e-14)


@pytest.mark.parametrize('count', [0, 1, 16, 35, 37])
def test_other_sizes_of_covariance_are_refused(count):
    with pytest.raises(ValueError, match=f'covariance has {count} numbers'):
        frames.flip_covariance([0.0] * count)
