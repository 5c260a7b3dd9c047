"""Whether the path of a command stays in the volume and within the limits of the vehicle."""

from __future__ import annotations

import math

from mambo_model.motion.polynomial import Array, Course, DEGREE
from mambo_model.motion.trajectory import LANDING, TAKEOFF, TRACK
from mambo_model.vehicle.parameters import Vehicle
import numpy as np

from . import demand as demands
from .command_params import CommandParams
from .demand import told_apart
from .maneuvers import Segment

_ROUNDING = 1e-6  # m, m/s, m/s^2


def _samples(segment: Segment, polynomials: Array) -> Array:
    """Return polynomials, (..., k), at the times at which a path is checked, (n, ...)."""
    t = demands.times(_course([segment]))
    return np.polynomial.polynomial.polyval(t, polynomials.T).T


def _outside(points: Array, low: float, p: CommandParams) -> str:
    """Return how points, (n, 3) m inertial NED, leave the volume; empty: they do not."""
    for name, value, limit in (
            ('x', points[:, 0], p.x_limit), ('y', -points[:, 1], p.y_limit)):
        far = float(value[np.argmax(np.abs(value))])
        if not abs(far) <= limit + _ROUNDING:
            told = told_apart(far, math.copysign(limit, far))
            return f'the path leaves the volume: {name} = {told} m, limit {limit:g} m'
    high, deep = float(-points[:, 2].min()), float(-points[:, 2].max()) + 0.0
    if not high <= p.ceiling + _ROUNDING:
        return f'the path is {told_apart(high, p.ceiling)} m high, ceiling {p.ceiling:g} m'
    if not deep >= low - _ROUNDING:
        return (f'the path comes down to {told_apart(deep, p.lowest)} m, '
                f'lowest flight {p.lowest:g} m')
    return ''


def beyond(
    segments: list[Segment], end: Array, height: float, p: CommandParams, vehicle: Vehicle,
    hovers: bool = False,
) -> str:
    """
    Return which limit a path exceeds, in one line; empty: none.

    Parameters
    ----------
    segments
        The path, each part of a duration in s.
    end : (4,) m, inertial NED, and rad
        Where it comes to rest.
    height : m
        Of the present reference: a path may begin below the lowest flight, but not sink further.
    p
        Volume, speed, acceleration, yaw rate.
    vehicle
        As the controller knows it.
    hovers
        Whether the end is a hover at a height that was asked for, not one where the path stops.

    """
    segments = [one for one in segments if one.coefficients.shape[1] > 1]  # the others rest
    total = sum(segment.duration for segment in segments)
    if not total <= p.longest:
        return f'the path takes {told_apart(total, p.longest)} s, limit {p.longest:g} s'
    for segment in (Segment(0.0, end[:, None], TRACK), *segments):
        landing = segment.phase in (TAKEOFF, LANDING) or segment.duration == 0.0
        low = 0.0 if landing else min(p.lowest, height)
        low = p.lowest if hovers and segment.duration == 0.0 else low
        if wrong := _outside(_samples(segment, segment.coefficients[:3]), low, p):
            return wrong
    if not segments:
        return ''
    return _too_fast(segments, p) or _too_much(segments, p, vehicle)


def _course(segments: list[Segment]) -> Course:
    """Return a path as a course."""
    coefficients = np.zeros((len(segments), 4, DEGREE + 1))
    for row, segment in zip(coefficients, segments, strict=True):
        row[:, :segment.coefficients.shape[1]] = segment.coefficients
    return Course(np.array([segment.duration for segment in segments]), coefficients)


def _too_fast(segments: list[Segment], p: CommandParams) -> str:
    """Return whether a path turns faster than it may; empty: it does not."""
    for segment in segments:
        rate = np.polynomial.polynomial.polyder(segment.coefficients[3])
        fastest = float(np.abs(_samples(segment, rate)).max())
        if not fastest <= p.yaw_rate + _ROUNDING:
            return (f'the path turns at {told_apart(fastest, p.yaw_rate)} rad/s, '
                    f'limit {p.yaw_rate:g} rad/s')
    return ''


def _too_much(segments: list[Segment], p: CommandParams, vehicle: Vehicle) -> str:
    """Return what a path demands beyond a limit; empty: nothing."""
    t, columns = demands.demand(_course(segments), vehicle)
    ranges = demands.limits(vehicle, p.body_rate)
    ranges |= {'speed': demands.Limit(-math.inf, p.speed + _ROUNDING),
               'acceleration': demands.Limit(-math.inf, p.acceleration + _ROUNDING),
               'height': demands.Limit(-_ROUNDING, p.ceiling + _ROUNDING)}
    found = demands.failure(t, columns, ranges)
    return f'the path needs {found}' if found else ''
