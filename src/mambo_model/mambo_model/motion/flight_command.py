"""Commands to a vehicle in flight, as data: take off, land, go to, follow, stop, and streams."""

from __future__ import annotations

from typing import NamedTuple

from .vector import Vec3

TAKEOFF, LAND, GO_TO, FOLLOW, STOP, VELOCITY, SETPOINT = range(7)  # of mambo_interfaces/Command
NAMES = ('takeoff', 'land', 'go_to', 'follow', 'stop', 'velocity', 'setpoint')
STREAMED = (VELOCITY, SETPOINT)
"""Kinds that are sent many times a second; each is valid for a moment only."""
MAX_TRAJECTORY = 200_000  # characters of the text of a course
_ZERO: Vec3 = (0.0, 0.0, 0.0)


class FlightCommand(NamedTuple):
    """One command; only the fields that its kind needs are used."""

    t: int                      # ns of flight time, of the step at which it takes effect
    kind: int                   # TAKEOFF ... SETPOINT
    relative: bool = False      # go_to: position and yaw, follow: position, from the present
    duration: float = 0.0       # s, 0: as short as the limits allow; velocity: its validity
    height: float = 0.0         # m above the floor: of the take-off, or where the motors stop
    position: Vec3 = _ZERO      # (3,) m, inertial NED; goal or setpoint
    velocity: Vec3 = _ZERO      # (3,) m/s, inertial NED
    acceleration: Vec3 = _ZERO  # (3,) m/s^2, inertial NED; this and the next two: setpoint
    jerk: Vec3 = _ZERO          # (3,) m/s^3, inertial NED
    snap: Vec3 = _ZERO          # (3,) m/s^4, inertial NED
    yaw: float = 0.0            # rad, about NED z
    yaw_rate: float = 0.0       # rad/s, about NED z
    timescale: float = 1.0      # follow: flown in so many times its duration
    trajectory: str = ''        # follow: text of a course, mambo_model.motion.uav_trajectories
