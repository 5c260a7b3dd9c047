"""Live view: shows the drones of the graph on a page in the browser, and sends its commands."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
import math
from pathlib import Path
import time

from diagnostic_msgs.msg import DiagnosticArray
from mambo_model import schema
from mambo_ros import node, process, topics
from mambo_ros.commands import client, table
from mambo_ros.commands.command_request import parameters_of, setting
from mambo_ros.endpoints import Input
from mambo_ros.loop import Loop
from rclpy.serialization import deserialize_message

from .dispatcher import Dispatcher, FOLDERS
from .live import Mailbox, SHOWN
from .page import Page, PORT

_DRAW_EVERY, _REPORT_EVERY, _LOOK_EVERY = 0.2, 0.5, 1.0  # s
_LENGTH = 1500  # samples of the curves: a minute


@dataclass(frozen=True)
class ViewNodeParams:
    """Parameters of ``view_node``."""

    drones: str = schema.text('/mambo', 'namespaces of the drones, separated by commas')
    port: int = schema.quantity(PORT, '1', 1, 65535, 'design choice: TCP port of the page')
    rate: float = schema.quantity(
        50.0, 'Hz', 1.0, 60.0, 'design choice: frames of a page in a second')
    commands: bool = schema.flag(True, 'whether the page has buttons that command the drones')
    trajectories: str = schema.text(
        FOLDERS, 'folders whose trajectories can be followed, separated by commas')

    def __post_init__(self) -> None:
        schema.check(self)
        names = self.names
        if not names or not all(name.startswith('/') for name in names):
            raise schema.ParameterError(
                f'drones = {schema.shown(self.drones)} must be namespaces such as /mambo1,/mambo2')
        if len(set(names)) < len(names):
            raise schema.ParameterError(
                f'drones = {schema.shown(self.drones)} names a drone twice')
        for name in names:
            client.check_namespace(name)
        for folder in self.folders:
            if self.trajectories != FOLDERS and not folder.is_dir():
                raise schema.ParameterError(
                    f'trajectories: {schema.shown(str(folder))} is no folder')

    @property
    def names(self) -> list[str]:
        """Return the namespaces of the drones."""
        return [name.strip() for name in self.drones.split(',') if name.strip()]

    @property
    def folders(self) -> list[Path]:
        """Return the folders of trajectories."""
        return [Path(one.strip()) for one in self.trajectories.split(',') if one.strip()]


def statuses(data: bytes) -> list[tuple[str, int, str]]:
    """Return (node, level, message) of each status in a message of ``/diagnostics``."""
    return [(one.name, one.level[0], one.message)
            for one in deserialize_message(data, DiagnosticArray).status]


def read_course(path: Path) -> str:
    """Return the text of a trajectory for ``follow``, as ``mambo follow`` sends it."""
    from mambo_flight.commanded import course_text  # 1 s of CPU, for this command alone
    return course_text(path)


class ViewNode(node.MamboNode[ViewNodeParams]):
    """
    Live view of one or several drones in the browser.

    Subscribes poses, references, motor commands and health of each drone with best effort, so
    that it never holds up who publishes, and publishes nothing. Its page calls the services of a
    commanded flight.
    """

    subscribes = SHOWN
    calls = (*table.REFERENCE, table.PAUSE, table.STEP, *map(
        parameters_of, ('controller_node', 'estimator_node', 'sim_node')))
    example = '--ros-args -p port:=8081'

    def __init__(self, **kwargs) -> None:
        super().__init__('view_node', ViewNodeParams, **kwargs)
        names = self.params.names
        self.page = Page(names, self.params.port, _LENGTH, self.params.commands)
        self._dispatcher = Dispatcher(
            self.page.controls, names, partial(client.Call, self), read_course, setting,
            self.params.folders) if self.page.controls else None
        self._boxes = [Mailbox(statuses) for _ in names]
        for name, box in zip(names, self._boxes, strict=True):
            for topic in SHOWN:
                full = replace(topic, name=topics.full_name(topic, name))
                self.inputs.append(
                    Input(full, full.name, partial(box.put, topic), False, reliable=False))
        self._drawn = self._reported = self._looked = -math.inf
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
        if self._dispatcher:
            if now - self._looked >= _LOOK_EVERY:
                self._looked = now
                self._dispatcher.offer(self._has)
            self._dispatcher.step(now)

    def _has(self, drone: str, service: str) -> bool:
        """Return whether a drone answers a command."""
        return self.count_services(f'{drone}/{service}') > 0

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
            f', {refused} messages could not be shown' if refused else ''), time.monotonic())

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
