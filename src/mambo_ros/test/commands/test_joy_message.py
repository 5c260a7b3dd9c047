"""Messages of a joystick: read, or refused without an end of the node."""

from mambo_ros.commands.joy_message import decode, MOST
from mambo_ros.layout import LayoutError
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Joy


def test_axes_and_buttons_are_read_with_the_stamp():
    message = Joy(axes=[0.5, -1.0], buttons=[0, 1, 1])
    message.header.stamp.sec = 3
    assert decode(serialize_message(message)) == (3 * 10**9, (0.5, -1.0), (0, 1, 1))


@pytest.mark.parametrize('data', [
    b'', b'\0', b'\0\1\0\0' + b'\xff' * 60,
    serialize_message(Joy(axes=[0.0] * (MOST + 1))), serialize_message(Joy(buttons=[0] * 1000))])
def test_what_cannot_be_one_is_refused(data):
    with pytest.raises(LayoutError):
        decode(data)
