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
_POINTS = 65  # of a segment whose length is measured
_DETOUR = 1.25  # [-] times the way by a point of rest, that one polynomial may be long


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


def length(way: list[Segment]) -> float:
    """Return how long a way of finite duration is, m."""
    out = 0.0
    for segment in way:
        t = np.linspace(0.0, segment.duration, _POINTS)
        points = np.polynomial.polynomial.polyval(t, segment.coefficients[:3].T)
        steps = np.diff(points)
        out += float(np.sqrt((steps * steps).sum(axis=0)).sum())
    return out


def visit(start: Array, end: Array, duration: float, p: CommandParams) -> list[Segment]:
    """
    Return the path from one state to another in a duration in s.

    One polynomial that begins with a velocity and has much time overshoots by it: then the way
    is to rest first, and on from there.
    """
    direct = [move(start, end, duration)]
    slowing, there = stop(start, p)
    left = duration - sum(segment.duration for segment in slowing)
    if not slowing or left < SHORTEST:
        return direct
    over = [*slowing, move(at_rest(there), end, left)]
    return over if length(direct) > _DETOUR * length(over) else direct


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
