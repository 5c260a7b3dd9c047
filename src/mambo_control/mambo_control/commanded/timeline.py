"""
The reference of a commanded flight: one pure step from a command to the path that it makes.

The path is a sequence of polynomials of flight time, :class:`Timeline`. A command replaces what
comes after its time by a path that continues the present reference with four derivatives. The
reference therefore is a function of the commands with their times alone: node, replay and closed
loop evaluate the same polynomials and get the same bits.

A command that is unsafe has no effect; :func:`step` gives the reason in one line.
"""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable
from functools import partial
import math
from typing import NamedTuple

from mambo_model.errors import InputError
from mambo_model.motion import flight_command as fc, uav_trajectories
from mambo_model.motion.flight_command import FlightCommand
from mambo_model.motion.polynomial import Array, DEGREE, jet, settled, state_at, stretched
from mambo_model.motion.rigid_body import LIFTED
from mambo_model.motion.trajectory import GROUND, LANDED, LANDING, TAKEOFF, TRACK
from mambo_model.schema import ParameterError
from mambo_model.vehicle.parameters import Vehicle
import numpy as np

from ..safety import LARGEST
from .command_params import CommandParams
from .demand import STEP
from .envelope import beyond
from .maneuvers import (
    at_rest, by_rest, extrapolated, fly_on, is_resting, least_duration, length, move, rest,
    Segment, SHORTEST, stop, straight, visit)

LINGERS = 4.0
"""
Time below the lowest flight, s, of a climb or descent whose duration is given. Of 1 m in 8 s none
was more than 0.29 m off; of 1 m in 10 s the Kalman filters ended flights.
"""
_POINTS = 401  # of a path, to see how long it is low
TOUCHDOWN = 0.1  # m, highest reference at which the motors may stop
ALIGNING = 0.5  # s from the start, in which the vehicle rests and the estimator aligns
_LONGER = 1.4  # factor by which a duration that is not given grows until the limits allow it
_TRIES = 8
_FEW = 33  # points of a path whose length is measured in flight
_SOON = 5.0  # s, in which a path may end by itself where a stop or a landing does not fit
_JOINED = 1e-6  # m, rad and their derivatives, by which the ends of a course may miss
_STREAM_TRIES = 5  # of a kind that comes many times a second
_PHASES = ('on the floor', 'taking off', 'flying', 'landing', 'on the floor')
Way = tuple[list[Segment], Array]  # the way, and the point of rest behind it, (4,)


class Refused(InputError):
    """A command cannot be carried out; the text is the reason."""


class _Beyond(Refused):
    """Its path exceeds a limit, however long it takes."""


class Timeline(NamedTuple):
    """The reference so far and to come; a piece lasts until the next begins."""

    begin: tuple[float, ...]          # s of flight time, increasing
    coefficients: tuple[Array, ...]   # (4, 10) each, as in polynomial.Pieces
    phases: tuple[int, ...]           # GROUND ... LANDED of trajectory
    until: float                      # s, end of the newest command's path
    streamed: bool                    # whether that command is one of a stream
    last: int                         # ns, time of the newest command; -1: none


def _padded(coefficients: Array) -> Array:
    out = np.zeros((4, DEGREE + 1))
    out[:, :coefficients.shape[1]] = coefficients
    return out


def initial() -> Timeline:
    """Return the timeline without commands: at rest on the floor, at the origin."""
    return Timeline((0.0,), (_padded(np.zeros((4, 1))),), (GROUND,), 0.0, False, -1)


def state_of(timeline: Timeline, t: float) -> tuple[Array, int]:
    """Return the reference at t in s, (4, 5) m and rad with four derivatives, and its phase."""
    i = max(bisect_right(timeline.begin, t) - 1, 0)
    x, c = max(t - timeline.begin[i], 0.0), timeline.coefficients[i]
    return np.array([jet(axis, x) for axis in c]), timeline.phases[i]


