"""The parameter services of a node, for requests of a bounded size and of known types."""

from __future__ import annotations

from typing import Any
import weakref

from rcl_interfaces.msg import Parameter as Message, SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_service import ParameterService
from rclpy.qos import QoSProfile

MOST = 1000
"""Parameters in a request; reading a thousand takes a control step or two."""
WAITING = 10
"""Requests that wait for a service, as for other services of ROS; of those for parameters rclpy
holds 1000, which were 1.5 GB of hostile ones."""
_REFUSED = SetParametersResult(
    successful=False, reason=f'more than {MOST} parameters in one request')
_TYPES = frozenset(one.value for one in Parameter.Type)


def _wrong(parameter: Message) -> SetParametersResult | None:
    """Return what to answer to a parameter of a type that ROS does not have, else None."""
    if parameter.value.type in _TYPES:
        return None
    return SetParametersResult(successful=False, reason=(
        f'{parameter.name}: type {parameter.value.type} is none of rcl_interfaces/ParameterType'))


class _Owner:
    """A node whose services hold ``WAITING`` requests; rclpy takes the number from a constant."""

    def __init__(self, node: Node) -> None:
        self._node, self.get_name = node, node.get_name

    def create_service(self, *what: Any, qos_profile: QoSProfile) -> None:
        """Create a service with a short queue in place of the given one."""
        self._node.create_service(*what, qos_profile=QoSProfile(depth=WAITING))


class BoundedService(ParameterService):
    """
    The services of rclpy, which refuse very many parameters at once, and unknown types.

    rclpy reads one parameter after the other, and a node that flies has steps to take meanwhile.
    A type that ROS does not have would end its callback, and the answer would be empty.
    """

    def __init__(self, node: Node) -> None:
        super().__init__(_Owner(node))
        self._node_weak_ref = weakref.ref(node)

    def _set_parameters_callback(
        self, request: SetParameters.Request, response: SetParameters.Response,
    ) -> SetParameters.Response:
        """Answer a request to set parameters one by one."""
        count = len(request.parameters)
        if count > MOST:
            response.results = [_REFUSED] * count
            return response
        for parameter in request.parameters:
            wrong = _wrong(parameter)
            if wrong is None:
                super()._set_parameters_callback(
                    SetParameters.Request(parameters=[parameter]), response)
            else:
                response.results.append(wrong)
        return response

    def _set_parameters_atomically_callback(
        self, request: SetParametersAtomically.Request, response: SetParametersAtomically.Response,
    ) -> SetParametersAtomically.Response:
        """Answer a request to set all parameters, or none."""
        wrong = _REFUSED if len(request.parameters) > MOST else next(
            filter(None, map(_wrong, request.parameters)), None)
        if wrong is None:
            return super()._set_parameters_atomically_callback(request, response)
        response.result = wrong
        return response
