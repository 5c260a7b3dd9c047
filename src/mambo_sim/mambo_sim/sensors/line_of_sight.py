"""
Lines of sight from cameras to markers in a hall with several drones.

The body of a drone is a flattened ellipsoid with its axes along those of the body: ``radius`` to
the sides, ``half_height`` up and down. A marker is hidden from a camera if the straight line
between them passes through the body of another drone. What the drone's own body hides is not
computed here: ``optitrack.markers.occlusion`` stands for it.
"""

from __future__ import annotations

from mambo_model.compiled import jit
from mambo_model.motion.quaternion import conjugate, Quat, rotate
from mambo_model.motion.vector import dot, sub, Vec3
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@jit
def _scaled(point: Vec3, centre: Vec3, q: Quat, radius: float, half_height: float) -> Vec3:
    """Return a point in the axes of a body in which its ellipsoid is the unit sphere."""
    x, y, z = rotate(conjugate(q), sub(point, centre))
    return (x / radius, y / radius, z / half_height)


@jit
def is_hidden(
    camera: Vec3, marker: Vec3, centre: Vec3, q: Quat, radius: float, half_height: float,
) -> bool:
    """
    Return whether a body stands between a camera and a marker.

    Parameters
    ----------
    camera, marker, centre : (3,) m, inertial NED of the hall
        The last one is the middle of the body.
    q : (4,) unit, body to inertial
    radius, half_height : m
        Half axes of the ellipsoid.

    """
    start = _scaled(camera, centre, q, radius, half_height)
    end = _scaled(marker, centre, q, radius, half_height)
    way = sub(end, start)
    length = dot(way, way)
    share = 0.0
    if length > 0.0:  # where the line comes nearest to the middle
        share = min(max(-dot(start, way) / length, 0.0), 1.0)
    x, y, z = (start[0] + share * way[0], start[1] + share * way[1], start[2] + share * way[2])
    return x * x + y * y + z * z < 1.0


@jit
def count_cameras(
    marker: Vec3, own: int, cameras: Array, bodies: Array, here: NDArray[np.bool_],
    radius: float, half_height: float,
) -> int:
    """
    Return how many cameras see a marker of one body past all other bodies.

    Parameters
    ----------
    marker : (3,) m, inertial NED of the hall
    own : int
        Row of the body that carries the marker.
    cameras : (m, 3) m, likewise
    bodies : (n, 7)
        Position in m, likewise, and attitude w x y z of each body.
    here : (n,)
        Which of them there are.
    radius, half_height : m
        Half axes of a body.

    """
    free = 0
    for c in range(len(cameras)):
        camera = (cameras[c, 0], cameras[c, 1], cameras[c, 2])
        clear = True
        for b in range(len(bodies)):
            if clear and b != own and here[b]:
                row = bodies[b]
                clear = not is_hidden(
                    camera, marker, (row[0], row[1], row[2]),
                    (row[3], row[4], row[5], row[6]), radius, half_height)
        free += clear
    return free
