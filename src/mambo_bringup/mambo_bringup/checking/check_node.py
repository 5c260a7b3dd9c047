"""The rest of a graph around nodes that are checked: it owns time, drives them and judges them."""

from __future__ import annotations

from functools import partial
import json
import sys
from typing import Any

from mambo_control.controller_node import ControllerNode
from mambo_control.reference_node import ReferenceNode
from mambo_estimation.estimator_node import EstimatorNode
from mambo_ros import process, topics
from mambo_ros.loop import Loop
from mambo_sim.optitrack_node import OptitrackNode
from mambo_sim.sim_node import SimNode
import numpy as np
from rclpy.serialization import deserialize_message

from . import ends, stand
from .contract import BY_TOPIC
from .idle import Idle
from .transcript import FOUND, READY, TIMES, Transcript

_NODES = {'optitrack': OptitrackNode, 'estimator': EstimatorNode, 'reference': ReferenceNode,
          'controller': ControllerNode}


class CheckNode(SimNode):
    """
    The simulator of a check: hears what the checked nodes publish.

    These are the publishers that its parameter ``wait_for_publishers`` names.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        names = [name.strip() for name in self.params.wait_for_publishers.split(',')]
        self.idle: Idle | None = None  # of a controller
        self.transcripts = [Transcript(BY_TOPIC[name]) for name in names if name]
        for one in self.transcripts:
            self.subscribe(one.contract.answer, self._listener(one))
            if one.contract.answer is topics.MOTOR_PWM:
                self.idle = Idle(one)
                self.subscribe(topics.MOTOR_PWM, self.idle.hear_command)
                self.subscribe(topics.REFERENCE, self.idle.hear_reference)

    def _listener(self, one: Transcript) -> Any:
        """Return what takes the messages of a checked node."""
        wanted = one.contract.frames

        def take(data: bytes) -> None:
            """Note a message and, of the first one with a stamp, its frames."""
            one.hear(data)
            if 'frames' in one.notes or one.heard[-1].stamp < 0:
                return
            message = deserialize_message(data, one.contract.answer.msg_type)
            found = (message.header.frame_id, getattr(message, 'child_frame_id', ''))[:len(wanted)]
            kept = found == wanted or wanted == ('',)
            one.note('frames', kept, ', '.join(map(repr, found)) + (
                '' if kept else f', wanted {", ".join(map(repr, wanted))}'))
        return take


def _tell(one: Transcript) -> None:
    """Print the findings of a node for the command."""
    for finding in one.findings():
        print(FOUND + json.dumps(finding._asdict()), flush=True)
    for name, paced in (('lockstep', False), ('real time', True)):
        took = one.latencies(paced)
        if len(took):
            print(TIMES + json.dumps({
                'node': one.contract.node, 'mode': name, 'answers': len(took),
                'median_ms': round(float(np.median(took)) * 1e3, 3),
                'largest_ms': round(float(took.max()) * 1e3, 3)}), flush=True)


def check(patience: float, sim: CheckNode, loop: Loop) -> int:
    """Check the nodes, print what was found, then serve the graph until stopped."""
    if stand.wait_for_nodes(sim, loop, sim.transcripts, sim.params.start_patience):
        stand.Stand(sim, loop, sim.transcripts, patience).run()
        for one in sim.transcripts:
            stand.note_refusals(
                loop.nodes, one, sim.resolve_topic_name(one.contract.answer.name))
            ends.check_sim_time(sim, loop, one)
        if sim.idle is not None:
            sim.idle.judge()
    for one in sim.transcripts:
        _tell(one)
    print(READY, flush=True)
    loop.run()
    return 0


def main(args: list[str] | None = None) -> None:
    """Entry point ``check_node NODE[,NODE...] PATIENCE``, then arguments of ROS."""
    words = sys.argv[1:] if args is None else args
    if len(words) < 2 or '--help' in words:
        process.compose([CheckNode], ['--help'])
        return
    nodes = [node for name, node in _NODES.items() if name not in words[0].split(',')]
    process.compose([*nodes, CheckNode], words[2:], partial(check, float(words[1])))
