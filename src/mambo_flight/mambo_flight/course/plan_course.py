"""
Plan a course: polynomials of minimum snap or jerk through waypoints, as a CSV file to fly.

The format is that of uav_trajectories. A function of time or a file of polynomials is written in
the same format, moved, resized and stretched by the options. The format of a file of waypoints is
described in mambo_flight/course/waypoints.py.
"""

from __future__ import annotations

import argparse

from mambo_bags.command import guard, Parser
from mambo_model.motion.uav_trajectories import to_text
from mambo_model.whole_file import refuse_existing, write_text

from . import feasibility
from .check_course import add_course, chosen, left_limits


def _run(options: argparse.Namespace) -> None:
    refuse_existing(options.output)
    course, vehicle, factor = chosen(options)
    write_text(options.output, to_text(course))
    print(f'{options.output}: {course.total:.3f} s, {len(course.duration)} polynomials' + (
        f', stretched {factor:.4f} times' if factor != 1.0 else ''))
    if odd := feasibility.odd(course):
        print(f'warning: the course {odd}')
    for line in left_limits(options, course):
        print(line)
    if failure := feasibility.check(course, vehicle):
        print(f'warning: {options.vehicle} cannot fly it: {failure}; '
              f'{feasibility.remedy(course, vehicle)}')


def parser() -> Parser:
    """Return the command line."""
    out = Parser('trajectory plan', __doc__)
    add_course(out)
    out.add_output('CSV', 'file of polynomials to write', required=True)
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point ``mambo trajectory plan``; return the exit code."""
    options = parser().parse_args(arguments)
    return guard('trajectory plan', lambda: _run(options))
