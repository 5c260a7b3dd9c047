"""
Run a command that lacks something, and judge how it ends.

The command has a mount namespace of its own, with its own shared memory, where the kernel permits
one. It survives if it ends within :data:`WALL` with exit code 0 and everything made, or with 1 or
2 behind one line on stderr that says what it lacked; without a name of Python's, and without a
process, a temporary folder, shared memory, a ``.part`` file or a bag that nobody can read.
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path
import random
import re
import shutil
import signal
import subprocess
import time
from typing import NamedTuple

from mambo_bags.reader import BagError
from mambo_bags.recover import recover
from mambo_bringup.stuck import is_closed

from . import living, tasks
from .scarce import below, Place, SCARCITIES, Scarcity
from .tasks import Made, START, Task

WALL = 240.0     # s, on a machine with other work
LEFT = 15.0      # s after the command until nothing may be left
WATCHED = 8.0    # s after which a command without an end is interrupted
MEMORY = 256_000  # kB of shared memory, where it is not what is scarce
BEGUN = 250_000  # bytes of a bag with more in it than schemas and scenario
INTERNALS = re.compile(r"Traceback|\b\w*(Error|Exception|Interrupt)\b|<class '|object at 0x")
OWN = re.compile(r'(run|mambo[a-z -]*): ')  # begins every line of a command
NOTED = 'compiled code cannot be written there, so all is compiled again'
"""Said before the work, so that a command which then fails for another reason has two lines."""
PROGRESS = re.compile(r': \d+ s so far$')  # of a flight that starts slowly on a busy machine
READER = ('--inh-caps=+dac_read_search', '--ambient-caps=+dac_read_search')
"""Another user may read all, as Python and the checkout may be in a home folder."""
_TRACER = 'lttng-ust-wait-'  # of the tracer of ROS, one for each user, until the machine ends
_INTERRUPTED = 128 + signal.SIGINT


class End(NamedTuple):
    """How a command ended."""

    outcome: str  # 'done', 'refused' or 'failed', for exit codes 0, 2 and 1
    wrong: str    # what was wrong with it, empty: survived
    took: float   # s of wall time
    line: str     # the last one on stderr


def permitted() -> str:
    """Return why the kernel permits no namespaces of one's own; '' if it does."""
    done = subprocess.run([*_unshare(False), 'true'], text=True, capture_output=True)
    return done.stderr.strip() if done.returncode else ''


def _unshare(network: bool) -> list[str]:
    """Return the command line that enters new namespaces."""
    return ['unshare', '-m', *([] if network else ['-n']), *(['-r'] if os.geteuid() else [])]


