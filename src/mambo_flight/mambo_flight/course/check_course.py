"""
Check a course: what it asks of the vehicle, and when it asks for too much.

A course is a CSV file of polynomials (uav_trajectories), a CSV or YAML file of waypoints, or a
function of time in Python. Exit code 1 and one line with the time and the quantity if the vehicle
cannot fly it.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
import json
import math
from pathlib import Path
from typing import Any

from mambo_bags.command import guard, Parser, refuse_existing, write_json
from mambo_model import schema
from mambo_model.errors import InputError, JobError
from mambo_model.motion.polynomial import Array, Course, raised, resized, stretched
from mambo_model.motion.uav_trajectories import FARTHEST
from mambo_model.vehicle.parameters import find, PRESETS, Vehicle

from . import course_file, feasibility, function_course
from .waypoints import Settings

PICTURES = ('.png', '.svg', '.pdf')
PLANNER = {'minimise': 'minimise', 'speed': 'speed', 'tube': 'tube', 'pieces': 'pieces',
           'max_speed': 'limits.speed', 'max_acceleration': 'limits.acceleration',
           'max_jerk': 'limits.jerk', 'max_snap': 'limits.snap',
           'max_yaw_rate': 'limits.yaw_rate'}
"""Options of the planner and the settings that they stand for."""


def add_course(out: Parser) -> None:
    """Add the options that say which course."""
    add = out.add_argument
    add('course', metavar='COURSE',
        help='a file of waypoints (.csv, .yaml) or polynomials (.csv), or a function: FILE.py, '
             'FILE.py:NAME or an installed one')
    add('--duration', type=float, metavar='S',
        help='of a function, which gets the time from 0 on (default: as its file says)')
    leaves = dict(schema.walk(Settings))
    for option, name in PLANNER.items():
        meta, flag = leaves[name].metadata, f'--{option.replace("_", "-")}'
        if 'options' in meta:
            add(flag, choices=meta['options'], help='what waypoints are joined with least of')
        else:
            add(flag, type=int if name == 'pieces' else float, metavar=meta['unit'],
                help={'speed': 'mean speed of legs without a time',
                      'tube': 'radius of the corridor round each leg',
                      'pieces': 'polynomials for each leg in corridors or limits'
                      }.get(name, f'limit for waypoints: {name.removeprefix("limits.")}'))
    add('--height', type=float, metavar='M', help='at which the course begins')
    add('--scale', type=float, metavar='FACTOR', help='size of the path about its first point')
    add('--stretch', metavar='FACTOR',
        help='fly it in FACTOR times its time; auto: the least in which the vehicle can')
    add('--vehicle', metavar='NAME', default='identified',
        help=f"one of: {', '.join(PRESETS)}, or a file (default: identified)")


def _factor(text: str, option: str) -> float:
    """Return a factor of an option; InputError if it is none."""
    try:
        value = float(text)
    except ValueError:
        raise InputError(f'{option} {text}: write a number, or auto') from None
    if not 0.01 <= value <= 100.0:
        raise InputError(f'{option} {text} must be within 0.01 to 100')
    return value


def chosen(options: argparse.Namespace) -> tuple[Course, Vehicle, float]:
    """
    Return the course of the options of :func:`add_course`, the vehicle, and the factor of time.

    Raises
    ------
    mambo_model.errors.MamboError
        Naming what cannot be read, planned or stretched.

    """
    over: dict[str, Any] = {
        name: value for option, name in PLANNER.items()
        if (value := getattr(options, option)) is not None}
    is_table = Path(options.course).suffix.lower() in course_file.SUFFIXES
    if not is_table and course_file.is_course(options.course):
        course = _of_function(options, over)
    elif options.duration is not None:
        raise InputError('--duration is for a function; --stretch makes a file longer')
    else:
        course = course_file.read(Path(options.course).expanduser(), over)
    vehicle, factor = find(options.vehicle), 1.0
    if options.scale is not None:
        course = resized(course, _factor(str(options.scale), '--scale'))
    if options.height is not None:
        if not abs(options.height) <= FARTHEST:
            raise InputError(f'--height {options.height:g} must be at most {FARTHEST:g} m')
        course = raised(course, options.height)
    if options.stretch is not None:
        factor = (feasibility.stretch(course, vehicle) if options.stretch == 'auto'
                  else _factor(options.stretch, '--stretch'))
        course = stretched(course, factor)
    return course, vehicle, factor


def _of_function(options: argparse.Namespace, over: Mapping[str, Any]) -> Course:
    """Return the course of a function."""
    source = function_course.load(options.course)
    duration = source.duration if options.duration is None else options.duration
    if duration is None:
        raise InputError(f'{source.name}: how long? give --duration, or state duration = 12.0 (s) '
                         'in the file')
    if over:
        raise InputError(f'{source.name}: a function is no plan of waypoints; '
                         f'{", ".join(over)} does not matter')
    return function_course.fit(source, duration)


def table(t: Array, columns: Array, vehicle: Vehicle) -> str:
    """Return the least and largest of every quantity, with times and limits."""
    ranges = feasibility.limits(vehicle)
    lines = [f'{"":<22}{"least":>10}{"at [s]":>9}{"largest":>10}{"at [s]":>9}   limits']
    for name, values in zip(feasibility.QUANTITIES, columns.T, strict=True):
        if name == 'battery' and not vehicle.battery.enabled:
            continue
        low, high = int(values.argmin()), int(values.argmax())
        bounds = ranges.get(name)
        edges = '' if bounds is None else ' to '.join(
            '' if math.isinf(edge) else f'{edge:.4g}' for edge in bounds)
        lines.append(f'{f"{name} [{feasibility.QUANTITIES[name]}]":<22}{values[low]:10.4g}'
                     f'{t[low]:9.3f}{values[high]:10.4g}{t[high]:9.3f}   {edges}'.rstrip())
    return '\n'.join(lines)


def report(
    course: Course, factor: float, t: Array, columns: Array, failure: feasibility.Failure | None,
) -> dict[str, Any]:
    """Return the numbers of a check for JSON."""
    return {
        'duration': course.total, 'pieces': len(course.duration), 'stretched': factor,
        'feasible': failure is None,
        'failure': None if failure is None else failure._asdict(),
        'quantities': {
            name: {'unit': unit, 'least': float(values.min()), 'largest': float(values.max())}
            for (name, unit), values in zip(
                feasibility.QUANTITIES.items(), columns.T, strict=True)}}


def _run(options: argparse.Namespace) -> None:
    refuse_existing(options.output)
    if options.output and options.output.suffix.lower() not in PICTURES:
        raise InputError(f'{options.output}: a picture ends in {", ".join(PICTURES)}')
    course, vehicle, factor = chosen(options)
    t, columns = feasibility.demand(course, vehicle)
    failure = feasibility.failure(t, columns, vehicle)
    if options.json:
        write_json(options.json, json.dumps(
            report(course, factor, t, columns, failure), indent=2))
    if options.json != '-':
        print(f'{options.course}: {course.total:.3f} s, {len(course.duration)} polynomials' + (
            f', stretched {factor:.4f} times' if factor != 1.0 else ''))
        print(table(t, columns, vehicle))
    if options.output:
        from .plot_course import draw
        draw(options.output, course, t, columns, feasibility.limits(vehicle), options.course)
        if options.json != '-':
            print(f'picture: {options.output}')
    if failure:
        raise JobError(f'{options.course}: cannot be flown: {failure}; --stretch auto slows it')


def parser() -> Parser:
    """Return the command line."""
    out = Parser('trajectory check', __doc__)
    add_course(out)
    out.add_output('PNG', 'picture to draw: the path and what it asks of the vehicle')
    out.add_json()
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``mambo trajectory check``; return the exit code."""
    options = parser().parse_args(arguments)
    return guard('trajectory check', lambda: _run(options))
