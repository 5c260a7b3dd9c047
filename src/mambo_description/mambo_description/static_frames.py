"""
Frames that are fixed on the vehicle: rotors, IMU, sonar, camera and markers.

Axes are those of REP-103: ``base_link`` has x forward, y left and z up. The simulator measures at
the centre of mass, so IMU, sonar and camera have their origin there. The table gives the fixed
joints of the URDF and the transforms of ``/tf_static`` alike.
"""

from __future__ import annotations

from collections.abc import Iterable
import math
from typing import NamedTuple

from mambo_model.frames import flip_vector
from mambo_model.motion.vector import Vec3
from mambo_model.vehicle.parameters import Vehicle

BASE, IMU, SONAR, CAMERA = 'base_link', 'imu_link', 'sonar_link', 'camera_link'
OPTICAL = 'camera_optical_frame'
ROTOR_HEIGHT = 0.012  # m, of the rotors above the centre of mass, for the picture alone
_DOWN = (0.0, math.pi / 2.0, 0.0)  # x points down, z forward
_OPTICAL = (-math.pi / 2.0, 0.0, -math.pi / 2.0)  # REP-103: z along the view, x right, y down


class Frame(NamedTuple):
    """A frame and its fixed place in another one."""

    name: str
    parent: str
    position: Vec3  # m, of its origin in the parent
    rpy: Vec3       # rad, about the fixed axes x, y, z of the parent, in this order

    @property
    def quaternion(self) -> tuple[float, float, float, float]:
        """Return the rotation as a unit quaternion x y z w."""
        (cr, sr), (cp, sp), (cy, sy) = (
            (math.cos(0.5 * angle), math.sin(0.5 * angle)) for angle in self.rpy)
        return (sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy,
                cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy)


def rotor_places(vehicle: Vehicle) -> list[Vec3]:
    """Return the centre of each rotor in ``base_link``, m, in the order of the motors (3.2)."""
    return [(vehicle.arm * x, vehicle.arm * y, ROTOR_HEIGHT)
            for x, y in ((1, 1), (1, -1), (-1, -1), (-1, 1))]


def static_frames(vehicle: Vehicle, markers: Iterable[Vec3] = ()) -> list[Frame]:
    """
    Return every fixed frame of a vehicle, a parent before its children.

    Parameters
    ----------
    vehicle
        Gives the places of the rotors.
    markers : (n, 3) m
        Place of each marker from the centre of mass, body FRD.

    """
    level = (0.0, 0.0, 0.0)
    return [
        Frame(IMU, BASE, level, level),
        Frame(SONAR, BASE, level, _DOWN),  # sensor_msgs/Range: the beam is +x
        Frame(CAMERA, BASE, level, _DOWN),
        Frame(OPTICAL, CAMERA, level, _OPTICAL),
        *(Frame(f'rotor_{number}', BASE, place, level)
          for number, place in enumerate(rotor_places(vehicle), 1)),
        *(Frame(f'marker_{number}', BASE, flip_vector(place), level)
          for number, place in enumerate(markers, 1))]
