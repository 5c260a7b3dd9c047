"""
Keeper of a flight: ends the nodes and removes the folder of a runner that was killed.

The kernel interrupts a node whose runner is gone, but a node that is stopped or deaf does not
hear that, and nobody is left to remove what the runner made. This program runs beside the runner
and reads what to look after from its standard input, a line each: ``+PID`` of a node, or a
folder. The end of the input is the end of the runner. A runner that is suspended for some seconds
is told to end its flight, as nobody watches its nodes meanwhile.

It is run as a file, by a Python without packages: standard library only.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
from pathlib import Path
import select
import shutil
import signal
import subprocess
import sys
import time

ASK, TELL = 6.0, 3.0  # s that a node has to leave after SIGINT, and after SIGTERM
SUSPENDED = 4.0  # s for which a runner may be stopped
_YOUNG = 1.0  # s of age within which a lock may not be held yet
_SHARED = Path('/dev/shm')


def is_stopped(pid: int) -> bool:
    """Return whether a process is stopped by a signal; one that a debugger holds is not."""
    with contextlib.suppress(OSError):
        return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0] == 'T'
    return False


def sweep() -> None:
    """
    Remove the shared memory that killed processes have left.

    Fast DDS removes its files itself unless its process is killed. Each has a lock beside it,
    held as long as its process lives: what can be locked has nobody. The mutex of a port outlives
    the port.
    """
    for lock in _SHARED.glob('fastrtps_*_el'):
        with contextlib.suppress(OSError):
            if time.time() - lock.stat().st_mtime < _YOUNG:
                continue
            with lock.open() as file:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                lock.with_name(lock.name.removesuffix('_el')).unlink(missing_ok=True)
                lock.unlink()
    for mutex in _SHARED.glob('sem.fastrtps_port*_mutex'):
        with contextlib.suppress(OSError):
            port = mutex.name.removeprefix('sem.').removesuffix('_mutex')
            old = time.time() - mutex.stat().st_mtime >= _YOUNG
            if old and not any(_SHARED.glob(f'{port}*')):
                mutex.unlink()


class Keeper:
    """The runner's side: starts the program, tells it what to look after, ends it."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, '-I', '-S', __file__, str(os.getpid())], stdin=subprocess.PIPE,
            text=True, start_new_session=True)

    def keep(self, what: str) -> None:
        """Look after a folder, or a process as ``+PID``."""
        with contextlib.suppress(BrokenPipeError):  # it was killed: the flight goes on without
            self._process.stdin.write(f'{what}\n')
            self._process.stdin.flush()

    def release(self) -> None:
        """Leave the keeper with nothing to do, and see it end."""
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.close()
        try:
            self._process.wait(2.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()


def _tell_suspended(runner: int) -> None:
    """Have a suspended runner continue, and end its flight."""
    with contextlib.suppress(OSError):
        print(f'suspended for {SUSPENDED:g} s: the flight ends', file=sys.stderr, flush=True)
        os.kill(runner, signal.SIGTERM)
        os.kill(runner, signal.SIGCONT)


def _listen(runner: int) -> tuple[list[int], list[str]]:
    """Read until the runner is gone; return handles of the nodes, and the folders."""
    handles, folders, stopped_since, rest = [], [], None, ''
    while True:
        if select.select([sys.stdin], [], [], 0.5)[0]:
            data = os.read(sys.stdin.fileno(), 4096).decode()
            if not data:
                return handles, folders
            *lines, rest = (rest + data).split('\n')
            folders += [line for line in lines if not line.startswith('+')]
            for line in lines:
                with contextlib.suppress(OSError):
                    handles += [os.pidfd_open(int(line[1:]))] if line.startswith('+') else []
        elif not is_stopped(runner):
            stopped_since = None
        elif stopped_since is None:
            stopped_since = time.monotonic()
        elif time.monotonic() - stopped_since > SUSPENDED:
            stopped_since = None
            _tell_suspended(runner)


def _end(handles: list[int]) -> None:
    """End nodes: ask, tell, kill."""
    for number, seconds in ((signal.SIGINT, ASK), (signal.SIGTERM, TELL), (signal.SIGKILL, TELL)):
        for handle in handles:
            with contextlib.suppress(ProcessLookupError):
                signal.pidfd_send_signal(handle, number)
                signal.pidfd_send_signal(handle, signal.SIGCONT)
        limit = time.monotonic() + seconds
        while handles and (left := limit - time.monotonic()) > 0.0:
            gone = select.select(handles, [], [], left)[0]
            handles = [handle for handle in handles if handle not in gone]


def main() -> None:
    """Look after what the runner names until it is gone, then end and remove that."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    handles, folders = _listen(int(sys.argv[1]))
    _end([handle for handle in handles if not select.select([handle], [], [], 0.0)[0]])
    for folder in folders:
        shutil.rmtree(folder, ignore_errors=True)
    sweep()


if __name__ == '__main__':
    main()
