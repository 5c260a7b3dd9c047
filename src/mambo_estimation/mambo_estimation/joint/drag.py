r"""
Rotor drag in the accelerometer: a measurement of bias and body velocity.

In flight the accelerometer measures thrust and drag (3.13), not gravity. Along body x and y,

    a_xy = b_xy + k_xy s_z nu_xy,    s_z = -f / m,  the specific force of the thrust

with k = k_c / 4 of (3.13). Averaging over a window removes most of the vibration. The measurement
separates an accelerometer bias from a tilt, which flow alone cannot. The derivative by the error
state, with s and (s nu) averaged over the window, is

    d a_xy = db_xy + k_xy s (R^T xi)_xy + (s nu)_xy dk_xy
"""

from __future__ import annotations

from typing import NamedTuple

from mambo_model.compiled import jit
from mambo_model.motion.quaternion import rotate_inverse, to_matrix
from mambo_model.motion.vector import add, scale, Vec3

from ..blocks import Vec2
from .state import ACCEL_BIAS, Array, DRAG, Nominal, VELOCITY


class Window(NamedTuple):
    """Integrals since the last measurement."""

    time: float    # s
    force: Vec2    # (2,) m/s, of the specific force along body x and y
    thrust: float  # m/s, of that along body z, bias taken off
    drag: Vec2     # (2,) m^2/s^2, of the latter times the body velocity


EMPTY = Window(0.0, (0.0, 0.0), 0.0, (0.0, 0.0))


@jit
def accumulate(w: Window, before: Nominal, x: Nominal, accel: Vec3, dt: float) -> Window:
    """
    Return the window with one step more.

    Parameters
    ----------
    w
        Before.
    before, x
        State before and after the step.
    accel : (3,) m/s^2, body FRD
        Specific force, mean over the step, bias included.
    dt : s

    """
    nu = scale(0.5, add(rotate_inverse(before.q, before.v), rotate_inverse(x.q, x.v)))
    s = (accel[2] - x.accel_bias[2]) * dt
    return Window(
        w.time + dt, (w.force[0] + accel[0] * dt, w.force[1] + accel[1] * dt), w.thrust + s,
        (w.drag[0] + s * nu[0], w.drag[1] + s * nu[1]))


@jit
def innovation(w: Window, x: Nominal) -> Vec2:
    """Return measured minus expected force, means over the window, (2,) m/s^2, body FRD."""
    return (
        (w.force[0] - x.drag[0] * w.drag[0]) / w.time - x.accel_bias[0],
        (w.force[1] - x.drag[1] * w.drag[1]) / w.time - x.accel_bias[1])


@jit
def jacobian(w: Window, x: Nominal, H: Array) -> None:
    """Store the derivative of the expected force by the error state in ``H``, (2, SIZE)."""
    R = to_matrix(x.q)
    H[:] = 0.0
    for i in range(2):
        gain = x.drag[i] * w.thrust / w.time
        for j in range(3):
            H[i, VELOCITY + j] = gain * R[j][i]
        H[i, ACCEL_BIAS + i] = 1.0
        H[i, DRAG + i] = w.drag[i] / w.time
