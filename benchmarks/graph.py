"""The graph of nodes in lockstep, and replays of its bag: wall time, CPU time, memory."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
import re
import shutil
import subprocess
import sys
import threading
import time

from mambo_analysis.compare import estimate
from mambo_analysis.compare.compare import compare
from mambo_bags.reader import read_bag
from mambo_bringup import replay
from mambo_bringup.processes import FlightError
from mambo_flight import closed_loop, recording_to_bag, scenario
from mambo_ros import topics
import numpy as np

from .measure import Contender, Gap, timed

TEN_MINUTES = 600.0  # s
JOINT = 40.0  # s, of the flight of the joint filter
FACTORS_SEPARATE, FACTORS_COMPOSED = {4: 2.0}, {16: 1.0}
"""Least flight time over wall time of several drones in one hall, by their number."""
PACE = {'lockstep': 'lockstep', 'realtime': 'real time'}
NODE = re.compile(r'(\w+) ([\d.]+)')
FLOWN = re.compile(
    r'flew (?P<flown>[\d.]+) s in (?P<took>[\d.]+) s of wall time, (?P<missed>\d+) steps '
    r'without their motor command(?:, (?P<late>\d+) waited)?')
DELAY = re.compile(r'p50 (?P<median>[\d.]+) ms, p99 (?P<p99>[\d.]+) ms, max (?P<most>[\d.]+) ms')
SPENT = re.compile(r'CPU: [\d.]+ cores: (?P<nodes>.*); memory: (?P<memory>\d+) MB')


class Memory:
    """Most memory of a process and its children together; shared memory counts once."""

    def __init__(self, pid: int) -> None:
        self.most = 0.0  # MB
        self._pid, self._end = pid, threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> Memory:
        self._thread.start()
        return self

    def __exit__(self, *_) -> None:
        self._end.set()
        self._thread.join()

    def _watch(self) -> None:
        own = Path(f'/proc/{self._pid}/task/{self._pid}/children')
        while not self._end.wait(0.2):
            try:
                processes = [str(self._pid), *own.read_text().split()]
                self.most = max(self.most, sum(map(_share, processes)))
            except OSError:  # one of them has just ended
                continue


def _share(pid: str) -> float:
    """Return the proportional share of a process in its memory in MB."""
    found = re.search(r'^Pss:\s+(\d+) kB', Path(f'/proc/{pid}/smaps_rollup').read_text(), re.M)
    return int(found[1]) / 1024.0


def _run(
    bag: Path, seconds: float, composed: bool = False, mode: str = 'lockstep', drones: int = 1,
) -> tuple[str, float, float]:
    """Fly the circle with ./run; return what it says, wall time in s and memory in MB."""
    shutil.rmtree(bag, ignore_errors=True)
    began = time.perf_counter()
    run = subprocess.Popen(
        [sys.executable, '-m', 'mambo_bringup.run', '--no-report', '--output', bag,
         '--duration', str(seconds), '--mode', mode, '--drones', str(drones),
         *(['--composed'] if composed else [])],
        text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    with Memory(run.pid) as memory:
        output, complaint = run.communicate()
    if run.returncode:
        raise Gap((complaint.strip().splitlines() or ['./run failed'])[-1])
    return output, time.perf_counter() - began, memory.most


def _measure(
    folder: Path, seconds: float, composed: bool, mode: str, drones: int = 1,
) -> dict[str, float]:
    """Fly one second and a whole flight."""
    start = _run(folder / 'first_second', 1.0, composed, mode, drones)[1]
    output, _, memory = _run(folder / 'flight', seconds, composed, mode, drones)
    flown, spent = list(FLOWN.finditer(output)), list(SPENT.finditer(output))
    took = max(float(one['took']) for one in flown)
    out = {'factor': float(flown[0]['flown']) / took, 'start': start,
           'missed': sum(float(one['missed']) for one in flown),
           'late': sum(float(one['late'] or 0) for one in flown),
           'lost': float(sum(map(_lost, (folder / 'flight').rglob('*.mcap')))),
           'memory': max(float(one['memory']) for one in spent), 'memory_all': memory}
    for one in spent:  # of each drone, and of what all share
        for name, cores in NODE.findall(one['nodes']):
            seconds_of_cpu = float(cores) / out['factor']
            out[f'cpu {name}'] = out.get(f'cpu {name}', 0.0) + seconds_of_cpu
    out['cpu'] = sum(value for name, value in out.items() if name.startswith('cpu '))
    if delays := max(DELAY.finditer(output), key=lambda one: float(one['median']), default=None):
        out.update({f'delay {name}': float(found) for name, found in delays.groupdict().items()})
    return out


def _lost(bag: Path) -> int:
    """Return how many messages a bag lacks."""
    return sum(entry['lost'] or 0 for entry in compare(read_bag(bag))['topics'])


@cache
def _recorded(folder: Path, seconds: float) -> Path:
    """Return a bag of the graph, flown once."""
    _run(folder / 'recorded', seconds)
    return folder / 'recorded'


def _offline(path: Path) -> dict[str, float]:
    """Read a bag, estimate again, compare; count estimates that are not the recorded ones."""
    bag, answer, _ = estimate.again(path)
    known, found = bag['estimate/odom'].table, estimate.messages(answer)[topics.ESTIMATE]
    return {'lost': float(len(known) - len(found)),
            'different': 0.0 if np.array_equal(known, found) else 1.0}


def _command(bag: Path, seconds: float) -> dict[str, float]:
    """Estimate a bag again in a process of its own."""
    began = time.perf_counter()
    done = subprocess.run([sys.executable, '-m', 'mambo_analysis.compare.estimate', str(bag)],
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


@cache
def _with_joint(folder: Path) -> Path:
    """Return a bag of the joint filter, flown once in one process."""
    flight, path = scenario.scenario(estimator='joint', duration=JOINT), folder / 'with_joint'
    shutil.rmtree(path, ignore_errors=True)
    recording_to_bag.write(path, flight, closed_loop.fly(flight, inner=True))
    return path


def contenders(quick: bool, folder: Path) -> list[Contender]:
    """Return the graph in its forms, and its bag replayed offline and live."""
    seconds = 10.0 if quick else 40.0

    def bag() -> Path:
        return _recorded(folder, seconds)

    def prepare_offline() -> None:
        _offline(bag())

    def offline(name: str, title: str, path: Callable[[], Path], flown: float) -> Contender:
        def prepare() -> None:
            _offline(path())
        return Contender(
            'replay', name, title,
            lambda: {**timed(flown, lambda: estimate.again(path())), **_offline(path())},
            prepare, at_least={'factor': 500.0}, at_most={'lost': 0.0, 'different': 0.0})

    def prepare_live() -> None:
        bag()

    def graph(name: str, title: str, composed: bool, mode: str = 'lockstep', drones: int = 1,
              least: float = 0.0, **most: float) -> Contender:
        return Contender(
            'graph', name, title, lambda: _measure(folder, seconds, composed, mode, drones),
            lambda: _warm(folder, composed), '', {'factor': least} if least else {},
            {'lost': 0.0, **most})

    def endurance(how: str, composed: bool, mode: str, least: float, **most: float) -> Contender:
        long = 30.0 if quick else TEN_MINUTES
        return Contender(
            'endurance', f'endurance_{mode}_{"composed" if composed else "separate"}',
            f'{long:.0f} s in {PACE[mode]}, {how}',
            lambda: _measure(folder, long, composed, mode), lambda: _warm(folder, composed), '',
            {'factor': least}, {'lost': 0.0, 'missed': 0.0, **most}, once=True)
    return [
        graph('graph_separate', 'every node a process', False, least=5.0, start=2.0,
              memory=250.0),
        graph('graph_composed', 'composed in one process', True, least=10.0, start=2.0,
              memory=250.0),
        *(graph(f'graph_separate_{drones}', f'{drones} drones, every node a process', False,
                drones=drones, least=FACTORS_SEPARATE.get(drones, 0.0)) for drones in (2, 4)),
        *(graph(f'graph_composed_{drones}', f'{drones} drones in one process', True,
                drones=drones, least=FACTORS_COMPOSED.get(drones, 0.0))
          for drones in (2, 4, 8, 16, 32)),
        *(endurance(*how, *mode, **most)
          for mode, most in ((('lockstep', 5.0), {}), (('realtime', 0.99), {'cpu': 1.0}))
          for how in (('every node a process', False), ('composed', True))),
        offline('replay_offline', 'offline: bag read, estimated again, compared', bag, seconds),
        offline('replay_offline_joint', 'the same, joint filter', lambda: _with_joint(folder),
                JOINT),
        Contender('replay', 'replay_command', 'the same as a command, start of Python to report',
                  lambda: _command(bag(), seconds), prepare_offline),
        Contender('replay', 'replay_live', 'live: start of three nodes to closed bag',
                  lambda: _live(folder, bag(), seconds), prepare_live,
                  at_most={'lost': 0.0, 'different': 0.0})]


def _warm(folder: Path, composed: bool) -> None:
    """Compile what the nodes need."""
    _run(folder / 'first_second', 1.0, composed)
