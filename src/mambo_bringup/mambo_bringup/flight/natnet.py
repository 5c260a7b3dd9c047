"""A flight whose poses go through NatNet: a server of the simulated hall, and its client."""

from __future__ import annotations

import json
from pathlib import Path
import socket

from mambo_analysis.compare.ending import REPORTS, statuses
from mambo_bags.reader import read_bag
from mambo_flight import scenario as scenarios
from mambo_flight.world.world_file import Hall
from mambo_model import schema
from mambo_model.errors import InputError
from mambo_model.frames import flip_vector
from mambo_ros import topics

SERVER, CLIENT = ('mambo_mocap', 'natnet_server_node'), ('mambo_mocap', 'natnet_client_node')
PORT = 1510
"""Command port of Motive; the data port is the next one."""
_HOST, _GROUP = '127.0.0.1', '239.255.42.99'  # where commands and frames go by default
_LATE = 0.1  # s of poses that may be missing at the start without a word
_HALL = ('rate', 'latency', 'noise', 'fault', 'fault_begin', 'fault_end', 'fault_distance')


def scenario(flight: scenarios.Scenario) -> scenarios.Scenario:
    """
    Return a flight with what NatNet needs: real time, and poses that are used as they arrive.

    Raises
    ------
    ParameterError
        If its motion capture has something that no NatNet server streams.

    """
    capture = flight.optitrack_node.optitrack
    if capture.model != 'markers' or capture.frame_loss or capture.stamp != 'exposure':
        raise schema.ParameterError(
            'with NatNet optitrack_node.optitrack needs model: markers, stamp: exposure and '
            'frame_loss: 0.0')
    return scenarios.override(flight, {
        'sim_node.mode': 'realtime', 'estimator_node.synchronise': 'arrival'})


def check_ports(port: int) -> None:
    """Raise InputError if the command port of a server, or its data port, is in use."""
    for number, address in ((port, _HOST), (port + 1, _GROUP)):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
            if address == _GROUP:  # several clients may listen
                one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                one.bind((address, number))
            except OSError as error:
                raise InputError(
                    f'--natnet {port}: UDP port {number} of this machine cannot be used '
                    f'({error.strerror}): end what uses it, or give another port') from None


def _several(hall: Hall) -> tuple[dict[str, object], dict[str, object]]:
    """Return what server and client have of their own where several drones share a hall."""
    places = '; '.join(' '.join(map(repr, flip_vector(place))) for place in hall.places.values())

    def bodies(topic: topics.Topic) -> str:
        return ', '.join(f'{space[1:]}={topics.full_name(topic, space)}' for space in hall.places)

    return {
        'bodies': bodies(topics.GROUND_TRUTH), 'places': places,
        **{f'capture.{name}': value
           for name, value in schema.flatten(hall.params.capture).items()}}, {
        'bodies': bodies(topics.OPTITRACK), 'places': places}


def parameters(
    flight: scenarios.Scenario, port: int, namespace: str, several: Hall | None = None,
) -> dict[str, object]:
    """
    Return the parameters of server and client as the content of a parameter file.

    Parameters
    ----------
    flight
        Of the drone, the first one of several.
    port
        Command port of the server.
    namespace
        Of the nodes.
    several
        Hall of several drones with the motion capture of the first and consecutive seeds; None:
        there is one drone.

    """
    of_server, of_client = _several(several) if several else ({}, {})
    capture = flight.optitrack_node.optitrack
    hall = {f'markers.{name}': value for name, value in schema.flatten(capture.markers).items()}
    hall |= {name: getattr(capture, name) for name in _HALL}
    return {
        f'{namespace}/{SERVER[1]}': {'ros__parameters': {
            **hall, **of_server, 'seed': flight.optitrack_node.seed,
            'command_port': port, 'data_port': port + 1}},
        f'{namespace}/{CLIENT[1]}': {'ros__parameters': {
            **of_client, 'command_port': port, 'stamp': 'server',
            'connect_within': flight.sim_node.patience}}}


def write(file: Path, flight: scenarios.Scenario, port: int, namespace: str,
          several: Hall | None = None) -> Path:
    """Write the parameters of server and client beside the file of a flight; return where."""
    target = file.with_name(f'natnet_{file.name}')
    target.write_text(json.dumps(parameters(flight, port, namespace, several)))  # parsed as YAML
    return target


def missing(bag: Path, flight: scenarios.Scenario) -> tuple[str, bool]:
    """
    Return which poses of a drone did not come through NatNet into its bag at the start.

    Returns
    -------
    line
        Empty if the first pose is there in time, or if the cameras lose the drone at the start.
    failed
        Whether the flight is not the one that was asked for: no pose came, or the estimator takes
        poses and the first one came after the vehicle had left the floor, where it aligns itself
        without them.

    """
    capture, poses = flight.optitrack_node.optitrack, topics.OPTITRACK.name
    recording = read_bag(bag, (poses, *REPORTS))
    if poses not in recording:
        said = [status.message for _, status in statuses(recording)
                if status.name.endswith(CLIENT[1]) and status.level > 0]
        return ': '.join([f'{bag}: no {poses}: none came through NatNet', *said[-1:]]), True
    first = float(recording[poses].stamp[0]) * 1e-9
    if first <= _LATE or capture.fault == 'lost' and capture.fault_begin <= _LATE:
        return '', False
    plan = flight.reference_node.plan
    leaves = 0.0 if plan.takeoff == 'none' else plan.takeoff_time
    failed = flight.estimator_node.aided and first > leaves and (
        not flight.reference_node.commands.enabled)
    line = (f'{bag}: the first pose came through NatNet at t = {first:.2f} s, about '
            f'{first * capture.rate:.0f} are missing before it')
    return line + (f'; the vehicle leaves the floor at {leaves:g} s' if failed else ''), failed
