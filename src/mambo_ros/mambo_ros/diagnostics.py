"""Health reports on ``/diagnostics``, stamped with flight time."""

from __future__ import annotations

from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from .cdr import serialize

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
LEVELS = (OK, WARN, ERROR)
REFUSED = 'refused messages:'
"""Start of the log line that counts refused messages."""


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
