"""The processes of one graph, from the first start to the last end."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
import tempfile

from .domain import Domain
from .keeper import Keeper
from .processes import end, Interrupts, NodeProcess, watch


class Crew:
    """
    Nodes in a ROS domain of their own, with a folder for what they read.

    ``with`` ends them whatever happens: those that own time first, the recorders last. Nothing is
    left of them, even where this process is killed.

    Parameters
    ----------
    recorder : str
        Name of the nodes that the others must have left before they end.
    owners : int
        How many nodes own time; they are started last.

    Attributes
    ----------
    folder : Path
        Removed at the end.
    children : list[NodeProcess]
        In the order of their start, those that own time last.
    domain : int
        ROS domain of the nodes.
    interrupts : Interrupts
        Signals of the user.
    fault : str
        What went wrong as a phrase that begins with the node, empty if nothing did.

    """

    def __init__(self, recorder: str, owners: int = 1) -> None:
        self._recorder, self._owners = recorder, owners
        self.children: list[NodeProcess] = []
        self.fault = ''

    def __enter__(self) -> Crew:
        with ExitStack() as stack:
            self.domain = stack.enter_context(Domain()).number
            self._keeper = Keeper()
            stack.callback(self._keeper.release)
            folder = stack.enter_context(tempfile.TemporaryDirectory(prefix='mambo_'))
            self._keeper.keep(folder)
            self.folder = Path(folder)
            self.interrupts = stack.enter_context(Interrupts())
            stack.callback(self._end)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def start(self, package: str, name: str, arguments: list[str],
              on_line: Callable[[str], None] | None = None, label: str = '') -> NodeProcess:
        """Start a node, as :class:`NodeProcess`; one that owns time after all others."""
        child = NodeProcess(package, name, arguments, on_line, label)
        self.children.append(child)
        self._keeper.keep(f'+{child.pid}')
        return child

    def watch(self) -> None:
        """Wait until the flight is over, a node fails or the user stops it."""
        self.fault = watch(self.children, self.interrupts, self._owners)

    def _end(self) -> None:
        """End all nodes."""
        last = self.children[-self._owners:] if len(self.children) >= self._owners else []
        recorders = [child for child in self.children if child.name == self._recorder]
        others = [child for child in self.children if child not in (*last, *recorders)]
        for child in self.children:
            child.resume()
        # those who own time are answered until they have left
        for group in (last, others, recorders):
            end(group, interrupts=self.interrupts)
        for child in self.children:
            self.fault = self.fault or child.trouble(owner=child in last)
