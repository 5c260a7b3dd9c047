"""
The meshes of the vehicle, made from boxes and cylinders, as binary STL.

``python3 -m mambo_description.meshes FOLDER`` writes ``body.stl``, a Mambo with the arm of
:data:`ARM`, and ``rotor.stl``, a rotor of radius 1 m; the URDF scales both to its vehicle. The
shapes were drawn for this project from the outer dimensions of a Mambo and nothing else.
"""

from __future__ import annotations

from pathlib import Path
import sys

import numpy as np
from numpy.typing import NDArray

Triangles = NDArray[np.float64]
"""Corners of triangles, (n, 3, 3) m, anticlockwise as seen from outside."""

FOLDER = Path(__file__).with_name('meshes')
ARM = 0.0441234  # m, from the centre to a rotor along x and y, of the Mambo
HEIGHT = 0.024  # m, of its body
_SIDES = 16  # of a cylinder
_BLADE = 0.2  # rad, pitch
_FACES = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
"""Corners of each side of a box, numbered 4 x + 2 y + z."""


def box(size: tuple[float, float, float], centre: tuple[float, float, float] = (0.0, 0.0, 0.0),
        yaw: float = 0.0, roll: float = 0.0) -> Triangles:
    """Return a box, rolled about its own x axis, then turned about z, then moved; m and rad."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
    c, s, cr, sr = np.cos(yaw), np.sin(yaw), np.cos(roll), np.sin(roll)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ np.array(
        [[1.0, 0.0, 0.0], [0.0, cr, -sr], [0.0, sr, cr]])
    faces = [corner for a, b, c, d in _FACES for corner in (a, b, c, a, c, d)]
    return ((corners * size) @ turn.T + centre)[faces].reshape(-1, 3, 3)


def cylinder(radius: float, height: float,
             centre: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Triangles:
    """Return an upright cylinder, m."""
    angles = 2.0 * np.pi * np.arange(_SIDES) / _SIDES
    ring = radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    low, high = (np.column_stack([ring, np.full(_SIDES, z)]) for z in (-height / 2, height / 2))
    under, over = np.array([0.0, 0.0, -height / 2]), np.array([0.0, 0.0, height / 2])
    out = []
    for i in range(_SIDES):
        j = (i + 1) % _SIDES
        out += [[low[i], low[j], high[j]], [low[i], high[j], high[i]],
                [under, low[j], low[i]], [over, high[i], high[j]]]
    return np.array(out) + centre


def body() -> Triangles:
    """Return the airframe: body, battery, nose, four arms with motors and landing legs."""
    parts = [box((0.088, 0.036, HEIGHT)), box((0.050, 0.024, 0.010), (-0.008, 0.0, 0.016)),
             box((0.012, 0.022, 0.014), (0.049, 0.0, -0.002))]
    for x, y in ((1, 1), (1, -1), (-1, -1), (-1, 1)):
        yaw = x * y * np.pi / 4.0
        parts += [box((0.050, 0.007, 0.006), (x * ARM * 0.6, y * ARM * 0.6, 0.0), yaw),
                  cylinder(0.006, 0.022, (x * ARM, y * ARM, 0.0)),
                  cylinder(0.003, 0.012, (x * ARM, y * ARM, -0.017))]
    return np.concatenate(parts)


def rotor() -> Triangles:
    """Return a rotor with two blades and radius 1 m."""
    return np.concatenate([
        cylinder(0.1, 0.12),
        box((0.9, 0.2, 0.03), (0.55, 0.0, 0.0), 0.0, _BLADE),
        box((0.9, 0.2, 0.03), (-0.55, 0.0, 0.0), 0.0, -_BLADE)])


def stl(triangles: Triangles) -> bytes:
    """Return triangles as a binary STL file."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    out = np.zeros(len(triangles), [('normal', '<f4', 3), ('corners', '<f4', (3, 3)),
                                    ('attribute', '<u2')])
    out['normal'], out['corners'] = normals, triangles
    head = b'Mambo, made by mambo_description.meshes'.ljust(80)
    return head + np.uint32(len(triangles)).astype('<u4').tobytes() + out.tobytes()


MESHES = {'body.stl': body, 'rotor.stl': rotor}


def main() -> None:
    """Write the meshes to the folder of the command line."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER
    folder.mkdir(parents=True, exist_ok=True)
    for name, make in MESHES.items():
        (folder / name).write_bytes(stl(make()))


if __name__ == '__main__':
    main()
