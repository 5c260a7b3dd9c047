"""What a flight has running, mapped and written: to see that nothing of it is left."""

from __future__ import annotations

from collections.abc import Callable, Iterable
import contextlib
import os
from pathlib import Path
import resource
import signal
import time

from mambo_bags.reader import BagError, read_bag
from mambo_bags.recover import recover
from mambo_bringup.flight.nodes import COMPOSED, FLIGHT_NODES, HALL_CAPTURE, RECORDER, SIMULATOR
from mambo_bringup.stuck import is_closed

SHARED = Path('/dev/shm')
_PAGE = resource.getpagesize()
_NAMES = tuple(name for _, name in (RECORDER, *FLIGHT_NODES, SIMULATOR, HALL_CAPTURE, COMPOSED))


def wait(condition: Callable[[], object], seconds: float) -> bool:
    """Wait until a condition holds; return whether it does."""
    limit = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > limit:
            return False
        time.sleep(0.01)
    return True


def processes(mark: str) -> dict[int, str]:
    """Return {number: name} of the living processes whose environment holds a text."""
    found = {}
    for entry in Path('/proc').iterdir():
        try:
            if entry.name.isdigit() and mark.encode() in (entry / 'environ').read_bytes():
                if (entry / 'stat').read_text().rpartition(')')[2].split()[0] != 'Z':
                    command = (entry / 'cmdline').read_text()
                    name = (entry / 'comm').read_text().strip()  # 15 characters at most
                    full = next((node for node in _NAMES if node[:15] == name), name)
                    found[int(entry.name)] = 'watchdog' if 'watchdog.py' in command else full
        except OSError:
            pass
    return found


def kill(pids: Iterable[int]) -> None:
    """Kill processes that are left."""
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)


def memory(pid: int) -> int:
    """Return the resident memory of a process in bytes; 0 if it has ended."""
    try:
        return int(Path(f'/proc/{pid}/statm').read_text().split()[1]) * _PAGE
    except OSError:
        return 0


def shared(pids: Iterable[int]) -> set[Path]:
    """Return the files of shared memory that processes have mapped."""
    found = set()
    for pid in pids:
        try:
            lines = Path(f'/proc/{pid}/maps').read_text().splitlines()
        except OSError:
            continue
        found |= {Path(line.split()[-1]) for line in lines if f'{SHARED}/' in line}
    return found


def shared_by_others(mark: str) -> set[Path]:
    """Return the files of shared memory of processes whose environment does not hold a text."""
    ours = processes(mark)
    everybody = (int(path.name) for path in Path('/proc').glob('[0-9]*'))
    return shared(pid for pid in everybody if pid not in ours)


def shared_left(files: set[Path]) -> str:
    """Return which shared memory is left and mapped by nobody, after a moment; '' if none."""
    def left() -> set[Path]:
        there = {path for path in files if path.exists()}
        everybody = (int(path.name) for path in Path('/proc').glob('[0-9]*'))
        return there and there - shared(everybody)
    return '' if wait(lambda: not left(), 3.0) else f'shared memory left: {sorted(left())}'


def folder_left(temporary: Path, seconds: float) -> str:
    """Return which temporary folder is left after so many s; '' if none."""
    empty = wait(lambda: not [x for x in temporary.iterdir() if x.is_dir()], seconds)
    return '' if empty else f'folder left: {sorted(temporary.iterdir())}'


def unreadable(bag: Path, spare: Path) -> str:
    """Return which recording in a folder cannot be read, even recovered; '' if none."""
    for file in bag.rglob('*.mcap'):
        path = file.parent
        try:
            if not is_closed(path):
                path = spare / path.name
                recover(file.parent, path)
            if not any('imu/data_raw' in name for name in read_bag(path).topics):
                return f'{file.parent} has no sensors'
        except (BagError, OSError) as error:
            return f'{file.parent} is neither closed nor recoverable: {error}'
    return ''
