"""The scenarios of the drones of a world: seeds, flight plans, places, and their separation."""

from __future__ import annotations

from collections.abc import Iterator
import itertools
import math
from typing import NamedTuple

from mambo_model.compiled import jit
from mambo_model.errors import InputError
from mambo_model.motion import uav_trajectories
from mambo_model.motion.trajectory import COURSE, flat_output, PlanValues
from mambo_model.motion.vector import Vec3
from mambo_model.schema import ParameterError
from mambo_ros import topics
from mambo_sim.parameters import STEP_NS
from mambo_sim.world import places as places_of, WorldParams
import numpy as np
from numpy.typing import NDArray

from .. import scenario as scenarios, unused
from ..course import course_file, feasibility, function_course
from ..scenario import Scenario
from ..scenario_file import FIELDS, long_enough
from .world_file import Hall

Array = NDArray[np.float64]


class Drones(NamedTuple):
    """Several drones and the hall that they share."""

    flights: list[Scenario]  # in the order of the places
    hall: Hall


def namespaces(drones: int) -> list[str]:
    """Return the namespaces of one drone, ``/mambo``, or of several, ``/mambo1`` and so on."""
    return [topics.NAMESPACE] if drones == 1 else [
        f'{topics.NAMESPACE}{number + 1}' for number in range(drones)]


def hall(base: Scenario, params: WorldParams, timed: bool = False) -> Drones:
    """
    Return the scenario of every drone of a world, and the hall with the place of each.

    The drones have consecutive seeds from that of ``base`` on. The references of commanded flights
    are not known before they fly, and are not checked.

    Parameters
    ----------
    base
        Scenario of the first drone.
    params
        Of the world.
    timed
        Whether the duration of ``base`` was asked for even if it is the default; an exchange
        otherwise takes the time that it needs.

    Raises
    ------
    InputError
        If references come nearer to each other than ``least_separation``: with pair and time.
    ParameterError
        If the time of the flight is too short for the formation, or its trajectory is not flown.

    """
    places = places_of(params)
    if params.formation == 'exchange':
        base = _with_time(base, params, timed)
    out = [
        scenarios.override(base, {
            **{name: _seed(base, number) for name in scenarios.SEEDS},
            **_plan(base, params, places[number], number)})
        for number in range(params.drones)]
    if not base.reference_node.commands.enabled:
        check(out, places, params.least_separation)
    return Drones(out, Hall(
        params, dict(zip(namespaces(params.drones), places, strict=True))))


def _seed(base: Scenario, number: int) -> int:
    """Return the seed of a drone."""
    if base.seed + number > scenarios.MAX_SEED:
        raise ParameterError(f'seed {base.seed} leaves no seeds for {number + 1} drones')
    return base.seed + number


def _plan(
    base: Scenario, params: WorldParams, place: Vec3, number: int,
) -> dict[str, object]:
    """Return what the flight plan of a drone has of its own, by parameter."""
    plan, prefix = base.reference_node.plan, 'reference_node.plan.'
    if params.formation == 'follow':
        later = plan.start_time + number * params.delay
        end, ends = plan.landing_time, 'land'
        if not end and not base.reference_node.commands.enabled:
            end, ends = base.sim_node.duration, 'end its flight'
        if 0.0 < end < later + plan.blend_duration:
            raise ParameterError(
                f'world.delay = {params.delay:g} s: drone {number + 1} would begin its motion at '
                f't = {later:g} s and {ends} at {end:g} s; lengthen the flight or shorten the '
                'delay')
        return {f'{prefix}start_time': later}
    if params.formation == 'exchange':
        return {f'{prefix}trajectory': COURSE,
                f'{prefix}course': _half_turn(place, plan.hover()[2], params.turn_time)}
    return {}


