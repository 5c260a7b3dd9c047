"""Warnings about the course of a flight: a wrong unit, a jump, and what the vehicle cannot fly."""

from __future__ import annotations

from collections.abc import Iterator

from mambo_model.errors import JobError
from mambo_model.motion.trajectory import COURSE, FlightPlanParams
from mambo_model.vehicle.parameters import Vehicle

from . import course_file, feasibility

_RATE = 'reference_node.plan.scale_rate'


def describe(plan: FlightPlanParams, vehicle: Vehicle, stretch: bool = False) -> Iterator[str]:
    """
    Yield warnings about the course of a plan, one line each; none if it flies no course.

    Parameters
    ----------
    plan
        Of the flight.
    vehicle
        That the controller knows.
    stretch
        Whether to name the option ``--stretch auto``, which slows the course.

    """
    if plan.trajectory != COURSE:
        return
    course = plan.flown_course()
    name = course_file.source(plan).partition(',')[0] or 'the course'
    if odd := feasibility.odd(course):
        yield f'{name} {odd}'
    failure = feasibility.check(course, vehicle)
    if failure is None:
        if failure := feasibility.check_flight(plan, vehicle):
            part = feasibility.part_of(plan, failure.t)
            yield (f'the vehicle cannot fly the way to or from {name}: {failure} (time of the '
                   f'flight); lengthen it with reference_node.plan.{part}, now '
                   f'{getattr(plan, part):g} s')
        return
    try:
        rate = f'{_RATE}={plan.scale_rate / feasibility.stretch(course, vehicle):.3f}'
        remedy = f'--stretch auto slows it: {rate}' if stretch else f'{rate} slows it'
    except JobError:
        remedy = 'mambo trajectory check says more'
    yield f'the vehicle cannot fly {name}: {failure} (time of the course); {remedy}'
