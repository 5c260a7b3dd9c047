"""
Every node of a flight in one process, for speed, with the same topics and the same bag.

The nodes pass each other their messages directly; subscribers in other processes get them from
the middleware. Each node has its own section in a parameter file. ``--world FILE`` flies the
drones of a hall, each in its namespace; with ``--simulators`` this process holds their simulators
alone.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
import sys

from mambo_bags.command import one_line
from mambo_bags.recorder_node import RecorderNode
from mambo_control.controller_node import ControllerNode
from mambo_control.reference_node import ReferenceNode
from mambo_estimation.estimator_node import EstimatorNode
from mambo_flight.world import world_file
from mambo_flight.world.world_file import Hall
from mambo_model.errors import MamboError
from mambo_ros import process, topics, usage
from mambo_sim import sim_node
from mambo_sim.optitrack_node import OptitrackNode

from .flight import fleet

NODES = (
    RecorderNode, OptitrackNode, EstimatorNode, ReferenceNode, ControllerNode, sim_node.SimNode)
"""The node that owns time is the last."""


def main(args: list[str] | None = None) -> None:
    """Entry point ``composed_node``."""
    words = sys.argv[1:] if args is None else args
    own = argparse.ArgumentParser('composed_node', add_help=False)
    own.add_argument('--world', type=Path)
    own.add_argument('--simulators', action='store_true')
    options, others = own.parse_known_args(words)
    if options.world is None or usage.asked(words):
        process.compose(NODES, args, sim_node.fly)
        return
    hall = read_hall('composed_node', options.world)
    types = NODES[-1:] if options.simulators else NODES
    process.compose(
        [partial(node, namespace=space, cli_args=own_topics())
         for space in hall.places for node in types], others, partial(fleet.fly, hall))


def read_hall(program: str, path: Path) -> Hall:
    """Return the hall of a file; print one line and exit behind it if it is none."""
    try:
        return world_file.read(path)
    except MamboError as error:
        print(f'{program}: --world: {one_line(str(error))}', file=sys.stderr)
        raise SystemExit(error.exit_code) from None


def own_topics() -> list[str]:
    """Return the arguments that give one of several drones its own clock and frames."""
    return ['--ros-args', *(word for topic in topics.OWN for word in (
        '-r', f'/{topic}:={topic}'))]
