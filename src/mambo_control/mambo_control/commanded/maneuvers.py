"""
Smooth paths from a present state: move, stop, fly on at a velocity, descend.

Each is one or several polynomials of degree 9 (:mod:`mambo_model.motion.polynomial`) that
continue the present position and yaw with four derivatives. States are (4, 5): x, y, z in m
(inertial NED) and yaw in rad, with derivatives up to the fourth.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from mambo_model.motion.polynomial import Array, connect
from mambo_model.motion.trajectory import BLEND_ACCELERATION, BLEND_SPEED, TRACK
import numpy as np

from .command_params import CommandParams

SHORTEST = 1.0  # s, of a path whose duration is not given
_MARGIN = 0.8  # of the limits, that a path whose duration is not given keeps
_BRAKE = 35.0 / 16.0  # peak of the acceleration over its mean, of a change of velocity
_BRAKE_SHORTEST = 0.4  # s
_POINTS = 65  # of a segment that is measured
_SWING = 0.2  # m, about the width of the drone, that one polynomial may go out of its way


class Segment(NamedTuple):
    """One polynomial of a path."""

    duration: float      # s; inf: to the end of the flight
    coefficients: Array  # (4, k) as in polynomial.Pieces
    phase: int           # of the flight while it lasts, GROUND ... LANDED of trajectory


def at_rest(point: Array) -> Array:
    """Return the state of rest at a point, (4,)."""
    return np.hstack((point[:, None], np.zeros((4, 4))))


def rest(point: Array, phase: int, duration: float = math.inf) -> Segment:
    """Return rest at a point, (4,) m and rad."""
    return Segment(duration, point[:, None], phase)


def is_resting(state: Array) -> bool:
    """Return whether a state is one of rest."""
    return not state[:, 1:].any()


def move(start: Array, end: Array, duration: float, phase: int = TRACK) -> Segment:
    """Return the polynomial from one state to another in a duration in s."""
    return Segment(duration, connect(start, end, duration), phase)


def _along(segment: Segment) -> Array:
    """Return positions along a segment of finite duration, (3, n) m."""
    t = np.linspace(0.0, segment.duration, _POINTS)
    return np.polynomial.polynomial.polyval(t, segment.coefficients[:3].T)


def length(way: list[Segment]) -> float:
    """Return how long a way of finite duration is, m."""
    out = 0.0
    for segment in way:
        steps = np.diff(_along(segment))
        out += float(np.sqrt((steps * steps).sum(axis=0)).sum())
    return out


def straight(
    start: Array, end: Array, duration: float, p: CommandParams, longer: float = 1.0,
) -> list[Segment]:
    """Return the path of one polynomial from one state to another; arguments as :func:`visit`."""
    return [move(start, end, duration or longer * least_duration(start, end[:, 0], p))]


def by_rest(
    start: Array, end: Array, duration: float, p: CommandParams, longer: float = 1.0,
    slower: float = 1.0,
) -> list[Segment]:
    """
    Return the path from one state to another that comes to rest first, as by :func:`stop`.

    Without the time for it, or from rest, it is :func:`straight`. Arguments as :func:`visit`;
    ``slower`` is the factor of the time to rest.
    """
    slowing, there = stop(start, p, slower)
    left = duration - sum(segment.duration for segment in slowing) if duration else (
        longer * least_duration(at_rest(there), end[:, 0], p))
    if not slowing or left < SHORTEST:
        return straight(start, end, duration, p, longer)
    return [*slowing, move(at_rest(there), end, left)]


def visit(
    start: Array, end: Array, duration: float, p: CommandParams, longer: float = 1.0,
) -> list[Segment]:
    """
    Return the path from one state to another.

    One polynomial that begins with a velocity may swing far out by it: then the way is to rest
    first, and on from there.

    Parameters
    ----------
    start, end
        States, (4, 5).
    duration : s
        Of the whole path; 0: as the limits allow.
    p
        Limits.
    longer
        Factor of a duration that is not given; the time to rest stays.

    """
    direct = straight(start, end, duration, p, longer)
    over = by_rest(start, end, duration, p, longer)
    points = np.array([start[:3, 0], stop(start, p)[1][:3], end[:3, 0]])
    return over if _outside(direct, points) > _outside(over, points) + _SWING else direct


def _outside(way: list[Segment], points: Array) -> float:
    """Return how far a way leaves the box around points, (n, 3) m, along an axis, m."""
    out = 0.0
    for segment in way:
        path = _along(segment)
        out = max(out, float((path.max(axis=1) - points.max(axis=0)).max()),
                  float((points.min(axis=0) - path.min(axis=1)).max()))
    return out


def least_duration(start: Array, goal: Array, p: CommandParams) -> float:
    """Return the time in s from a state to rest at a goal, (4,), that the limits allow at rest."""
    distance = float(np.linalg.norm(goal[:3] - start[:3, 0]))
    turn = abs(float(goal[3] - start[3, 0]))
    return max(SHORTEST, BLEND_SPEED * distance / (_MARGIN * p.speed),
               BLEND_SPEED * turn / (_MARGIN * p.yaw_rate),
               math.sqrt(BLEND_ACCELERATION * distance / (_MARGIN * p.acceleration)))


def _change_duration(change: Array, p: CommandParams) -> float:
    """Return the time in s in which a velocity may change, (4,) m/s and rad/s."""
    return max(_BRAKE_SHORTEST, _BRAKE * float(np.linalg.norm(change[:3])) / (
        0.5 * p.acceleration), abs(float(change[3])) / p.yaw_rate)


def stop(start: Array, p: CommandParams, longer: float = 1.0) -> tuple[list[Segment], Array]:
    """
    Return the path to rest from a state, and where it ends, (4,).

    Parameters
    ----------
    start
        Present state, (4, 5).
    p
        Limits.
    longer
        Factor of the time that it takes.

    """
    if is_resting(start):
        return [], start[:, 0]
    duration = longer * _change_duration(start[:, 1], p)
    end = start[:, 0] + 0.5 * duration * start[:, 1]
    return [move(start, at_rest(end), duration)], end


def fly_on(
    start: Array, velocity: Array, hold: float, p: CommandParams, longer: float = 1.0,
) -> tuple[list[Segment], Array]:
    """
    Return the path to a velocity, on at it, and to rest; and where it ends, (4,).

    Parameters
    ----------
    start
        Present state, (4, 5).
    velocity : (4,) m/s, inertial NED, and rad/s
    hold : s
        For which the velocity is kept after it was reached.
    p
        Limits.
    longer
        Factor of the times in which the velocity changes.

    """
    duration = longer * _change_duration(velocity - start[:, 1], p)
    moving = np.zeros((4, 5))
    moving[:, 0] = start[:, 0] + 0.5 * duration * (start[:, 1] + velocity)
    moving[:, 1] = velocity
    out = [move(start, moving, duration)]
    if velocity.any():
        out.append(Segment(hold, moving[:, :2].copy(), TRACK))
        moving[:, 0] += hold * velocity
    slowing, end = stop(moving, p, longer)
    return out + slowing, end


def extrapolated(state: Array, duration: float) -> Array:
    """Return a state, (4, 5), after a duration in s if its fourth derivative stays."""
    out, term = np.zeros((4, 5)), 1.0
    for power in range(5):
        for order in range(5 - power):
            out[:, order] += state[:, order + power] * term
        term *= duration / (power + 1)
    return out