def forgotten(timeline: Timeline, t: float) -> Timeline:
    """Return the timeline without the pieces that ended before t in s."""
    i = max(bisect_right(timeline.begin, t) - 1, 0)
    return timeline._replace(begin=timeline.begin[i:], coefficients=timeline.coefficients[i:],
                             phases=timeline.phases[i:])


def step(
    timeline: Timeline, command: FlightCommand, p: CommandParams, vehicle: Vehicle,
) -> tuple[Timeline, str]:
    """
    Return the timeline after a command, and why it was refused; empty: it was not.

    Parameters
    ----------
    timeline
        Result of the previous step, or :func:`initial`.
    command
        Not earlier than the previous one.
    p
        Limits of commands.
    vehicle
        As the controller knows it: thrust, tilt, rates and PWM of the path are checked.

    """
    t = command.t * 1e-9
    state, phase = state_of(timeline, t)
    waits = phase == GROUND and t < timeline.until  # for the estimator, to take off
    try:
        _check(timeline, command, TAKEOFF if waits else phase, p.longest,
               -state[2, 0] < p.lowest)
        begins = _just_begun(timeline, phase, t)
        if waits and command.kind in (fc.LAND, fc.STOP) or begins and command.kind == fc.LAND:
            # gives the take-off up
            return _joined(timeline, command, [], state[:, 0], phase=GROUND), ''
        if phase == TAKEOFF and -state[2, 0] < LIFTED and command.kind == fc.LAND:
            # there is nothing to descend: the motors stop at once
            return _joined(timeline, command, [], _on_floor(state)[:, 0], phase=LANDED), ''
        segments, end = _plan(command, state, phase, p, vehicle)
        if waits or begins:
            segments = _taking_off(segments)
        elif command.kind in (fc.STOP, fc.LAND) and segments and _ends_nearer(
                timeline, t, segments[0]) and (
                later := _at_its_end(timeline, command, t, p, vehicle)):
            return later, ''
    except _Beyond as error:
        later = _at_its_end(timeline, command, t, p, vehicle)
        return (timeline, str(error)) if later is None else (later, '')
    except (Refused, ParameterError) as error:
        return timeline, str(error)
    return _joined(timeline, command, segments, end), ''


def is_free(timeline: Timeline, t: float) -> bool:
    """Return whether a stream may begin or go on at t in s: no other command is carried out."""
    return state_of(timeline, t)[1] == TRACK and (timeline.streamed or t >= timeline.until)


def _just_begun(timeline: Timeline, phase: int, t: float) -> bool:
    """Return whether the first step of a take-off from the floor is not flown yet."""
    i = max(bisect_right(timeline.begin, t) - 1, 0)
    first = phase == TAKEOFF and i > 0 and timeline.phases[i - 1] == GROUND
    return first and t - timeline.begin[i] < 0.5 * STEP


def _taking_off(segments: list[Segment]) -> list[Segment]:
    """Return a path with its first part as a take-off, which the estimator must be aligned for."""
    for k, one in enumerate(segments):
        if one.phase != GROUND:
            return [*segments[:k], one._replace(phase=TAKEOFF), *segments[k + 1:]]
    return segments


def _ends_nearer(timeline: Timeline, t: float, stopping: Segment) -> bool:
    """Return whether a path has a shorter way to its end than one that stops at once."""
    if not t < timeline.until <= t + _SOON:
        return False
    points = np.array([state_of(timeline, at)[0][:3, 0]
                       for at in np.linspace(t, timeline.until, _FEW)])
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()) < length([stopping])


def _at_its_end(
    timeline: Timeline, c: FlightCommand, t: float, p: CommandParams, vehicle: Vehicle,
) -> Timeline | None:
    """
    Return the timeline with a stop or a landing where its path comes to rest by itself.

    Near its end, or near a limit, a path may have no other way to rest within the limits, or none
    that is as short. None: it does not end soon, or the command is another one.
    """
    end, phase = state_of(timeline, timeline.until)
    if c.kind not in (fc.STOP, fc.LAND) or phase != TRACK or not (
            0.0 < timeline.until - t <= _SOON):
        return None
    try:
        segments, point = _plan(c, end, phase, p, vehicle)
    except Refused:
        return None
    return _joined(timeline, c, segments, point, timeline.until)


