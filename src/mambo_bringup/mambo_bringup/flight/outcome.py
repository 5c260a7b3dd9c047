"""Outcome of a flight, read from the lines that the nodes print."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
import os
from pathlib import Path
import re
import signal
import sys

from mambo_sim.parameters import STEP_NS
from tqdm import tqdm

from ..processes import FlightError, NodeProcess
from .nodes import RECORDER

_FLOWN = re.compile(
    r'flew ([\d.]+) s in ([\d.]+) s of wall time, (\d+) steps without their motor command'
    r'(?:, (\d+) waited for a late one)?')
_PAUSED = re.compile(r'paused before t = ')
_DELAY = re.compile(r'IMU sample to motor command: .*')
_USED = re.compile(r'used ([\d.]+) s of CPU and (\d+) MB')
_SOURCE = re.compile(r'\[([\w.]+)\.\w+\]: ')  # namespace and node
_REFUSED = re.compile(r'\[[\w.]*?(\w+)\]: refused messages: (.+)')
_DROPPED = re.compile(r'\d+ commands? of the scenario refused in flight, first .*')
_BEGUN = re.compile(r'flying in \w+ mode$')
_COLLIDED = re.compile(r'/\S+ and /\S+ collided at t = [\d.]+ s: [\d.]+ m apart')
_PACED = re.compile(r'flying in realtime mode$')
_WAITS = re.compile(r'waiting for .*')
_REMARK = re.compile(r'motor_pwm of t = .* are limited to .*')
_PACE = re.compile(
    r'fell [\d.]+ s behind the wall clock.*|did not run for [\d.]+ s in all.*')
_TIME = re.compile(r't = ([\d.]+) s$')
MANY = 0.05  # [-] of the steps without a motor command, from which the flight is another one
_QUIET = 10.0  # s without a word where no progress bar is seen; each further wait is twice as long


@dataclass
class Outcome:
    """Result of a flight."""

    bag: Path
    flown: float  # s of flight time
    took: float  # s of wall time from the first to the last step
    missed: int  # steps without a motor command in time
    delay: str  # wall time from IMU sample to motor command, one line
    stopped: signal.Signals | None  # signal by which the user ended the flight
    used: dict[str, tuple[float, int]]  # by node of its own: s of CPU, peak memory in MB
    refused: dict[str, str]  # by node: numbers of refused messages by topic and reason
    closed: bool  # the bag
    fault: str = ''  # why the flight ended early, one line
    recorded: bool = True  # whether the bag is of this flight
    whole: bool = False  # whether the full duration was flown
    collisions: list[str] = field(default_factory=list)  # in the hall, one line each
    remarks: list[str] = field(default_factory=list)  # of the simulator, one line each
    dropped: list[str] = field(default_factory=list)  # commands not carried out, one line
    late: int = 0  # steps that waited for a late motor command
    paused: bool = False  # for a while, which ``took`` leaves out
    hall_remarks: list[str] = field(default_factory=list)  # on all drones, one line each
    hall_used: dict[str, tuple[float, int]] = field(default_factory=dict)  # by nodes of all drones

    @property
    def real_time_factor(self) -> float | None:
        """Return flight time over wall time; None if the simulator could not say the latter."""
        return self.flown / self.took if self.took else None

    def overloaded(self) -> str:
        """Return what to do about many steps without a motor command in time, or ''."""
        share = self.missed * STEP_NS * 1e-9 / self.flown if self.flown else 0.0
        if share <= MANY:
            return ''
        said = f'warning: {min(share, 1.0):.0%} of the steps had no motor command in time'
        # a flight that failed has its reason: a lost stream is answered late, a killed node never
        return said if self.fault else (f'{said}: a node stood still, or the controller or the '
                                        'machine is too slow: then fly with a lower --speed, or '
                                        'in lockstep')

    def spent(self) -> str:
        """Return the CPU time and memory of the drone's own nodes as one line, largest first."""
        return self._spent(self.used)

    def hall_spent(self) -> str:
        """Return the CPU time and memory of the nodes that all drones share as one line."""
        return self._spent(self.hall_used)

    def _spent(self, used: Mapping[str, tuple[float, int]]) -> str:
        """Return the CPU time and memory of nodes as one line, the largest first."""
        # of CPU used in a pause, and at the start, the wall time of the flight knows nothing
        total = sum(seconds for seconds, _ in used.values())
        per, unit = (1.0, 's') if self.paused or total > self.took * len(
            os.sched_getaffinity(0)) else (self.took, 'cores')
        cpu = {name.removesuffix('_node'): seconds / per
               for name, (seconds, _) in used.items()}
        nodes = ', '.join(f'{name} {cpu[name]:.2f}' for name in sorted(cpu, key=cpu.get)[::-1])
        memory = max(memory for _, memory in used.values())
        return f'CPU: {sum(cpu.values()):.2f} {unit}: {nodes}; memory: {memory} MB at most'


