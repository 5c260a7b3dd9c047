"""What a node says when a part of it has failed for good."""

from __future__ import annotations


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
