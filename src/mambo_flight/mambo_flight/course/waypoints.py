"""
Files of waypoints, CSV or YAML: positions with times or speeds.

A CSV file has a header with the names of its columns and a row for each waypoint, in order:

``x``, ``y`` and ``z`` in m, inertial NED; ``height`` in m stands for ``z`` and points up.
``t`` in s, time of the waypoint, or ``speed`` in m/s, mean speed from the previous waypoint.
``yaw`` in rad or ``yaw_deg``; ``vx``, ``vy``, ``vz`` in m/s, the velocity there.
``tube`` in m, radius of the corridor around the straight line from the previous waypoint.

An empty cell leaves its quantity free. A YAML file has the same names in a list called
``waypoints``, a ``box`` for the leg to a waypoint, and the settings of :class:`Settings`.
"""

from __future__ import annotations

from collections.abc import Mapping
import dataclasses
import math
from pathlib import Path
from typing import Any, NamedTuple

from mambo_model import schema
from mambo_model.motion.polynomial import Course
from mambo_model.motion.uav_trajectories import (
    fail, FARTHEST, LONGEST, MAX_PIECES, number, read_text, rows)
from mambo_model.schema import ParameterError
from mambo_model.yaml_nodes import Reader
import numpy as np
import yaml

from . import constrained, minimum_snap
from .constrained import Bounds, DERIVATIVES
from .minimum_snap import Waypoints

COLUMNS = ('t', 'speed', 'x', 'y', 'z', 'height', 'yaw', 'yaw_deg', 'vx', 'vy', 'vz', 'tube')
FASTEST = 30.0   # m/s, largest speed of a course
HIGHEST = 100.0  # m, of a waypoint
_ROUNDING = 1e-3  # [-] by which a limit may be passed
_POINTS = 201  # of a piece whose derivatives are compared with the limits
_MOST_YAW = 4.0 * math.pi


@dataclasses.dataclass(frozen=True)
class LimitParams:
    """Largest lengths of the derivatives of the path, and of the yaw rate; 0: no limit."""

    speed: float = schema.quantity(0.0, 'm/s', 0.0, FASTEST, 'design choice; 0: none')
    acceleration: float = schema.quantity(0.0, 'm/s^2', 0.0, 1000.0, 'design choice; 0: none')
    jerk: float = schema.quantity(0.0, 'm/s^3', 0.0, 1e5, 'design choice; 0: none')
    snap: float = schema.quantity(0.0, 'm/s^4', 0.0, 1e7, 'design choice; 0: none')
    yaw_rate: float = schema.quantity(0.0, 'rad/s', 0.0, 100.0, 'design choice; 0: none')

    def __post_init__(self) -> None:
        schema.check(self)


@dataclasses.dataclass(frozen=True)
class Settings:
    """Settings of the planner."""

    minimise: str = schema.choice(
        'snap', tuple(minimum_snap.ORDERS), 'Mellinger 2011; jerk: lower degree, calmer')
    speed: float = schema.quantity(
        0.0, 'm/s', 0.0, FASTEST, 'mean one of legs without t and speed; 0: they need one')
    tube: float = schema.quantity(0.0, 'm', 0.0, 100.0, 'radius of legs without tube; 0: none')
    pieces: int = schema.quantity(
        3, '1', 1, 20, 'polynomials for each leg where there are corridors or limits')
    limits: LimitParams = schema.group(LimitParams)

    def __post_init__(self) -> None:
        schema.check(self)


class Row(NamedTuple):
    """A waypoint as written."""

    line: int
    values: dict[str, float]  # by column
    box: tuple[tuple[float, float], ...] | None  # of x, y, z in m, NED


def read(path: Path, over: Mapping[str, Any] | None = None) -> Course:
    """
    Plan the course of a file of waypoints.

    Parameters
    ----------
    path
        CSV or YAML.
    over
        Settings that replace those of the file, flat by name.

    Raises
    ------
    ParameterError
        Naming file and line of the error.
    mambo_model.errors.InputError
        If corridors or limits need a solver that is not installed.
    mambo_model.errors.JobError
        If no course satisfies the corridors and limits.

    """
    return plan(str(path), *_content(path, over))


def _content(path: Path, over: Mapping[str, Any] | None) -> tuple[list[Row], Settings]:
    """Return the waypoints of a file and the settings of the planner."""
    if path.suffix.lower() == '.csv':
        return from_csv(read_text(path), str(path)), schema.build(Settings, over or {})
    points, settings = _Reader(path).content()
    return points, schema.build(Settings, {**schema.flatten(settings), **(over or {})})


