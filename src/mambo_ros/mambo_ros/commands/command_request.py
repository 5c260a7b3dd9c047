"""What a command to a running flight holds: its service, its request, its answer."""

from __future__ import annotations

from collections.abc import Callable, Mapping
import inspect
import sys
from typing import Any, NamedTuple

from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point
from mambo_model import yaml_nodes
from mambo_model.errors import InputError, JobError
from mambo_model.schema import shown
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
import yaml

from . import table
from ..cdr import SECOND

LONGEST = 2.0**31  # s, of a duration in a message


def _request_duration(seconds: float) -> Duration:
    """Return a duration for a request; InputError where there is none."""
    if not 0.0 <= _number('duration', seconds) < LONGEST:
        raise InputError(f'duration = {seconds:g} s must be from 0 to {LONGEST:g} s')
    sec, nanosec = divmod(round(seconds * SECOND), SECOND)
    return Duration(sec=sec, nanosec=nanosec)


def _number(name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f'{name} = {shown(value)} must be a number')
    if not -sys.float_info.max <= value <= sys.float_info.max:
        raise InputError(f'{name} = {shown(value)} must be finite')
    return float(value)


def _flag(name: str, value: Any) -> bool:
    if not isinstance(value, bool):
        raise InputError(f'{name} = {value!r} must be True or False')
    return value


def _takeoff(height: float, duration: float = 0.0) -> Any:
    return table.TAKEOFF.srv_type.Request(
        height=_number('height', height), duration=_request_duration(duration))


def _land(height: float = 0.0, duration: float = 0.0) -> Any:
    return table.LAND.srv_type.Request(
        height=_number('height', height), duration=_request_duration(duration))


def _go_to(goal: Any, yaw: float = 0.0, relative: bool = False, duration: float = 0.0) -> Any:
    if not isinstance(goal, list | tuple) or len(goal) != 3:
        raise InputError(f'goal = {goal!r} must be three numbers')
    x, y, z = (_number('goal', one) for one in goal)
    return table.GO_TO.srv_type.Request(
        goal=Point(x=x, y=y, z=z), yaw=_number('yaw', yaw), relative=_flag('relative', relative),
        duration=_request_duration(duration))


def _follow(trajectory: str, timescale: float = 1.0, relative: bool = False,
            duration: float = 0.0) -> Any:
    if not isinstance(trajectory, str):
        raise InputError(f'trajectory = {trajectory!r} must be the path of a course or its text')
    return table.START_TRAJECTORY.srv_type.Request(
        trajectory=trajectory, timescale=_number('timescale', timescale),
        relative=_flag('relative', relative), duration=_request_duration(duration))


def _set(parameters: Mapping[str, Any]) -> Any:
    return SetParametersAtomically.Request(parameters=[
        Parameter(name, value=_plain(value)).to_parameter_msg()
        for name, value in parameters.items()])


def _plain(value: Any) -> Any:
    """Return a value for a parameter; every vector is one of floats."""
    return [float(x) for x in value] if isinstance(value, (list, tuple)) else value


def _step(steps: int = 1) -> Any:
    if isinstance(steps, bool) or not isinstance(steps, int) or not 0 <= steps < 2**32:
        raise InputError(f'steps = {steps!r} must be a whole number from 0 to {2**32 - 1}')
    return table.STEP.srv_type.Request(steps=steps)


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


def prepare(name: str, arguments: Mapping[str, Any]) -> tuple[table.Service, Any]:
    """
    Return the service of a command and its request.

    Raises
    ------
    InputError
        For a command or argument that does not exist or has a wrong value.

    """
    if name != SET and name not in COMMANDS:
        raise InputError(f'{name}: is none of {", ".join((*COMMANDS, SET))}')
    _check(name, _setting if name == SET else COMMANDS[name].request, arguments)
    if name == SET:
        kind, arguments = _setting(**arguments)
    else:
        kind = COMMANDS[name]
    try:
        return kind.service, kind.request(**arguments)
    except (AssertionError, OverflowError, TypeError, ValueError) as error:
        raise InputError(f'{name}: {error}') from None


def _check(name: str, make: Callable[..., Any], arguments: Mapping[str, Any]) -> None:
    """Raise InputError if a command has an argument that it does not take, or lacks one."""
    known = {} if isinstance(make, type) else inspect.signature(make).parameters
    takes = f'; it takes {", ".join(known)}' if known else ''
    for argument in arguments:
        if argument not in known:
            raise InputError(f'{name}: {argument} is not an argument of this command{takes}')
    for argument, about in known.items():
        if about.default is about.empty and argument not in arguments:
            raise InputError(f'{name}: {argument} is missing{takes}')


def answer(name: str, response: Any) -> str:
    """Return what a flight answered to a command; JobError with its reason if it refused."""
    if name == SET:
        success, message = response.result.successful, response.result.reason
    else:
        success, message = response.success, response.message
    if not success:
        raise JobError(message or 'refused without a reason')
    return message


def setting(text: str) -> tuple[str, Any]:
    """Return name and value of ``NODE.PARAMETER=VALUE``; InputError if it is not of that form."""
    name, equals, value = text.partition('=')
    try:
        if equals and name.strip():
            return name.strip(), yaml_nodes.load(value)
    except yaml.YAMLError as error:
        raise InputError(f'{text}: {yaml_nodes.reason(error)}') from None
    raise InputError(f'{text}: write NODE.PARAMETER=VALUE')


def parameters_of(node: str) -> table.Service:
    """Return the service that sets parameters of a node."""
    return table.Service(f'{node}/set_parameters_atomically', SetParametersAtomically)


def _setting(parameters: Mapping[str, Any]) -> tuple[_Kind, dict[str, Any]]:
    """Return the command that sets parameters of a node, and its arguments."""
    nodes = {full.partition('.')[0] for full in parameters}
    if len(nodes) != 1 or not all(full.partition('.')[2] for full in parameters):
        raise InputError('set: give NODE.PARAMETER of one node, such as '
                         'controller_node.cascaded.k_p')
    return _Kind(parameters_of(nodes.pop()), _set), {'parameters': {
        full.partition('.')[2]: value for full, value in parameters.items()}}
