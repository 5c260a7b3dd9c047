"""Send a command to a running flight and wait for its answer: from a terminal, script or page."""

from __future__ import annotations

import time
from typing import Any

from mambo_model.errors import InputError, JobError
import rclpy
from rclpy.exceptions import InvalidNamespaceException
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future
from rclpy.validate_namespace import validate_namespace

from ..graph import domains, loopback
from ..topics import NAMESPACE
from .command_request import answer, prepare

FIND = 8.0  # s of wall time, to find the service
ANSWER = 10.0  # s of wall time, for its answer
MOST = 32  # drones that a message lists


class Call:
    """
    A command on its way to a flight, in a node that somebody else serves.

    :meth:`poll` is called again and again, and never waits.

    Parameters
    ----------
    node
        That sends it.
    name, namespace, arguments
        As of :func:`send`.

    Raises
    ------
    InputError
        As :func:`send`.

    """

    def __init__(self, node: Node, name: str, namespace: str = NAMESPACE,
                 **arguments: Any) -> None:
        self._service, self._request = prepare(name, arguments)
        self._node, self._name, self._namespace = node, name, namespace
        self._client = node.create_client(
            self._service.srv_type, f'{namespace.rstrip("/")}/{self._service.name}')
        self._future: Future | None = None
        self._limit = time.monotonic() + FIND

    @property
    def sent(self) -> bool:
        """Return whether the flight may have got it."""
        return self._future is not None

    def poll(self, now: float) -> str | None:
        """
        Return what the flight answered; None: nothing yet.

        Parameters
        ----------
        now
            Of ``time.monotonic``, s.

        Raises
        ------
        JobError
            If no flight answers, or it refuses the command; the message is the reason.

        """
        if self._future is None:
            if self._client.service_is_ready():
                self._future = self._client.call_async(self._request)
                self._limit = now + ANSWER
            elif now > self._limit:
                raise JobError(self._missing())
            return None
        if self._future.done():
            return answer(self._name, self._future.result())
        if now > self._limit:
            raise JobError(f'{self._service.name}: no answer within {ANSWER:g} s')
        return None

    def close(self) -> None:
        """Forget it; an answer that is still to come is dropped."""
        self._node.destroy_client(self._client)

    def _missing(self) -> str:
        """Return why there is no such service."""
        domain = self._node.context.get_domain_id()
        nodes = self._node.get_node_names_and_namespaces()
        flying = [name for name, space in nodes
                  if space == self._namespace and name != self._node.get_name()]
        others = sorted({space for name, space in nodes if name == 'reference_node'})
        if not flying and others:
            return (f'no flight of {self._namespace} runs in ROS domain {domain}, but of '
                    f'{", ".join(others[:MOST])}: choose one with --drone')
        if not flying:
            return (f'no flight of {self._namespace} runs in ROS domain {domain}: start one '
                    'with ./run --commanded')
        own, _, parameters = self._service.name.partition('/')
        return f'the flight of {self._namespace} in ROS domain {domain} has no ' + (
            f'{own}; it has {", ".join(sorted(flying))}' if parameters else
            f'{own}: it takes commands if it is started with ./run --commanded')


def check_namespace(namespace: str) -> None:
    """
    Refuse a namespace that no drone can have.

    Raises
    ------
    InputError
        Says why no drone can have it.

    """
    try:
        if not namespace.strip('/') or not namespace.isprintable():
            raise TypeError
        validate_namespace(f'/{namespace.removeprefix("/")}')
    except InvalidNamespaceException as error:
        reason = str(error).splitlines()[0].removeprefix('Invalid namespace: ').rstrip(':')
        raise InputError(f'drone {namespace[:80]!r}: {reason}') from None
    except (AttributeError, TypeError):
        raise InputError(
            f'drone {str(namespace)[:80]!r}: it must be a namespace such as {NAMESPACE}') from None


def send(name: str, namespace: str = NAMESPACE, **arguments: Any) -> str:
    """
    Send a command to the flight that runs on this machine, or in ``ROS_DOMAIN_ID``.

    Parameters
    ----------
    name
        One of ``command_request.COMMANDS``, or ``set``.
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
        For a command, argument or namespace that cannot be, or a choice of flights.
    JobError
        If no flight answers, or it refuses the command; the message is the reason.

    """
    prepare(name, arguments)  # what cannot be sent is refused before anything is started
    check_namespace(namespace)
    domain = domains.chosen()
    loopback.check()
    loopback.configure()
    context = rclpy.Context()
    rclpy.init(args=[], context=context, domain_id=domain,
               signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = Node('mambo_command', context=context, namespace=namespace,
                    enable_rosout=False, start_parameter_services=False)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        call = Call(node, name, node.get_namespace(), **arguments)
        while (message := call.poll(time.monotonic())) is None:
            executor.spin_once(0.02)
        executor.shutdown()
        return message
    finally:
        rclpy.try_shutdown(context=context)