def left(path: Path, course: Course, over: Mapping[str, Any] | None = None) -> list[str]:
    """
    Return which limits of a file of waypoints a course leaves that was made of it, in words.

    A course that is planned keeps them; one that is stretched or resized afterwards may not.

    Parameters
    ----------
    path, over
        As of :func:`read`.
    course
        As it is flown.

    """
    limits, out = _content(path, over)[1].limits, []
    for name, field in schema.walk(LimitParams):
        limit, unit = getattr(limits, name), field.metadata['unit']
        order, axes = (1, slice(3, 4)) if name == 'yaw_rate' else (
            DERIVATIVES.index(name) + 1, slice(3))
        if limit and (most := _most(course, order, axes)) > limit * (1.0 + _ROUNDING):
            out.append(f'{name} is {most:.3g} {unit} at most, above limits.{name} = {limit:g} '
                       f'{unit} of {path}')
    return out


def _most(course: Course, order: int, axes: slice) -> float:
    """Return the largest length of a derivative of some axes, at many points of each piece."""
    most = 0.0
    for duration, piece in zip(course.duration, course.coefficients, strict=True):
        derivative = np.polynomial.polynomial.polyder(piece[axes], order, axis=1)
        values = np.polynomial.polynomial.polyval(
            np.linspace(0.0, duration, _POINTS), derivative.T)
        most = max(most, float(np.linalg.norm(values, axis=0).max()))
    return most


