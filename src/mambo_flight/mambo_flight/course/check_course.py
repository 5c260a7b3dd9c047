"""
Check whether the vehicle can fly a course: its demands beside the limits of the vehicle.

A course is a CSV file of polynomials (uav_trajectories), a CSV or YAML file of waypoints, or a
function of time in Python. If the vehicle cannot fly it, one line names the time and the
quantity, and the exit code is 1.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
import json
import math
from pathlib import Path
from typing import Any

from mambo_bags.cli.option_types import declared, real
from mambo_bags.command import guard, Parser, write_json
from mambo_model import schema
from mambo_model.errors import InputError, JobError, MamboError
from mambo_model.motion.polynomial import Array, Course, raised, resized, stretched
from mambo_model.motion.uav_trajectories import FARTHEST, LONGEST
from mambo_model.vehicle.parameters import find, PRESETS, Vehicle
from mambo_model.whole_file import refuse_existing
import numpy as np

from . import course_file, feasibility, function_course
from .waypoints import Settings

PICTURES = ('.png', '.svg', '.pdf')
PLANNER = {'minimise': 'minimise', 'speed': 'speed', 'tube': 'tube', 'pieces': 'pieces',
           'max_speed': 'limits.speed', 'max_acceleration': 'limits.acceleration',
           'max_jerk': 'limits.jerk', 'max_snap': 'limits.snap',
           'max_yaw_rate': 'limits.yaw_rate'}
"""Options of the planner and the settings that they set."""


def add_course(out: Parser) -> None:
    """Add the options that select a course."""
    add = out.add_argument
    add('course', metavar='COURSE',
        help='a file of waypoints (.csv, .yaml) or polynomials (.csv), or a function: FILE.py, '
             'FILE.py:NAME or an installed one')
    add('--duration', type=real(0.0, LONGEST, 's', above=True), metavar='S',
        help='duration of a function of time, from 0 (default: as its file states)')
    leaves = dict(schema.walk(Settings))
    for option, name in PLANNER.items():
        meta, flag = leaves[name].metadata, f'--{option.replace("_", "-")}'
        if 'options' in meta:
            add(flag, choices=meta['options'], help='what the path between waypoints minimises')
        else:
            add(flag, metavar=meta['unit'], type=declared(
                leaves[name].default, meta['low'], meta['high'], meta['unit'], name == 'speed'),
                help={'speed': 'mean speed of legs without a time',
                      'tube': 'radius of the corridor round each leg',
                      'pieces': 'polynomials for each leg in corridors or limits'
                      }.get(name, f'limit for waypoints: {name.removeprefix("limits.")}'))
    add('--height', type=real(-FARTHEST, FARTHEST, 'm'), metavar='M',
        help='height at which the course begins')
    add('--scale', type=real(0.01, 100.0), metavar='FACTOR',
        help='size of the path about its first point')
    add('--stretch', metavar='FACTOR',
        help='stretch time by FACTOR; auto: slow a course down that the vehicle cannot fly, by '
        'the smallest factor')
    add('--vehicle', metavar='NAME', default='identified',
        help=f"one of: {', '.join(PRESETS)}, or a file (default: identified)")


def chosen(options: argparse.Namespace) -> tuple[Course, Vehicle, float]:
    """
    Return course, vehicle and stretch of time that the options of :func:`add_course` select.

    Raises
    ------
    mambo_model.errors.MamboError
        If the course cannot be read, planned or stretched.

    """
    over = _planner(options)
    is_table = Path(options.course).suffix.lower() in course_file.SUFFIXES
    if not is_table and course_file.is_course(options.course):
        course = _of_function(options, over)
    elif options.duration is not None:
        raise InputError('--duration is for a function of time; for a file use --stretch')
    else:
        course = course_file.read(Path(options.course).expanduser(), over)
        _refuse_unused_speed(Path(options.course).expanduser(), over, course)
    vehicle, factor = find(options.vehicle), 1.0
    if options.scale is not None:
        course = resized(course, options.scale)
    if options.height is not None:
        course = raised(course, options.height)
    if options.stretch is not None:
        factor = (feasibility.stretch(course, vehicle) if options.stretch == 'auto'
                  else feasibility.factor(options.stretch, '--stretch'))
        course = stretched(course, factor)
    return course, vehicle, factor


def _planner(options: argparse.Namespace) -> dict[str, Any]:
    """Return the settings of the planner that the options give, flat by name."""
    return {name: value for option, name in PLANNER.items()
            if (value := getattr(options, option)) is not None}


def left_limits(options: argparse.Namespace, course: Course) -> list[str]:
    """Return a line about each limit of a file that its course left as the options change it."""
    if options.stretch is None and options.scale is None:
        return []
    path = Path(options.course).expanduser()
    return [f'warning: {line}: --stretch and --scale do not keep it'
            for line in course_file.left(path, course, _planner(options))]


def _refuse_unused_speed(path: Path, over: Mapping[str, Any], course: Course) -> None:
    """Raise InputError if a speed is given for a course in which each leg has its own time."""
    if 'speed' not in over:
        return
    try:
        own = course_file.read(path, {name: over[name] for name in over if name != 'speed'})
    except MamboError:  # legs without a time
        return
    if np.array_equal(own.duration, course.duration):
        raise InputError(f'--speed is for legs without a time: each leg of {path} has a time or '
                         'a speed of its own; use --stretch')


def _of_function(options: argparse.Namespace, over: Mapping[str, Any]) -> Course:
    """Return the course of a function."""
    source = function_course.load(options.course)
    duration = source.duration if options.duration is None else options.duration
    if duration is None:
        raise InputError(f'{source.name}: no duration: give --duration, or state '
                         'duration = 12.0 (s) in the file')
    if over:
        raise InputError(f'{source.name}: is a function of time: leave out the options for '
                         f'waypoints, {", ".join(over)}')
    return function_course.fit(source, duration)


def table(t: Array, columns: Array, vehicle: Vehicle) -> str:
    """Return smallest and largest value of every quantity, with times and limits, as text."""
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
    """Return the result of a check for JSON."""
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
        raise InputError(
            f'{options.output}: the name of a picture must end in {", ".join(PICTURES)}')
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
        if odd := feasibility.odd(course):
            print(f'warning: the course {odd}')
        for line in left_limits(options, course):
            print(line)
    if options.output:
        from .plot_course import draw
        draw(options.output, course, t, columns, feasibility.limits(vehicle), options.course)
        if options.json != '-':
            print(f'picture: {options.output}')
    if failure:
        raise JobError(f'{options.course}: cannot be flown: {failure}; '
                       f'{feasibility.remedy(course, vehicle)}')


def parser() -> Parser:
    """Return the command line."""
    out = Parser('trajectory check', __doc__)
    add_course(out)
    out.add_output('PNG', 'picture to draw: the path and its demands on the vehicle')
    out.add_json()
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``mambo trajectory check``; return the exit code."""
    options = parser().parse_args(arguments)
    return guard('trajectory check', lambda: _run(options))
