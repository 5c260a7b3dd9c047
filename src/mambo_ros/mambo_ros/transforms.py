"""Transforms of ``/tf``: ``map`` to ``odom`` to ``base_link``, as REP-105 has them."""

from __future__ import annotations

import struct

from geometry_msgs.msg import TransformStamped
from mambo_model import frames
from mambo_model.motion.rigid_body import State

from . import messages
from .cdr import ENCAPSULATION
from .layout import Layout

# elements of the sequence of TFMessage, the first behind their count
_VEHICLE = Layout(
    TransformStamped, 4, header__frame_id=messages.ODOM, child_frame_id=messages.BASE)
_ODOM = Layout(
    TransformStamped, _VEHICLE.nbytes - 4, header__frame_id=messages.MAP,
    child_frame_id=messages.ODOM)
_SAME = (*(0.0,) * 6, 1.0)  # translation and rotation


def _numbers(pose: State) -> tuple[float, ...]:
    """Return translation and rotation of a pose on the wire, (7,)."""
    return (*frames.flip_vector(pose.rho), *frames.wire_quaternion(pose.q))


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
    count = struct.pack('<I', 2 if with_map else 1)
    out = ENCAPSULATION + count + _VEHICLE.stamped(t, *_numbers(vehicle))[8:]
    if with_map:
        anchor = _SAME if odom is None else _numbers(odom)
        out += _ODOM.stamped(t, *anchor)[len(out):]
    return out