def plan(where: str, points: list[Row], settings: Settings) -> Course:
    """Return the course through waypoints; errors as in :func:`read`."""
    waypoints, bounds = assemble(where, points, settings)
    if not bounds.binding:
        return minimum_snap.minimum(waypoints, settings.minimise)
    pieces = min(settings.pieces, MAX_PIECES // (len(points) - 1))
    return constrained.minimum(waypoints, bounds, settings.minimise, pieces)


def from_csv(text: str, where: str) -> list[Row]:
    """Return the waypoints of a CSV text; ParameterError naming file and row."""
    table = rows(text)
    header = [cell.lower() for cell in table[0][1]] if table else []
    first = table[0][0] if table else 1
    for name in header:
        if name not in COLUMNS:
            fail(where, first, f'{schema.shown(name)} is not a column: the first row must name '
                 f'columns out of {", ".join(COLUMNS)}')
        if header.count(name) > 1:
            fail(where, first, f'duplicate column {name}')
    out = []
    for line, cells in table[1:]:
        if len(cells) > len(header):
            fail(where, line, f'{len(cells)} cells; the header has {len(header)} columns')
        out.append(Row(line, {
            name: number(where, line, name, cell)
            for name, cell in zip(header, cells, strict=False) if cell}, None))
    return out


class _Reader(Reader):
    """Reads a YAML file of waypoints."""

    def content(self) -> tuple[list[Row], Settings]:
        """Return waypoints and settings; ParameterError naming file and line."""
        keys = self.mapping(self.root(), 'file')
        if 'waypoints' not in keys:
            raise ParameterError(f'{self.path}: waypoints: missing')
        key, node = keys.pop('waypoints')
        if not isinstance(node, yaml.SequenceNode):
            self.fail(key, 'waypoints', 'must be a list')
        settings = self.settings(keys, Settings, '')
        points = [self.row(one) for one in node.value]
        if points and isinstance(first := node.value[0], yaml.MappingNode):
            for name, (below, _) in self.mapping(first, 'waypoint').items():
                if name in ('box', 'tube'):
                    self.fail(below, name, 'is of the leg to a waypoint, and no leg goes to the '
                              'first one: leave it out, or give it to the next')
        return points, schema.build(Settings, settings)

    def settings(
        self, keys: Mapping[str, tuple[yaml.Node, yaml.Node]], kind: type, prefix: str,
    ) -> dict[str, Any]:
        """Return settings by name."""
        fields = {field.name: field for field in dataclasses.fields(kind)}
        out: dict[str, Any] = {}
        for name, (key, node) in keys.items():
            if name not in fields:
                known = [*fields] if prefix else [*fields, 'waypoints']
                raise ParameterError(f'{self.where(key)}: {prefix}{schema.unknown(name, known)}')
            if 'group' in fields[name].metadata:
                out[name] = self.settings(
                    self.mapping(node, name), fields[name].metadata['group'], f'{name}.')
            else:
                out[name] = self.leaf(
                    f'course.{prefix}'.rstrip('.'), name, fields[name], node)
        return out

    def row(self, node: yaml.Node) -> Row:
        """Return one waypoint."""
        values, box = {}, None
        for name, (key, below) in self.mapping(node, 'waypoint').items():
            if name == 'box':
                box = self.box(below)
            elif name in COLUMNS:
                values[name] = number(
                    str(self.path), below.start_mark.line + 1, name, self.text(below, name))
            else:
                raise ParameterError(
                    f'{self.where(key)}: {schema.unknown(name, [*COLUMNS, "box"])}')
        return Row(node.start_mark.line + 1, values, box)

    def box(self, node: yaml.Node) -> tuple[tuple[float, float], ...]:
        """Return lowest and highest x, y and z of a box; other axes are unbounded."""
        edges = dict.fromkeys(('x', 'y', 'z'), (-math.inf, math.inf))
        for name, (key, below) in self.mapping(node, 'box').items():
            low, high = self.numbers(below, name, 2)
            if not low < high:
                self.fail(below, name, f'[{low:g}, {high:g}] must be the lowest and the highest')
            if name == 'height':
                edges['z'] = (-high, -low)
            elif name in edges:
                edges[name] = (low, high)
            else:
                self.fail(key, name, 'a box has x, y and z or height')
        return tuple(edges.values())


def assemble(where: str, points: list[Row], settings: Settings) -> tuple[Waypoints, Bounds]:
    """
    Return waypoints and bounds as the planner takes them.

    Raises
    ------
    ParameterError
        Naming file and line of a missing or wrong value.

    """
    if len(points) < 2:
        raise ParameterError(
            f'{where}: {len(points)} waypoint{"s" * (len(points) != 1)}; a course has at least 2')
    if len(points) > MAX_PIECES:
        raise ParameterError(
            f'{where}: {len(points)} waypoints; a course has at most {MAX_PIECES}')
    fixed = np.full((len(points), 4, 4), np.nan)
    fixed[[0, -1], :, 1:] = 0.0
    for i, row in enumerate(points):
        fixed[i, :3, 0] = _position(where, row, 0 < i < len(points) - 1)
        velocity = [row.values.get(name, np.nan) for name in ('vx', 'vy', 'vz')]
        fixed[i, :3, 1] = np.where(np.isnan(velocity), fixed[i, :3, 1], velocity)
    fixed[:, 3, 0] = _yaw(where, points)
    t = _times(where, points, fixed[:, :3, 0], settings)
    limits = np.array([getattr(settings.limits, name) or np.inf for name in DERIVATIVES])
    bounds = Bounds(
        limits, settings.limits.yaw_rate or np.inf, *_corridors(where, points, fixed, settings))
    _check_limits(where, points, t, fixed, bounds)
    return Waypoints(t, fixed), bounds


def _position(where: str, row: Row, may_be_free: bool) -> list[float]:
    """Return x, y and z of a waypoint in m, NED; NaN where they are free."""
    values = dict(row.values)
    if 'z' in values and 'height' in values:
        fail(where, row.line, 'z and height: give one of them')
    if 'height' in values:
        values['z'] = 0.0 - values['height']
    elif values.get('z', 0.0) > 0.0:
        fail(where, row.line, f'z = {values["z"]:g} m is below the ground, as z points down: '
             f'write {-values["z"]:g}, or call the column height')
    out = [values.get(name, np.nan) for name in ('x', 'y', 'z')]
    for name, value in zip(('x', 'y', 'z'), out, strict=True):
        if np.isnan(value) and not may_be_free:
            fail(where, row.line, f'{name} is missing: the first and the last waypoint need it')
        if abs(value) > FARTHEST:
            fail(where, row.line, f'{name} = {value:g} m is outside [-{FARTHEST:g}, '
                 f'{FARTHEST:g}]: positions are in metres')
    if -out[2] > HIGHEST:
        fail(where, row.line, f'a height of {-out[2]:g} m is above {HIGHEST:g} m: positions are '
             'in metres')
    return out


def _yaw(where: str, points: list[Row]) -> np.ndarray:
    """Return the yaw at each waypoint in rad, unwrapped the shorter way; NaN: free."""
    out = np.full(len(points), np.nan)
    before = 0.0
    for i, row in enumerate(points):
        if 'yaw' in row.values and 'yaw_deg' in row.values:
            fail(where, row.line, 'yaw and yaw_deg: give one of them')
        yaw = row.values.get('yaw', math.radians(row.values.get('yaw_deg', np.nan)))
        if abs(yaw) > _MOST_YAW:
            fail(where, row.line, f'yaw = {yaw:g} rad is more than two turns: call the column '
                 'yaw_deg if it is in degrees')
        if not np.isnan(yaw):
            before = out[i] = before + math.remainder(yaw - before, 2.0 * math.pi)
    return out


def _times(where: str, points: list[Row], at: np.ndarray, settings: Settings) -> np.ndarray:
    """Return the time of each waypoint, (n,) s, the first at 0."""
    first = points[0]
    start = first.values.get('t', 0.0)
    if 't' in first.values and 'speed' in first.values:
        fail(where, first.line, 't and speed: give one of them')
    for name, unit in (('speed', 'm/s'), ('tube', 'm')):  # 0: at rest, no leg
        if first.values.get(name, 0.0) < 0.0:
            fail(where, first.line, f'{name} = {first.values[name]:g} {unit} must be above 0')
    out = np.zeros(len(points))
    for i, row in enumerate(points[1:], 1):
        speed = row.values.get('speed', settings.speed)
        if 't' in row.values:
            if 'speed' in row.values:
                fail(where, row.line, 't and speed: give one of them')
            out[i] = row.values['t'] - start
            if not out[i] > out[i - 1]:
                fail(where, row.line, f't = {row.values["t"]:g} s is not after '
                     f'{out[i - 1] + start:g} s of the waypoint before')
        elif 'speed' not in row.values and speed == 0.0:
            fail(where, row.line, 't or speed is missing')
        elif not speed > 0.0:
            fail(where, row.line, f'speed = {speed:g} m/s must be above 0')
        else:
            way = np.linalg.norm(at[i] - at[i - 1])
            if not way > 0.0:
                fail(where, row.line, 'a speed needs a distance: give t if the vehicle stays in '
                     'place or a coordinate is free')
            out[i] = out[i - 1] + way / speed
        duration, way = out[i] - out[i - 1], np.nan_to_num(np.linalg.norm(at[i] - at[i - 1]))
        if duration > LONGEST:
            fail(where, row.line, f'{way:.3g} m in {duration:.3g} s: the most is {LONGEST:g} s; '
                 'positions are in metres, times in seconds')
        if way / duration > FASTEST:
            fail(where, row.line, f'{way:.3g} m in {duration:.3g} s are {way / duration:.3g} m/s, '
                 f'above {FASTEST:g} m/s: positions are in metres, times in seconds, speeds in '
                 'm/s')
    return out


def _corridors(
    where: str, points: list[Row], fixed: np.ndarray, settings: Settings,
) -> tuple[np.ndarray, np.ndarray]:
    """Return radius and box of the corridor of each leg."""
    nothing = constrained.unbounded(len(points) - 1)
    for leg, row in enumerate(points[1:]):
        tube = row.values.get('tube', settings.tube or np.nan)
        ends = fixed[leg:leg + 2, :3, 0]
        if tube <= 0.0:
            fail(where, row.line, f'tube = {tube:g} m must be above 0')
        if not np.isnan(tube) and np.isnan(ends).any():
            whose = '' if 'tube' in row.values else ', and the setting tube is for every leg'
            fail(where, row.line, f'a tube needs x, y and z of both ends of its leg{whose}')
        nothing.tube[leg] = tube
        if row.box is None:
            continue
        nothing.box[leg] = row.box
        low, high = nothing.box[leg].T
        for point, other in zip(ends, points[leg:leg + 2], strict=True):
            if ((point < low) | (point > high)).any():
                fail(where, row.line, f'the box excludes the waypoint of line {other.line}')
    return nothing.tube, nothing.box


def _check_limits(
    where: str, points: list[Row], t: np.ndarray, fixed: np.ndarray, bounds: Bounds,
) -> None:
    """Raise ParameterError if the mean speed of a leg or a given velocity is above the limit."""
    way = np.linalg.norm(np.diff(fixed[:, :3, 0], axis=0), axis=1)
    for name, ways, most, unit in (
            ('speed', way, bounds.limits[0], 'm/s'),
            ('yaw_rate', np.abs(np.diff(fixed[:, 3, 0])), bounds.yaw_rate, 'rad/s')):
        for row, mean in zip(points[1:], ways / np.diff(t), strict=True):
            if mean > most:
                fail(where, row.line, f'the leg takes {mean:.3g} {unit} on average, more than '
                     f'the limit {name} = {most:g} {unit}: give it more time')
    for row, speed in zip(points, np.linalg.norm(fixed[:, :3, 1], axis=1), strict=True):
        if speed > bounds.limits[0]:
            fail(where, row.line, f'the velocity of {speed:.3g} m/s is above the limit speed = '
                 f'{bounds.limits[0]:g} m/s')
