"""The hall of several drones as text, which nodes read and bags keep as ``world.yaml``."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
import dataclasses
from pathlib import Path
import re
from typing import Any, NamedTuple, NoReturn

from mambo_model import schema
from mambo_model.motion.vector import Vec3
from mambo_model.yaml_nodes import compose, dump, load, read_text, reason
from mambo_sim.sensors import hall_capture
from mambo_sim.world import MOST, WorldParams
import yaml

from ..scenario import Scenario

NAME = 'world.yaml'
_FAR = 1e6  # m, the farthest place


class Hall(NamedTuple):
    """A world and the place of each drone in it, (3,) m, inertial NED, by namespace."""

    params: WorldParams
    places: Mapping[str, Vec3]


def check_cameras(hall: Hall, flights: Sequence[Scenario]) -> None:
    """
    Check whether the drones of a hall can share a motion capture.

    Parameters
    ----------
    hall
        With a place for each drone.
    flights
        Scenario of each drone.

    Raises
    ------
    ParameterError
        If something in their motion capture excludes it.

    """
    hall_capture.of_hall(hall.params.capture, list(hall.places.values()), [
        flight.optitrack_node.optitrack for flight in flights])


_FRAME = ('# A place is where the frame of a drone begins in the hall, x y z in m, inertial NED\n'
          '# (z down). The topics of a drone have z up: x is the same, y and z change sign.\n')


def to_text(hall: Hall) -> str:
    """Return a hall as YAML."""
    places = {name: [float(x) for x in place] for name, place in hall.places.items()}
    return dump({'world': dataclasses.asdict(hall.params), 'places': places}) + _FRAME


def parse(text: str, where: str) -> Hall:
    """
    Return the hall of a text of :func:`to_text`.

    Parameters
    ----------
    text
        YAML.
    where
        File or bag, named in errors.

    Raises
    ------
    mambo_model.schema.ParameterError
        In one line, if it is not such a text.

    """
    def fail(what: str) -> NoReturn:
        raise schema.ParameterError(f'{where}: {NAME}: {what}')
    try:
        content = load(text)
        if double := _double(compose(text)):
            fail(f'line {double.start_mark.line + 1}: {schema.shown(double.value)} is given twice')
    except yaml.YAMLError as error:
        fail(reason(error))
    if not isinstance(content, dict) or set(content) != {'world', 'places'} or not all(
            isinstance(part, dict) for part in content.values()):
        fail('must hold world and places')
    if len(content['places']) > MOST:
        fail(f'{len(content["places"])} places; at most {MOST}')
    for name, place in content['places'].items():
        if not (isinstance(name, str) and re.fullmatch(r'(/[A-Za-z]\w{0,99})+', name, re.ASCII)):
            fail(f'{schema.shown(name)} is not the namespace of a drone')
        if not _is_place(place):
            fail(f'places: {name}: must be 3 numbers within {_FAR:g} m')
    try:
        params = schema.build(WorldParams, content['world'])
    except schema.ParameterError as error:
        fail(str(error))
    if len(content['places']) != params.drones:
        fail(f'{len(content["places"])} places, but drones = {params.drones}')
    return Hall(params, {name: tuple(map(float, place))
                         for name, place in content['places'].items()})


def read(path: Path) -> Hall:
    """Return the hall of a file; ParameterError as of :func:`parse`, or if it cannot be read."""
    return parse(read_text(path), str(path))


def _double(node: yaml.Node | None) -> yaml.ScalarNode | None:
    """Return a key that a node or one inside it has twice, if there is one."""
    if not isinstance(node, yaml.MappingNode):
        return None
    seen = set()
    for key, value in node.value:
        if isinstance(key, yaml.ScalarNode):
            if key.value in seen:
                return key
            seen.add(key.value)
        if inside := _double(value):
            return inside
    return None


def _is_place(place: Any) -> bool:
    """Return whether a value is a place."""
    return isinstance(place, list) and len(place) == 3 and all(
        isinstance(x, (int, float)) and not isinstance(x, bool) and abs(x) <= _FAR
        for x in place)  # not of NaN, nor of infinity