def fold(
    commands: Iterable[FlightCommand], p: CommandParams, vehicle: Vehicle,
) -> Timeline:
    """
    Return the timeline of a whole flight.

    Raises
    ------
    ParameterError
        For a command that is refused, naming it and its time.

    """
    out = initial()
    for command in commands:
        out, reason = step(out, command, p, vehicle)
        if reason:
            raise ParameterError(
                f'{fc.NAMES[command.kind]} at t = {command.t * 1e-9:g} s: {reason}')
    return out


def _joined(
    timeline: Timeline, command: FlightCommand, segments: list[Segment], end: Array,
    at: float | None = None, phase: int = TRACK,
) -> Timeline:
    """
    Return the timeline with a path in place of all that comes after its command, or after a time.

    ``at`` is that time, s; ``phase`` that of the rest at the end, unless the path lands.
    """
    t = command.t * 1e-9 if at is None else at
    kept = sum(begin < t for begin in timeline.begin)
    begins, coefficients, phases = [], [], []
    last = LANDED if segments and segments[-1].phase == LANDING else phase
    for segment in (*segments, rest(end, last)):
        begins.append(t)
        coefficients.append(_padded(segment.coefficients))
        phases.append(segment.phase)
        t += segment.duration
    return Timeline(
        (*timeline.begin[:kept], *begins), (*timeline.coefficients[:kept], *coefficients),
        (*timeline.phases[:kept], *phases), begins[-1], command.kind in fc.STREAMED, command.t)


def _check(
    timeline: Timeline, c: FlightCommand, phase: int, longest: float, low: bool,
) -> None:
    """
    Raise Refused for a command that does not fit the moment, or is none at all.

    ``phase`` is TAKEOFF also while the vehicle waits to take off; ``low`` is whether the
    reference is below the lowest flight.
    """
    numbers = (c.duration, c.height, c.yaw, c.yaw_rate, c.timescale, *c.position, *c.velocity,
               *c.acceleration, *c.jerk, *c.snap)
    if not 0 <= c.kind < len(fc.NAMES):
        raise Refused(f'{c.kind} is not a kind of command')
    if not all(map(math.isfinite, numbers)):
        raise Refused('holds a number that is not finite')
    if c.t < max(timeline.last, 0):
        raise Refused(f'is earlier than the command before it, at {timeline.last * 1e-9:g} s')
    if not all(abs(number) <= LARGEST for number in numbers):
        raise Refused(f'holds a number above {LARGEST:g}')
    if not 0.0 <= c.duration <= longest:
        raise Refused(f'duration = {c.duration:g} s is outside [0, {longest:g}] s')
    if 0.0 < c.duration < STEP:
        raise Refused(f'duration = {c.duration:g} s is shorter than a control step, {STEP:g} s')
    grounded = phase in (GROUND, LANDED)
    if c.kind == fc.TAKEOFF and not grounded:
        raise Refused(f'the vehicle is {_PHASES[phase]} already')
    if c.kind != fc.TAKEOFF and grounded:
        raise Refused('the vehicle is on the floor: take off first')
    if c.kind == fc.LAND and phase == LANDING:
        raise Refused('the vehicle is landing already')
    if c.kind == fc.STOP and phase == LANDING and low:
        raise Refused('the vehicle is landing and too low to hover')
    if c.kind in fc.STREAMED and not is_free(timeline, c.t * 1e-9):
        raise Refused('another command is being carried out, until '
                      f't = {timeline.until:.3f} s')


def _on_floor(state: Array) -> Array:
    """Return rest on the floor below a state, (4, 5)."""
    return at_rest(state[:, 0] * np.array([1.0, 1.0, 0.0, 1.0]))


