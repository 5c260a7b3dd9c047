r"""
Candidate errors of the optical flow in one equation, with a parameter for each mechanism.

.. math:: f = \frac{h(t - \tau) + \delta}{h\, Q(h)} x (1 + c x^2), \qquad
          x = \frac{\nu_{xy} - k \nu_3 - \lambda l}{Z^*} + \kappa [\omega_2, -\omega_1]

Without errors all parameters are 0 and the scale is that of Q(h). The equation covers the errors
of the simulated sensor (:mod:`mambo_sim.sensors.optical_flow`) and also errors of an estimator,
expressed as if they were in the flow: ``l`` is the part of the velocity that rotation to level
axes adds (C2), ``Z*`` lies between Z and h (C1), and a velocity filter without the Coriolis term
adds ``omega x nu / L`` (G). The same equation therefore fits raw flow and estimates.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from .paths import Array, Track

REFERENCE_HEIGHT = 1.5  # m, the height at which Q(h) equals the scale


class Parameter(NamedTuple):
    """
    A parameter of the equation.

    Attributes
    ----------
    name, unit
    width
        Prior standard deviation about 0 (of the scale: about 1).

    """

    name: str
    unit: str
    width: float


class Mechanism(NamedTuple):
    """A candidate error: its letter, a description, and the names of its parameters."""

    letter: str
    description: str
    parameters: tuple[str, ...]


PARAMETERS = {p.name: p for p in (
    Parameter('scale', '1', 0.3),
    Parameter('delay', 's', 0.005),
    Parameter('slope', '1/m', 0.1),
    Parameter('gain', '1', 0.015),
    Parameter('height_offset', 'm', 0.15),
    Parameter('height_lag', 's', 0.1),
    Parameter('tilt_ignored', '1', 1.0),
    Parameter('frame', '1', 1.0),
    Parameter('leakage', '1', 1.0),
    Parameter('coupling_x', '1', 0.05),
    Parameter('coupling_y', '1', 0.05),
    Parameter('cubic', 's^2', 0.1),
    Parameter('coriolis', 's', 0.5),
)}

MECHANISMS = {m.letter: m for m in (
    Mechanism('A', 'factor rises with height, linear', ('slope',)),
    Mechanism('A3', 'factor rises with height, exponential', ('gain',)),
    Mechanism('H', 'height offset', ('height_offset',)),
    Mechanism('B', 'height lags', ('height_lag',)),
    Mechanism('C1', 'tilt ignored in Z', ('tilt_ignored',)),
    Mechanism('C2', 'flow velocity not rotated to inertial axes', ('frame',)),
    Mechanism('D', 'rotational flow left in (+) or removed twice (-)', ('leakage',)),
    Mechanism('E', 'vertical speed couples into the flow', ('coupling_x', 'coupling_y')),
    Mechanism('F', 'sensor not linear', ('cubic',)),
    Mechanism('G', 'Coriolis term missing in the velocity filter', ('coriolis',)),
)}
"""The mechanisms by letter. I, a constant error of the scale, is part of every model."""


def factor(height: Array, scale: float, slope: float, gain: float) -> Array:
    """Return Q(h), (n,): (C.2b) and (C.2a), relative to the value at 1.5 m."""
    return scale * (1.0 + slope * (height - REFERENCE_HEIGHT)
                    + gain * (np.exp(height) - np.exp(REFERENCE_HEIGHT)))


def level_part(track: Track) -> Array:
    """
    Return the part that rotation to level axes adds to a body velocity, (n, 2) m/s, body axes.

    To first order it is ``nu_3`` times the tilt. It does not depend on the heading.
    """
    forward = track.R[:, :2, 0] / np.linalg.norm(track.R[:, :2, 0], axis=1, keepdims=True)
    heading = np.stack([forward, forward[:, ::-1] * [-1.0, 1.0]], axis=2)
    unturned = np.einsum('nij,nj->ni', heading, track.nu[:, :2])
    added = track.velocity[:, :2] - unturned  # horizontal, inertial
    return np.einsum('nji,nj->ni', track.R[:, :2, :2], added)


def flow(track: Track, height: Array, values: Mapping[str, float]) -> Array:
    """
    Return the flow measured along a motion, (n, 2) rad/s, body x forward and y right.

    Parameters
    ----------
    track
        True motion.
    height : (n,) m
        The height ``height_lag`` earlier.
    values
        {parameter: value}; missing parameters are 0, a missing scale is 1.

    """
    p = {name: values.get(name, 0.0) for name in PARAMETERS}
    nu, omega, h = track.nu, track.omega, track.height
    wrong = np.outer(nu[:, 2], [p['coupling_x'], p['coupling_y']])
    if p['frame']:
        wrong += p['frame'] * level_part(track)
    if p['coriolis']:
        wrong -= p['coriolis'] * np.cross(omega, nu)[:, :2]
    rotation = np.column_stack([omega[:, 1], -omega[:, 0]])
    x = (nu[:, :2] - wrong) / track.depth[:, None] + p['leakage'] * rotation
    Q = factor(h, values.get('scale', 1.0), p['slope'], p['gain'])
    scaling = (height + p['height_offset']) / (h * Q)
    if p['tilt_ignored']:
        scaling *= 1.0 + p['tilt_ignored'] * (track.R[:, 2, 2] - 1.0)
    return scaling[:, None] * x * (1.0 + p['cubic'] * x * x)


def rate_share(track: Track, values: Mapping[str, float]) -> Array:
    """Return the change of the flow by that of a rate about x or y, (n, 2), as :func:`flow`."""
    turned = values.get('leakage', 0.0) + values.get('coriolis', 0.0) * (
        track.nu[:, 2] / track.depth)
    Q = factor(track.height, *(values.get(name, start) for name, start in (
        ('scale', 1.0), ('slope', 0.0), ('gain', 0.0))))
    return np.repeat((turned / Q)[:, None], 2, axis=1)


def dead_reckoned(track: Track, flow_rates: Array, scale: float = 1.0) -> Array:
    """
    Return the horizontal velocity according to (5.2), (n, 2) m/s, inertial.

    Height, attitude and vertical body velocity are true values.
    """
    body = np.column_stack([scale * track.depth[:, None] * flow_rates, track.nu[:, 2]])
    return np.einsum('nij,nj->ni', track.R, body)[:, :2]
