"""
Bifilar pendulum (4.2): a body on two wires that swings about the vertical.

The angle theta is that about the vertical from rest; rates do not depend on the sign of the axis.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled import jit

LONGEST_STEP = 0.05  # of 1/omega_0: leaves the phase to 1e-8 of a swing


class Swing(NamedTuple):
    """What of (4.2) a swing shows: J itself needs the geometry, see :func:`inertia`."""

    frequency: float  # omega_0, rad/s, of small swings: omega_0^2 = m g D^2 / (4 J h)
    quadratic: float  # K_D/J, 1/rad
    linear: float     # C/J, 1/s
    ratio: float      # D/h; 0 is a body about a fixed horizontal axis, too


def physical_inertia(frequency: float, mass: float, gravity: float, arm: float) -> float:
    """
    Return J about the centre of mass in kg m^2 of a body that swings about a horizontal axis.

    Parameters
    ----------
    frequency : rad/s
        Of small swings without damping.
    mass : kg
    gravity : m/s^2
    arm : m
        From the axis to the centre of mass.

    """
    return mass * arm * (gravity / (frequency * frequency) - arm)


def inertia(frequency: float, mass: float, gravity: float, D: float, h: float) -> float:
    """
    Return J of a bifilar pendulum in kg m^2, from (4.2) for small swings.

    Parameters
    ----------
    frequency : rad/s
        Of small swings without damping.
    mass : kg
    gravity : m/s^2
    D, h : m
        Between the wires, length of the wires.

    """
    return mass * gravity * D * D / (4.0 * h * frequency * frequency)


@jit
def acceleration(theta: float, rate: float, s: Swing) -> float:
    """
    Return the angular acceleration (4.2b) in rad/s^2.

    Its restoring part is that of V = -m g sqrt(h^2 - D^2/2 (1 - cos theta)); the kinetic energy of
    the rise is neglected, 0.13 % of J at 0.5 rad and D/h = 0.2.

    Parameters
    ----------
    theta, rate : rad, rad/s
    s
        Of the pendulum.

    """
    drop = math.sqrt(1.0 - 0.5 * s.ratio * s.ratio * (1.0 - math.cos(theta)))
    restoring = s.frequency * s.frequency * math.sin(theta) / drop
    return -(s.quadratic * abs(rate) + s.linear) * rate - restoring


@jit
def swing(
    t: NDArray[np.float64], theta: float, rate: float, s: Swing,
) -> NDArray[np.float64]:
    """
    Return the rates of a swing, (n,) rad/s, by the classical Runge-Kutta method.

    Parameters
    ----------
    t : (n,) s
        When, rising.
    theta, rate : rad, rad/s
        At t[0].
    s
        Of the pendulum.

    """
    out = np.empty(len(t))
    for k in range(len(t)):
        span = t[k] - t[k - 1] if k else 0.0
        steps = int(math.ceil(span * s.frequency / LONGEST_STEP))
        for _ in range(steps):
            h = span / steps
            a1 = acceleration(theta, rate, s)
            v2 = rate + 0.5 * h * a1
            a2 = acceleration(theta + 0.5 * h * rate, v2, s)
            v3 = rate + 0.5 * h * a2
            a3 = acceleration(theta + 0.5 * h * v2, v3, s)
            v4 = rate + h * a3
            a4 = acceleration(theta + h * v3, v4, s)
            theta += h / 6.0 * (rate + 2.0 * v2 + 2.0 * v3 + v4)
            rate += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        out[k] = rate
    return out
