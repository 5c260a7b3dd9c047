"""Courses by name, a file or a function, and the flight plan that they need."""

from __future__ import annotations

from collections.abc import Mapping
import math
from pathlib import Path
from typing import Any

from mambo_model import components
from mambo_model.errors import InputError
from mambo_model.motion import uav_trajectories
from mambo_model.motion.polynomial import Course
from mambo_model.motion.trajectory import COURSE, FlightPlanParams, TRAJECTORIES
from mambo_model.own_file import digest
from mambo_model.schema import ParameterError, shown

from . import function_course

SUFFIXES = ('.csv', '.yaml', '.yml')
REST = 1.0  # s, hover between the end of a course and the landing


def is_course(name: str) -> bool:
    """Return whether the name of a trajectory refers to a file or a function."""
    return name not in TRAJECTORIES and (
        Path(name).suffix.lower() in SUFFIXES or function_course.is_function(name)
        or name in function_course.installed())


def check_name(name: str) -> None:
    """Raise ParameterError if a name is neither a built-in trajectory nor a file or function."""
    if name not in TRAJECTORIES and not is_course(name):
        raise ParameterError(
            f'trajectory {shown(name)} is unknown: give a file ({", ".join(SUFFIXES)}), a '
            'function (mine.py or mine.py:NAME), an installed one (entry point of '
            f'{function_course.GROUP}) or one of {", ".join(TRAJECTORIES)}')


def absolute(name: str, folder: Path) -> str:
    """Return the name of a trajectory; if it is a file, with an absolute path."""
    if Path(name).suffix.lower() in SUFFIXES:
        return str((folder / Path(name).expanduser()).absolute())
    return name if name in TRAJECTORIES else components.absolute(name, folder)


def read(path: Path, over: Mapping[str, Any] | None = None) -> Course:
    """
    Read a course from a file.

    Parameters
    ----------
    path
        CSV file in the format of :mod:`uav_trajectories`, whose first column is ``duration``, or
        a CSV or YAML file of :mod:`waypoints`.
    over
        Settings of the planner that replace those of the file, flat by name.

    Raises
    ------
    ParameterError
        Naming file and row of the error.
    mambo_model.errors.MamboError
        See ``waypoints.read``.

    """
    if is_polynomial(path):
        if over:
            raise ParameterError(f'{path}: holds polynomials, not waypoints: leave out the '
                                 f'options of the planner, {", ".join(over)}')
        return uav_trajectories.load(path)
    from . import waypoints  # with scipy's linear algebra, 0.3 s of CPU, for such files alone
    return waypoints.read(path, over)


def left(path: Path, course: Course, over: Mapping[str, Any] | None = None) -> list[str]:
    """Return which limits of its file a course leaves; see ``waypoints.left``."""
    if path.suffix.lower() not in SUFFIXES or is_polynomial(path):
        return []
    from . import waypoints
    return waypoints.left(path, course, over)


def is_polynomial(path: Path) -> bool:
    """Return whether a file holds polynomials, not waypoints."""
    if path.suffix.lower() != '.csv':
        return False
    table = uav_trajectories.rows(uav_trajectories.read_text(path))
    return bool(table) and table[0][1][0].lower() == uav_trajectories.HEADER[0]


def states_duration(trajectory: str, folder: Path = Path()) -> bool:
    """Return whether a course states its duration; a function may leave it to the flight."""
    if Path(trajectory).suffix.lower() in SUFFIXES:
        return True
    try:
        return function_course.load(trajectory, folder).duration is not None
    except InputError as error:
        raise ParameterError(str(error)) from None


def plan(trajectory: str, folder: Path = Path(), room: float = math.nan) -> dict[str, Any]:
    """
    Return the values of FlightPlanParams that select a trajectory.

    Parameters
    ----------
    trajectory
        Name of a built-in trajectory, of a file, or of a function.
    folder
        Folder of a relative path.
    room : s
        Duration for a function that does not state its own; NaN: unknown.

    Returns
    -------
    values
        By name; the text of a course begins with a comment with name and sha256 of its source.

    Raises
    ------
    ParameterError
        See :func:`read`; also for a function that is not smooth, or without time to fly it.

    """
    if not is_course(trajectory):
        return {'trajectory': trajectory}
    if Path(trajectory).suffix.lower() in SUFFIXES:
        path = folder / Path(trajectory).expanduser()
        course, about = read(path), f'{path.name}, sha256 {digest(path)}'
    else:
        course, about = _function(trajectory, folder, room)
    return {'trajectory': COURSE, 'course': f'# {about}\n{uav_trajectories.to_text(course)}'}


def _function(trajectory: str, folder: Path, room: float) -> tuple[Course, str]:
    """Return the course of a function and the description of its source."""
    try:
        source = function_course.load(trajectory, folder)
        duration = room if source.duration is None else source.duration
        if math.isnan(duration) or duration <= 0.0:
            function_course.check(source)
            raise InputError(
                f'{source.name}: the flight leaves no time for it: give a longer duration, or '
                f'state that of the path, duration = 12.0 (s), in the file')
        return function_course.fit(source, duration), source.about
    except InputError as error:
        raise ParameterError(str(error)) from None


def source(plan: FlightPlanParams) -> str:
    """Return the source of a plan's course with its hash; '' if unknown."""
    first = plan.course.partition('\n')[0]
    return first.removeprefix('# ') if first.startswith('# ') else ''


def end(plan: FlightPlanParams) -> float:
    """Return the flight time in s at which the course of a plan ends, with a moment of rest."""
    return math.ceil(plan.timing.course_begin + plan.flown_course().total + REST)
