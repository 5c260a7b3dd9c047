r"""
The smooth saturation of (3.18) and its derivatives along a path.

.. math:: \sigma(x) = x / \sqrt{1 + x^T x}

The length of the result is below 1 and it commutes with rotations. All vectors are (3,); the
unit of x (m or m/s) is dropped, since 1 is its scale.
"""

from __future__ import annotations

import math

from mambo_model.compiled import jit
from mambo_model.motion.vector import add, dot, scale, sub, Vec3


@jit
def sigma(x: Vec3) -> Vec3:
    """Return the saturated vector."""
    return scale(1.0 / math.sqrt(1.0 + dot(x, x)), x)


@jit
def sigma_dot(x: Vec3, x_dot: Vec3) -> Vec3:
    """Return d/dt sigma(x) along a path with the given x and x'."""
    r = 1.0 / math.sqrt(1.0 + dot(x, x))
    return sub(scale(r, x_dot), scale(r * r * r * dot(x, x_dot), x))


@jit
def sigma_ddot(x: Vec3, x_dot: Vec3, x_ddot: Vec3) -> Vec3:
    """Return d^2/dt^2 sigma(x) along a path with the given x, x' and x''."""
    r = 1.0 / math.sqrt(1.0 + dot(x, x))
    c = r * r * r
    radial = dot(x, x_dot)
    along_x = 3.0 * c * r * r * radial * radial - c * (dot(x_dot, x_dot) + dot(x, x_ddot))
    return add(sub(scale(r, x_ddot), scale(2.0 * c * radial, x_dot)), scale(along_x, x))
