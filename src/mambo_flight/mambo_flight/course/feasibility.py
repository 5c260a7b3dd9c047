"""
Feasibility of a course: whether a vehicle can fly it, and how much slower it could.

What the course demands and the limits are those of :mod:`mambo_control.commanded.demand`.
"""

from __future__ import annotations

from mambo_control.commanded import demand as demands
from mambo_control.commanded.demand import demand, Failure, Limit, QUANTITIES
from mambo_model.errors import InputError, JobError
from mambo_model.motion.polynomial import Array, Course, ends, stretched
from mambo_model.motion.trajectory import FlightPlanParams
from mambo_model.vehicle.motor_mixer import thrust_from_pwm
from mambo_model.vehicle.parameters import Vehicle
from mambo_sim.sensors.imu import ImuParams
import numpy as np

__all__ = [
    'check', 'check_flight', 'demand', 'factor', 'Failure', 'failure', 'Limit', 'limits', 'odd',
    'part_of', 'QUANTITIES', 'remedy', 'stretch', 'too_heavy']

LONGEST = 100.0     # largest factor of time, tried or given by an option
PRECISION = 1e-4    # relative precision of the stretch
FAR = 30.0          # m, from the first point; a hall is smaller
JUMP = 2.0          # m/s^2 of acceleration; 1 costs flatness_drag 11 mm between two parabolas
LONG, SLOW = 600.0, 0.01  # s and m/s; a course that is longer and slower has its times in ms


def limits(vehicle: Vehicle) -> dict[str, Limit]:
    """Return the range of each limited quantity; the body rate is the range of the gyro."""
    return demands.limits(vehicle, ImuParams().gyro_range)


def failure(t: Array, columns: Array, vehicle: Vehicle) -> Failure | None:
    """Return the first point of a result of :func:`demand` beyond a limit, else None."""
    return demands.failure(t, columns, limits(vehicle))


def check(course: Course, vehicle: Vehicle) -> Failure | None:
    """Return the first point of a course that a vehicle cannot fly, else None."""
    return failure(*demand(course, vehicle), vehicle)


def check_flight(plan: FlightPlanParams, vehicle: Vehicle) -> Failure | None:
    """
    Return the first point of a whole flight that a vehicle cannot fly, else None.

    Parameters
    ----------
    plan
        Of a course: climb, way to the course, course, stop and descent.
    vehicle

    """
    pieces = plan.pieces()
    flight = Course(np.diff(pieces.begin), pieces.coefficients[:-1])  # the last is rest for ever
    ranges = {name: one for name, one in limits(vehicle).items() if name != 'height'}
    return demands.failure(*demand(flight, vehicle), ranges)


def part_of(plan: FlightPlanParams, t: float) -> str:
    """Return the parameter that says how long the part of a plan at t in s takes."""
    timing = plan.timing
    aloft = timing.start_time <= t < timing.landing_time + timing.blend_duration
    return 'blend_duration' if aloft else 'climb_duration'


def too_heavy(vehicle: Vehicle) -> str:
    """Return in words that a vehicle cannot lift its weight, '' if it can, with a full battery."""
    vv, battery = vehicle.values(), vehicle.battery
    sag = battery.full_voltage / battery.reference_voltage if battery.enabled else 1.0
    most, weight = 4.0 * thrust_from_pwm(sag * vv.pwm_max, vv), vv.mass * vv.gravity
    return '' if most > weight else (
        f'the vehicle cannot lift its weight: its most thrust is {most:.3g} N, its weight '
        f'{weight:.3g} N')


def odd(course: Course) -> str:
    """Return in words what of a course suggests a wrong unit or missing smoothness, else ''."""
    first, last = ends(course)
    at = np.concatenate([first, last])[:, :3, 0]  # of all pieces
    way = float(np.linalg.norm(at - at[0], axis=1).max())
    if way > FAR:
        return f'goes {way:.3g} m from its first point: positions are in metres'
    if course.total > LONG and way < SLOW * course.total:
        return f'takes {course.total:.4g} s to go {way:.3g} m: times are in seconds'
    jumps = np.linalg.norm(first[1:, :3, 2] - last[:-1, :3, 2], axis=1)
    if len(jumps) and (most := float(jumps.max())) > JUMP:
        return (f'has an acceleration that jumps by {most:.3g} m/s^2 at t = '
                f'{course.begin[int(jumps.argmax()) + 1]:.3f} s: no vehicle tilts at once, so it '
                'leaves the path there')
    return ''


def factor(text: str, option: str) -> float:
    """Return the factor given by an option; InputError if it is not valid."""
    try:
        value = float(text)
    except ValueError:
        raise InputError(f'{option} {text}: write a number, or auto') from None
    if not 1.0 / LONGEST <= value <= LONGEST:
        raise InputError(f'{option} {text} must be within {1.0 / LONGEST:g} to {LONGEST:g}')
    return value


def stretch(course: Course, vehicle: Vehicle) -> float:
    """
    Return the smallest factor >= 1 by which time must be stretched to make a course feasible.

    Found by bisection to a relative precision of 1e-4; stretched by the returned factor, the
    course is feasible.

    Raises
    ------
    JobError
        If the course is not feasible at a hundred times its duration; the message says why.

    """
    if check(course, vehicle) is None:
        return 1.0
    low, high = 1.0, 2.0
    while reason := check(stretched(course, high), vehicle):
        low, high = high, 2.0 * high
        if high > LONGEST:
            raise JobError(f'no slower course is feasible either: {reason}, at {low:g} times '
                           'the duration')
    while high - low > PRECISION * low:
        middle = 0.5 * (low + high)
        if check(stretched(course, middle), vehicle) is None:
            high = middle
        else:
            low = middle
    return high


def remedy(course: Course, vehicle: Vehicle) -> str:
    """Return in words what lets a vehicle fly a course that it cannot fly as it is."""
    height, (low, high) = demand(course, vehicle)[1][:, 0], limits(vehicle)['height']
    if height.min() < low or height.max() > high:  # of the path, at any speed
        return (f'no --stretch changes its heights, {height.min():.4g} to {height.max():.4g} m: '
                f'move it with --height, or resize it with --scale, to {low:g} to {high:g} m')
    try:
        stretch(course, vehicle)
    except JobError as error:
        return str(error)
    return '--stretch auto slows it'
