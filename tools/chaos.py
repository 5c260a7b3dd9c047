"""
Injects faults into flights and checks that each ends as it should.

``./chaos processes`` sends a signal to one process of a flight or of a replay: any signal, any
process, in any mode, at any time. A fault is survived if everything is over within 15 s behind
one line and a non-zero exit code, the bag is closed or can be recovered, and no process, no
temporary folder and no shared memory is left.

``./chaos files`` damages files of every format, and writes command lines, by their structure. An
input is survived if the command ends with exit code 0, or with 1 or 2 behind one line, within
limits of time, memory and output, and leaves nothing half-written.

``./chaos messages`` flies while a hostile process publishes on the topics of the flight: wrong
values, stamps and bytes, floods, other types, a second clock, requests. An attack is survived if
the flight ends within bounds of time, memory and output, says what it refused, leaves nothing, and
the vehicle stays where it should: to the bit, in lockstep.

``./chaos resources`` runs commands on a machine that has too little of something: disk, memory,
open files, permissions, network, compiled code. A scarcity is survived if the command ends with
exit code 0 and has made everything, or with 1 or 2 behind one line that says what it lacked, and
leaves nothing half-written.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from itertools import product
import os
from pathlib import Path
import random
import signal
import subprocess
import sys
import tempfile
import time
from typing import Any, NamedTuple

from mambo_bags.cli.option_types import whole
from mambo_bags.reader import read_bag
from mambo_bringup.flight.nodes import FLIGHT_NODES, HALL_CAPTURE, RECORDER, SIMULATOR
from mambo_bringup.replay import ESTIMATOR, PLAYER
from mambo_bringup.stuck import is_closed
from mambo_ros import topics

sys.path.append(str(Path(__file__).parent))  # also where Python is told to leave it out

from chaos_files import living

ROOT = Path(__file__).resolve().parents[1]
WITHIN = 15.0  # s from the signal to the end of all
BUSY = 240.0  # s that a loaded machine may take to come to the phase
SIGNALS = ('SIGINT', 'SIGTERM', 'SIGHUP', 'SIGKILL', 'SIGSTOP')
NODES = tuple(name for _, name in (RECORDER, *FLIGHT_NODES, SIMULATOR))
REPLAYED = tuple(name for _, name in (RECORDER, ESTIMATOR, PLAYER))
MODES = {'processes': ['--processes'], 'composed': ['--composed'],
         'realtime': ['--mode', 'realtime'], 'drones': ['--drones', '4', '--processes']}
OWNERS = ('sim_node', 'composed_node', 'replay_node')
_PLAN = '--set=reference_node.plan.'
PHASES = {
    'start': ['--duration=200'],
    'calibration': ['--duration=200', f'{_PLAN}takeoff_time=190', f'{_PLAN}start_time=195'],
    'flight': ['--duration=200'],
    'landing': ['--duration=200', f'{_PLAN}start_time=4', f'{_PLAN}blend_duration=0.5',
                f'{_PLAN}landing_time=5'],
    'closing': ['--duration=4'],
    'report': ['--duration=4']}
"""Options of the flight that is struck in each phase; most phases are made to last."""
_BEGUN = 250_000  # bytes of a bag with more in it than schemas and scenario
_LANDS = 1_150_000  # bytes of a bag after the landing has begun


class Fault(NamedTuple):
    """A signal to one process of a flight or replay."""

    signal: str
    target: str  # name of a node, 'runner' or 'watchdog'
    mode: str    # of MODES, or 'replay'
    phase: str   # of PHASES


class Verdict(NamedTuple):
    """How a fault went."""

    lost: str    # what was wrong, empty: survived
    took: float  # s from the signal to the end of all
    line: str    # that the runner ended with
    missed: bool = False  # whether the flight was over before the signal


def every() -> Iterator[Fault]:
    """Yield every fault there is."""
    for number, mode, phase in product(SIGNALS, (*MODES, 'replay'), PHASES):
        if mode == 'replay' and phase in ('calibration', 'landing'):
            continue
        nodes = {'composed': ('composed_node',), 'replay': REPLAYED,
                 'drones': (RECORDER[1], HALL_CAPTURE[1], *NODES[2:-1], 'composed_node')
                 }.get(mode, NODES)
        for target in ('runner', 'watchdog', *nodes):
            if phase == 'report' and target != 'runner':
                continue  # nothing else runs
            if phase == 'closing' and target in OWNERS:
                continue  # it has left
            if target == 'watchdog' and phase not in ('start', 'closing'):
                continue  # the flight goes on without: one that is long would be waited for
            if (number, phase) == ('SIGSTOP', 'report'):
                continue  # the watchdog that would end it has left
            yield Fault(number, target, mode, phase)


class Struck:
    """
    A flight or replay that a fault is injected into.

    Parameters
    ----------
    fault
        What to inject.
    folder
        Empty folder for the bag and the temporary files.
    recording
        Bag that a replay plays.
    delay : s
        From the first sight of the phase to the signal.

    """

    def __init__(self, fault: Fault, folder: Path, recording: Path, delay: float = 0.0) -> None:
        self.fault, self.bag, self._delay = fault, folder / 'bag', delay
        self._recording = recording
        self._temporary = folder / 'tmp'
        self._temporary.mkdir()
        self._older = set(living.SHARED.iterdir())
        self._tool = 'replay' if fault.mode == 'replay' else 'run'
        if self._tool == 'replay':
            command = ['mambo', 'replay', str(recording), '--output', str(self.bag)]
            if fault.phase not in ('closing', 'report'):
                command += ['--rate', '1']
        else:
            command = ['run', '--no-landing', '--output', str(self.bag), *MODES[fault.mode],
                       *PHASES[fault.phase]]
            if fault.phase == 'landing':
                command.remove('--no-landing')
            if fault.target == 'watchdog':
                command.append('--duration=4')
            if fault.phase != 'report':
                command.append('--no-report')
        self.run = subprocess.Popen(
            [sys.executable, '-m', 'mambo_bringup.starting', *command],
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
            env={**os.environ, 'TMPDIR': str(self._temporary)})

    def _living(self) -> dict[int, str]:
        """Return the processes of the flight but its runner."""
        found = living.processes(str(self._temporary))
        found.pop(self.run.pid, None)
        return found

    def _reached(self) -> bool:
        """Return whether the flight has come to the phase, and the target is there."""
        phase, there = self.fault.phase, set(self._living().values())
        if phase == 'start':
            return self.fault.target in ({*there, 'runner'} if there else there)
        bags = 4 if self.fault.mode == 'drones' else 1
        files = list(self.bag.rglob('*.mcap'))
        size = _LANDS if phase == 'landing' else _BEGUN
        if len(files) < bags or any(file.stat().st_size < size for file in files):
            return False
        if phase in ('closing', 'report'):
            return not there & {*OWNERS, *(NODES if phase == 'report' else ())}
        return bool(there)

    def strike(self) -> Verdict:
        """Send the signal at the time; see how everything ends."""
        fault = self.fault
        try:
            if not living.wait(lambda: self._reached() or self.run.poll() is not None, BUSY):
                self.run.terminate()
                return self._missed()
            time.sleep(self._delay)
            running = self._living()
            running[self.run.pid] = 'runner'
            struck = [pid for pid, name in running.items() if name == fault.target]
            if self.run.poll() is not None or not struck:
                return self._missed()
            memory = living.shared(running) - self._older
            try:
                os.kill(struck[0], getattr(signal, fault.signal))
            except ProcessLookupError:  # it has just ended by itself
                return self._missed()
            began = time.monotonic()
            out, err = self.run.communicate(timeout=BUSY)
            left = not living.wait(lambda: not self._living(), WITHIN)
            took = time.monotonic() - began
        except subprocess.TimeoutExpired:
            return Verdict(f'hung: {self._living()}', BUSY, '')
        finally:
            self.run.kill()
        lines = err.strip().splitlines()
        wrong = f'left running: {self._living()}' if left else (
            self._wrong_words(out, err) or self._wrong_files() or living.shared_left(memory))
        if not wrong and took >= WITHIN and fault.target != 'watchdog':
            wrong = 'took too long'
        return Verdict(wrong, took, lines[-1] if lines else '')

    def _missed(self) -> Verdict:
        """Return the verdict on a flight that was over before, which may not have failed."""
        try:
            _, err = self.run.communicate(timeout=BUSY)
        except subprocess.TimeoutExpired:
            return Verdict(f'hung without a signal: {self._living()}', BUSY, '')
        code = self.run.returncode
        if code == 128 + signal.SIGTERM:  # ours, as it did not come to the phase
            return Verdict('', 0.0, '', True)
        return Verdict(f'failed without a signal: {err}' if code else '', 0.0, '', not code)

    def _wrong_words(self, out: str, err: str) -> str:
        """Return what is wrong with the exit code and the line of the runner."""
        fault, code = self.fault, self.run.returncode
        if 'Traceback' in out + err:
            return f'traceback: {err}'
        if (fault.signal, fault.target) == ('SIGKILL', 'runner'):
            return '' if code == -signal.SIGKILL else f'exit code {code}'
        late = fault.phase in ('closing', 'report') and fault.target != 'runner'
        if code == 0 and (late or fault.target == 'watchdog' or self._replayed_whole()):
            return ''  # nothing is missing
        lines = [line for line in err.splitlines() if f'{self._tool}: ' in line]
        if code <= 0 or len(lines) != 1 or err.splitlines()[-1] != lines[0]:
            return f'exit code {code}, stderr: {err!r}, stdout: {out!r}'
        return ''

    def _replayed_whole(self) -> bool:
        """Return whether this is a replay that has recorded every estimate; a node may drain."""
        if self._tool != 'replay' or not is_closed(self.bag):
            return False
        name = f'{topics.NAMESPACE}/{topics.ESTIMATE.name}'
        return len(read_bag(self.bag)[name].t) == len(read_bag(self._recording)[name].t)

    def _wrong_files(self) -> str:
        """Return what is wrong with the bags and the temporary folder."""
        left = living.folder_left(self._temporary, WITHIN)
        return left or ('' if self.fault.phase == 'start' else
                        living.unreadable(self.bag, self._temporary))


def try_fault(fault: Fault, recording: Path, delay: float = 0.0,
              folder: Path | None = None) -> Verdict:
    """Inject a fault; return how it went. Parameters as of Struck."""
    with tempfile.TemporaryDirectory(prefix='chaos_', dir=folder) as place:
        return Struck(fault, Path(place), recording, delay).strike()


def processes(count: int, seed: int, recording: Path, start: int = 0, jobs: int = 1) -> int:
    """Inject process faults, chosen by ``seed``; print each; return the exit code."""
    if signal.getsignal(signal.SIGHUP) == signal.SIG_IGN:  # of nohup, which flights would inherit
        signal.signal(signal.SIGHUP, lambda *_: None)
    chance = random.Random(seed)
    chosen = [(fault, chance.choice((0.0, chance.uniform(0.0, 2.0))))
              for fault in chance.choices(sorted(every()), k=start + count)][start:]
    words: Counter[str] = Counter()
    slowest = 0.0
    with tempfile.TemporaryDirectory() as folder:  # compile before the first one
        subprocess.run([sys.executable, '-m', 'mambo_bringup.starting', 'run', '--duration=1',
                        '--no-report', f'--output={folder}/bag'], check=True, capture_output=True)
    with ThreadPoolExecutor(jobs) as pool:
        faults, delays = zip(*chosen, strict=True)
        verdicts = pool.map(try_fault, faults, [recording] * count, delays)
        for number, ((fault, delay), verdict) in enumerate(
                zip(chosen, verdicts, strict=True), start):
            word = 'lost' if verdict.lost else 'missed' if verdict.missed else 'survived'
            words[word] += 1
            slowest = max(slowest, verdict.took)
            print(f'{number:3d} {word} {" ".join(fault)} +{delay:.2f} s: over after '
                  f'{verdict.took:.1f} s: {verdict.lost or verdict.line}', flush=True)
    print(f'tried {count}, survived {words["survived"]}, lost {words["lost"]}, over before the '
          f'signal {words["missed"]}; the slowest was over after {slowest:.1f} s')
    return 1 if words['lost'] else 0


def _add(kinds: Any, name: str, help: str, *, what: str, count: int, most: int,
         jobs: int = 1, most_jobs: int = 64) -> Callable[..., Any]:
    """Add a command with the options that all have; return what adds others."""
    add: Callable[..., Any] = kinds.add_parser(name, help=help).add_argument
    add('--count', type=whole(1, most), default=count, metavar='N',
        help=f'{what} to try (default: {count})')
    add('--seed', type=whole(0, 2**31 - 1), default=1, metavar='S',
        help='of their choice (default: 1)')
    add('--start', type=whole(0, most), default=0, metavar='N',
        help=f'number of the first of the {what} (default: 0)')
    add('--jobs', type=whole(1, most_jobs), default=jobs, metavar='N',
        help=f'{what} at a time (default: {"one for each core" if jobs > 1 else 1})')
    return add


def parser() -> argparse.ArgumentParser:
    """Return the command line."""
    out = argparse.ArgumentParser(prog='chaos', description=__doc__.split('\n\n')[0].strip())
    kinds, cores = out.add_subparsers(dest='kind_of_fault', required=True), os.cpu_count() or 1
    add = _add(kinds, 'processes', 'signals to any process of a flight or replay, at any time',
               what='faults', count=100, most=1_000_000)
    add('--recording', type=Path, default=ROOT / 'bags/circle_short', metavar='BAG',
        help='bag that replays play (default: bags/circle_short)')
    add = _add(kinds, 'files', 'damaged files of every format, and command lines',
               what='inputs', count=1000, most=10_000_000, jobs=cores, most_jobs=1024)
    add('--kind', default='', metavar='KIND,...', help='only these, such as bag,line; each has '
        'its own numbers')
    _add(kinds, 'messages', 'hostile messages on every topic of a flight or replay',
         what='attacks', count=100, most=1_000_000, most_jobs=16)
    _add(kinds, 'resources', 'commands on machines that run out of something',
         what='commands', count=100, most=1_000_000)
    _add(kinds, 'parameters', 'flights with extreme parameters',
         what='flights', count=300, most=10_000_000, jobs=cores, most_jobs=1024)
    return out


def main() -> int:
    """Run a campaign of the command line; return the exit code."""
    options = parser().parse_args()
    if options.kind_of_fault == 'messages':
        from chaos_files import hostile
        return bool(hostile.messages(options.count, options.seed, options.start, options.jobs))
    if options.kind_of_fault == 'resources':
        from chaos_files import resources
        return bool(resources.resources(
            options.count, options.seed, options.start, options.jobs))
    if options.kind_of_fault in ('files', 'parameters'):
        from chaos_files import campaign
        chosen = options.kind if options.kind_of_fault == 'files' else campaign.EXTREME
        return bool(campaign.files(
            options.count, options.seed, options.jobs, chosen, options.start))
    return processes(options.count, options.seed, options.recording.absolute(), options.start,
                     options.jobs)


if __name__ == '__main__':
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        print('chaos: interrupted; --start goes on from a later one', file=sys.stderr)
        sys.exit(128 + signal.SIGINT)
