"""The second-order low-pass filter of incremental controllers, exact for an input that is held."""

from __future__ import annotations

import math

from mambo_model.arithmetic.exponential import exp
from mambo_model.arithmetic.trigonometry import sin_cos
from mambo_model.compiled import jit
from mambo_model.motion.vector import add, scale, sub, Vec3


@jit
def lowpass(
    y: Vec3, y_dot: Vec3, u: Vec3, omega: float, damping: float, dt: float,
) -> tuple[Vec3, Vec3]:
    r"""
    Return the output of :math:`\omega^2/(s^2 + 2 \zeta \omega s + \omega^2)` after one period.

    Parameters
    ----------
    y, y_dot : (3,) unit of u, and per second
        Output and its derivative before.
    u : (3,)
        Input, held over the period.
    omega, damping : rad/s, 1
        Natural frequency, and zeta, below 1.
    dt : s
        Period.

    Returns
    -------
    y, y_dot : (3,)
        After the period.

    """
    sigma, w = damping * omega, omega * math.sqrt(1.0 - damping * damping)
    keep = exp(-sigma * dt)
    sine, cosine = sin_cos(w * dt)
    c, s = keep * cosine, keep * sine
    off = sub(y, u)
    after = add(scale(c + sigma / w * s, off), scale(s / w, y_dot))
    rate = add(scale(-omega * omega / w * s, off), scale(c - sigma / w * s, y_dot))
    return add(u, after), rate
