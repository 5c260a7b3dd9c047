"""The node processes of one flight: start, supervise and end them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
import math
from pathlib import Path
import sys
import tempfile
import time

from .domain import Domain
from .processes import end, Interrupts, NodeProcess, refuse_not_utf8, watch
from .watchdog import Watchdog

BACK = 0.5  # s; a time server slews a clock by 0.3 s in ten minutes at most (500 ppm)


class NodeGroup:
    """
    Starts and ends the nodes of a flight, in a ROS domain and with a temporary folder of their
    own.

    Leaving ``with`` ends all nodes: those that own time first, the recorders last. No process or
    file remains, even if this process is killed. A line says so if the clock of the machine was
    set back meanwhile: the middleware's waits then last longer by as much.

    Parameters
    ----------
    recorder : str
        Name of the recorder nodes, which end after all others.
    owners : int
        Number of nodes that own time; they are started last.

    Attributes
    ----------
    folder : Path
        Temporary folder, removed at the end.
    children : list[NodeProcess]
        In the order of their start, those that own time last.
    domain : int
        ROS domain of the nodes.
    interrupts : Interrupts
        Signals received from the user.
    spectators_lost : list[str]
        How each spectator ended that did so before the flight.
    fault : str
        What went wrong, beginning with the name of the node; empty if nothing did.

    """

    def __init__(self, recorder: str, owners: int = 1) -> None:
        self._recorder, self._owners = recorder, owners
        self.children: list[NodeProcess] = []
        self._spectators: list[NodeProcess] = []
        self.spectators_lost: list[str] = []
        self.fault = ''
        self._ahead = _ahead()

    def __enter__(self) -> NodeGroup:
        with ExitStack() as stack:
            self.domain = stack.enter_context(Domain()).number
            self._watchdog = Watchdog()
            stack.callback(self._watchdog.release)
            refuse_not_utf8(Path(tempfile.gettempdir()), 'set TMPDIR to another folder')
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix='mambo_'))
            self._watchdog.keep(folder)
            self.folder = Path(folder)
            self.interrupts = stack.enter_context(Interrupts())
            stack.callback(self._end)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()
        back = self._ahead - _ahead()
        if back > BACK:
            print(f'warning: the clock of this machine was set back by {back:.1f} s while the '
                  'nodes ran: the middleware waits by it, and nodes that are processes of their '
                  'own may stand still, answer late or not end', file=sys.stderr, flush=True)

    def start(self, package: str, name: str, arguments: list[str],
              on_line: Callable[[str], None] | None = None, label: str = '',
              command: Sequence[str] = ()) -> NodeProcess:
        """Start a node, as :class:`NodeProcess`; one that owns time after all others."""
        child = NodeProcess(package, name, arguments, on_line, label, command)
        self.children.append(child)
        self._watchdog.keep(f'+{child.pid}')
        return child

    def start_spectator(self, package: str, name: str, arguments: list[str]) -> None:
        """Start a node without which the flight goes on, whatever happens to it."""
        child = NodeProcess(package, name, arguments)
        self._spectators.append(child)
        self._watchdog.keep(f'+{child.pid}')

    def watch(self, late: Callable[[float], str] = lambda _: '', limit: float = math.inf,
              hung: Callable[[], str] = str) -> None:
        """Wait until the flight is over, a node fails or the user stops it; see ``watch``."""
        self.fault = watch(self.children, self.interrupts, self._owners, late, limit, hung)

    def _end(self) -> None:
        """End all nodes."""
        last = self.children[-self._owners:] if len(self.children) >= self._owners else []
        recorders = [child for child in self.children if child.name == self._recorder]
        others = [child for child in self.children if child not in (*last, *recorders)]
        self.spectators_lost = [
            child.trouble() for child in self._spectators if child.exit_code is not None]
        for child in (*self.children, *self._spectators):
            child.resume()
        # nodes that own time get their answers until they have ended
        for group in (last, others, recorders, self._spectators):
            end(group, interrupts=self.interrupts)
        for child in self.children:
            self.fault = self.fault or child.trouble(owner=child in last)


def _ahead() -> float:
    """Return by how much the clock of the machine is ahead of one that nobody sets, s."""
    return time.time() - time.monotonic()
