"""Commands on the wire: z-up, exact, the bytes of the middleware."""

from mambo_interfaces.msg import Command
from mambo_model.motion import flight_command as fc
from mambo_model.motion.flight_command import FlightCommand
from mambo_ros import cdr
from mambo_ros.commands.command_message import decode, encode
from rclpy.serialization import deserialize_message

FULL = FlightCommand(
    12_345_000_000, fc.SETPOINT, True, 0.1, 0.2, (1.0, 2.0, -3.0), (0.1, 0.2, 0.3),
    (1e-9, -2.0, 1 / 3), (4.0, 5.0, 6.0), (-7.0, 8.0, 9.0), 0.7, -0.3, 1.5, 'duration,"ü"\n')


def test_a_command_comes_back_exactly():
    assert decode(encode(FULL)) == FULL
    assert decode(encode(FlightCommand(0, fc.STOP))) == FlightCommand(0, fc.STOP)


def test_axes_on_the_wire_are_z_up_and_the_stamp_is_the_step():
    data = encode(FULL)
    m = deserialize_message(data, Command)
    assert cdr.stamp_ns(data) == FULL.t and m.header.frame_id == 'odom'
    assert (m.position.x, m.position.y, m.position.z) == (1.0, -2.0, 3.0)
    assert (m.yaw, m.yaw_rate, m.kind) == (-0.7, 0.3, Command.SETPOINT)


def test_the_kinds_of_the_message_are_those_of_the_code():
    assert [getattr(Command, name.upper()) for name in fc.NAMES] == list(range(len(fc.NAMES)))
