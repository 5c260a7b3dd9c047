"""Courses by the names that people give: a file, and the flight that it needs."""

from __future__ import annotations

from collections.abc import Mapping
import math
from pathlib import Path
from typing import Any

from mambo_model.motion import uav_trajectories
from mambo_model.motion.polynomial import Course
from mambo_model.motion.trajectory import COURSE, FlightPlanParams, TRAJECTORIES
from mambo_model.schema import ParameterError, shown

from . import waypoints

SUFFIXES = ('.csv', '.yaml', '.yml')
REST = 1.0  # s, hover between the end of a course and the landing


def is_file(name: str) -> bool:
    """Return whether the name of a trajectory is that of a file."""
    return Path(name).suffix.lower() in SUFFIXES


def check_name(name: str) -> None:
    """Raise ParameterError if the name of a trajectory is neither a built-in one nor a file."""
    if name not in TRAJECTORIES and not is_file(name):
        raise ParameterError(
            f'trajectory {shown(name)} is unknown: give a file ({", ".join(SUFFIXES)}) or one of '
            f'{", ".join(TRAJECTORIES)}')


def read(path: Path, over: Mapping[str, Any] | None = None) -> Course:
    """
    Read a course from a file.

    Parameters
    ----------
    path
        CSV file in the format of :mod:`uav_trajectories`, told by its first column
        ``duration``, or a CSV or YAML file of :mod:`waypoints`.
    over
        Settings of the planner that replace those of the file, flat by name.

    Raises
    ------
    ParameterError
        Naming file and row of what is wrong.
    mambo_model.errors.MamboError
        As ``waypoints.read``.

    """
    if is_polynomial(path):
        if over:
            raise ParameterError(f'{path}: its polynomials are planned already; '
                                 f'{", ".join(over)} does not matter')
        return uav_trajectories.load(path)
    return waypoints.read(path, over)


def is_polynomial(path: Path) -> bool:
    """Return whether a file is one of polynomials and not of waypoints."""
    if path.suffix.lower() != '.csv':
        return False
    table = uav_trajectories.rows(uav_trajectories.read_text(path))
    return bool(table) and table[0][1][0].lower() == uav_trajectories.HEADER[0]


def plan(trajectory: str, folder: Path = Path()) -> dict[str, Any]:
    """
    Return the values of FlightPlanParams that choose a trajectory.

    Parameters
    ----------
    trajectory
        Name of a built-in one or of a file.
    folder
        What a path is relative to.

    Raises
    ------
    ParameterError
        As :func:`read`.

    """
    if not is_file(trajectory):
        return {'trajectory': trajectory}
    course = read(folder / Path(trajectory).expanduser())
    return {'trajectory': COURSE, 'course': uav_trajectories.to_text(course)}


def end(plan: FlightPlanParams) -> float:
    """Return when the course of a plan ends, in s of flight time, with a moment of rest."""
    return math.ceil(plan.timing.course_begin + plan.flown_course().total + REST)
