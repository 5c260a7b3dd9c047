"""Convert changes of parameters between ``/diagnostics``, which records them, and data."""

from __future__ import annotations

from collections.abc import Mapping
import json
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from mambo_model.motion.parameter_change import Change
from mambo_model.schema import ParameterError

from .. import diagnostics, topics
from ..cdr import SECOND

_ENDING = ': parameters'


def encode(t: int, node: str, values: Mapping[str, Any]) -> bytes:
    """
    Serialise the status that records a change.

    Parameters
    ----------
    t : ns
        The control step from which it counts.
    node
        Name of the node without namespace.
    values
        By name within the node; in the status as JSON, whose numbers read back exactly.

    """
    texts = {name: json.dumps(values[name]) for name in sorted(values)}
    return diagnostics.report(
        t, f'{node}{_ENDING}', diagnostics.OK,
        'changed: ' + ', '.join(f'{name} = {text}' for name, text in texts.items()), texts)


def decode(data: bytes, namespace: str = topics.NAMESPACE) -> list[tuple[str, Change]]:
    """
    Return (node, change) of every change in a serialised ``DiagnosticArray``.

    Parameters
    ----------
    data
        The message.
    namespace
        Of the drone: changes of nodes in another one, named with it, are left out.

    Raises
    ------
    ParameterError
        For a value that is not JSON.

    """
    from rclpy.serialization import deserialize_message
    if _ENDING.encode() not in data:  # most messages are reports of health
        return []
    message = deserialize_message(bytes(data), DiagnosticArray)
    t = message.header.stamp.sec * SECOND + message.header.stamp.nanosec
    out = []
    for status in message.status:
        node, mark, rest = status.name.rpartition(_ENDING)
        space, _, node = node.rpartition('/')
        if mark and not rest and space in ('', namespace.strip('/')):
            try:
                values = {one.key: json.loads(one.value) for one in status.values}
            except ValueError:
                raise ParameterError(
                    f'/diagnostics at t = {t * 1e-9:g} s: a recorded parameter of {node} cannot '
                    'be read') from None
            out.append((node, Change(t, values)))
    return out
