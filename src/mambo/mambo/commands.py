"""Commands to a running flight, and recorded ones, from a script."""

from __future__ import annotations

from pathlib import Path
from typing import Any
import warnings

from mambo_bags.reader import Bag
from mambo_flight import commanded
from mambo_flight.scenario import Scenario

from . import given


def command(name: str, drone: str = '/mambo', **arguments: Any) -> str:
    """
    Send a command to the flight that runs on this machine, or in ``ROS_DOMAIN_ID``.

    Parameters
    ----------
    name
        ``takeoff`` (height m), ``go_to`` (goal (x, y, z) m z-up, yaw rad, relative), ``follow``
        (trajectory: path of a course or its text, timescale, relative), ``stop``, ``land``, all
        but stop with duration s, 0: as short as the limits allow; ``pause``, ``step`` (steps) and
        ``resume``.
    drone
        Its namespace.
    arguments
        Of the command.

    Returns
    -------
    answer
        The flight time from which the command counts.

    Raises
    ------
    InputError
        For a command or argument that does not exist.
    JobError
        If no flight answers, or it refuses the command; the text is the reason.

    """
    if 'parameters' in arguments:
        arguments['parameters'] = given.parameters(arguments['parameters'])
    return commanded.send(name, drone, **given.plain(arguments))


def recorded_commands(bag: Bag | Path | str) -> Scenario:
    """
    Return the scenario of a recorded commanded flight, with the recorded commands as its script.

    :func:`mambo.fly` flies it again, with the same reference to the last bit. A drone of a hall
    flies alone then, and a warning says so.

    Raises
    ------
    InputError
        If the bag is not one of a commanded flight, or the path is a folder of several bags.

    """
    path = bag.path if isinstance(bag, Bag) else given.path(bag, 'bag')
    flight = commanded.scenario_of(path)
    for line in commanded.alone(path):
        warnings.warn(line, stacklevel=2)
    return flight
