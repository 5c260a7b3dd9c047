"""The only bridge between parameter dataclasses and ROS parameters."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

from mambo_model import schema
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import (
    InvalidParameterTypeException, InvalidParameterValueException, ParameterException)
from rclpy.node import Node
from rclpy.service import Service

from . import parameter_texts

P = TypeVar('P')
_WARN_EVERY = 1.0  # s


def _descriptor(name: str, field: Any, read_only: bool) -> ParameterDescriptor:
    """Describe one parameter: what it is, unit, range or options, source."""
    meta, default = field.metadata, field.default
    about = ParameterDescriptor(read_only=read_only)
    if 'unit' in meta:
        about.description = f'[{meta["unit"]}] source: {meta["source"]}'
        about.additional_constraints = f'[{meta["low"]:g}, {meta["high"]:g}] {meta["unit"]}'
        if isinstance(default, float):
            about.floating_point_range = [
                FloatingPointRange(from_value=float(meta['low']), to_value=float(meta['high']))]
        elif isinstance(default, int):
            about.integer_range = [
                IntegerRange(from_value=int(meta['low']), to_value=int(meta['high']))]
    elif 'options' in meta:
        about.description = f'one of: {", ".join(meta["options"])}; source: {meta["source"]}'
    elif 'component' in meta:
        about.description = (
            f'one of: {", ".join(meta["component"].names)}, or FILE.py, FILE.py:NAME, or an '
            f'installed one; source: {meta["source"]}')
    else:
        about.description = f'source: {meta["source"]}'
    if what := parameter_texts.describe(name):
        about.description = f'{what}; {about.description}'
    return about


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def declare(node: Node, params_type: type[P]) -> P:
    """
    Declare every field of a parameter dataclass, nested ones with dotted names, and fill it.

    An integer is accepted for a floating-point parameter. Parameters are read-only, but for those
    that ``params.fixed`` gives no reason for: they can change while the node flies
    (:mod:`.commands.live`).

    Raises
    ------
    mambo_model.schema.ParameterError
        If a given parameter is unknown or its value unusable; the message names the parameter,
        its value, unit and range.

    """
    given = {name: parameter.value for name, parameter in node._parameter_overrides.items()}
    params_type = schema.extended(params_type, given)
    known = dict(schema.walk(params_type))
    params = _declare(node, params_type, '', given)
    unknown = sorted(name for name in given if not node.has_parameter(name))
    if unknown:
        raise schema.ParameterError(schema.unknown(unknown[0], known))
    _guard_services(node)
    return params


def declare_group(node: Node, params_type: type[P], prefix: str) -> P:
    """Declare a dataclass whose parameters have a prefix, before :func:`declare`; errors alike."""
    return _declare(node, params_type, prefix, {
        name.removeprefix(prefix): parameter.value
        for name, parameter in node._parameter_overrides.items() if name.startswith(prefix)})


def _declare(node: Node, params_type: type[P], prefix: str, given: dict[str, Any]) -> P:
    """Declare the fields of a dataclass below a prefix; return it with the given values."""
    known = dict(schema.walk(params_type))
    params = schema.build(
        params_type, {name: value for name, value in given.items() if name in known}, prefix)
    fixed = getattr(params, 'fixed', lambda name: 'all are')
    for name, value in schema.flatten(params).items():
        try:
            node.declare_parameter(
                prefix + name, _plain(value),
                _descriptor(prefix + name, known[name], bool(fixed(name))), ignore_override=True)
        except (InvalidParameterTypeException, InvalidParameterValueException,
                ParameterException) as error:
            raise schema.ParameterError(f'{prefix}{name} = {value!r}: {error}') from None
    return params


def _guard_services(node: Node) -> None:
    """
    Keep requests to the parameter services from ending a node.

    Any client may call them with any content, and ``rclpy`` raises if a parameter type does not
    exist. Such a request gets an empty response and is logged as a warning.
    """
    for service in node.services:
        service.callback = _guarded(node, service)


def _guarded(node: Node, service: Service) -> Callable[[Any, Any], Any]:
    """Return the callback of a service, with its errors caught."""
    callback, name = service.callback, service.srv_name

    def answer(request: Any, response: Any) -> Any:
        """Call the original callback; warn of a request that it cannot handle."""
        try:
            return callback(request, response)
        except Exception as error:
            node.get_logger().warning(
                f'{name}: ignored a request: {error}', throttle_duration_sec=_WARN_EVERY)
            return response
    return answer