class Namespace:
    """
    Private mounts, held by a shell until the end of ``with``.

    Parameters
    ----------
    scarcity
        What to mount, and whether there is a network.
    private
        Whether there are any namespaces.

    Attributes
    ----------
    root : Path
        Where the files of the namespace are seen from outside.

    """

    def __init__(self, scarcity: Scarcity, private: bool) -> None:
        self._scarcity, self._private = scarcity, private
        self.root = Path('/')

    def __enter__(self) -> Namespace:
        if self._private:
            mounts = (f'mount -t tmpfs -o size={MEMORY}k,mode=1777 tmpfs /dev/shm',
                      *self._scarcity.mounts)
            self._holder = subprocess.Popen(
                [*_unshare(self._scarcity.network), 'sh', '-c',
                 ' && '.join((*mounts, 'echo ready && exec cat'))],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
            if self._holder.stdout.readline() != 'ready\n':
                raise RuntimeError(f'mount: {self._holder.stderr.read()}')
            self.root = Path(f'/proc/{self._holder.pid}/root')
        return self

    def entering(self) -> list[str]:
        """Return the command line that enters it."""
        if not self._private:
            return []
        user = ['-U', '--preserve-credentials'] if os.geteuid() else []
        network = [] if self._scarcity.network else ['-n']
        return ['nsenter', '-t', str(self._holder.pid), *user, '-m', *network, '--']

    def __exit__(self, *_: object) -> None:
        if self._private:
            self._holder.communicate('')


class Starved:
    """
    A command under a scarcity.

    Parameters
    ----------
    task, lacks
        Command, and name of the scarcity.
    rng
        Of what is random in the scarcity.
    folder
        Empty folder.
    base
        Folder with the inputs of commands.
    whole
        What the command makes when it has enough.
    compiled
        Folder of compiled code of the checkout.
    private
        Whether it has namespaces of its own.

    """

    def __init__(self, task: Task, lacks: str, rng: random.Random, folder: Path, base: Path,
                 whole: Made, compiled: Path, private: bool = True) -> None:
        self._task, self._whole = task, whole
        place = self._place = Place(
            folder, *(folder / name for name in ('out', 'tmp', 'home', 'cache')))
        self._work = folder / 'work'
        for path in (*place[1:], self._work):
            path.mkdir()
        self.scarcity = SCARCITIES[lacks](rng, place)
        self._private = private and self.scarcity.private
        self.scarcity.prepare(compiled)
        if self.scarcity.user:
            self._give(self.scarcity.user)
        self._words = tasks.words_of(task, place.out, base, rng.randint(20_000, 30_000))
        self._out, self._err = folder / 'stdout', folder / 'stderr'
        self._whole_before = False

    def _give(self, user: int) -> None:
        """Make the folders those of another user."""
        self._place.root.chmod(0o755)
        for path in (self._place.root, *self._place.root.rglob('*')):
            os.chown(path, user, user)

    def _environment(self) -> dict[str, str]:
        """Return the variables of the command; every process of it has that of the mark."""
        values = {**os.environ, 'TMPDIR': str(self._place.tmp), 'HOME': str(self._place.home),
                  'NUMBA_CACHE_DIR': None, 'CHAOS': str(self._place.root),
                  **self.scarcity.environment}
        return {name: value for name, value in values.items() if value is not None}

    def _start(self, inside: Namespace) -> subprocess.Popen:
        """Start the command."""
        user = self.scarcity.user
        other = ['setpriv', f'--reuid={user}', f'--regid={user}', '--clear-groups', *READER] if (
            user) else []
        out = self._out.open('wb')
        if not self.scarcity.reader:
            read, write = os.pipe()
            os.close(read)
            out = open(write, 'wb')
        with out, self._err.open('wb') as err:
            return subprocess.Popen(
                [*inside.entering(), *other, 'sh', '-c',
                 f'cd "$0" && exec "$@" {self.scarcity.streams}', str(self._work),
                 *self.scarcity.limits, *START, *self._words],
                stdin=subprocess.DEVNULL, stdout=out, stderr=err, start_new_session=True,
                env=self._environment())

    def _watch(self, run: subprocess.Popen, root: Path) -> bool:
        """Wait for the end, take away what is taken meanwhile; return whether it ended."""
        began = time.monotonic()
        taken, asked = self.scarcity.during is None, self._task.ends
        while run.poll() is None:
            passed = time.monotonic() - began
            if passed > WALL:
                return False
            if not taken and passed > self.scarcity.after:
                taken = True
                bags = list(self._place.out.rglob('metadata.yaml'))
                self._whole_before = bool(bags) and all(is_closed(bag.parent) for bag in bags)
                self.scarcity.during(root)
            if not asked and passed > WATCHED:
                asked = True
                run.send_signal(signal.SIGINT)
            time.sleep(0.02)
        return True

    def end(self) -> End:
        """Run the command; return how it ended."""
        mark = str(self._place.root)
        with Namespace(self.scarcity, self._private) as inside:
            began = time.monotonic()
            run = self._start(inside)
            ended = self._watch(run, inside.root)
            took = time.monotonic() - began
            left = not living.wait(lambda: not living.processes(mark), LEFT if ended else 0.0)
            running = living.processes(mark) if left else {}
            living.kill(running)
            code = run.wait()
            out, err = (path.read_text(errors='replace') for path in (self._out, self._err))
            wrong = f'did not end within {WALL:g} s: {running}' if not ended else (
                f'left running: {running}' if running else '')
            wrong = wrong or self._wrong_words(code, out, err) or self._wrong_rest(inside.root)
            kept = self._place.root / 'kept'
            kept.mkdir()
            with contextlib.suppress(FileNotFoundError):  # it was removed
                shutil.copytree(below(inside.root, self._place.out), kept, dirs_exist_ok=True)
        wrong = wrong or self._wrong_files(code, kept, out)
        lines = err.splitlines()
        outcome = {0: 'done', 1: 'failed', 2: 'refused', _INTERRUPTED: 'done'}.get(code, 'lost')
        return End(outcome, wrong, took, lines[-1] if lines else '')

    def _wrong_words(self, code: int, out: str, err: str) -> str:
        """Return what is wrong with the exit code and the lines."""
        if found := INTERNALS.search(out + err):
            return f'{found[0]}: exit code {code}: {err[-1500:]}'
        lines = [line for line in err.splitlines() if not PROGRESS.search(line)]
        said = [line for line in lines if NOTED not in line]
        if any(not OWN.match(line) for line in lines):
            return f'exit code {code}: a line without the name of the command: {err[-1500:]}'
        if not self._task.ends and code == _INTERRUPTED:
            return '' if len(said) == 1 or '2>' in self.scarcity.streams else f'stderr: {err}'
        if code not in (0, 1, 2):
            return f'exit code {code}: {err[-600:]}'
        if '2>' in self.scarcity.streams:
            return ''  # nobody could read it
        if not code:
            return f'exit code 0 with an error: {err}' if said else ''
        silent = not self.scarcity.reader and not said  # as the shell expects
        if len(said) != 1 and not silent:
            return f'exit code {code} behind {len(said)} lines: {err[-1500:]}'
        if not silent and not re.search(self.scarcity.cause, said[0]):
            return f'exit code {code} for another reason: {said[0]}'
        return ''

    def _wrong_rest(self, root: Path) -> str:
        """Return which temporary file or shared memory is left."""
        if self._private:
            memory = below(root, living.SHARED)  # a port is left if a flight uses its number

            def left() -> list[str]:
                everybody = (int(path.name) for path in Path('/proc').glob('[0-9]*'))
                used = tuple(path.name for path in living.shared(everybody))
                return [path.name for path in memory.iterdir() if not path.name.startswith(
                    _TRACER) and not any(name in path.name for name in used)]
            if not living.wait(lambda: not left(), 3.0):
                return f'shared memory left: {left()}'
        for folder in (self._place.tmp, self._work):
            if files := [path.name for path in below(root, folder).iterdir()]:
                return f'left in {folder.name}: {files}'
        return ''

    def _wrong_files(self, code: int, kept: Path, out: str) -> str:
        """Return what is wrong with what the command has made."""
        if part := next(kept.rglob('*.part'), None):
            return f'{part.name} is left'
        if code == 0:
            if self._whole_before:
                return ''  # it was whole when it was removed
            lost = bool(re.search(r'(^|[^2])>', self.scarcity.streams))
            if lost or not self.scarcity.reader:
                return 'exit code 0, but nobody got its output' if self._whole.lines else ''
            try:
                return tasks.missing(self._task, tasks.made(kept, out), self._whole)
            except (BagError, OSError) as error:
                return f'exit code 0, but {error}'
        for number, file in enumerate(kept.rglob('*.mcap')):
            if not is_closed(file.parent) and file.stat().st_size > BEGUN:
                try:
                    recover(file.parent, self._place.root / f'recovered_{number}')
                except (BagError, OSError) as error:
                    return f'{file.name} is neither closed nor recoverable: {error}'
        return ''
