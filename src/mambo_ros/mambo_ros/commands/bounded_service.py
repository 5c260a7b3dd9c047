"""The parameter services of a node, for requests of a bounded size and of known types."""

from __future__ import annotations

from functools import partial
from typing import Any
import weakref

from rcl_interfaces.msg import Parameter as Message, SetParametersResult
from rcl_interfaces.srv import ListParameters, SetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.parameter_service import ParameterService
from rclpy.qos import QoSProfile

from .request_size import bounded, PARAMETER, STRING, TooLarge

MOST = 1000
"""Parameters in a request; reading a thousand takes a control step or two."""
MOST_PREFIXES = 20
"""Prefixes in a request for a list; each is compared with all parameters of the node."""
LARGEST = 100_000
"""Characters and elements of arrays in a request; reading them takes a control step or two."""
WAITING = 10
"""Requests that wait for a service, as for other services of ROS; of those for parameters rclpy
holds 1000, which were 1.5 GB of hostile ones."""
_TYPES = frozenset(one.value for one in Parameter.Type)


def _wrong(parameter: Message) -> SetParametersResult | None:
    """Return what to answer to a parameter of a type that ROS does not have, else None."""
    if parameter.value.type in _TYPES:
        return None
    return SetParametersResult(successful=False, reason=(
        f'{parameter.name}: type {parameter.value.type} is none of rcl_interfaces/ParameterType'))


def _answer(callback: Any, request: Any, response: Any) -> Any:
    """Answer a request; one that is too large with one result, or with nothing."""
    if not isinstance(request, TooLarge):
        return callback(request, response)
    refused = SetParametersResult(successful=False, reason=request.reason)
    if isinstance(response, SetParameters.Response):
        response.results = [refused] * min(request.count, MOST)
    elif isinstance(response, SetParametersAtomically.Response):
        response.result = refused
    return response


class _Owner:
    """
    A node whose parameter services read no large requests.

    They hold ``WAITING`` requests; rclpy takes that number from a constant.
    """

    def __init__(self, node: Node) -> None:
        self._node, self.get_name = node, node.get_name

    def create_service(self, srv_type: Any, name: str, callback: Any, *,
                       qos_profile: QoSProfile) -> None:
        """Create a service with a short queue in place of the given one."""
        service = self._node.create_service(
            srv_type, name, partial(_answer, callback), qos_profile=QoSProfile(depth=WAITING))
        service.srv_type = (
            bounded(srv_type, PARAMETER, MOST, LARGEST, 'parameters')
            if srv_type in (SetParameters, SetParametersAtomically)
            else bounded(srv_type, STRING, MOST_PREFIXES, LARGEST, 'prefixes')
            if srv_type is ListParameters
            else bounded(srv_type, STRING, MOST, LARGEST, 'names'))


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
        wrong = next(filter(None, map(_wrong, request.parameters)), None)
        if wrong is None:
            return super()._set_parameters_atomically_callback(request, response)
        response.result = wrong
        return response
