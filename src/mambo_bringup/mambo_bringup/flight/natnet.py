"""A flight whose poses go through NatNet: a server of the simulated hall, and its client."""

from __future__ import annotations

import json
from pathlib import Path

from mambo_flight import scenario as scenarios
from mambo_model import schema

SERVER, CLIENT = ('mambo_mocap', 'natnet_server_node'), ('mambo_mocap', 'natnet_client_node')
PORT = 1510
"""Command port of Motive; the data port is the next one."""
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


def parameters(flight: scenarios.Scenario, port: int, namespace: str) -> dict[str, object]:
    """Return the parameters of server and client as the content of a parameter file."""
    capture = flight.optitrack_node.optitrack
    hall = {f'markers.{name}': value for name, value in schema.flatten(capture.markers).items()}
    hall |= {name: getattr(capture, name) for name in _HALL}
    return {
        f'{namespace}/{SERVER[1]}': {'ros__parameters': {
            **hall, 'seed': flight.optitrack_node.seed,
            'command_port': port, 'data_port': port + 1}},
        f'{namespace}/{CLIENT[1]}': {'ros__parameters': {
            'command_port': port, 'stamp': 'server'}}}


def write(file: Path, flight: scenarios.Scenario, port: int, namespace: str) -> Path:
    """Write the parameters of server and client beside the file of a flight; return where."""
    target = file.with_name(f'natnet_{file.name}')
    target.write_text(json.dumps(parameters(flight, port, namespace)))  # parsed as YAML
    return target
