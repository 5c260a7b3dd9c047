"""Parameters of a commanded flight: whether it is one, its script, and what commands may ask."""

from __future__ import annotations

from dataclasses import dataclass
import math

from mambo_model.schema import flag, group, quantity, text
from mambo_model.values import Parameters

_HALL = 'design choice: a room with a net'
_CALM = 'design choice: a calm flight for people beside it'


@dataclass(frozen=True)
class JoystickParams(Parameters):
    """Axes and buttons of a ``sensor_msgs/Joy``, counted from 0; ROS's order of a gamepad."""

    enable: int = quantity(4, '1', 0, 63, 'button to hold down while flying (left shoulder)')
    takeoff: int = quantity(7, '1', 0, 63, 'button to take off, with the other held (start)')
    land: int = quantity(6, '1', 0, 63, 'button to land, with the other held (back)')
    forward: int = quantity(4, '1', 0, 63, 'axis forward (right stick, up is positive)')
    left: int = quantity(3, '1', 0, 63, 'axis to the left (right stick, left is positive)')
    up: int = quantity(1, '1', 0, 63, 'axis up (left stick, up is positive)')
    turn: int = quantity(0, '1', 0, 63, 'axis of the turn to the left (left stick)')
    speed: float = quantity(0.8, 'm/s', 0.0, 5.0, f'of a full stick; {_CALM}')
    climb: float = quantity(0.5, 'm/s', 0.0, 5.0, f'of a full stick; {_CALM}')
    yaw_rate: float = quantity(1.0, 'rad/s', 0.0, 5.0, f'of a full stick; {_CALM}')
    height: float = quantity(1.0, 'm', 0.1, 1000.0, f'of the take-off; {_CALM}')
    deadband: float = quantity(0.05, '1', 0.0, 0.9, 'of a stick about its centre (judgement)')
    period: float = quantity(0.05, 's', 0.005, 1.0, 'of flight time between velocity commands')
    timeout: float = quantity(0.5, 's', 0.05, 5.0, 'without a message: stop and hover')


@dataclass(frozen=True)
class CommandParams(Parameters):
    """
    A commanded flight: the vehicle waits on the floor, and commands make its reference.

    A command is refused if the path that it needs leaves the volume, or exceeds the limits here
    or those of the vehicle.
    """

    enabled: bool = flag(False, 'commands make the reference, not the flight plan')
    script: str = text('', 'commands at given times, a YAML list: see docs/how-to/commands.md')
    x_limit: float = quantity(5.0, 'm', 0.1, 1000.0, f'of |x| in odom; {_HALL}')
    y_limit: float = quantity(5.0, 'm', 0.1, 1000.0, f'of |y| in odom; {_HALL}')
    ceiling: float = quantity(3.0, 'm', 0.1, 1000.0, f'highest flight; {_HALL}')
    lowest: float = quantity(
        0.5, 'm', 0.0, 10.0,
        'lowest flight, except to take off and land: the sonar is blind below 0.434 m')
    speed: float = quantity(2.0, 'm/s', 0.05, 20.0, _CALM)
    acceleration: float = quantity(4.0, 'm/s^2', 0.1, 9.0, _CALM)
    yaw_rate: float = quantity(2.0, 'rad/s', 0.05, 10.0, _CALM)
    body_rate: float = quantity(
        math.radians(2000.0), 'rad/s', 0.1, 1000.0, 'range of the gyro, as simulator.imu')
    longest: float = quantity(120.0, 's', 1.0, 600.0, 'of the path of one command')
    setpoint_period: float = quantity(
        0.02, 's', 0.005, 1.0, 'setpoints of the topic in between are left out')
    setpoint_timeout: float = quantity(
        0.5, 's', 0.05, 2.0, 'how far a setpoint is flown ahead: stop when none follows')
    setpoint_landing: float = quantity(
        5.0, 's', 0.0, 600.0, 'hover after the last setpoint, then land')
    joystick: JoystickParams = group(JoystickParams)
