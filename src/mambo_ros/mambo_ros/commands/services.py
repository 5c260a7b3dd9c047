"""Services that commands come through: bounded, and no request can end the node."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
import time
from typing import Any

from rclpy.node import Node

from .table import Service

MOST = 100  # requests in a second of wall time, all services of a node together
BUSY = f'more than {MOST} requests in a second'


class Services:
    """
    The command services of a node.

    Parameters
    ----------
    node
        That offers them, in its namespace.

    Attributes
    ----------
    refused : int
        Requests that came too fast, or raised an error.

    """

    def __init__(self, node: Node) -> None:
        self._node, self.refused = node, 0
        self._since, self._count = time.monotonic(), 0

    def offer(self, *served: tuple[Service, Callable[[Any], tuple[bool, str]]]) -> None:
        """
        Offer services.

        Parameters
        ----------
        served
            Each with the function from a request to ``success`` and ``message``.

        """
        for service, answer in served:
            self._node.create_service(
                service.srv_type, service.name, partial(self._respond, service.name, answer))

    def _respond(self, name: str, answer: Callable[[Any], tuple[bool, str]], request: Any,
                 response: Any) -> Any:
        """Fill the response to a request."""
        response.success, response.message = self._answer(name, request, answer)
        return response

    def _answer(
        self, name: str, request: Any, answer: Callable[[Any], tuple[bool, str]],
    ) -> tuple[bool, str]:
        now = time.monotonic()
        if now - self._since > 1.0:
            self._since, self._count = now, 0
        self._count += 1
        if self._count > MOST:
            self.refused += 1
            return False, BUSY
        try:
            return answer(request)
        except Exception as error:  # any client may send anything
            self.refused += 1
            self._node.get_logger().warning(
                f'{name}: ignored a request: {error}', throttle_duration_sec=1.0)
            return False, f'the request cannot be read: {error}'


def seconds(duration: Any) -> float:
    """Return a ``builtin_interfaces/Duration`` in s; ValueError if it is none."""
    if duration.nanosec >= 1_000_000_000:
        raise ValueError(f'duration.nanosec = {duration.nanosec}, not below 1e9')
    return duration.sec + duration.nanosec * 1e-9
