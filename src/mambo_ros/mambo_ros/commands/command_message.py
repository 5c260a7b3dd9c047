"""Convert commands between ``mambo_interfaces/Command`` and the tuple of the mathematics."""

from __future__ import annotations

from mambo_interfaces.msg import Command
from mambo_model.frames import flip_vector
from mambo_model.motion.flight_command import FlightCommand

from ..cdr import SECOND, serialize
from ..messages import ODOM

_VECTORS = ('position', 'velocity', 'acceleration', 'jerk', 'snap')
_PLAIN = ('kind', 'relative', 'duration', 'height', 'timescale', 'trajectory')


def encode(command: FlightCommand) -> bytes:
    """Serialise a command; NED becomes z-up."""
    out = Command(**{name: getattr(command, name) for name in _PLAIN},
                  yaw=-command.yaw, yaw_rate=-command.yaw_rate)
    out.header.stamp.sec, out.header.stamp.nanosec = divmod(command.t, SECOND)
    out.header.frame_id = ODOM
    for name in _VECTORS:
        vector = getattr(out, name)
        vector.x, vector.y, vector.z = flip_vector(getattr(command, name))
    return serialize(out)


def decode(data: bytes) -> FlightCommand:
    """Return the command of a serialised message; z-up becomes NED."""
    from rclpy.serialization import deserialize_message
    m = deserialize_message(bytes(data), Command)
    vectors = {name: flip_vector((getattr(m, name).x, getattr(m, name).y, getattr(m, name).z))
               for name in _VECTORS}
    return FlightCommand(
        m.header.stamp.sec * SECOND + m.header.stamp.nanosec, yaw=-m.yaw, yaw_rate=-m.yaw_rate,
        **{name: getattr(m, name) for name in _PLAIN}, **vectors)
