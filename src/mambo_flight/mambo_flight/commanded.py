"""
Commanded flights: commands in a scenario file, of a recorded flight, and to a running one.

In a scenario file::

    title: up, aside, down
    duration: 20.0
    commands:
      - {time: 2.0, takeoff: {height: 1.0}}
      - {time: 6.0, go_to: {goal: [1.0, 0.0, 1.0], yaw: 0.5}}
      - {time: 10.0, follow: {file: loop.csv}}
      - {time: 15.0, land: {}}

``follow`` takes the file of a course, or its text as ``trajectory``.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mambo_bags.playback import recorded
from mambo_bags.reader import read_bag
from mambo_control.commanded import script
from mambo_model.errors import InputError
from mambo_model.motion import uav_trajectories
from mambo_model.motion.flight_command import FlightCommand
from mambo_model.schema import ParameterError
from mambo_ros import topics
from mambo_ros.commands.command_message import decode
import yaml

from . import recorded_changes, scenario as scenarios
from .course import course_file
from .scenario import ParameterReader, Place, Scenario
from .world import separation, world_file

_GROUP = 'reference_node.commands'
_EARLY = 0.1  # s that a recording ends before its flight; of a whole one none or a step


def parameters(reader: ParameterReader, node: yaml.Node) -> dict[str, Place]:
    """
    Return the parameters of a commanded flight, of the key ``commands`` of a scenario file.

    Raises
    ------
    ParameterError
        Naming file, line and what is wrong.

    """
    entries = reader.plain(node, 'commands')
    folder = Path(reader.path).parent
    where = f'{reader.where(node)}: commands'
    for entry in entries if isinstance(entries, list) else ():
        _read_course(entry, folder, where)
    found = script.commands(entries, where)
    return {f'{_GROUP}.{name}': Place(value, reader.where(node)) for name, value in (
        ('enabled', True), ('script', script.to_text(found)))}


def _read_course(entry: Any, folder: Path, where: str) -> None:
    """Replace the file of a ``follow`` by the text of its course."""
    follow = entry.get('follow') if isinstance(entry, dict) else None
    if isinstance(follow, dict) and 'file' in follow:
        if not isinstance(follow['file'], str):
            raise ParameterError(f'{where}: follow: file must be the path of a course')
        follow['trajectory'] = course_text(folder / Path(follow.pop('file')).expanduser())


def course_text(path: Path) -> str:
    """Return the text of a course for ``follow``, of any file of a course."""
    return uav_trajectories.to_text(course_file.read(path))


def late(flight: Scenario) -> Iterator[str]:
    """Yield a line if scripted commands come after the end of a flight."""
    end, given = flight.sim_node.duration, flight.reference_node.commands
    after = [one.t * 1e-9 for one in script.parse(given.script) if end and one.t >= end * 1e9]
    if given.enabled and after:
        yield (f'commands at t = {after[0]:g} s or later have no effect: the flight ends at '
               f'{end:g} s')


def commands_of(bag: Path, namespace: str = topics.NAMESPACE) -> list[FlightCommand]:
    """Return the commands that a flight has recorded, in their order."""
    name = topics.full_name(topics.COMMAND, namespace)
    return [decode(data) for _, _, data in recorded(bag, {name})]


def scenario_of(bag: Path) -> Scenario:
    """
    Return the scenario of a recorded flight, with the recorded commands and changes as its script.

    Flown in lockstep or in one process, it gives the reference of the recorded flight to the last
    bit, and all of a flight in lockstep. Of a drone of a hall it is the scenario of this drone
    alone, and the reference is equal; see :func:`alone`.

    Raises
    ------
    InputError
        If the path is the folder of several bags, or the bag holds no scenario, or one without
        commands and changes of parameters.

    """
    if separation.is_folder(bag):
        first = min(file.parent for file in bag.glob('*/metadata.yaml'))
        raise InputError(
            f'{bag}: a folder of bags, and one is flown again at a time, of several drones each '
            f'alone: name a bag, such as {first}')
    found = read_bag(bag, recorded_changes.RECORD)
    text = found.attachments.get('scenario.yaml')
    if text is None:
        raise InputError(f'{bag}: holds no scenario.yaml: it was not recorded by ./run')
    flight = scenarios.from_yaml(str(text), f'scenario.yaml in {bag}')
    again: dict[str, Any] = recorded_changes.changes_of(found)
    again['sim_node.paused'] = False  # nobody may be there to go on
    if flight.reference_node.commands.enabled:
        again[f'{_GROUP}.script'] = script.to_text(
            commands_of(bag, found.namespace or topics.NAMESPACE))
    elif not any(again.values()):
        raise InputError(f'{bag}: is not a commanded flight, and no parameter changed in it')
    return scenarios.override(flight, again)


def alone(bag: Path) -> Iterator[str]:
    """Yield a line if a recorded drone shared a hall with others, which are not flown again."""
    found = read_bag(bag, ())
    if world_file.NAME in found.attachments:
        yield (f'{bag}: {found.namespace} shared its hall with other drones; they are absent now, '
               'and so are their downwash, the markers that they hid or swapped, and the stop '
               'after a collision')


def beyond(bag: Path, flight: Scenario) -> Iterator[str]:
    """Yield a line if a flight goes on after the end of the recording whose commands it has."""
    end = read_bag(bag, (topics.CLOCK.name, topics.CLOCK.name[1:])).end * 1e-9
    duration = flight.sim_node.duration
    if end < duration - _EARLY:
        yield (f'{bag} ends at {end:.3f} s, and this flight at {duration:g} s: it has no command '
               'after the end of the recording, neither one of its scenario nor another')


def send(name: str, drone: str = topics.NAMESPACE, **arguments: Any) -> str:
    """
    Send a command to a running flight; see ``mambo_ros.commands.client.send``.

    Parameters
    ----------
    name
        ``takeoff``, ``go_to``, ``follow``, ``stop``, ``land``, ``pause``, ``resume``, ``step`` or
        ``set``.
    drone
        Its namespace.
    arguments
        Of the command; ``trajectory`` is a course, as text of several lines or
        as the path of its file.

    """
    from mambo_ros.commands import client  # ROS, which nothing else here needs
    trajectory = arguments.get('trajectory')
    if isinstance(trajectory, Path) or isinstance(trajectory, str) and '\n' not in trajectory:
        arguments['trajectory'] = course_text(Path(trajectory))
    return client.send(name, drone, **arguments)
