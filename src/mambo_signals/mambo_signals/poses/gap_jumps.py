"""
Jumps of a motion capture over a gap: a tracker that lost the body finds it with other markers.

A vehicle may really turn and move in a gap, so the limits for one frame of :mod:`.outliers` say
nothing there. The motion in the gap is taken from the speeds before and after it. What a step
shows beyond that motion is a suspected jump. It may also be a maneuver in the gap: a jump counts
only where another sensor shows it, or where the poses jump back later.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ..resample import Bools, Floats, gaps

NEAR = 0.1      # s before and after a gap, over which speeds are taken
TURN = 1.2      # rad beyond the motion: six real flights of 0.5 m/s had 0.6 at most in any gap
FASTER = 8.0    # rad/s beyond the speeds beside a gap, that a vehicle may turn in it
SHIFT = 0.5     # m beyond the motion, at least
SPEEDS_UP = 10.0  # m/s^2: a gap of dt admits this times dt^2 of shift more
LONGEST = 0.35  # s of a gap that the speeds beside it can bridge
DOUBTFUL = 5.0  # s of a gap, up to which a turn of ``TURN`` is told
HALF_TURN = 2.5  # rad, that is told between two frames of a slow capture
SAME_TURN = 1.0  # rad, tolerance for one assignment across a gap
STEADY = 0.5    # rad between the turns by both speeds, above which neither counts
BY_SENSOR = 1.0  # rad between the turn of the poses and that of another sensor
COVERED = 2.0   # s of a gap over which a gyro is integrated
MANY = 1000     # steps for which another sensor is asked
Turned = Callable[[float, float], Floats]
"""
How the body turned between two times in s by another sensor: a quaternion x y z w in the axes of
the body before; NaN: not known.
"""


class Steps(NamedTuple):
    """
    What the n - 1 steps between poses show beyond the motion of the vehicle.

    Attributes
    ----------
    turns : (n - 1, 4)
        Quaternions x y z w, in the axes of the body before. Where the speeds differ too much, of
        the whole step.
    shifts : (n - 1, 3)
        m.
    sure, suspected, doubtful : (n - 1,)
        Jumps that another sensor shows; that the speeds beside them contradict; turns in a gap
        that is too long to say.

    """

    turns: Floats
    shifts: Floats
    sure: Bools
    suspected: Bools
    doubtful: Bools


def largest_shift(dt: Floats) -> Floats:
    """Return how far, m, a vehicle may come in a gap in s beyond what its speeds tell."""
    return SHIFT + SPEEDS_UP * dt * dt


def _speeds(
    times: Floats, position: Floats, turns: Rotation, first: object, last: object,
) -> tuple[Floats, Floats]:
    """Return the mean velocities, m/s, and rates in the frame of the room, rad/s, (k, 3) each."""
    span = np.maximum(times[last] - times[first], 1e-9)[:, None]
    return (position[last] - position[first]) / span, (
        (turns[last] * turns[first].inv()).as_rotvec() / span)


def steps(
    times: Floats, position: Floats, turns: Rotation, turned: Turned | None = None,
) -> Steps:
    """
    Return what the steps between n poses show beyond the motion of the vehicle.

    Parameters
    ----------
    times : (n,) s, ascending
    position : (n, 3) m
    turns
        n attitudes, body to inertial.
    turned
        By another sensor.

    """
    k = np.arange(1, len(times))
    before = np.clip(np.searchsorted(times, times[k - 1] - NEAR), 0, np.maximum(k - 2, 0))
    after = np.clip(np.searchsorted(times, times[k] + NEAR, side='right') - 1,
                    np.minimum(k + 1, len(times) - 1), len(times) - 1)
    v0, w0 = _speeds(times, position, turns, before, k - 1)
    v1, w1 = _speeds(times, position, turns, k, after)
    dt = np.diff(times)
    half = 0.5 * dt[:, None]
    moved = position[k] - position[k - 1]
    plain = turns[k - 1].inv() * turns[k]
    beyond = turns[k - 1].inv() * Rotation.from_rotvec(-half * (w0 + w1)) * turns[k]
    further = moved - half * (v0 + v1)
    size = np.minimum(beyond.magnitude(), plain.magnitude())
    shift = np.minimum(np.linalg.norm(further, axis=1), np.linalg.norm(moved, axis=1))
    even = np.linalg.norm(half * (w1 - w0), axis=1)[:, None] < STEADY
    kept = np.where(even, beyond.as_quat(), plain.as_quat())
    shifts = np.where(np.linalg.norm(half * (v1 - v0), axis=1)[:, None] < SHIFT, further, moved)
    gap = gaps(times)
    bridged = (dt <= LONGEST) & (gap | (np.median(dt) <= NEAR))
    faster = size > np.maximum(TURN, FASTER * dt)
    farther = (dt >= NEAR) & (shift > largest_shift(dt))
    suspected = bridged & (faster | farther)
    doubtful = ~bridged & (dt <= DOUBTFUL) & (size > np.where(gap, TURN, HALF_TURN))
    sure = np.zeros(len(dt), bool)
    if turned is not None:
        asked = (gap | (plain.magnitude() > TURN)) & (dt <= COVERED)
        for i in np.flatnonzero(asked)[:MANY]:
            by_it = turned(float(times[i]), float(times[i + 1]))
            if np.isfinite(by_it).all():
                sure[i] = between(plain[i].as_quat(), by_it) > BY_SENSOR
                suspected[i] &= sure[i] | farther[i]
                doubtful[i] = False
    return Steps(kept, shifts, sure, suspected, doubtful)


def between(one: Floats, other: Floats) -> float:
    """
    Return the least angle, rad, between two turns whose axes differ by an unknown yaw alone.

    A turn about another heading of the body has the same w and z, and the same length of x and y.
    """
    cosine = abs(one[3] * other[3] + one[2] * other[2]) + (
        np.linalg.norm(one[:2]) * np.linalg.norm(other[:2]))
    return float(2.0 * np.arccos(min(cosine, 1.0)))
