"""What a machine may run out of, and how a command is made to lack it."""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import dataclasses
import os
from pathlib import Path
import random
import shutil
from typing import NamedTuple

NEVER = r'(?!)'
"""Cause of a scarcity that no command may fail for."""
_USERS = (20_000, 60_000)  # numbers of users that nobody is


class Place(NamedTuple):
    """Folders of one attempt."""

    root: Path
    out: Path    # of what the command makes
    tmp: Path    # TMPDIR
    home: Path   # HOME
    cache: Path  # MAMBO_CACHE_DIR, where it is not that of the checkout


@dataclasses.dataclass
class Scarcity:
    """
    What a command lacks.

    Attributes
    ----------
    cause
        Regular expression: what the one line of a failed command must say.
    mounts
        Shell commands in the private mount namespace of the command.
    network
        Whether the network interfaces of the machine are there.
    environment
        Variables to set; None: to unset.
    limits
        Command line in front of the command.
    streams
        Redirections of the shell.
    reader
        Whether anybody reads stdout.
    during
        Called while the command runs, with the root of its files.
    after : s
        From the start of the command until then.
    prepare
        Called before the command, with the folder of compiled code of the checkout.
    user
        Number of the user that the command runs as; 0: the present one.
    private
        Whether namespaces leave the scarcity as it is: in its own, a user may write everywhere.

    """

    cause: str
    mounts: tuple[str, ...] = ()
    network: bool = True
    environment: dict[str, str | None] = dataclasses.field(default_factory=dict)
    limits: tuple[str, ...] = ()
    streams: str = ''
    reader: bool = True
    during: Callable[[Path], None] | None = None
    after: float = 0.0
    prepare: Callable[[Path], None] = lambda compiled: None
    user: int = 0
    private: bool = True


def below(root: Path, path: Path) -> Path:
    """Return where an absolute path is below a root."""
    return root / str(path).lstrip('/')


def _sizes(rng: random.Random, low: float, high: float) -> int:
    """Return a size in kB whose logarithm is uniform."""
    return round(low * (high / low) ** rng.random())


def _own_cache(place: Place) -> dict[str, str | None]:
    """Return the variables that env.bash sets for a user who may not write into the checkout."""
    return {'MAMBO_CACHE_DIR': str(place.cache), 'MPLCONFIGDIR': str(place.cache / 'matplotlib'),
            'ROS_LOG_DIR': str(place.cache / 'ros-log')}


def _tmpfs(folder: Path | str, size: int) -> tuple[str, ...]:
    return (f"mount -t tmpfs -o size={size}k,mode=1777 tmpfs '{folder}'",)


def _read_only(folder: Path) -> tuple[str, ...]:
    return (f"mount -t tmpfs -o ro,mode=1777 tmpfs '{folder}'",)


def full_disk(rng: random.Random, place: Place) -> Scarcity:
    """Limit the disk of the output."""
    return Scarcity('No space left', _tmpfs(place.out, _sizes(rng, 4, 2000)))


def filling_disk(rng: random.Random, place: Place) -> Scarcity:
    """Let another program fill the disk of the output meanwhile."""
    def fill(root: Path) -> None:
        with contextlib.suppress(OSError), (below(root, place.out) / 'filler').open('wb') as file:
            while True:
                file.write(bytes(1 << 16))
                file.flush()
    return Scarcity('No space left', _tmpfs(place.out, 40_000), during=fill,
                    after=rng.uniform(0.5, 8.0))


def read_only(rng: random.Random, place: Place) -> Scarcity:
    """Make the folder of the output one of a read-only file system."""
    return Scarcity('Read-only file system', _read_only(place.out))


def forbidden(rng: random.Random, place: Place) -> Scarcity:
    """Take the permission to write into the folder of the output."""
    def prepare(compiled: Path) -> None:
        if not os.geteuid():
            shutil.copytree(compiled, place.cache / compiled.name)
        place.out.chmod(0o555)
    if os.geteuid():
        return Scarcity('Permission denied', prepare=prepare, private=False)
    return Scarcity('Permission denied', prepare=prepare, user=rng.randint(*_USERS),
                    environment={**_own_cache(place), 'HOME': None})


def removed(rng: random.Random, place: Place) -> Scarcity:
    """Remove the folder of the output meanwhile."""
    return Scarcity(
        'No such file|was removed|is not there', after=rng.uniform(0.5, 8.0),
        during=lambda root: shutil.rmtree(below(root, place.out), ignore_errors=True))


def temporary(rng: random.Random, place: Place) -> Scarcity:
    """Make the folder for temporary files full, missing, or read-only."""
    kind = rng.choice(('full', 'missing', 'read-only'))
    if kind == 'missing':
        return Scarcity('temporary|TMPDIR', environment={'TMPDIR': str(place.tmp / 'none')})
    mounts = _tmpfs(place.tmp, _sizes(rng, 4, 500)) if kind == 'full' else _read_only(place.tmp)
    return Scarcity('temporary|TMPDIR|No space left|Read-only', mounts)


def home(rng: random.Random, place: Place) -> Scarcity:
    """Make the home folder missing, unset, or read-only, and let nothing else be given."""
    kind = rng.choice(('missing', 'unset', 'read-only'))
    values = {'missing': str(place.home / 'none'), 'unset': None, 'read-only': str(place.home)}
    mounts = _read_only(place.home) if kind == 'read-only' else ()
    return Scarcity('ROS_LOG_DIR', mounts, environment={
        'HOME': values[kind], 'MPLCONFIGDIR': None, 'ROS_LOG_DIR': None})


