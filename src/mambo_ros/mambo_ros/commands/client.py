"""Send a command to a running flight and wait for its answer: from a terminal or a script."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point
from mambo_model.errors import InputError, JobError
from rcl_interfaces.srv import SetParametersAtomically
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from . import table
from ..cdr import SECOND
from ..graph import domains, loopback
from ..topics import NAMESPACE

FIND = 8.0  # s of wall time, to find the service
ANSWER = 10.0  # s of wall time, for its answer


def _request_duration(seconds: float) -> Duration:
    """Return a duration for a request; InputError where there is none."""
    if not 0.0 <= seconds < 2.0**31:
        raise InputError(f'duration = {seconds:g} s must be 0 or more')
    sec, nanosec = divmod(round(seconds * SECOND), SECOND)
    return Duration(sec=sec, nanosec=nanosec)


def _takeoff(height: float, duration: float = 0.0) -> Any:
    return table.TAKEOFF.srv_type.Request(
        height=float(height), duration=_request_duration(duration))


def _land(height: float = 0.0, duration: float = 0.0) -> Any:
    return table.LAND.srv_type.Request(
        height=float(height), duration=_request_duration(duration))


def _go_to(goal: Any, yaw: float = 0.0, relative: bool = False, duration: float = 0.0) -> Any:
    x, y, z = map(float, goal)
    return table.GO_TO.srv_type.Request(
        goal=Point(x=x, y=y, z=z), yaw=float(yaw), relative=bool(relative),
        duration=_request_duration(duration))


def _follow(trajectory: str, timescale: float = 1.0, relative: bool = False,
            duration: float = 0.0) -> Any:
    return table.START_TRAJECTORY.srv_type.Request(
        trajectory=trajectory, timescale=float(timescale), relative=bool(relative),
        duration=_request_duration(duration))


def _set(parameters: Mapping[str, Any]) -> Any:
    return SetParametersAtomically.Request(parameters=[
        Parameter(name, value=_plain(value)).to_parameter_msg()
        for name, value in parameters.items()])


def _plain(value: Any) -> Any:
    """Return a value for a parameter; every vector is one of floats."""
    return [float(x) for x in value] if isinstance(value, (list, tuple)) else value


def _step(steps: int = 1) -> Any:
    if not 0 <= steps < 2**32:
        raise InputError(f'steps = {steps} must be 0 to {2**32 - 1}')
    return table.STEP.srv_type.Request(steps=int(steps))


class _Kind(NamedTuple):
    """A command: its service, and the request made of its arguments."""

    service: table.Service
    request: Callable[..., Any]


COMMANDS = {
    'takeoff': _Kind(table.TAKEOFF, _takeoff),
    'land': _Kind(table.LAND, _land),
    'go_to': _Kind(table.GO_TO, _go_to),
    'follow': _Kind(table.START_TRAJECTORY, _follow),
    'stop': _Kind(table.STOP, table.STOP.srv_type.Request),
    'pause': _Kind(table.PAUSE, lambda: table.PAUSE.srv_type.Request(data=True)),
    'resume': _Kind(table.PAUSE, lambda: table.PAUSE.srv_type.Request(data=False)),
    'step': _Kind(table.STEP, _step)}
SET = 'set'
"""Command that sets parameters of a node."""


def send(name: str, namespace: str = NAMESPACE, **arguments: Any) -> str:
    """
    Send a command to the flight that runs on this machine, or in ``ROS_DOMAIN_ID``.

    Parameters
    ----------
    name
        One of :data:`COMMANDS`, or :data:`SET`.
    namespace
        Of the drone.
    arguments
        Of the command: ``height`` m, ``duration`` s, ``goal`` (3,) m z-up, ``yaw`` rad, ...; to
        set: ``parameters``, {'node.parameter': value}, all of one node.

    Returns
    -------
    message
        What the flight answered: the flight time from which the command counts.

    Raises
    ------
    InputError
        For a command or argument that does not exist, or a choice of flights.
    JobError
        If no flight answers, or it refuses the command; the message is the reason.

    """
    if name == SET:
        kind, arguments = _setting(**arguments)
    elif name in COMMANDS:
        kind = COMMANDS[name]
    else:
        raise InputError(f'{name}: is none of {", ".join((*COMMANDS, SET))}')
    try:
        request = kind.request(**arguments)
    except (AssertionError, TypeError, ValueError) as error:
        raise InputError(f'{name}: {error}') from None
    domain = domains.chosen()
    loopback.check()
    loopback.configure()
    context = rclpy.Context()
    rclpy.init(args=[], context=context, domain_id=domain,
               signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = Node('mambo_command', context=context, namespace=namespace,
                    enable_rosout=False, start_parameter_services=False)
        response = _call(node, kind.service, request, domain)
    finally:
        rclpy.try_shutdown(context=context)
    if name == SET:
        success, message = response.result.successful, response.result.reason
    else:
        success, message = response.success, response.message
    if not success:
        raise JobError(message or 'refused without a reason')
    return message


def _setting(parameters: Mapping[str, Any]) -> tuple[_Kind, dict[str, Any]]:
    """Return the command that sets parameters of a node, and its arguments."""
    nodes = {full.partition('.')[0] for full in parameters}
    if len(nodes) != 1 or not all(full.partition('.')[2] for full in parameters):
        raise InputError('set: give NODE.PARAMETER of one node, such as '
                         'controller_node.cascaded.k_p')
    node = nodes.pop()
    service = table.Service(f'{node}/set_parameters_atomically', SetParametersAtomically)
    return _Kind(service, _set), {'parameters': {
        full.partition('.')[2]: value for full, value in parameters.items()}}


def _call(node: Node, service: table.Service, request: Any, domain: int) -> Any:
    """Return the response of a service, within the bounds of this module."""
    client = node.create_client(service.srv_type, service.name)
    if not client.wait_for_service(FIND):
        flying = [name for name, space in node.get_node_names_and_namespaces()
                  if space == node.get_namespace() and name != node.get_name()]
        if not flying:
            raise JobError(
                f'no flight of {node.get_namespace()} runs in ROS domain {domain}: start one '
                'with ./run --commanded')
        own, _, parameters = service.name.partition('/')
        raise JobError(
            f'the flight of {node.get_namespace()} in ROS domain {domain} has no ' + (
                f'{own}; it has {", ".join(sorted(flying))}' if parameters else
                f'{own}: it takes commands if it is started with ./run --commanded'))
    executor = SingleThreadedExecutor(context=node.context)
    executor.add_node(node)
    future = client.call_async(request)
    executor.spin_until_future_complete(future, ANSWER)
    executor.shutdown()
    if not future.done():
        raise JobError(f'{service.name}: no answer within {ANSWER:g} s')
    return future.result()
