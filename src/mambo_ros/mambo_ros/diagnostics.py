"""Health reports on ``/diagnostics``, stamped with flight time."""

from __future__ import annotations

from collections.abc import Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from .cdr import serialize

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
LEVELS = (OK, WARN, ERROR)
REFUSED = 'refused messages:'
"""Begin of the line that says how many."""


def report(t: int, name: str, level: bytes, message: str, values: Mapping[str, object]) -> bytes:
    """
    Serialise one status.

    Parameters
    ----------
    t : ns
        Flight time.
    name : str
        Node name.
    level : bytes
        ``OK``, ``WARN`` or ``ERROR``.
    message : str
        One line for a person.
    values
        Numbers behind it.

    """
    array = DiagnosticArray(status=[DiagnosticStatus(
        level=level, name=name, message=message,
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()])])
    array.header.stamp.sec, array.header.stamp.nanosec = divmod(t, 1_000_000_000)
    return serialize(array)


def refusals_line(counts: Mapping[str, int]) -> str:
    """Return as one line how many messages were refused, by topic and reason."""
    return f'{REFUSED} ' + ', '.join(f'{count} {what}' for what, count in counts.items())


class Faulty:
    """
    A node that goes on with a fault, and ends with a code that tells of it.

    Attributes
    ----------
    fault : str
        The first one, one line; empty: none.

    """

    fault = ''

    def fail(self, what: str) -> None:
        """Keep and log a fault; the first one counts, an empty text is none."""
        if what and not self.fault:
            self.fault = what
            self.get_logger().error(what)  # type: ignore[attr-defined]  # of the node
