"""The nodes of a flight: which programs are started, with which arguments and parameters."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
import json
from pathlib import Path
from types import MappingProxyType

from mambo_flight import recording_to_bag, scenario as scenarios
from mambo_ros.topics import NAMESPACE, OWN, RECORDED

from . import natnet as natnet_nodes
from ..processes import parameter

FLIGHT_NODES = (
    ('mambo_sim', 'optitrack_node'), ('mambo_estimation', 'estimator_node'),
    ('mambo_control', 'reference_node'), ('mambo_control', 'controller_node'))
REPLACEABLE = {
    'optitrack': (FLIGHT_NODES[0], 'optitrack/pose'),
    'estimator': (FLIGHT_NODES[1], 'estimate/odom'),
    'reference': (FLIGHT_NODES[2], 'reference'), 'controller': (FLIGHT_NODES[3], 'motor_pwm')}
"""Values of ``--without``: the node, and the topic that the user's node publishes instead."""
RECORDER = ('mambo_bags', 'recorder_node')
SIMULATOR = ('mambo_sim', 'sim_node')
VIEW = ('mambo_view', 'view_node')
DESCRIPTION = ('mambo_description', 'description_node')
COMPOSED = ('mambo_bringup', 'composed_node')
HALL_CAPTURE = ('mambo_bringup', 'hall_capture_node')


def label(namespace: str, node: tuple[str, str]) -> str:
    """Return the name of a node in messages, with its namespace if there are several drones."""
    return node[1] if namespace == NAMESPACE else f'{namespace}/{node[1]}'


def _nodes_to_start(without: Collection[str], natnet: bool) -> list[tuple[str, str]]:
    """Return the nodes, other than simulator and recorder, that the runner starts."""
    theirs = [REPLACEABLE[name][0] for name in without]
    capture = (natnet_nodes.SERVER, natnet_nodes.CLIENT) if natnet else FLIGHT_NODES[:1]
    return [node for node in (*capture, *FLIGHT_NODES[1:]) if node not in theirs]


def run_parameters(flight: scenarios.Scenario, without: Collection[str],
                   natnet: bool = False, recorded: bool = True) -> dict[str, object]:
    """Return the parameters that belong to the run, not to the experiment."""
    waited = [name for _, name in (
        *_nodes_to_start(without, natnet), *((RECORDER,) if recorded else ()))]
    return {'optitrack_node.watermark': flight.estimator_node.waits_for_capture,
            'sim_node.wait_for': ','.join(waited),
            'sim_node.wait_for_publishers': ','.join(REPLACEABLE[name][1] for name in without)}


def recorder_topics(flight: scenarios.Scenario) -> dict[str, str]:
    """
    Return the parameter ``topics`` of the recorder, or nothing for its default topics.

    A flight whose estimator uses motion capture has further topics, and so has a commanded one.
    """
    if recording_to_bag.recorded(flight) == RECORDED:
        return {}
    return {'topics': ','.join(topic.name for topic in recording_to_bag.recorded(flight))}


def world_process(file: Path, owners: Sequence[list[str]], composed: bool) -> list[str]:
    """
    Return the arguments of the process that steps all drones of a hall.

    Parameters
    ----------
    file
        The hall.
    owners
        Arguments of the process of each drone that owns time, from :func:`start_arguments`.
    composed
        Whether all nodes of all drones run in it, or their simulators alone.

    """
    return ['--world', str(file), *([] if composed else ['--simulators']), '--ros-args',
            *_parameter_files(owners)]


def _parameter_files(nodes: Iterable[list[str]]) -> list[str]:
    """Return the words among the arguments of nodes that name parameter files."""
    return [word for arguments in nodes
            for flag, value in zip(arguments, arguments[1:], strict=False)
            if flag == '--params-file' for word in (flag, value)]


def take_cameras(
    file: Path, started: Sequence[tuple[str, tuple[str, str], list[str]]],
) -> tuple[list[tuple[str, tuple[str, str], list[str]]], list[str]]:
    """
    Let one process have the cameras of all drones of a hall.

    Parameters
    ----------
    file
        The hall.
    started
        Namespace, node and arguments of each process of the drones.

    Returns
    -------
    others
        The processes without the cameras of single drones.
    arguments
        Of :data:`HALL_CAPTURE`; empty if there are no cameras.

    """
    cameras = [words for _, node, words in started if node == FLIGHT_NODES[0]]
    others = [one for one in started if one[1] != FLIGHT_NODES[0]]
    return others, ['--world', str(file), '--ros-args', *_parameter_files(cameras)
                    ] if cameras else []


def start_arguments(
    file: Path, bag: Path, composed: bool, namespace: str, without: Collection[str] = (),
    recorder: Mapping[str, str] = MappingProxyType({}), natnet: Path | None = None,
    own: bool | None = None,
) -> list[tuple[tuple[str, str], list[str]]]:
    """
    Return the nodes of a drone with their command line arguments.

    The recorder comes first, the node that publishes the clock last.

    Parameters
    ----------
    file
        Parameters of all nodes.
    bag
        Directory that the recorder creates.
    composed
        Whether all nodes run in one process.
    namespace
        Of the drone.
    without
        Names in :data:`REPLACEABLE` of nodes that the user starts.
    recorder
        Further parameters of the recorder.
    natnet
        Parameters of the NatNet server and client, which stand in for the mock Optitrack.
    own
        Whether the drone has a clock, frames and diagnostics of its own; None: it has them if its
        namespace is not that of a drone that flies alone.

    """
    arguments = ['--ros-args']
    if namespace != NAMESPACE:
        arguments += ['-r', f'__ns:={namespace}']
    if namespace != NAMESPACE if own is None else own:
        for topic in OWN:
            arguments += ['-r', f'/{topic}:={topic}']
    flown = [*arguments, '--params-file', str(file)]
    if composed:
        recorder_file = file.with_name(f'recorder_{file.name}')
        recorder_file.write_text(json.dumps({f'{namespace}/recorder_node': {  # parsed as YAML
            'ros__parameters': {'bag': str(bag), 'scenario': str(file), **recorder}}},
            ensure_ascii=False))
        return [(COMPOSED, [*flown, '--params-file', str(recorder_file)])]
    recorded = [*arguments, *parameter('bag', bag), *parameter('scenario', file),
                *(one for name, value in recorder.items() for one in parameter(name, value))]
    if natnet is not None:
        flown += ['--params-file', str(natnet)]
    others = (*_nodes_to_start(without, natnet is not None), SIMULATOR)
    return [(RECORDER, recorded), *((node, flown) for node in others)]
