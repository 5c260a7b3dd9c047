"""Fly while a hostile process attacks the graph; judge how each flight ends; count."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
import fcntl
from functools import partial
import json
import os
from pathlib import Path
import random
import re
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from typing import Any, NamedTuple

from mambo_ros import topics

from . import flown, living, ROOT
from .attempt import LONGEST
from .tables import table, with_outcome

KINDS = ('values', 'stamps', 'flood', 'large', 'rival', 'garbage', 'type', 'qos', 'churn', 'clock',
         'requests')
OUTCOMES = ('flown', 'ended', 'missed', 'lost')
MODES = {
    'composed': ['run', '--composed', '--duration=240'],
    'processes': ['run', '--processes', '--duration=40'],
    'realtime': ['run', '--mode', 'realtime', '--duration=9'],
    'drones 2': ['run', '--drones', '2', '--processes', '--duration=20'],
    'drones 4': ['run', '--drones', '4', '--processes', '--duration=10'],
    'replay': ['mambo', 'replay', str(ROOT / 'bags/circle_short'), '--rate', '1']}
"""Command lines, which last for about 10 s in the air."""
CHANCES = (3, 5, 3, 2, 1, 2)
EXACT = ('composed', 'processes', 'drones 2', 'drones 4', 'replay')
"""Modes in which the bag is that of the undisturbed flight, to the bit."""
MOMENTS = ('start', 'flight', 'flight', 'flight')
LIMIT = 240.0       # s from the start to the end of a flight, on a machine with other work
WITHIN = 15.0       # s until nothing of it is left
MORE = 1 << 30      # bytes of a process beyond the undisturbed flight
LINES = 200         # of output, the table of a replay included
ENOUGH = 20         # messages that must be refused aloud
_LOOK = 0.25        # s between looks at the memory of the flight,
_RARELY = 4         # of which every fourth is at that of all others
_DOMAINS = range(50, 10, -1)  # tests have higher ones, other flights take the lowest
_NOT_BEGUN = re.compile(r'the flight does not begin|publishes \S*clock too')  # no messages then
_INTERNALS = re.compile(r"Traceback|<class '|object at 0x|\bException\b")
_SHARED = tuple(topic.name.lstrip('/') for topic in (
    topics.TF, topics.TF_STATIC, topics.DIAGNOSTICS, topics.LINKS))


class Attack(NamedTuple):
    """One hostile act on one flight."""

    kind: str    # of KINDS
    mode: str    # of MODES
    moment: str  # of MOMENTS
    seed: int
    number: int  # within its kind and seed

    @property
    def name(self) -> str:
        """Return how it is printed and kept."""
        return f'{self.kind} {self.seed} {self.number}'


class Calm(NamedTuple):
    """An undisturbed flight of a mode."""

    digests: flown.Digests
    memory: int  # bytes of its largest process


class Ended(NamedTuple):
    """How a flight ended."""

    code: int | None  # None: it had to be killed
    out: str
    err: str
    memory: int  # bytes of its largest process
    left: dict[int, str]  # processes that are left
    deed: dict[str, Any] = {}  # what the stranger did; empty if it did not come to it
    broken: str = ''  # what went wrong in the stranger itself


class Verdict(NamedTuple):
    """How an attack went."""

    lost: str   # what was wrong, empty: survived
    deed: dict[str, Any]
    code: int | None
    line: str   # last one of the runner's errors
    took: float  # s


def chosen(kind: str, seed: int, number: int) -> Attack:
    """Return the attack of a number; it depends on kind, seed and number alone."""
    rng = random.Random(f'{seed} {kind} {number} flight')
    mode = rng.choices(list(MODES), CHANCES)[0]
    return Attack(kind, mode, rng.choice(MOMENTS), seed, number)


@contextmanager
def own_domain() -> Iterator[int]:
    """Hold a ROS domain that no other campaign on this machine has."""
    for number in _DOMAINS:
        path = Path(tempfile.gettempdir()) / f'mambo_chaos_domain_{number}.lock'
        with open(path, 'a') as held:
            try:
                fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                continue
            yield number
            return
    sys.exit('chaos: no ROS domain is free')


class Watched:
    """
    A flight in a domain and a folder of its own, whose processes are watched.

    Parameters
    ----------
    mode
        Of MODES.
    folder
        Empty folder.
    domain
        ROS domain.

    """

    def __init__(self, mode: str, folder: Path, domain: int) -> None:
        self.bag, self._temporary = folder / 'bag', folder / 'tmp'
        self._temporary.mkdir()
        self.env = {**os.environ, 'ROS_DOMAIN_ID': str(domain),
                    'ROS_LOG_DIR': str(folder / 'log')}
        command = [*MODES[mode], '--output', str(self.bag)]
        if command[0] == 'run':
            command += ['--no-landing', '--no-report', '--seed', '3']
        self._older = set(living.SHARED.iterdir())
        self.run = subprocess.Popen(
            [sys.executable, '-m', 'mambo_bringup.starting', *command], text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True,
            env={**self.env, 'TMPDIR': str(self._temporary)})
        self._memory, self._mapped, self._others = 0, set[Path](), set[Path]()
        self._over = threading.Event()
        self._watch = threading.Thread(target=self._look)
        self._watch.start()

    def _look(self) -> None:
        """Look at the memory of the processes until they are over."""
        looks = 0
        while not self._over.wait(_LOOK):
            pids = living.processes(str(self._temporary))
            if not looks % _RARELY:
                self._others |= living.shared_by_others(str(self._temporary.parent))
            looks += 1
            self._memory = max([self._memory, *map(living.memory, pids)])
            self._mapped |= living.shared(pids) - self._older

    def end(self) -> Ended:
        """Wait for the end; kill what does not end."""
        code: int | None = None
        try:
            out, err = self.run.communicate(timeout=LIMIT)
            code = self.run.returncode
        except subprocess.TimeoutExpired:
            self.run.kill()
            out, err = self.run.communicate()
        mark = str(self._temporary)
        living.wait(lambda: not living.processes(mark), WITHIN)
        left = living.processes(mark)
        self._over.set()
        self._watch.join()
        living.kill(left)
        return Ended(code, out, err, self._memory, left)

    def folder_left(self) -> str:
        """Return which temporary folder is left; '' if none."""
        return living.folder_left(self._temporary, WITHIN)

    def shared_left(self) -> str:
        """
        Return which shared memory is left; '' if none.

        Ports of the middleware have the same names for all flights on a machine: one that another
        flight had, too, may be left by that.
        """
        return living.shared_left(self._mapped - self._others)

    def unreadable(self) -> str:
        """Return which bag can neither be read nor recovered; '' if none."""
        return living.unreadable(self.bag, self._temporary)


def calm(base: Path, mode: str) -> Calm:
    """Return the undisturbed flight of a mode, made in a folder within another."""
    folder = base / f'calm {mode}'
    folder.mkdir()
    with own_domain() as domain:
        flight = Watched(mode, folder, domain)
        ended = flight.end()
    if ended.code:
        raise SystemExit(f'chaos: the undisturbed flight failed, {mode}: {ended.err}')
    digests = flown.digests(flight.bag)
    shutil.rmtree(folder)
    return Calm(digests, ended.memory)


def attacked(attack: Attack, folder: Path) -> tuple[Watched, Ended]:
    """Fly in an empty folder while the stranger attacks; return the flight and its end."""
    with own_domain() as domain:
        stranger = _stranger(attack, domain, folder)
        try:
            stranger.stdout.readline()
            flight = Watched(attack.mode, folder, domain)
            ended = flight.end()
        finally:
            stranger.terminate()
            told, errors = _said(stranger)
    (folder / 'told').write_text(f'{told}\n{errors}')
    (folder / 'output').write_text(f'{ended.out}\n{ended.err}')
    deed = next((json.loads(line) for line in told.splitlines() if line.startswith('{"')), {})
    return flight, ended._replace(deed=deed, broken=_broken(errors))


def try_attack(attack: Attack, undisturbed: Calm, folder: Path) -> Verdict:
    """Attack a flight in an empty folder; return how it went."""
    began = time.monotonic()
    flight, ended = attacked(attack, folder)
    lines = ended.err.strip().splitlines()
    return Verdict(judge(attack, ended, undisturbed, flight), ended.deed, ended.code,
                   lines[-1] if lines else '', time.monotonic() - began)


def _stranger(attack: Attack, domain: int, folder: Path) -> subprocess.Popen[str]:
    """Start the hostile process."""
    space = f'{topics.NAMESPACE}1' if 'drones' in attack.mode else topics.NAMESPACE
    path = os.pathsep.join(filter(None, (str(ROOT / 'tools'), os.environ.get('PYTHONPATH'))))
    return subprocess.Popen(
        [sys.executable, '-m', 'chaos_files.strangers', attack.kind, str(attack.seed),
         str(attack.number), attack.moment, space],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
        env={**os.environ, 'ROS_DOMAIN_ID': str(domain), 'PYTHONPATH': path,
             'TMPDIR': str(folder)})


def _said(stranger: subprocess.Popen[str]) -> tuple[str, str]:
    """Return what an ending stranger has printed; it may be too busy to leave."""
    try:
        return stranger.communicate(timeout=WITHIN)
    except subprocess.TimeoutExpired:
        stranger.kill()
        return stranger.communicate()


def _broken(errors: str) -> str:
    """Return the error of the stranger itself; '' if there is none."""
    return f'the stranger failed: {errors[-600:]}' if 'Traceback' in errors else ''


def judge(attack: Attack, ended: Ended, undisturbed: Calm, flight: Watched) -> str:
    """Return what is wrong with the end of an attacked flight; '' if nothing is."""
    if ended.code is None:
        return f'did not end within {LIMIT:g} s: {ended.err[-300:]}'
    begun = not _NOT_BEGUN.search(ended.err)
    return (wrong_words(ended)
            or (f'left running: {ended.left}' if ended.left else '')
            or flight.folder_left() or flight.shared_left()
            or (f'{ended.memory >> 20} MB instead of {undisturbed.memory >> 20} MB'
                if ended.memory > undisturbed.memory + MORE else '')
            or (flight.unreadable() if ended.code and begun else flown.unclosed(flight.bag))
            or (flown.wrong(flight.bag) if begun else '')
            or (flown.other(flight.bag, undisturbed.digests)
                if attack.mode in EXACT and not ended.code else '')
            or unsaid(attack, ended, flight.bag.parent / 'log') or ended.broken)


def wrong_words(ended: Ended) -> str:
    """Return what is wrong with the exit code and the output; '' if nothing is."""
    lines = (ended.out + ended.err).splitlines()
    if found := _INTERNALS.search(ended.out + ended.err):
        return f'{found[0]}: {ended.err[-600:]}'
    longest = max(map(len, lines), default=0)
    if len(lines) > LINES or longest > LONGEST:
        return f'{len(lines)} lines, {longest} characters in the longest'
    errors = ended.err.strip().splitlines()
    if ended.code and (ended.code < 0 or len(errors) != 1 or not re.match(
            r'(run|mambo replay|replay): \S', errors[0])):
        return f'exit code {ended.code} behind {errors}'
    return ''


def unsaid(attack: Attack, ended: Ended, log: Path) -> str:
    """Return which refusal was not said, where the stranger reached an input; '' if none."""
    deed = ended.deed
    if not deed or ended.code or not deed['readers']:
        return ''  # it was not there in time, reached nobody, or the flight says why it ended
    target = deed['target']
    if target.endswith(_SHARED):
        return ''  # anybody may publish there
    heard = attack.kind not in ('type', 'qos') and deed['matched'] and deed['sent'] >= ENOUGH
    named = attack.kind in ('type', 'qos') and deed['to'] - deed['from'] > 0
    if not heard and not named:
        return ''
    lines = ended.out.splitlines() + [
        line for file in log.rglob('*.log')
        for line in file.read_text(errors='replace').splitlines() if 'WARN' in line]
    said = any(f'{target} ' in line or f'{target}:' in line or f'{target},' in line
               for line in lines)
    return '' if said else f'{deed["sent"]} messages on {target} refused without a word'


def messages(count: int, seed: int, start: int = 0, jobs: int = 1,
             keep: Path = ROOT / '.cache/chaos') -> int:
    """
    Attack flights; print each, and a table.

    Parameters
    ----------
    count
        Number of attacks.
    seed
        Of their choice.
    start
        Number of the first attack.
    jobs
        Flights at a time.
    keep
        Folder for the output of lost flights.

    Returns
    -------
    lost
        How many were lost.

    """
    began = time.monotonic()
    tried: Counter[tuple[str, str]] = Counter()
    attacks = [chosen(KINDS[index % len(KINDS)], seed, index // len(KINDS))
               for index in range(start, start + count)]
    with tempfile.TemporaryDirectory(prefix='chaos_') as name, ThreadPoolExecutor(jobs) as pool:
        base = Path(name)
        modes = sorted({attack.mode for attack in attacks})
        calms = dict(zip(modes, pool.map(partial(calm, base), modes), strict=True))
        for attack, verdict in pool.map(partial(_one, base, calms, keep), attacks):
            outcome = ('lost' if verdict.lost else 'missed' if not verdict.deed else
                       'ended' if verdict.code else 'flown')
            tried[attack.kind, outcome] += 1
            print(_line(attack, verdict, outcome), flush=True)
    print(table(tried, KINDS, OUTCOMES))
    flew, ended, missed, lost = (with_outcome(tried, outcome) for outcome in OUTCOMES)
    print(f'tried {count}, survived {flew + ended}, lost {lost}, over before the attack '
          f'{missed}; {time.monotonic() - began:.0f} s')
    return lost


def _one(base: Path, calms: dict[str, Calm], keep: Path, attack: Attack,
         ) -> tuple[Attack, Verdict]:
    """Make one attack in a folder of its own; keep what is said of one that is lost."""
    folder = base / attack.name.replace(' ', '_')
    folder.mkdir()
    verdict = try_attack(attack, calms[attack.mode], folder)
    if verdict.lost:
        shutil.copytree(folder, keep / f'messages_{folder.name}', dirs_exist_ok=True,
                        ignore=shutil.ignore_patterns('bag', 'tmp'))
        (keep / f'messages_{folder.name}/lost').write_text(f'{attack}\n{verdict}\n')
    shutil.rmtree(folder, ignore_errors=True)
    return attack, verdict


def _line(attack: Attack, verdict: Verdict, outcome: str) -> str:
    """Return one line, or two, about an attack."""
    deed = verdict.deed
    target = f'{deed["sent"]} to {deed["target"]}' if deed else 'not there in time'
    text = (f'{outcome} {attack.name}: {attack.mode}, {attack.moment}, {target}, '
            f'{verdict.took:.0f} s')
    if verdict.lost:
        text += f'\n  {verdict.lost[:1500]}'
    elif verdict.line:
        text += f': {verdict.line[:300]}'
    return text.encode('utf-8', 'backslashreplace').decode()
