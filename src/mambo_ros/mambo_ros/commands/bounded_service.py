"""The parameter services of a node, for requests of a bounded size."""

from __future__ import annotations

from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.parameter_service import ParameterService

MOST = 1000
"""Parameters in a request; reading a thousand takes a control step or two."""
_REFUSED = SetParametersResult(
    successful=False, reason=f'more than {MOST} parameters in one request')


class BoundedService(ParameterService):
    """
    The services of rclpy, which refuse to set very many parameters at once.

    rclpy reads one parameter after the other, and a node that flies has steps to take meanwhile.
    """

    def _set_parameters_callback(
        self, request: SetParameters.Request, response: SetParameters.Response,
    ) -> SetParameters.Response:
        """Answer a request to set parameters one by one."""
        count = len(request.parameters)
        if count <= MOST:
            return super()._set_parameters_callback(request, response)
        response.results = [_REFUSED] * count
        return response

    def _set_parameters_atomically_callback(
        self, request: SetParametersAtomically.Request, response: SetParametersAtomically.Response,
    ) -> SetParametersAtomically.Response:
        """Answer a request to set all parameters, or none."""
        if len(request.parameters) <= MOST:
            return super()._set_parameters_atomically_callback(request, response)
        response.result = _REFUSED
        return response
