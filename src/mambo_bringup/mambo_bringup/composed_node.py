"""
Every node of a flight in one process, for speed, with the same topics and the same bag.

The nodes pass each other their messages directly; subscribers in other processes get them from
the middleware. Each node has its own section in a parameter file.
"""

from __future__ import annotations

from mambo_bags.recorder_node import RecorderNode
from mambo_control.controller_node import ControllerNode
from mambo_control.reference_node import ReferenceNode
from mambo_estimation.estimator_node import EstimatorNode
from mambo_ros import process
from mambo_sim import sim_node
from mambo_sim.optitrack_node import OptitrackNode

NODES = (
    RecorderNode, OptitrackNode, EstimatorNode, ReferenceNode, ControllerNode, sim_node.SimNode)
"""The node that owns time is the last."""


def main(args=None) -> None:
    """Entry point ``composed_node``."""
    process.compose(NODES, args, sim_node.fly)
