"""
Axes of a stream: Motive's own with y up, or with z up, and those used inside.

Motive's y-up axes have x to the right and z towards the viewer. A quarter turn about x makes z
up: (x, y, z) becomes (x, -z, y). The axes of a body turn alike, as Motive defines them parallel
to those of the room. Inside: NED world, FRD body, quaternion w x y z.
"""

from __future__ import annotations

from mambo_model.frames import body_quaternion, flip_vector, wire_quaternion

from .natnet.wire import Quat, Vec3

UP = ('y', 'z')


def to_stream(rho: Vec3, up: str) -> Vec3:
    """Return a vector (3,), NED, in the axes of a stream with ``up`` 'y' or 'z'."""
    x, y, z = flip_vector(rho)
    return (x, z, -y) if up == 'y' else (x, y, z)


def attitude_to_stream(q: Quat, up: str) -> Quat:
    """Return an attitude, (4,) w x y z of FRD in NED, as x y z w of a stream."""
    x, y, z, w = wire_quaternion(q)
    return (x, z, -y, w) if up == 'y' else (x, y, z, w)


def from_stream(position: Vec3, up: str) -> Vec3:
    """Return a vector (3,) of a stream with ``up`` 'y' or 'z' in NED."""
    x, y, z = position
    return flip_vector((x, -z, y) if up == 'y' else (x, y, z))


def attitude_from_stream(attitude: Quat, up: str) -> Quat:
    """Return an attitude x y z w of a stream as (4,) w x y z of FRD in NED."""
    x, y, z, w = attitude
    return body_quaternion(x, -z, y, w) if up == 'y' else body_quaternion(x, y, z, w)
