"""The graph of nodes in lockstep, and replays of its bag: wall time, CPU time, memory."""

from __future__ import annotations

from functools import cache
import os
from pathlib import Path
import re
import shutil
import subprocess
import sys
import threading
import time

from mambo_analysis import estimate, scenario
from mambo_analysis.bag import read_bag
from mambo_analysis.compare import compare
from mambo_bringup import flight, replay
from mambo_bringup.processes import FlightError
from mambo_ros import topics
import numpy as np

from .measure import Contender, Gap, timed

TICK = os.sysconf('SC_CLK_TCK')  # 1/s, of CPU time in /proc
NODE = re.compile(r'(\w+_node)$')
DELAY = re.compile(r'(?P<median>[\d.]+) ms.*?(?P<p99>[\d.]+) ms.*?(?P<most>[\d.]+) ms')


class Children:
    """CPU time and largest memory of the nodes that this process starts, while it is open."""

    def __init__(self) -> None:
        self.cpu: dict[str, float] = {}  # s
        self.memory: dict[str, float] = {}  # MB
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> Children:
        self._thread.start()
        return self

    def __exit__(self, *_) -> None:
        self._end.set()
        self._thread.join()

    def _watch(self) -> None:
        while not self._end.wait(0.05):
            for process in Path('/proc').glob('[0-9]*'):
                try:
                    self._look(process)
                except (OSError, IndexError):  # it has just ended
                    continue

    def _look(self, process: Path) -> None:
        fields = (process / 'stat').read_text().rpartition(')')[2].split()
        if int(fields[1]) != os.getpid():
            return
        words = (process / 'cmdline').read_text().split('\0')
        name = next((found[1] for word in words[:3] if (found := NODE.search(word))), None)
        if name is None:
            return
        self.cpu[name] = (int(fields[11]) + int(fields[12])) / TICK
        peak = re.search(r'VmHWM:\s+(\d+) kB', (process / 'status').read_text())
        if peak:
            self.memory[name] = int(peak[1]) / 1024.0


def _fly(
    bag: Path, seconds: float, composed: bool = False, mode: str = 'lockstep',
) -> tuple[flight.Outcome, Children, float]:
    """Fly the circle in the graph; return outcome, nodes, wall time in s from start to end."""
    shutil.rmtree(bag, ignore_errors=True)
    flown = scenario.scenario(duration=seconds, overrides={'sim_node.mode': mode})
    began = time.perf_counter()
    try:
        with Children() as nodes:
            outcome = flight.fly(flown, bag, composed)
    except FlightError as error:
        raise Gap(str(error)) from None
    return outcome, nodes, time.perf_counter() - began


def _measure(folder: Path, seconds: float, composed: bool, mode: str) -> dict[str, float]:
    """Fly one second and a whole flight: the difference is what a second costs, without start."""
    _, first, start = _fly(folder / 'first_second', 1.0, composed, mode)
    outcome, nodes, _ = _fly(folder / 'flight', seconds, composed, mode)
    lost = sum(entry['lost'] or 0 for entry in compare(read_bag(outcome.bag))['topics'])
    out = {'factor': outcome.real_time_factor, 'start': start,
           'missed': float(outcome.missed), 'lost': float(lost),
           'memory': max(nodes.memory.values()), 'memory_all': sum(nodes.memory.values())}
    for name in nodes.cpu:
        out[f'cpu {name}'] = (nodes.cpu[name] - first.cpu.get(name, 0.0)) / (seconds - 1.0)
        out[f'memory {name}'] = nodes.memory[name]
    out['cpu'] = sum(value for name, value in out.items() if name.startswith('cpu '))
    delays = DELAY.search(outcome.delay)
    if delays:
        out.update({f'delay {name}': float(found) for name, found in delays.groupdict().items()})
    return out


@cache
def _recorded(folder: Path, seconds: float) -> Path:
    """Return a bag of the graph, flown once."""
    return _fly(folder / 'recorded', seconds)[0].bag


def _offline(path: Path) -> dict[str, float]:
    """Read a bag, estimate again, compare; count estimates that are not the recorded ones."""
    bag, answer, _ = estimate.again(path)
    known, found = bag['estimate/odom'].table, estimate.messages(answer)[topics.ESTIMATE]
    return {'lost': float(len(known) - len(found)),
            'different': 0.0 if np.array_equal(known, found) else 1.0}


def _command(bag: Path, seconds: float) -> dict[str, float]:
    """Estimate a bag again in a process of its own."""
    began = time.perf_counter()
    done = subprocess.run([sys.executable, '-m', 'mambo_analysis.estimate', str(bag)],
                          text=True, capture_output=True)
    if done.returncode:
        raise Gap(done.stderr.strip())
    return {'factor': seconds / (time.perf_counter() - began)}


def _live(folder: Path, bag: Path, seconds: float) -> dict[str, float]:
    """Replay a bag through a live estimator; count recorded estimates that it does not repeat."""
    answer = folder / 'replayed'
    shutil.rmtree(answer, ignore_errors=True)
    began = time.perf_counter()
    try:
        replay.replay(bag, answer)
    except FlightError as error:
        raise Gap(str(error)) from None
    took = time.perf_counter() - began
    known, again = (read_bag(path)['estimate/odom'] for path in (bag, answer))
    same = len(known.raw) == len(again.raw) and np.array_equal(known.position, again.position)
    return {'factor': seconds / took, 'lost': float(len(known.raw) - len(again.raw)),
            'different': 0.0 if same else 1.0}


def contenders(quick: bool, folder: Path) -> list[Contender]:
    """Return the graph in its forms, and its bag replayed offline and live."""
    seconds = 10.0 if quick else 40.0

    def bag() -> Path:
        return _recorded(folder, seconds)

    def prepare_offline() -> None:
        _offline(bag())

    def prepare_live() -> None:
        bag()
    def graph(name: str, title: str, composed: bool, mode: str, factor: float,
              most: dict[str, float]) -> Contender:
        return Contender(
            'graph', name, title, lambda: _measure(folder, seconds, composed, mode),
            lambda: _warm(folder, composed), '', {'factor': factor}, {'lost': 0.0, **most})
    start = {'start': 2.0, 'memory': 250.0}
    return [
        graph('graph_separate', 'every node a process', False, 'lockstep', 5.0, start),
        graph('graph_composed', 'composed in one process', True, 'lockstep', 10.0, start),
        graph('graph_realtime', 'every node a process, real time', False, 'realtime', 0.99,
              {'cpu': 1.0, 'missed': 0.0}),
        Contender('replay', 'replay_offline', 'offline: bag read, estimated again, compared',
                  lambda: {**timed(seconds, lambda: estimate.again(bag())), **_offline(bag())},
                  prepare_offline, at_least={'factor': 500.0},
                  at_most={'lost': 0.0, 'different': 0.0}),
        Contender('replay', 'replay_command', 'the same as a command, start of Python to report',
                  lambda: _command(bag(), seconds), prepare_offline),
        Contender('replay', 'replay_live', 'live: start of three nodes to closed bag',
                  lambda: _live(folder, bag(), seconds), prepare_live,
                  at_most={'lost': 0.0, 'different': 0.0})]


def _warm(folder: Path, composed: bool) -> None:
    """Compile what the nodes need."""
    _fly(folder / 'first_second', 1.0, composed)
