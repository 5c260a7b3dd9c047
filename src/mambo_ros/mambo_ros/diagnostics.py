"""Health reports on ``/diagnostics``, stamped with flight time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from . import topics
from .cdr import serialize

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
LEVELS = (OK, WARN, ERROR)
REFUSED = 'refused messages:'
"""Start of the log line that counts refused messages."""
_REPORT_EVERY = 1.0  # s between reports of refused messages


def report(t: int, name: str, level: bytes, message: str, values: Mapping[str, object]) -> bytes:
    """
    Serialise one status.

    Parameters
    ----------
    t : ns
        Time of the flight.
    name : str
        Node name.
    level : bytes
        ``OK``, ``WARN`` or ``ERROR``.
    message : str
        One line for a human reader.
    values
        Values that belong to the message.

    """
    array = DiagnosticArray(status=[DiagnosticStatus(
        level=level, name=name, message=message,
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()])])
    array.header.stamp.sec, array.header.stamp.nanosec = divmod(t, 1_000_000_000)
    return serialize(array)


def refusals_line(counts: Mapping[str, int]) -> str:
    """Return one line with the number of refused messages by topic and reason."""
    return f'{REFUSED} ' + ', '.join(f'{count} {what}' for what, count in counts.items())


class Faulty:
    """
    A node that continues after a fault and then ends with exit code 1.

    Attributes
    ----------
    fault : str
        The first fault in one line; empty if there was none.

    """

    fault = ''

    def fail(self, what: str) -> None:
        """Log a fault and keep the first one; ignore an empty text."""
        if what and not self.fault:
            self.fault = what
            self.get_logger().error(what)  # type: ignore[attr-defined]  # of the node


class Refusals:
    """
    Reports of the messages that a node has refused.

    Parameters
    ----------
    owner : mambo_ros.node.MamboNode
        The node.

    """

    def __init__(self, owner: Any) -> None:
        self._owner = owner
        self._reported: dict[str, int] = {}  # by topic and reason
        self._next = 0.0  # s of wall time

    def report(self, now: float) -> None:
        """Warn of messages refused since the last report, once a second; s of wall time."""
        counts = self._owner.refused() if now >= self._next else self._reported
        if counts == self._reported:
            return
        self._reported, self._next = counts, now + _REPORT_EVERY
        line = refusals_line(counts)
        self._owner.get_logger().warning(line)
        stamp = max([0, *(guard.last for guard in self._owner.input_guards)])
        self._owner.advertise(topics.DIAGNOSTICS)(report(
            stamp, f'{self._owner.get_name()}: inputs', WARN, line, counts))
