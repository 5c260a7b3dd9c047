"""Read ``sensor_msgs/Joy`` messages."""

from __future__ import annotations

from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Joy

from ..cdr import SECOND
from ..layout import LayoutError

MOST = 64  # axes, and buttons


def decode(data: bytes) -> tuple[int, tuple[float, ...], tuple[int, ...]]:
    """
    Return (stamp ns, axes -1 to 1, buttons 0 or 1) of a joystick.

    Raises
    ------
    LayoutError
        If the bytes are not such a message, or hold more than 64 axes or buttons.

    """
    try:
        message = deserialize_message(bytes(data), Joy)
    except Exception as error:
        raise LayoutError(f'{len(data)} bytes are not a Joy: {error}') from error
    if max(len(message.axes), len(message.buttons)) > MOST:
        raise LayoutError(f'more than {MOST} axes or buttons')
    stamp = message.header.stamp
    return stamp.sec * SECOND + stamp.nanosec, tuple(message.axes), tuple(message.buttons)
