"""
Have the middleware drop what a flooding process sends, before it reaches any queue.

All publishers of a topic share the queue of its reader, so one that floods it displaces messages
of the others, however quickly the node refuses what it takes. The DDS standard has a remedy, to
ignore a participant, that ``rmw`` does not offer. So it is asked of Fast DDS itself, by
``rmw_fastrtps_cpp/get_participant.hpp`` and ``fastdds/dds/domain/DomainParticipant.hpp`` of ROS 2
Jazzy. It cannot be taken back. With another middleware floods are refused message by message.
"""

from __future__ import annotations

from collections.abc import Sequence
import ctypes

from rclpy.node import Node
from rclpy.utilities import get_rmw_implementation_identifier

from . import peers, publisher_guard
from .. import node

_PREFIX = 12  # bytes of a GID that its whole participant shares
_PARTICIPANT = b'\x00\x00\x01\xc1'  # entity of a participant itself, DDSI-RTPS 9.3.1.2
_GET = '_ZN16rmw_fastrtps_cpp22get_domain_participantEP10rmw_node_s'
_IGNORE = ('_ZN8eprosima7fastdds3dds17DomainParticipant18ignore_participantERKNS_8fastrtps4rtps16'
           'InstanceHandle_tE')


def ignore_participant(owner: Node, gid: bytes) -> bool:
    """
    Ignore the participant that a publisher belongs to, in all nodes of this process, for good.

    Parameters
    ----------
    owner
        Any node of this process.
    gid
        Of the publisher, (16,).

    Returns
    -------
    ignored : bool
        False where the middleware offers no way.

    """
    try:
        rmw, rcl = ctypes.PyDLL('librmw_fastrtps_cpp.so'), ctypes.PyDLL('librcl.so')
        get, ignore = getattr(rmw, _GET), getattr(rmw, _IGNORE)  # of a library it depends on
        handle_of = rcl.rcl_node_get_rmw_handle
    except (OSError, AttributeError):
        return False
    get.restype = handle_of.restype = ctypes.c_void_p
    get.argtypes = handle_of.argtypes = [ctypes.c_void_p]
    ignore.restype, ignore.argtypes = ctypes.c_uint32, [ctypes.c_void_p, ctypes.c_char_p]
    if get_rmw_implementation_identifier() != 'rmw_fastrtps_cpp':
        return False
    with owner.handle:
        participant = get(handle_of(owner.handle.pointer))
    defined = b'\x01'  # that the handle has a value
    return bool(participant) and not ignore(
        participant, gid[:_PREFIX] + _PARTICIPANT + defined)


class Floods:
    """
    Ends floods of the inputs of some nodes of one process.

    Parameters
    ----------
    nodes
        All nodes of the process that have inputs.

    """

    def __init__(self, nodes: Sequence[node.MamboNode]) -> None:
        self._nodes = nodes
        self._done: set[bytes] = set()  # participants

    def ignore(self, guard: publisher_guard.PublisherGuard, publisher: bytes) -> None:
        """
        Ignore the process of a flooding publisher, unless another input accepts it.

        Parameters
        ----------
        guard
            Of the flooded input.
        publisher
            GID, (16,).

        """
        participant = publisher[:_PREFIX]
        accepted = {each.first[:_PREFIX] for node in self._nodes for each in node.input_guards}
        if participant in self._done or participant in accepted:
            return
        self._done.add(participant)
        owner = self._nodes[0]
        name = next((peers.who(info) for info in owner.get_publishers_info_by_topic(guard.topic)
                     if bytes(info.endpoint_gid) == publisher), 'a publisher')
        if ignore_participant(owner, publisher):
            owner.get_logger().warning(
                f'{name} floods {guard.topic}, which has another publisher: everything from its '
                'process is ignored until the end')
