"""
Bifilar pendulum (4.2): a body on two wires that swings about the vertical.

The angle theta about the vertical is measured from the rest position. The equations do not depend
on the sign of the axis.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..arithmetic.trigonometry import sin_cos
from ..compiled import jit

LONGEST_STEP = 0.05  # in units of 1/omega_0: the phase error is 1e-8 of a swing


class Swing(NamedTuple):
    """Parameters of (4.2) that a swing determines; J also needs the geometry (:func:`inertia`)."""

    frequency: float  # omega_0, rad/s, of small swings: omega_0^2 = m g D^2 / (4 J h)
    quadratic: float  # K_D/J, 1/rad
    linear: float     # C/J, 1/s
    ratio: float      # D/h; 0 also describes a body on a fixed horizontal axis


def physical_inertia(frequency: float, mass: float, gravity: float, arm: float) -> float:
    """
    Return J about the centre of mass in kg m^2 of a body that swings about a horizontal axis.

    Parameters
    ----------
    frequency : rad/s
        Frequency of small swings without damping.
    mass : kg
    gravity : m/s^2
    arm : m
        Distance from the axis to the centre of mass.

    """
    return mass * arm * (gravity / (frequency * frequency) - arm)


def inertia(frequency: float, mass: float, gravity: float, D: float, h: float) -> float:
    """
    Return J of a bifilar pendulum in kg m^2, from (4.2) for small swings.

    Parameters
    ----------
    frequency : rad/s
        Frequency of small swings without damping.
    mass : kg
    gravity : m/s^2
    D, h : m
        Distance between the wires and length of the wires.

    """
    return mass * gravity * D * D / (4.0 * h * frequency * frequency)


@jit
def acceleration(theta: float, rate: float, s: Swing) -> float:
    """
    Return the angular acceleration (4.2b) in rad/s^2.

    The restoring part follows from V = -m g sqrt(h^2 - D^2/2 (1 - cos theta)). The kinetic energy
    of the vertical motion is neglected; it is 0.13 % at 0.5 rad and D/h = 0.2.

    Parameters
    ----------
    theta, rate : rad, rad/s
    s
        Parameters of the pendulum.

    """
    sine, cosine = sin_cos(theta)
    drop = math.sqrt(1.0 - 0.5 * s.ratio * s.ratio * (1.0 - cosine))
    restoring = s.frequency * s.frequency * sine / drop
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
        Times, increasing.
    theta, rate : rad, rad/s
        Angle and rate at t[0].
    s
        Parameters of the pendulum.

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
