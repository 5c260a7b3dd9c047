"""
What becomes of a flight in which a process stands still.

Compiled code of the user may never end. A process of one node is ended as every node is. Nodes
that are composed stand still together, the recorder among them: their process is killed once it
has been silent for longer than the simulator waits for an answer, and what the recorder had
written becomes a closed bag.

The middleware may come to a standstill in a process that starts: its flight never begins, and it
is killed too.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
import re
import signal
import tempfile
import time

from mambo_bags.recover import recover, Recovered
from mambo_bags.writer import NEVER, RECORDING
from mambo_flight.scenario import Scenario
from mambo_flight.supervised import own_compiled
from mambo_model.components import Component, own_components, where
from mambo_model.errors import MamboError

from .flight.nodes import COMPOSED
from .processes import NodeProcess

SLACK = 10.0  # s of silence beyond the simulator's patience
ASLEEP = 60.0  # s without a line: a simulator that waits for the others prints one every 5 s
AWAKE = 3.0  # s of CPU in these; a process that loads or compiles takes more on a busy machine
LARGEST = 200_000_000  # bytes of a bag that is closed in some 10 s, before the flight's last line


def stuck(flight: Scenario, killed: Iterable[str]) -> str:
    """
    Return which step of a user's component may never end, '' if it cannot be that.

    Parameters
    ----------
    flight
        What was flown.
    killed
        Names of the nodes that were ended by SIGKILL, as neither SIGINT nor SIGTERM ended them.

    """
    return '; '.join(
        f'{name} had to be killed: the compiled step of '
        f'{where(component.path, component.step)} may never end'
        for name in killed for component in _own(flight, name) if component.compiled)


def guests(flight: Scenario, ended: Iterable[str]) -> str:
    """
    Return which files of the user may have ended processes, '' if none ran in them.

    Parameters
    ----------
    flight
        What was flown.
    ended
        Names of the nodes whose processes ended without a reason.

    """
    return '; '.join(
        f'{component.path}, or code that it calls, may have ended {name}'
        for name in ended for component in _own(flight, name))


def _own(flight: Scenario, name: str) -> Iterable[Component]:
    """Return the components of the user that run in the process of a node."""
    params = flight if name == COMPOSED[1] else getattr(flight, name, None)
    return () if params is None else own_components(params)


class Silence:
    """
    Kills a process with a simulator that stands still for too long.

    Parameters
    ----------
    flight
        What it flies; in flight a process is watched if all nodes are composed in it, with
        compiled code of the user.
    child
        The process.

    """

    def __init__(self, flight: Scenario, child: NodeProcess) -> None:
        self._child, self._seen = child, -1
        self._limit = flight.sim_node.patience + SLACK
        self._watched = child.name == COMPOSED[1] and bool(own_compiled(flight))
        self._since, self._worked = time.monotonic(), 0.0

    def kill(self, begun: bool, ended: bool, count: int) -> str:
        """
        Kill the process if it has been silent; return why, '' if it has not.

        Parameters
        ----------
        begun, ended
            Whether the flight has.
        count
            Of the lines that it has printed: its simulator prints one every few seconds.

        """
        now = time.monotonic()
        if ended or count != self._seen:
            self._seen, self._since, self._worked = count, now, self._child.cpu()
        limit = self._limit if begun else ASLEEP
        if begun and not self._watched or now - self._since <= limit:
            return ''
        if not begun and (worked := self._child.cpu()) - self._worked > AWAKE:
            self._since, self._worked = now, worked
            return ''
        self._child.send(signal.SIGKILL)
        return f'{self._child.label} did nothing for {limit:g} s'


def is_closed(bag: Path) -> bool:
    """Return whether a recorder has closed its bag, whatever became of its process."""
    try:
        text = (bag / 'metadata.yaml').read_text()
    except OSError:
        return False
    return f"state: {RECORDING['state']}" not in text


def is_own(bag: Path, nodes: Iterable[NodeProcess]) -> bool:
    """
    Return whether one of some nodes made a bag.

    Another flight may have made it since the output was looked at. The recorder has refused to
    overwrite it then, or, if it came to nothing, ``metadata.yaml`` names another process.
    """
    nodes = list(nodes)
    if not bag.exists() or any(
            f'{bag} exists' in line and NEVER in line for node in nodes for line in node.lines):
        return False
    try:
        found = re.search(r"\bprocess: '(\d+)'", (bag / 'metadata.yaml').read_text())
    except OSError:
        return True
    return found is None or int(found[1]) in {node.pid for node in nodes}


def closed_again(bag: Path) -> Recovered | None:
    """Close the bag of a recorder that was killed; return what it holds, None if it stays open."""
    if sum(file.stat().st_size for file in bag.glob('*.mcap')) > LARGEST:
        return None
    with tempfile.TemporaryDirectory(dir=bag.parent, prefix=f'{bag.name}_') as folder:
        whole = Path(folder) / bag.name
        try:
            found = recover(bag, whole)
        except (MamboError, OSError):  # also of a full disk
            return None
        bag.rename(Path(folder) / 'unclosed')
        whole.rename(bag)
    return found
