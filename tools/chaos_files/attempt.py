"""
Run a command of ``mambo`` in a forked process with limits, and judge how it ends.

The modules of all commands are imported once and each attempt is a fork, so that a thousand take
minutes. An attempt survives if the command exits with code 0, or with 1 or 2 behind exactly one
line on stderr that begins with its name; within the CPU time it may take, :data:`WALL_S`,
:data:`MEMORY` more than the process of the imports, and :data:`LINES`; without leaving a file
behind that it began, or processes.
"""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import faulthandler
import gc
import os
from pathlib import Path
import re
import resource
import select
import signal
import sys
import time
import traceback
from typing import NamedTuple

from mambo_bringup import mambo

CPU_S = 20       # s of CPU for one command
COMPILING_S = 120  # s of CPU for one that may compile what was damaged into another type
WALL_S = 120.0   # s, on a machine with other work
MEMORY = 1 << 30  # bytes of address space beyond what the imports take
LINES = 3000     # lines of output
LONGEST = 2500   # characters of the line of an error
_INTERNALS = re.compile(r"Traceback|\w+Error\(|<class '|object at 0x|\bException\b")
_FAILED = 70  # exit code of a fork whose command raised


class End(NamedTuple):
    """How an attempt ended."""

    outcome: str  # 'done', 'refused' or 'failed', for exit codes 0, 2 and 1
    wrong: str    # what was wrong with it, empty: survived
    took: float   # s of wall time


class Attempt:
    """
    A command line that runs in a fork; to be started in the main thread.

    Parameters
    ----------
    words
        Command and arguments, without ``mambo``.
    folder
        Working directory; the output is written beside it.
    prepare
        Called in the fork before the limits are set: makes the files.
    made
        What the command makes; it must not be there after exit code 2.
    most : s
        Of CPU.
    check
        Returns from ``words`` what is wrong with what was made; empty if nothing.

    """

    def __init__(self, words: list[str], folder: Path, prepare: Callable[[], None],
                 made: Path | None = None, most: int = CPU_S,
                 check: Callable[[list[str]], str] = lambda words: '') -> None:
        self.words, self._folder, self._made, self._check = words, folder, made, check
        self._files = [folder.with_name(f'{folder.name}.{name}') for name in ('out', 'err')]
        self._began = time.monotonic()
        self._wall = WALL_S + 3 * (most - CPU_S)
        sys.stdout.flush()
        gc.freeze()  # no collection copies pages in the fork
        self._child = os.fork()
        if not self._child:
            _work(words, folder, self._files, prepare, most)
        self.handle = os.pidfd_open(self._child)

    @property
    def left(self) -> float:
        """Return how long it may still run, in s."""
        return max(self._began + self._wall - time.monotonic(), 0.0)

    def end(self) -> End:
        """Return how it ended; kill it if it has not."""
        code = None
        if select.select([self.handle], [], [], 0.0)[0]:
            code = os.waitstatus_to_exitcode(os.waitpid(self._child, 0)[1])
        took = time.monotonic() - self._began
        left = _end_group(self._child)
        if code is None:
            os.waitpid(self._child, 0)
        os.close(self.handle)
        wrong = f'did not end within {self._wall:g} s'
        if code is not None:
            wrong = _wrong(code, *self._files, self._folder, self._made) or (
                'processes are left' if left else '') or self._check(self.words)
        return End({0: 'done', 1: 'failed', 2: 'refused'}.get(code, 'lost'), wrong, took)


def _work(words: list[str], folder: Path, files: list[Path], prepare: Callable[[], None],
          most: int) -> None:
    """Prepare and run the command in this fork, and exit."""
    code = _FAILED
    try:
        os.setsid()
        faulthandler.disable()
        for number, path in zip((1, 2), files, strict=True):
            os.dup2(os.open(path, os.O_CREAT | os.O_WRONLY | os.O_TRUNC), number)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        sys.stdout, sys.stderr = (
            open(number, 'w', closefd=False, errors='backslashreplace') for number in (1, 2))
        prepare()
        os.chdir(folder)
        own = int(Path('/proc/self/statm').read_text().split()[0]) * resource.getpagesize()
        cpu = most + round(time.process_time())
        for kind, most in ((resource.RLIMIT_AS, own + MEMORY), (resource.RLIMIT_CORE, 0),
                           (resource.RLIMIT_FSIZE, MEMORY)):
            resource.setrlimit(kind, (most, most))
        resource.setrlimit(resource.RLIMIT_CPU, (cpu, cpu + 5))  # SIGXCPU, which says why
        code = mambo.main(words)
    except SystemExit as end:
        code = end.code or 0
    except BaseException:
        traceback.print_exc()
    finally:
        with contextlib.suppress(BaseException):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def _end_group(group: int) -> bool:
    """Kill what a fork has left running; return whether there was anything."""
    try:
        os.killpg(group, signal.SIGKILL)
    except ProcessLookupError:
        return False
    return True


def _wrong(code: int, output: Path, errors: Path, folder: Path, made: Path | None) -> str:
    """Return what is wrong with an end, empty if nothing."""
    out, err = (path.read_text(errors='replace')[:1_000_000] for path in (output, errors))
    if code < 0:
        return f'ended by {signal.Signals(-code).name}: {err[-300:]}'
    if found := _INTERNALS.search(out + err):
        return f'{found[0]}: {err[-600:]}'
    if code not in (0, 1, 2):
        return f'exit code {code}: {err[-300:]}'
    lines = err.splitlines()
    if code and (len(lines) != 1 or not lines[0].startswith('mambo')):
        return f'exit code {code} behind {len(lines)} lines: {err[:600]}'
    if any(len(line) > LONGEST for line in lines) or out.count('\n') > LINES:
        return f'{max(map(len, lines), default=0)} characters, {len(out.splitlines())} lines'
    if 'out of memory' in err:
        return f'memory: {err}'
    if code == 2 and made is not None and made.exists():
        return f'{made.name} is left: {err}'
    part = next(folder.rglob('.*.part'), None)
    return f'{part.name} is left' if part else ''