class FlightEndedError(FlightError):
    """A flight failed after its start; ``outcomes`` describes what was flown until then."""

    def __init__(self, outcomes: list[Outcome]) -> None:
        super().__init__(outcomes[0].fault)
        self.outcomes = outcomes


@dataclass
class Commands:
    """How the motor commands of one drone came, as its simulator printed it."""

    missed: int = 0  # steps without one in time
    late: int = 0  # steps that waited for a late one
    delay: str = ''  # wall time from IMU sample to motor command, one line
    remarks: list[str] = field(default_factory=list)  # one line each


class Progress:
    """
    Progress bar of flight time, updated from the lines that the simulators print.

    Attributes
    ----------
    commands : dict
        :class:`Commands` by namespace.
    remarks : list of str
        On the pace of the flight, one line each; of a hall it is that of all drones.

    """

    def __init__(self, duration: float, shown: bool = True) -> None:
        self.flown, self.took = 0.0, 0.0
        self.commands: defaultdict[str, Commands] = defaultdict(Commands)
        self.begun = self.ended = self.paused = False
        self.lines = 0
        self.collisions: list[str] = []
        self.remarks: list[str] = []
        self._doing, self._said = 'starting (compiles once)', _QUIET
        self._bar = tqdm(
            total=duration, desc=self._doing, leave=False, disable=None if shown else True,
            bar_format='{desc} {bar} {n:.1f}/{total:.0f} s of flight, {elapsed} elapsed')

    def line(self, text: str) -> None:
        """Update from one line of a simulator."""
        self.lines += 1
        own = self.commands[source(text)]
        self.begun = self.begun or bool(_BEGUN.search(text))
        if found := _FLOWN.search(text):
            self.flown, self.took = float(found[1]), float(found[2])
            own.missed, own.late = int(found[3]), int(found[4] or 0)
            self.ended = True
        elif _PAUSED.search(text):
            self.paused = True
        elif found := _COLLIDED.search(text):
            self.collisions.append(found[0])
        elif found := _REMARK.search(text):
            own.remarks.append(found[0])
        elif found := _PACE.search(text):
            self.remarks.append(found[0])
        elif found := _DELAY.search(text):
            own.delay = found[0]
        elif found := _WAITS.search(text):
            self._doing = found[0]
            self._bar.set_description_str(found[0])
        elif found := _TIME.search(text):
            self.flown = float(found[1])
            self._bar.set_description_str('flying', refresh=False)
            self._bar.update(float(found[1]) - self._bar.n)

    def waits(self, seconds: float) -> bool:
        """Return whether time has not begun after some s; say so where no bar is seen."""
        if not self.begun and self._bar.disable and seconds >= self._said:
            self._said *= 2.0
            tqdm.write(f'{self._doing}: {seconds:.0f} s so far', file=sys.stderr)
        return not self.begun

    def close(self) -> None:
        """Remove the bar."""
        self._bar.close()


def listener(progress: Progress, children: list[NodeProcess]) -> Callable[[str], None]:
    """Return a callback for the simulator's lines: in real time it raises the nodes' priority."""
    def on_line(text: str) -> None:
        progress.line(text)
        for child in children if _PACED.search(text) else ():
            if child.name != RECORDER[1]:
                child.raise_priority()
    return on_line


def source(line: str) -> str:
    """Return the namespace of the node that logged a line; '' for any other line."""
    found = _SOURCE.search(line)
    return f"/{found[1].replace('.', '/')}" if found else ''


def used(nodes: list[NodeProcess]) -> dict[str, tuple[float, int]]:
    """Return the CPU time and memory that the nodes printed when they ended."""
    matches = {child.name: _USED.search('\n'.join(child.lines)) for child in nodes}
    return {name: (float(found[1]), int(found[2])) for name, found in matches.items() if found}


def _lines(nodes: Iterable[NodeProcess], namespace: str) -> list[str]:
    """Return the last lines of nodes, those of one drone if a namespace is given."""
    return [line for child in nodes for line in child.lines
            if not namespace or source(line) == namespace]


def refused(nodes: Iterable[NodeProcess], namespace: str = '') -> dict[str, str]:
    """Return the last line that each node logged about refused messages, by node."""
    lines = '\n'.join(_lines(nodes, namespace))
    return {found[1]: found[2] for found in _REFUSED.finditer(lines)}


def dropped(nodes: Iterable[NodeProcess], namespace: str = '') -> list[str]:
    """Return what the reference logged about commands of the scenario that were refused."""
    return [found[0] for line in _lines(nodes, namespace) if (found := _DROPPED.search(line))][-1:]


def print_refused(lines: dict[str, str]) -> None:
    """Print which messages each node refused, as of :func:`refused`."""
    for name, counts in lines.items():
        print(f'warning: {name} refused messages: {counts}')
