"""Transforms of ``/tf``: ``map`` to ``odom`` to ``base_link``, as REP-105 has them."""

from __future__ import annotations

from geometry_msgs.msg import TransformStamped
from mambo_model import frames
from mambo_model.motion.rigid_body import State
from tf2_msgs.msg import TFMessage

from . import cdr, messages


def _transform(t: int, parent: str, child: str, pose: State | None) -> TransformStamped:
    out = TransformStamped(child_frame_id=child)
    out.header.frame_id = parent
    out.header.stamp.sec, out.header.stamp.nanosec = divmod(t, 1_000_000_000)
    if pose is not None:
        where, turn = out.transform.translation, out.transform.rotation
        where.x, where.y, where.z = frames.flip_vector(pose.rho)
        turn.x, turn.y, turn.z, turn.w = frames.wire_quaternion(pose.q)
    return out


def encode(t: int, vehicle: State, odom: State | None, with_map: bool) -> bytes:
    """
    Encode ``/tf``.

    Parameters
    ----------
    t : ns
    vehicle
        Pose in ``odom``, inertial NED and body FRD.
    odom
        Pose of ``odom`` in ``map``, likewise; None: the same.
    with_map
        Whether there is a transform from ``map`` to ``odom``.

    """
    transforms = [_transform(t, messages.ODOM, messages.BASE, vehicle)]
    if with_map:
        transforms.append(_transform(t, messages.MAP, messages.ODOM, odom))
    return cdr.serialize(TFMessage(transforms=transforms))
