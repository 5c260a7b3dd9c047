"""Odom in map: what moves with it, and what does not."""

from joint_states import any_covariance, any_state, difference
from mambo_estimation.capture import frames
from mambo_estimation.capture.frames import Anchor
from mambo_estimation.joint.state import inject, SIZE
from mambo_model.motion.rigid_body import State
import numpy as np
import pytest

ANCHOR = Anchor(0.7, (1.0, -2.0, 0.3))


def test_pose_in_odom_and_the_anchor_are_the_pose_in_map():
    x = any_state(1)
    there = frames.in_odom(State(x.p, x.v, x.q, x.v), ANCHOR)
    back = frames.moved(x._replace(p=there.rho, q=there.q), ANCHOR)
    np.testing.assert_allclose(back.p, x.p, atol=1e-12)
    np.testing.assert_allclose(back.q, x.q, atol=1e-12)
    assert there.nu == x.v  # body axes: the same in both


@pytest.mark.parametrize('turn', [0.0, 0.3, -3.0])
def test_what_a_correction_moves_is_the_anchor_and_not_odom(turn):
    x = any_state(2)
    y = frames.moved(x, Anchor(turn, (0.1, 0.2, -0.3)))
    after = frames.take_up(ANCHOR, x.p, y.p, turn)
    one, two = (frames.in_odom(State(z.p, z.v, z.q, z.v), a) for z, a in (
        (x, ANCHOR), (y, after)))
    np.testing.assert_allclose(one.rho, two.rho, atol=1e-12)
    np.testing.assert_allclose(one.q, two.q, atol=1e-12)
    assert abs(after.yaw) <= np.pi


def test_moving_all_of_map_moves_the_anchor_along():
    x, by = any_state(3), Anchor(-1.1, (0.5, 0.0, 0.2))
    y, after = frames.moved(x, by), frames.composed(by, ANCHOR)
    one, two = (frames.in_odom(State(z.p, z.v, z.q, z.v), a) for z, a in (
        (x, ANCHOR), (y, after)))
    np.testing.assert_allclose(one.rho, two.rho, atol=1e-12)
    np.testing.assert_allclose(one.q, two.q, atol=1e-12)


def test_covariance_turns_as_the_errors_do():
    x, P, yaw = any_state(4), any_covariance(1), 0.9
    turned, size = P.copy(), 1e-6
    frames.turn_covariance(turned, yaw)
    T = np.empty((SIZE, SIZE))
    by = Anchor(yaw, (0.3, 0.1, 0.0))
    for i in range(SIZE):
        d = np.zeros(SIZE)
        d[i] = size
        T[:, i] = difference(frames.moved(inject(x, d), by), frames.moved(x, by)) / size
    np.testing.assert_allclose(turned, T @ P @ T.T, atol=1e-7)


def test_odom_in_map_is_a_pose():
    pose = frames.odom_in_map(ANCHOR)
    assert pose.rho == ANCHOR.shift
    np.testing.assert_allclose(
        frames.about_z(0.7, (1.0, 0.0, 0.0)), (np.cos(0.7), np.sin(0.7), 0.0))
    assert pose.q == pytest.approx((np.cos(0.35), 0.0, 0.0, np.sin(0.35)))
