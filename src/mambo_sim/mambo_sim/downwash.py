"""
Downwash: the jet below a multirotor, and the thrust that a vehicle in this jet loses.

Bauersfeld, Muller, Ziegler, Coletti, Scaramuzza, "Robotics meets Fluid Dynamics", RA-L 2024
(arXiv 2403.13321), measured the mean flow below quadrotors of several sizes. It is a turbulent
jet: with s along the axis of the rotors, r away from it, and l the distance of opposite motors,

    U_H = sqrt(T / (2 rho n pi R^2))                            induced velocity, (1)
    U_c = U_H B / (s/l - s0)                                    on the centre line, (2)
    U = U_c / (1 + (sqrt(2) - 1) (r / r_h)^2)^2                 across, (3), (4)
    r_h = l S (s/l - s0)                                        half-width, (6)

with B = 10.11, S = 0.07668 and s0 = -5.817 (9). T is the thrust of the moment, so that stopped
motors make no jet. The fit holds from s = 2.5 l on; nearer it is extrapolated down to s = 0. A
rotor in a flow U loses the share b U of its thrust: Su, Jing, Yang, Chen, Tan, Mueller,
"Downwash-aware Control Allocation for Over-actuated UAV Platforms", IROS 2022 (arXiv 2207.09645),
(5). The flow is taken at the middle of the lower vehicle, so there is no torque; its turbulence,
the time it takes to come down, and the floor are left out.
"""

from __future__ import annotations

from dataclasses import dataclass
import math

from mambo_model.compiled import jit
from mambo_model.schema import flag, quantity
from mambo_model.values import Parameters, values_type
from mambo_model.vehicle.parameters import Vehicle
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ROTORS = 4
_PROFILE = math.sqrt(2.0) - 1.0  # makes r_h the half-width


@dataclass(frozen=True)
class DownwashParams(Parameters):
    """The jet below a vehicle, and what it costs the vehicle inside."""

    enabled: bool = flag(False, 'design choice: vehicles do not feel each other, as in the thesis')
    decay: float = quantity(10.11, '1', 0.0, 100.0, 'B of (2), arXiv 2403.13321 (9)')
    spread: float = quantity(0.07668, '1', 0.001, 1.0, 'S of (6), arXiv 2403.13321 (9)')
    origin: float = quantity(-5.817, '1', -100.0, -0.1, 's0 of (2), (6), arXiv 2403.13321 (9)')
    thrust_loss: float = quantity(
        0.07, 's/m', 0.0, 1.0,
        'b of arXiv 2207.09645 (5): share of thrust lost per velocity of the air; assumed, of the '
        'size that fits rotors of 28 mm')


DownwashValues = values_type(DownwashParams)


@jit
def induced_velocity(thrust: float, area: float, density: float) -> float:
    """Return U_H (1) in m/s at a thrust in N, of discs of m^2 in air of kg/m^3."""
    return math.sqrt(max(thrust, 0.0) / (2.0 * density * area))


@jit
def speed(s: float, r: float, induced: float, length: float, p: DownwashValues) -> float:
    """
    Return the speed of the jet, U in m/s; 0 above the rotors.

    Parameters
    ----------
    s, r : m
        Distance below the rotors along their axis, and away from this axis.
    induced : m/s
        U_H.
    length : m
        l, from motor to opposite motor.
    p
        Parameters of the jet.

    """
    if s <= 0.0:
        return 0.0
    along = s / length - p.origin
    across = r / (length * p.spread * along)
    profile = 1.0 + _PROFILE * across * across
    return induced * p.decay / (along * profile * profile)


def vehicle_row(vehicle: Vehicle) -> tuple[float, float, float]:
    """Return what the jet depends on: l in m, area of the discs in m^2, density in kg/m^3."""
    radius = vehicle.rotor.radius
    return (2.0 * math.sqrt(2.0) * vehicle.arm, ROTORS * math.pi * radius * radius,
            vehicle.air_density)


@jit
def thrust_losses(
    position: Array, down: Array, thrust: Array, vehicles: Array, p: DownwashValues,
) -> Array:
    """
    Return the thrust that each vehicle loses in the jets of the others, (n,) N.

    Jets add up; no vehicle loses more than its thrust.

    Parameters
    ----------
    position : (n, 3) m
        In one inertial NED frame.
    down : (n, 3)
        Axis b3 of each vehicle in this frame: down through its rotors.
    thrust : (n,) N
    vehicles : (n, 3)
        Rows of :func:`vehicle_row`.
    p
        Parameters of the jet.

    """
    n = len(thrust)
    out = np.zeros(n)
    for lower in range(n):
        flow = 0.0
        for upper in range(n):
            if upper == lower or not thrust[upper] > 0.0:
                continue
            s, square = 0.0, 0.0
            for axis in range(3):
                gap = position[lower, axis] - position[upper, axis]
                s += gap * down[upper, axis]
                square += gap * gap
            facing = 0.0
            for axis in range(3):
                facing += down[lower, axis] * down[upper, axis]
            r = math.sqrt(max(square - s * s, 0.0))
            length, area, density = vehicles[upper]
            induced = induced_velocity(thrust[upper], area, density)
            flow += facing * speed(s, r, induced, length, p)
        out[lower] = min(max(p.thrust_loss * flow, 0.0), 1.0) * thrust[lower]
    return out
