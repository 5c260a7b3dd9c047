"""Transforms of /tf as REP-105 has them."""

import math

from mambo_model.motion.rigid_body import State
from mambo_ros import transforms
import pytest
from rclpy.serialization import deserialize_message
from tf2_msgs.msg import TFMessage

STILL = (0.0, 0.0, 0.0)
VEHICLE = State((1.0, 2.0, -1.5), STILL, (1.0, 0.0, 0.0, 0.0), STILL)
T = 3_250_000_000  # ns


def decoded(odom, with_map=True):
    return deserialize_message(transforms.encode(T, VEHICLE, odom, with_map), TFMessage).transforms


def test_the_vehicle_is_in_odom_with_z_up():
    only, = decoded(None, with_map=False)
    assert (only.header.frame_id, only.child_frame_id) == ('odom', 'base_link')
    assert (only.header.stamp.sec, only.header.stamp.nanosec) == (3, 250_000_000)
    where = only.transform.translation
    assert (where.x, where.y, where.z) == (1.0, -2.0, 1.5)


def test_without_motion_capture_map_is_odom():
    _, second = decoded(None)
    assert (second.header.frame_id, second.child_frame_id) == ('map', 'odom')
    where, turn = second.transform.translation, second.transform.rotation
    assert (where.x, where.y, where.z, turn.x, turn.y, turn.z, turn.w) == (0, 0, 0, 0, 0, 0, 1)


def test_odom_stands_in_map_where_it_is_said_to():
    yaw = 0.4  # about z down: the other way round on the wire
    _, second = decoded(State(
        (0.1, 0.2, 0.3), STILL, (math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)), STILL))
    where, turn = second.transform.translation, second.transform.rotation
    assert (where.x, where.y, where.z) == (0.1, -0.2, -0.3)
    assert (turn.w, turn.z) == pytest.approx((math.cos(yaw / 2), -math.sin(yaw / 2)))