def shared_memory(rng: random.Random, place: Place) -> Scarcity:
    """Limit the shared memory."""
    return Scarcity(r'shared memory|/dev/shm|No space left', _tmpfs(
        '/dev/shm', _sizes(rng, 64, 4096)))


def open_files(rng: random.Random, place: Place) -> Scarcity:
    """Limit the number of open files."""
    count = rng.choice((rng.randint(10, 40), rng.randint(10, 200)))
    return Scarcity('Too many open files|open files', limits=('prlimit', f'--nofile={count}'))


def memory(rng: random.Random, place: Place) -> Scarcity:
    """Limit the address space of each process."""
    size = _sizes(rng, 400_000, 2_500_000)
    return Scarcity('memory', limits=('prlimit', f'--as={size * 1000}'))


def file_size(rng: random.Random, place: Place) -> Scarcity:
    """Limit the size of a file."""
    size = _sizes(rng, 16, 2000)
    return Scarcity('File too large', limits=('prlimit', f'--fsize={size * 1000}'))


def many_processes(rng: random.Random, place: Place) -> Scarcity:
    """Limit the number of processes and threads of a user without any other."""
    count = rng.randint(1, 60)
    return Scarcity(
        'process|thread|temporarily unavailable', limits=('prlimit', f'--nproc={count}'),
        user=rng.randint(*_USERS), environment=_own_cache(place),
        prepare=lambda compiled: shutil.copytree(compiled, place.cache / compiled.name) and None)


def full_output(rng: random.Random, place: Place) -> Scarcity:
    """Let stdout, stderr or both go to a device that is full."""
    return Scarcity('No space left', streams=rng.choice(
        ('>/dev/full', '2>/dev/full', '>/dev/full 2>/dev/full')))


def closed_streams(rng: random.Random, place: Place) -> Scarcity:
    """Close one or all of stdin, stdout and stderr."""
    return Scarcity('output', streams=rng.choice(('<&-', '>&-', '2>&-', '<&- >&- 2>&-')))


def no_reader(rng: random.Random, place: Place) -> Scarcity:
    """Let the reader of stdout be gone."""
    return Scarcity('output', reader=False)


def no_network(rng: random.Random, place: Place) -> Scarcity:
    """Take every network interface."""
    return Scarcity('loopback|network|Network', network=False)


def slow(rng: random.Random, place: Place) -> Scarcity:
    """Give one processor, the lowest priority, or both."""
    one = ('taskset', '-c', str(min(os.sched_getaffinity(0))))
    low = ('nice', '-n', '19')
    return Scarcity(NEVER, limits=rng.choice((one, low, one + low)))


def no_cache(rng: random.Random, place: Place) -> Scarcity:
    """Make the folder of compiled code missing, read-only, or one of a full disk."""
    kind = rng.choice(('missing', 'read-only', 'full'))
    given = {'MAMBO_CACHE_DIR': str(place.cache / ('none' if kind == 'missing' else ''))}
    mounts = {'missing': (), 'read-only': _read_only(place.cache),
              'full': _tmpfs(place.cache, _sizes(rng, 4, 4000))}[kind]
    return Scarcity('No space left' if kind == 'full' else NEVER, mounts, environment=given)


def damaged_cache(rng: random.Random, place: Place) -> Scarcity:
    """Damage files of compiled code: they are cut, or some or all of their bytes are others."""
    def prepare(compiled: Path) -> None:
        folder = Path(shutil.copytree(compiled, place.cache / compiled.name))
        files = sorted(path for path in folder.rglob('*') if path.is_file())
        for path in rng.sample(files, max(1, round(len(files) * share))):
            data = path.read_bytes()
            at = rng.randrange(max(1, len(data)))
            path.write_bytes({
                'cut': data[:at], 'zero': bytes(len(data)),
                'random': rng.randbytes(len(data)),
                'one byte': data[:at] + rng.randbytes(1) + data[at + 1:],
            }[rng.choice(('cut', 'zero', 'random', 'one byte'))])
    share = rng.choice((0.02, 0.3, 1.0))
    return Scarcity(NEVER, prepare=prepare, environment={'MAMBO_CACHE_DIR': str(place.cache)})


SCARCITIES: dict[str, Callable[[random.Random, Place], Scarcity]] = {
    'full disk': full_disk, 'filling disk': filling_disk, 'read-only disk': read_only,
    'no permission': forbidden, 'removed folder': removed, 'temporary files': temporary,
    'home folder': home, 'shared memory': shared_memory, 'open files': open_files,
    'memory': memory, 'file size': file_size, 'processes': many_processes,
    'full output': full_output, 'closed streams': closed_streams, 'no reader': no_reader,
    'no network': no_network, 'slow machine': slow, 'no cache': no_cache,
    'damaged cache': damaged_cache}
"""By the name in the table."""
MOUNTED = ('full disk', 'filling disk', 'read-only disk', 'temporary files', 'home folder',
           'shared memory', 'no network', 'no cache')
"""Those that need namespaces of their own."""
OF_OUTPUT = ('full disk', 'filling disk', 'read-only disk', 'no permission', 'removed folder',
             'file size')
"""Those that only a command notices that makes files."""
AS_ROOT = ('processes',)
"""Those that need another user, whom only root can be."""
