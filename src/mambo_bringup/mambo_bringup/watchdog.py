"""
Watchdog of a flight: ends the nodes and removes the folder of a runner that was killed.

When a runner dies, the kernel interrupts its nodes, but a node that is stopped or hangs does not
react, and the runner's files remain. This program runs beside the runner and reads what to clean
up from its standard input, one line each: ``+PID`` of a node, or a folder. End of input means
that the runner has ended. A runner that is suspended for some seconds has to end its flight,
because its nodes run unsupervised meanwhile.

It runs as a script with the standard library only.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
from pathlib import Path
import re
import select
import shutil
import signal
import subprocess
import sys
import time

# s that a node has to exit after SIGINT, and after SIGTERM
INTERRUPT_TIMEOUT, TERMINATE_TIMEOUT = 6.0, 3.0
SUSPENDED = 4.0  # s for which a runner may be suspended
_YOUNG = 1.0  # s; a younger lock file may not be locked yet
_SHARED = Path('/dev/shm')
_MAPPED = re.compile(r'/dev/shm/(\S+)$', re.MULTILINE)


def is_stopped(pid: int) -> bool:
    """Return whether a process is stopped by a signal, and not by a debugger."""
    with contextlib.suppress(OSError):
        return Path(f'/proc/{pid}/stat').read_text().rpartition(')')[2].split()[0] == 'T'
    return False


def _mapped() -> set[str]:
    """Return the names of shared memory files that some process of this user has mapped."""
    found = set()
    for maps in Path('/proc').glob('[0-9]*/maps'):
        with contextlib.suppress(OSError):
            found |= set(_MAPPED.findall(maps.read_text()))
    return found


def _is_young(file: Path) -> bool:
    """Return whether a file is younger than a second, and not from before the clock was set."""
    return 0.0 <= time.time() - file.stat().st_mtime < _YOUNG


def _remove_unlocked(lock: Path) -> bool:
    """Remove a file whose lock is free, and the lock; return whether they are too young for it."""
    with contextlib.suppress(OSError), lock.open() as file:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if _is_young(lock):
            return True
        lock.with_name(lock.name.removesuffix('_el')).unlink(missing_ok=True)
        lock.unlink()
    return False


def sweep() -> bool:
    """
    Remove the shared memory that killed processes have left; return whether any is too young.

    Fast DDS removes its files unless its process is killed. Each file has a lock file that its
    process holds; a file whose lock is free has no owner. A port that was opened to send to a
    killed process has no lock file, nor has a file that found the shared memory full; they have no
    owner when no process has mapped them. The mutex of a port remains after the port.
    """
    young = [_remove_unlocked(lock) for lock in _SHARED.glob('fastrtps_*_el')]
    unlocked = [file for file in _SHARED.glob('fastrtps_*')
                if not file.name.endswith(('_el', '_sl'))
                and not any(map(Path.exists, (file.with_name(f'{file.name}_el'),
                                              file.with_name(f'{file.name}_sl'))))]
    mapped = _mapped() if unlocked else set()
    for file in [*(file for file in unlocked if file.name not in mapped),
                 *_SHARED.glob('sem.fastrtps_port*_mutex')]:
        port = file.name.removeprefix('sem.').removesuffix('_mutex')
        with contextlib.suppress(OSError):
            if file.name != port and any(_SHARED.glob(f'{port}*')):
                continue
            if _is_young(file):
                young.append(True)
            else:
                file.unlink()
    return any(young)


def _sweep_all() -> None:
    """Remove shared memory, also of nodes that were killed as soon as they began."""
    if sweep():
        time.sleep(_YOUNG)
        sweep()


class Watchdog:
    """The runner's side: starts the watchdog, names what to clean up, ends it."""

    def __init__(self) -> None:
        self._process = subprocess.Popen(
            [sys.executable, '-I', '-S', __file__, str(os.getpid())], stdin=subprocess.PIPE,
            text=True, start_new_session=True)

    def keep(self, what: str) -> None:
        """Add a folder, or a process as ``+PID``, to what the watchdog cleans up."""
        # it was killed: the flight continues without it
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.write(f'{what}\n')
            self._process.stdin.flush()

    def release(self) -> None:
        """End the watchdog without any clean-up."""
        with contextlib.suppress(BrokenPipeError):
            self._process.stdin.close()
        try:
            self._process.wait(2.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        if self._process.returncode:  # it was killed and has removed nothing
            _sweep_all()


def _end_suspended(runner: int) -> None:
    """Resume a suspended runner so that it ends its flight."""
    with contextlib.suppress(OSError):
        print(f'suspended for {SUSPENDED:g} s: the flight ends', file=sys.stderr, flush=True)
        os.kill(runner, signal.SIGTERM)
        os.kill(runner, signal.SIGCONT)


def _listen(runner: int) -> tuple[list[int], list[str]]:
    """Read until the runner has ended; return handles of the nodes, and the folders."""
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
            _end_suspended(runner)


def _end(handles: list[int]) -> None:
    """End nodes by SIGINT, then SIGTERM, then SIGKILL."""
    for number, seconds in ((signal.SIGINT, INTERRUPT_TIMEOUT),
                            (signal.SIGTERM, TERMINATE_TIMEOUT),
                            (signal.SIGKILL, TERMINATE_TIMEOUT)):
        for handle in handles:
            with contextlib.suppress(ProcessLookupError):
                signal.pidfd_send_signal(handle, number)
                signal.pidfd_send_signal(handle, signal.SIGCONT)
        limit = time.monotonic() + seconds
        while handles and (left := limit - time.monotonic()) > 0.0:
            gone = select.select(handles, [], [], left)[0]
            handles = [handle for handle in handles if handle not in gone]


def main() -> None:
    """Wait until the runner has ended, then end its nodes and remove its folders."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    handles, folders = _listen(int(sys.argv[1]))
    _end([handle for handle in handles if not select.select([handle], [], [], 0.0)[0]])
    for folder in folders:
        shutil.rmtree(folder, ignore_errors=True)
    _sweep_all()


if __name__ == '__main__':
    main()