def _half_turn(place: Vec3, altitude: float, duration: float) -> str:
    """
    Return the course of half a turn about the middle of the hall, in the frame of the drone.

    All drones are at the same angle of the turn at all times, so that they keep the shape and
    the distances of the places.

    Parameters
    ----------
    place : (3,) m
        Where the drone starts, from the middle.
    altitude : m
        NED.
    duration : s

    """
    x, y, _ = place

    def position(t: float) -> tuple[float, float, float]:
        """Return where the drone is at t in s, m."""
        share = min(max(t / duration, 0.0), 1.0)
        # rises from 0 to 1; five derivatives vanish at both ends
        smooth = share**6 * (462.0 + share * (-1980.0 + share * (3465.0 + share * (
            -3080.0 + share * (1386.0 - 252.0 * share)))))
        c, s = math.cos(math.pi * smooth), math.sin(math.pi * smooth)
        return (c * x - s * y - x, s * x + c * y - y, altitude)
    return uav_trajectories.to_text(function_course.fit(position, duration, 'exchange of places'))


def _with_time(base: Scenario, params: WorldParams, timed: bool) -> Scenario:
    """
    Return the scenario with the time that an exchange of places needs, landing included.

    A longer time that was asked for stays: the drones hover at the end.
    """
    plan, asked = base.reference_node.plan, base.sim_node.duration
    if plan.trajectory != FIELDS['trajectory'].default:
        unused.refuse_trajectory('reference_node.plan.trajectory', plan.trajectory, params)
    lands = plan.landing_time > 0.0
    course = scenarios.override(base, {
        'reference_node.plan.trajectory': COURSE, 'reference_node.plan.landing_time': 0.0,
        'reference_node.plan.course': _half_turn(
            (1.0, 0.0, 0.0), plan.hover()[2], params.turn_time)})
    duration = long_enough(course.reference_node.plan, lands)
    if asked and (timed or asked != FIELDS['duration'].default):
        needed = course_file.end(course.reference_node.plan) + lands * scenarios.LANDING
        if asked < needed:
            raise ParameterError(
                f'sim_node.duration = {asked:g} s: an exchange with world.turn_time = '
                f'{params.turn_time:g} s needs {needed:g} s{", landing included" * lands}: '
                'lengthen the flight or shorten the turn')
        duration = asked
    return scenarios.override(base, {
        'sim_node.duration': float(duration),
        'reference_node.plan.landing_time': (
            scenarios.landing_time(duration) if lands else 0.0)})


def remarks(drones: Drones) -> Iterator[str]:
    """Yield a warning, one line, if the drone with the longest way cannot exchange its place."""
    params = drones.hall.params
    if params.formation != 'exchange':
        return
    name, flight = max(
        zip(drones.hall.places, drones.flights, strict=True),
        key=lambda drone: math.hypot(*drones.hall.places[drone[0]]))
    course, vehicle = flight.reference_node.plan.flown_course(), flight.reference_node.vehicle
    if failure := feasibility.check(course, vehicle):
        yield (f'warning: {name} cannot fly its half turn in world.turn_time = '
               f'{params.turn_time:g} s: {failure}; lengthen the turn')


@jit
def _path(times: Array, plan: PlanValues) -> Array:
    """Return the positions of a plan at times in s, (n, 3) m."""
    out = np.empty((len(times), 3))
    for k in range(len(times)):
        rho, _, _, _, _, _ = flat_output(times[k], plan)
        out[k, 0], out[k, 1], out[k, 2] = rho
    return out


def check(flights: list[Scenario], places: list[Vec3], least: float) -> None:
    """
    Check the references of drones in one hall at every control step.

    Parameters
    ----------
    flights
        One scenario each.
    places
        Where each starts, (3,) m.
    least : m
        Least separation.

    Raises
    ------
    InputError
        Naming the pair that comes nearest, time and distance, if it is less.

    """
    duration = max(flight.sim_node.duration for flight in flights)
    times = np.arange(0.0, duration + 0.5e-9 * STEP_NS, 1e-9 * STEP_NS)
    paths = [
        _path(times, flight.reference_node.plan.values()) + np.array(place)
        for flight, place in zip(flights, places, strict=True)]
    worst = (math.inf, 0, 0, 0)
    for one, other in itertools.combinations(range(len(paths)), 2):
        distance = np.linalg.norm(paths[one] - paths[other], axis=1)
        k = int(distance.argmin())
        worst = min(worst, (float(distance[k]), k, one, other))
    distance, k, one, other = worst
    if distance < least - 1e-9:  # rounding of places
        raise InputError(
            f'the references of drones {one + 1} and {other + 1} come within {distance:.3f} m of '
            f'each other at t = {times[k]:.2f} s; world.least_separation is {least:g} m: '
            'raise world.spacing')
