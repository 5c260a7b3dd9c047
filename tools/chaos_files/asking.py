"""Hostile requests to the services of a flight: none of them may be granted."""

from __future__ import annotations

import math
import random
import time
from typing import Any

from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import ListParameters, SetParameters, SetParametersAtomically
import rclpy
from rclpy.node import Node
from std_srvs.srv import SetBool

from . import wild

THERE = 3.0  # s for a service to be there
ANSWERS = 3.0  # s for the answers
RESUMES = 10.0  # s within which a paused simulation must go on
_SETTERS = (SetParameters, SetParametersAtomically)
_NAMES = ('', 'no_such_parameter', 'a.' * 1000, '\x1b[2J', 'wire.', 'use_sim_time', 'x' * 70_000)
_ENORMOUS = (math.nan, math.inf, -math.inf, 1e300, -1e300)


def attack(node: Node, rng: random.Random, own: str) -> tuple[str, int]:
    """Send hostile requests to one service; return its name and how many were sent."""
    services = _offered(node, own)
    setters = [name for name in sorted(services) if services[name] in _SETTERS]
    commands = [name for name in sorted(services) if '_node/' not in name]
    others = [name for name in sorted(services) if name not in (*setters, *commands)]
    chosen = rng.choices((setters, commands, others), (5, 3, 2))[0] or setters
    if not chosen:
        return 'no service', 0
    name = rng.choice(chosen)
    client = node.create_client(services[name], name)
    client.wait_for_service(THERE)
    known = _names(node, name) if services[name] in _SETTERS else []
    futures = [client.call_async(request(rng, services[name], known))
               for _ in range(rng.choice((1, 5, 60, 300)))]
    limit = time.monotonic() + ANSWERS
    while time.monotonic() < limit and not all(future.done() for future in futures):
        rclpy.spin_once(node, timeout_sec=0.02)
    if name in commands:
        _resume(node, [one for one in commands if one.endswith('/pause')])
    return name, len(futures)


def _offered(node: Node, own: str) -> dict[str, type]:
    """Return the services of other nodes with their types, once they are settled."""
    before, names = -1, []
    while before != len(names):
        before = len(names)
        limit = time.monotonic() + 0.5
        while time.monotonic() < limit:
            rclpy.spin_once(node, timeout_sec=0.02)
        names = [(name, kinds) for name, kinds in node.get_service_names_and_types()
                 if not name.startswith(f'/{own}')]
    return {name: wild.found(kinds[0]) for name, kinds in names}


def _names(node: Node, service: str) -> list[str]:
    """Return the parameters of the node of a service."""
    client = node.create_client(ListParameters, f'{service.rpartition("/")[0]}/list_parameters')
    client.wait_for_service(THERE)
    future = client.call_async(ListParameters.Request())
    rclpy.spin_until_future_complete(node, future, timeout_sec=ANSWERS)
    return future.result().result.names if future.done() else []


def request(rng: random.Random, kind: type, known: list[str]) -> Any:
    """Return a hostile request to a service of a type."""
    out = kind.Request()
    if kind in _SETTERS:
        out.parameters = [
            Parameter(name=_name(rng, known), value=parameter_value(rng))
            for _ in range(rng.choice((0, 1, 3, 1001, 3000)))]
        return out
    for name, field in wild.leaves(out):
        setattr(out, name, wild.value(rng, field))
    return out


def _name(rng: random.Random, known: list[str]) -> str:
    """Return the name of a parameter, or nearly one."""
    name = rng.choice(known) if known and rng.random() < 0.8 else rng.choice(_NAMES)
    return name if rng.random() < 0.9 else f'{name}.x'


def parameter_value(rng: random.Random) -> ParameterValue:
    """Return a value that no parameter may have."""
    kind = rng.choice((0, 2, 3, 3, 3, 4, 5, 6, 7, 8, 9, 10, 200))
    out = ParameterValue(type=kind)
    out.integer_value = rng.choice((-2**63, 2**63 - 1))
    out.double_value = rng.choice(_ENORMOUS)
    out.string_value = rng.choice([text for text in wild.TEXTS if text not in ('map', 'odom')])
    out.double_array_value = [rng.choice(_ENORMOUS)] * rng.choice((0, 3, 2000))
    out.string_array_value = [out.string_value[:100]] * rng.choice((0, 3))
    return out


def _resume(node: Node, pauses: list[str]) -> None:
    """Let paused simulations go on; whoever may pause them may."""
    for name in pauses:
        client = node.create_client(SetBool, name)
        limit = time.monotonic() + RESUMES
        while time.monotonic() < limit:
            future = client.call_async(SetBool.Request(data=False))
            rclpy.spin_until_future_complete(node, future, timeout_sec=1.2)
            if future.done() and future.result().success:
                break
            time.sleep(0.3)
