"""
The motion capture of a hall: the cameras of all its drones in one process.

``--world FILE`` names the drones, each with an ``optitrack_node`` in its namespace, and says what
they do to each other's markers.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
import sys

from mambo_flight.world.world_file import Hall
from mambo_ros import process, usage
from mambo_ros.loop import Loop
from mambo_sim.optitrack_node import OptitrackNode

from .composed_node import own_topics, read_hall
from .flight import shared_capture


def serve(hall: Hall, _: OptitrackNode, loop: Loop) -> int:
    """Serve the cameras of a loop until stopped; return the exit code."""
    shared_capture.share(
        [node for node in loop.nodes if isinstance(node, OptitrackNode)], hall)
    loop.run()
    return 0


def main(args: list[str] | None = None) -> None:
    """Entry point ``hall_capture_node``."""
    words = sys.argv[1:] if args is None else args
    own = argparse.ArgumentParser('hall_capture_node', add_help=False)
    own.add_argument('--world', type=Path)
    options, others = own.parse_known_args(words)
    if usage.asked(words):
        process.main(OptitrackNode, args)
        return
    if options.world is None:
        print('hall_capture_node: give --world FILE, the world.yaml of a bag', file=sys.stderr)
        raise SystemExit(2)
    hall = read_hall('hall_capture_node', options.world)
    process.compose(
        [partial(OptitrackNode, namespace=space, cli_args=own_topics()) for space in hall.places],
        others, partial(serve, hall))