def _plan(
    c: FlightCommand, state: Array, phase: int, p: CommandParams, vehicle: Vehicle,
) -> Way:
    """Return the path of a command within all limits; raise Refused if there is none."""
    waiting = ALIGNING - c.t * 1e-9
    before = [rest(state[:, 0], GROUND, waiting)] if phase == GROUND and waiting > 0.0 else []
    if phase == LANDED:
        state = _on_floor(state)
    builds, tries = _BUILDERS[c.kind](c, state, p)
    first = ''
    for build in builds:
        longer = 1.0
        for _ in range(tries):
            way, end = build(longer)
            longer *= _LONGER
            reason = beyond(way, end, -state[2, 0], p, vehicle, c.kind in _HOVERS)
            if not reason:
                if c.duration or c.kind in _HOVERS:
                    _refuse_blind(way, p)
                return [*before, *way], end
            first = first or reason
    raise _Beyond(first)


_HOVERS = (fc.GO_TO, fc.FOLLOW)
Builder = tuple[list[Callable[[float], Way]], int]
"""Ways by a factor of time, the first within all limits is flown; how many factors are tried."""
_APPROACHES = (
    visit, *(partial(by_rest, slower=k) for k in (1.0, _LONGER, _LONGER * _LONGER)), straight)
"""Ways to a state: a stop that exceeds a limit takes longer; the last is for no room to stop."""


def _approaches(state: Array) -> Iterable[Callable[..., list[Segment]]]:
    """Return the ways to try from a state; all are the same from rest."""
    return (straight,) if is_resting(state) else _APPROACHES


def _tries(c: FlightCommand) -> int:
    """Return how many durations are tried: one that is given is flown, or refused."""
    return 1 if c.duration else _TRIES


def _takeoff(c: FlightCommand, state: Array, p: CommandParams) -> Builder:
    if not p.lowest <= c.height <= p.ceiling:
        raise Refused(f'height = {c.height:g} m is outside [{p.lowest:g}, {p.ceiling:g}] m')
    goal = state[:, 0].copy()
    goal[2] = -c.height
    duration = c.duration or max(2.0 * SHORTEST, least_duration(state, goal, p))
    return [lambda longer: ([move(state, at_rest(goal), longer * duration, TAKEOFF)], goal)], (
        _tries(c))


def _refuse_blind(way: list[Segment], p: CommandParams) -> None:
    """Raise Refused for a path that lingers where no sensor measures the height."""
    low = 0.0
    for segment in way:
        t = np.linspace(0.0, segment.duration, _POINTS)
        height = -np.polynomial.polynomial.polyval(t, segment.coefficients[2])
        low += float(np.mean(height < p.lowest)) * segment.duration
    if low > LINGERS:
        raise Refused(f'the vehicle would be below the lowest flight, {p.lowest:g} m, for '
                      f'{low:.1f} s, limit {LINGERS:g} s: give a shorter duration')


def _land(c: FlightCommand, state: Array, p: CommandParams) -> Builder:
    if not 0.0 <= c.height <= TOUCHDOWN:
        raise Refused(f'height = {c.height:g} m is outside [0, {TOUCHDOWN:g}] m: that of the '
                      'reference when the motors stop')

    def build(longer: float) -> Way:
        """Return the way down."""
        slowing, above = stop(state, p, longer)
        way, down = _descent(above, c.height, c.duration, p, longer)
        return slowing + way, down
    return [build], _tries(c)


def _descent(
    above: Array, height: float, duration: float, p: CommandParams, longer: float,
) -> Way:
    """Return the descent from rest at a point, in a duration in s; 0: as the limits allow."""
    down = above.copy()
    down[2] = -height
    took = duration or longer * max(
        2.0 * SHORTEST, 2.0 * least_duration(at_rest(above), down, p))
    return [move(at_rest(above), at_rest(down), took, LANDING)], down


def _go_to(c: FlightCommand, state: Array, p: CommandParams) -> Builder:
    here = state[:, 0]
    goal = np.array([*c.position, c.yaw]) + (here if c.relative else 0.0)
    goal[3] = here[3] + math.remainder(goal[3] - here[3], 2.0 * math.pi)
    return [lambda longer, way=way: (way(state, at_rest(goal), c.duration, p, longer), goal)
            for way in _approaches(state)], _tries(c)


