"""
A whole flight along a course as one piecewise polynomial: climb, approach, course, exit, landing.

Position and yaw are four times continuously differentiable wherever the course is, as (3.14)
requires. The vehicle climbs above the origin, flies to the initial state of the course, comes to
rest after the course and lands there.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..schema import ParameterError
from .polynomial import (
    Array, connect, Course, DEGREE, evaluate, largest, Pieces, settled, state_at)

MAX_DOWNWARD = 9.0  # m/s^2, below free fall
SWING = 0.25  # m beyond the way to rest


class Timing(NamedTuple):
    """Schedule of a flight, in s of flight time; see ``FlightPlanParams``."""

    takeoff: str
    takeoff_time: float
    climb_duration: float
    start_time: float
    blend_duration: float
    landing_time: float  # inf: never

    @property
    def course_begin(self) -> float:
        """Return the time at which the course itself begins."""
        if self.takeoff == 'none':
            return 0.0
        return self.start_time + (self.blend_duration if self.takeoff == 'smooth' else 0.0)


class _Timeline:
    """A growing sequence of pieces."""

    def __init__(self) -> None:
        self.begin: list[float] = []
        self.coefficients: list[Array] = []

    def add(self, begin: float, coefficients: Array) -> None:
        """Add the piece that begins at a time, in place of one that would last no time."""
        if self.begin and self.begin[-1] == begin:
            del self.begin[-1], self.coefficients[-1]
        padded = np.zeros((4, DEGREE + 1))
        padded[:, :coefficients.shape[1]] = coefficients
        self.begin.append(begin)
        self.coefficients.append(padded)

    def rest(self, begin: float, point: Array) -> None:
        """Add rest at a point, (4,) m and rad."""
        self.add(begin, point[:, None])

    def move(self, begin: float, duration: float, start: Array, end: Array) -> None:
        """Add the polynomial from one state, (4, 5), to another, or rest if both are that rest."""
        if not np.array_equal(start, end) or start[:, 1:].any():
            self.add(begin, connect(start, end, duration))
        else:
            self.rest(begin, end[:, 0])

    def pieces(self) -> Pieces:
        """Return the pieces for compiled code."""
        return Pieces(np.array(self.begin), np.array(self.coefficients))


def _at_rest(point: Array) -> Array:
    """Return the state, (4, 5), of rest at a point, (4,)."""
    return np.hstack((point[:, None], np.zeros((4, 4))))


def _stop(state: Array, duration: float) -> Array:
    """Return the point, (4,), reached if the velocity falls linearly to 0 in ``duration`` s."""
    return state[:, 0] + 0.5 * duration * state[:, 1]


def assemble(course: Course, timing: Timing) -> Pieces:
    """
    Return the pieces of a flight.

    Parameters
    ----------
    course
        Course with the size, height and speed to fly.
    timing
        With takeoff ``smooth``: on the ground until ``takeoff_time``, a climb to the height of
        the beginning of the course, at ``start_time`` a blend to its first state, then the
        course. ``step``: the reference jumps to that height and, at ``start_time``, onto the
        course. ``none``: the course from t = 0. At the end of the course, or at ``landing_time``
        if that is earlier, the vehicle comes to rest within ``blend_duration``. The descent begins
        ``blend_duration`` after ``landing_time``.

    Raises
    ------
    ParameterError
        If the flight hits the ground or accelerates downward by more than MAX_DOWNWARD; the
        message gives the time.

    """
    line, first = _Timeline(), settled(state_at(course, 0.0))
    above = np.array([0.0, 0.0, first[2, 0], 0.0])
    if timing.takeoff != 'none':
        line.rest(0.0, np.zeros(4))
        if timing.takeoff == 'smooth':
            line.move(timing.takeoff_time, timing.climb_duration,
                      _at_rest(np.zeros(4)), _at_rest(above))
        line.rest(timing.takeoff_time + (
            timing.climb_duration if timing.takeoff == 'smooth' else 0.0), above)
        if timing.takeoff == 'smooth':
            line.move(timing.start_time, timing.blend_duration, _at_rest(above), first)
    for begin, piece in zip(course.begin, course.coefficients, strict=True):
        line.add(timing.course_begin + begin, piece)
    end = timing.course_begin + course.total
    _leave(line, end, settled(state_at(course, math.inf)), timing.blend_duration)
    if timing.landing_time < math.inf:
        _land(line, timing)
    pieces = line.pieces()
    _check(pieces, timing)
    return pieces


def _leave(line: _Timeline, begin: float, state: Array, duration: float) -> Array:
    """
    Add the polynomial from a state to rest, and rest; return the point of rest, (4,).

    It takes the duration, or half or a quarter of it where a longer one swings far out.
    """
    for part in (1.0, 0.5, 0.25):
        end = _stop(state, part * duration)
        path = connect(state, _at_rest(end), part * duration)
        if _swing(path, part * duration, state[:, 0], end) < SWING:
            break
    line.move(begin, part * duration, state, _at_rest(end))
    line.rest(begin + part * duration, end)
    return end


def _swing(path: Array, duration: float, start: Array, end: Array) -> float:
    """Return by how many m a path, (4, 10), goes beyond the box of its ends, (4,)."""
    low, high = np.minimum(start, end), np.maximum(start, end)
    return max(max(largest(axis, duration, 0)[0] - high[k],
                   low[k] + largest(-axis, duration, 0)[0]) for k, axis in enumerate(path[:3]))


def _land(line: _Timeline, timing: Timing) -> None:
    """Replace the pieces after the landing time by a stop and a descent to the ground."""
    begin = timing.landing_time
    state = np.array(evaluate(begin, line.pieces()))
    kept = sum(other < begin for other in line.begin)
    del line.begin[kept:], line.coefficients[kept:]
    above = _leave(line, begin, state, timing.blend_duration)
    down = above * np.array([1.0, 1.0, 0.0, 1.0])
    begin += timing.blend_duration
    line.move(begin, timing.climb_duration, _at_rest(above), _at_rest(down))
    line.rest(begin + timing.climb_duration, down)


def _check(pieces: Pieces, timing: Timing) -> None:
    """Raise ParameterError if a flight hits the ground or accelerates downward too fast."""
    aloft = timing.start_time if timing.takeoff != 'none' else 0.0
    landed = timing.landing_time + timing.blend_duration
    stop = [*pieces.begin[1:], math.inf]
    for begin, end, piece in zip(pieces.begin, stop, pieces.coefficients, strict=True):
        duration = end - begin if end < math.inf else 0.0
        depth, when = largest(piece[2], duration, 0)
        if aloft <= begin < landed and depth >= 0.0:
            raise ParameterError(
                f'the trajectory reaches a height of {0.0 - depth:.3g} m '
                f'{_when(begin + when, timing)}: set height, that of its beginning in m')
        fall, when = largest(piece[2], duration, 2)
        if fall > MAX_DOWNWARD:
            raise ParameterError(
                f'the trajectory asks for {fall:.3g} m/s^2 downward '
                f'{_when(begin + when, timing)}, limit {MAX_DOWNWARD:g} m/s^2: lower scale_rate, '
                'or lengthen blend_duration or climb_duration')


def _when(t: float, timing: Timing) -> str:
    """Return a flight time in words, with the time of the course."""
    return f'at t = {t:.3g} s of the flight, {t - timing.course_begin:.3g} s of the course'
