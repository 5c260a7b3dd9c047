"""Live view: shows the drones of the graph on a page in the browser."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
import math
import time

from diagnostic_msgs.msg import DiagnosticArray
from mambo_model import schema
from mambo_ros import node, process, topics
from mambo_ros.endpoints import Input
from mambo_ros.loop import Loop
from rclpy.serialization import deserialize_message

from .live import Mailbox, SHOWN
from .page import Page, PORT

_DRAW_EVERY, _REPORT_EVERY = 0.2, 0.5  # s
_LENGTH = 1500  # samples of the curves: a minute


@dataclass(frozen=True)
class ViewNodeParams:
    """Parameters of ``view_node``."""

    drones: str = schema.text('/mambo', 'namespaces of the drones, separated by commas')
    port: int = schema.quantity(PORT, '1', 1, 65535, 'design choice: TCP port of the page')
    rate: float = schema.quantity(
        50.0, 'Hz', 1.0, 60.0, 'design choice: frames of a page in a second')

    def __post_init__(self) -> None:
        schema.check(self)


def statuses(data: bytes) -> list[tuple[str, int, str]]:
    """Return (node, level, message) of each status in a message of ``/diagnostics``."""
    return [(one.name, one.level[0], one.message)
            for one in deserialize_message(data, DiagnosticArray).status]


class ViewNode(node.MamboNode[ViewNodeParams]):
    """
    Live view of one or several drones in the browser.

    Subscribes poses, references, motor commands and health of each drone with best effort, so
    that it never holds up who publishes, and publishes nothing.
    """

    subscribes = SHOWN
    example = '--ros-args -p port:=8081'

    def __init__(self, **kwargs) -> None:
        super().__init__('view_node', ViewNodeParams, **kwargs)
        names = [name.strip() for name in self.params.drones.split(',') if name.strip()]
        if not names or not all(name.startswith('/') for name in names):
            raise schema.ParameterError(
                f'ViewNodeParams.drones = {self.params.drones!r} must be namespaces such as '
                '/mambo1,/mambo2')
        self.page = Page(names, self.params.port, _LENGTH)
        self._boxes = [Mailbox(statuses) for _ in names]
        for name, box in zip(names, self._boxes, strict=True):
            for topic in SHOWN:
                full = replace(topic, name=topics.full_name(topic, name))
                self.inputs.append(
                    Input(full, full.name, partial(box.put, topic), False, reliable=False))
        self._drawn = self._reported = -math.inf
        self.get_logger().info(f'view: {self.page.address}')

    def frame(self, now: float) -> None:
        """Show what has come since the last frame; ``now`` is a wall time, s."""
        self._show()
        if now - self._drawn >= _DRAW_EVERY:
            self._drawn = now
            self.page.draw()
        if now - self._reported >= _REPORT_EVERY:
            self._reported = now
            self._report()

    def _show(self) -> None:
        """Move the drones, if there is anything new."""
        new = [box.read() for box in self._boxes]
        if any(new):
            for box, history in zip(self._boxes, self.page.histories, strict=True):
                if math.isfinite(box.state.t):
                    history.add(box.state)
            self.page.show([box.state for box in self._boxes])

    def _report(self) -> None:
        """Write the line of status."""
        times = [box.state.t for box in self._boxes if math.isfinite(box.state.t)]
        refused = sum(box.refused for box in self._boxes)
        self.page.report([box.state for box in self._boxes], (
            f't = {max(times):.1f} s' if times else 'waiting for a flight') + (
            f', {refused} messages could not be shown' if refused else ''))

    def finish(self) -> None:
        """End the page."""
        self.page.close()


def watch(node: ViewNode, loop: Loop) -> None:
    """Show a frame at the rate of the node until the loop is told to stop."""
    period = 1.0 / node.params.rate
    due = time.monotonic()
    while not loop.stopping:
        while loop.once(0.0) and not loop.stopping and time.monotonic() < due + period:
            pass
        node.frame(time.monotonic())
        due += period
        late = time.monotonic() - due
        time.sleep(max(-late, 0.0))
        due += max(late, 0.0)  # frames that were missed are not made up for


def main(args=None) -> None:
    """Entry point ``view_node``."""
    process.main(ViewNode, args, watch)
