"""
Lumped rotor drag (3.13) in the four readings of its factor T.

By (3.11) and (3.12) T is the thrust of one rotor, f/4 (the default of the vehicle); the other
readings are kept to compare. The aerodynamic torque of (3.3d) is zero.
"""

from __future__ import annotations

from .compiled import jit
from .vector import Vec3
from .vehicle import (
    DRAG_ACCELERATION, DRAG_FORCE, DRAG_PER_ROTOR, DRAG_TOTAL, VehicleValues)


@jit
def lumped_drag(nu: Vec3, f: float, vv: VehicleValues) -> Vec3:
    """
    Return the drag force F_D = -T K_c V (3.13), (3,) N, body FRD.

    Parameters
    ----------
    nu : (3,) m/s, body FRD
        Velocity; only its first two components meet drag, K_c = diag(k_c, k_c, 0).
    f : N
        Total thrust of the four rotors.
    vv
        Vehicle; ``drag_reading`` tells what T is: f/4, f, 1 (k_c in kg/s) or the mass (1/s).

    """
    if vv.drag_reading == DRAG_PER_ROTOR:
        t = 0.25 * f
    elif vv.drag_reading == DRAG_TOTAL:
        t = f
    elif vv.drag_reading == DRAG_FORCE:
        t = 1.0
    elif vv.drag_reading == DRAG_ACCELERATION:
        t = vv.mass
    else:
        t = 0.0
    k = -t * vv.drag_coefficient
    return (k * nu[0], k * nu[1], 0.0)