def _follow(c: FlightCommand, state: Array, p: CommandParams) -> Builder:
    if len(c.trajectory) > fc.MAX_TRAJECTORY:
        raise Refused(f'the trajectory is longer than {fc.MAX_TRAJECTORY} characters')
    if not 0.05 <= c.timescale <= 20.0:
        raise Refused(f'timescale = {c.timescale:g} is outside [0.05, 20]')
    course = stretched(uav_trajectories.parse(c.trajectory, 'trajectory'), c.timescale)
    if course.total > p.longest:
        raise Refused(f'the trajectory lasts {course.total:g} s, limit {p.longest:g} s')
    shift = np.zeros(4)
    if c.relative:
        shift[:3] = state[:3, 0] - state_at(course, 0.0)[:3, 0]
    first, last = state_at(course, 0.0), state_at(course, math.inf)
    turn = 2.0 * math.pi * round((state[3, 0] - first[3, 0]) / (2.0 * math.pi))
    shift[3] = turn
    first[:, 0] += shift
    last[:, 0] += shift
    pieces = course.coefficients.copy()
    pieces[:, :, 0] += shift
    own = [Segment(float(duration), piece, TRACK)
           for duration, piece in zip(course.duration, pieces, strict=True)]
    # pieces of degree 7 join up to jerk only, so the whole may as well
    near = np.allclose(state[:, :4], first[:, :4], rtol=0.0, atol=_JOINED)
    first, last = settled(first), settled(last)

    def build(longer: float, approach: Callable[..., list[Segment]]) -> Way:
        """Return the way to the course, the course, and the way to rest."""
        way = [] if near else approach(state, first, c.duration, p, longer)
        slowing, end = stop(last, p, longer)
        return way + own + slowing, end
    return [partial(build, approach=approach) for approach in _approaches(state)], _tries(c)


def _stop(c: FlightCommand, state: Array, p: CommandParams) -> Builder:
    def build(longer: float) -> Way:
        """Return the way to rest; of a take-off that is too low to hover, up to where it may."""
        way, end = stop(state, p, longer)
        if max(-state[2, 0], -end[2]) >= p.lowest - _JOINED:
            return way, end
        goal = np.array([*end[:2], -p.lowest, end[3]])
        duration = max(2.0 * SHORTEST, least_duration(state, goal, p))
        return [move(state, at_rest(goal), longer * duration, TAKEOFF)], goal
    return [build], _TRIES


def _velocity(c: FlightCommand, state: Array, p: CommandParams) -> Builder:
    velocity = np.array([*c.velocity, c.yaw_rate])
    return [lambda longer: fly_on(state, velocity, c.duration, p, longer)], _STREAM_TRIES


def _setpoint(c: FlightCommand, state: Array, p: CommandParams) -> Builder:
    wanted = np.zeros((4, 5))
    for order, vector in enumerate((c.position, c.velocity, c.acceleration, c.jerk, c.snap)):
        wanted[:3, order] = vector
    yaw = state[3, 0] + math.remainder(c.yaw - state[3, 0], 2.0 * math.pi)
    wanted[3, :2] = yaw, c.yaw_rate

    def build(longer: float) -> Way:
        """Return the way to the setpoint ahead, to rest, and down."""
        ahead = longer * p.setpoint_timeout
        there = extrapolated(wanted, ahead)
        slowing, above = stop(there, p)
        way, down = _descent(above, 0.0, 0.0, p, 1.0)
        hover = [rest(above, TRACK, p.setpoint_landing)] if p.setpoint_landing else []
        return [move(state, there, ahead), *slowing, *hover, *way], down
    return [build], _STREAM_TRIES


_BUILDERS = {fc.TAKEOFF: _takeoff, fc.LAND: _land, fc.GO_TO: _go_to, fc.FOLLOW: _follow,
             fc.STOP: _stop, fc.VELOCITY: _velocity, fc.SETPOINT: _setpoint}
