"""Child processes of a flight: started together, ended in order, never left behind."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
import ctypes
import gc
from importlib import import_module
import json
import multiprocessing
import os
from pathlib import Path
import signal
import subprocess
import sys
import threading
import time

from ament_index_python.packages import get_package_prefix, PackageNotFoundError
from mambo_model import compiled

_PR_SET_PDEATHSIG, _PR_SET_NAME = 1, 15
_LIBC = ctypes.CDLL(None, use_errno=True)
_ENVIRONMENT = {'PYTHONUNBUFFERED': '1', 'RCUTILS_LOGGING_BUFFERED_STREAM': '0'}


class FlightError(RuntimeError):
    """A flight cannot be flown or went wrong; the text says why in one line."""


def executable(package: str, name: str) -> Path:
    """
    Return the path of an installed node.

    Raises
    ------
    FlightError
        If it is not installed.

    """
    try:
        path = Path(get_package_prefix(package)) / 'lib' / package / name
    except PackageNotFoundError:
        path = None
    if path is None or not path.is_file():
        raise FlightError(
            f'{package} {name} is not installed: run colcon build, then source env.bash')
    return path


def parameter(name: str, text: str | Path) -> list[str]:
    """Return the arguments that give a node a text as it is, whatever YAML would make of it."""
    return ['-p', f'{name}:={json.dumps(str(text), ensure_ascii=False)}']


def _die_with_parent() -> None:
    """Let the kernel interrupt this process when its parent is gone."""
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGINT)


_FORK = multiprocessing.get_context('fork')
_LOADED = set[str]()  # modules of nodes that a copy of this process can run


def load(modules: Iterable[str]) -> None:
    """
    Load nodes, so that each begins as a copy of this process instead of loading Python again.

    Copies share the memory of what was loaded before them. A process that has ROS already is
    left alone: it may have threads of the middleware, which a copy lacks.
    """
    if 'rclpy' in sys.modules:
        return
    for module in modules:
        import_module(module)
        _LOADED.add(module)
    sys.modules['scipy.linalg.cython_blas'] = None  # our compiled code has no linear algebra
    compiled.hold(None, None, None)  # what numba loads for its first function, without scipy's
    del sys.modules['scipy.linalg.cython_blas']
    gc.collect()
    gc.freeze()  # nor does the collector touch what the copies share


class _Copy(_FORK.Process):
    """A node as a copy of this process that has loaded it, to be used as ``Popen``."""

    def __init__(self, module: str, arguments: list[str]) -> None:
        read, write = os.pipe()
        super().__init__(target=_be, args=(module, arguments, write))
        self.start()
        os.close(write)
        self.stdout = open(read, errors='replace')

    def poll(self) -> int | None:
        """Return the exit code, None while the process runs."""
        return self.exitcode

    def wait(self, seconds: float | None = None) -> int:
        """Wait for the end; return the exit code."""
        self.join(seconds)
        if self.exitcode is None:
            raise subprocess.TimeoutExpired(self.name, seconds)
        return self.exitcode

    def send_signal(self, number: int) -> None:
        """Send a signal to the process."""
        os.kill(self.pid, number)


def _be(module: str, arguments: list[str], output: int) -> None:
    """Be a node: what a new process and the shell's redirections would have given it."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    os.setsid()
    _die_with_parent()
    name = module.rpartition('.')[2]
    _LIBC.prctl(_PR_SET_NAME, name.encode())
    for number, stream in enumerate((os.open(os.devnull, os.O_RDONLY), output, output)):
        os.dup2(stream, number)
    os.closerange(3, os.sysconf('SC_OPEN_MAX'))
    sys.stdout.reconfigure(line_buffering=True)
    os.environ.update(_ENVIRONMENT)
    sys.argv = [name, *arguments]
    sys.modules[module].main()


class NodeProcess:
    """
    One node as a process.

    Parameters
    ----------
    package, name : str
        What to start.
    arguments : list[str]
        After the executable.
    on_line : callable
        Gets each line that the node prints, from a thread.

    """

    def __init__(self, package: str, name: str, arguments: list[str],
                 on_line: Callable[[str], None] | None = None) -> None:
        self.name = name
        self.lines: deque[str] = deque(maxlen=200)
        self._on_line = on_line
        module = f'{package}.{name}'
        self._process = _Copy(module, arguments) if module in _LOADED else subprocess.Popen(
            [str(executable(package, name)), *arguments], stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors='replace',
            start_new_session=True, preexec_fn=_die_with_parent,
            env={**os.environ, **_ENVIRONMENT})
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        for line in self._process.stdout:
            self.lines.append(line.rstrip())
            if self._on_line:
                self._on_line(line.rstrip())

    @property
    def exit_code(self) -> int | None:
        """Return the exit code, None while the process runs."""
        return self._process.poll()

    def hurry(self) -> None:
        """Have the scheduler prefer this process to others, where the user may ask for that."""
        try:
            for thread in os.listdir(f'/proc/{self._process.pid}/task'):
                os.sched_setscheduler(int(thread), os.SCHED_RR, os.sched_param(1))
        except OSError:  # not allowed, or it has just ended
            pass

    def interrupt(self) -> None:
        """Ask the process to finish."""
        if self.exit_code is None:
            self._process.send_signal(signal.SIGINT)

    def wait(self, seconds: float) -> int | None:
        """Wait for the end; return the exit code, None if it has not come."""
        try:
            code = self._process.wait(seconds)
        except subprocess.TimeoutExpired:
            return None
        self._reader.join(1.0)
        return code

    def end(self, seconds: float) -> int:
        """Interrupt, wait, and kill what does not listen; return the exit code."""
        self.interrupt()
        code = self.wait(seconds)
        if code is None:
            self._process.kill()
            code = self._process.wait()
        return code

    def complaint(self) -> str:
        """Return the last line that tells what went wrong."""
        telling = [line for line in self.lines if line.strip() and not line.startswith('  ')]
        errors = [line for line in telling if 'ERROR' in line or 'Error' in line]
        return (errors or telling or ['no output'])[-1]


class Interrupts:
    """Counts Ctrl-C and SIGTERM instead of dying by them."""

    def __init__(self) -> None:
        self.count = 0

    def __enter__(self) -> Interrupts:
        self._before = [
            (number, signal.signal(number, self._on_signal))
            for number in (signal.SIGINT, signal.SIGTERM)]
        return self

    def _on_signal(self, *_) -> None:
        self.count += 1

    def __exit__(self, *_) -> None:
        for number, handler in self._before:
            signal.signal(number, handler)


def watch(children: list[NodeProcess], interrupts: Interrupts, owners: int = 1) -> None:
    """Wait until the last children, which own time, have ended, one died or the user stops."""
    others, last = children[:-owners], children[-owners:]
    while any(owner.exit_code is None for owner in last):
        if interrupts.count:
            for owner in last:
                owner.interrupt()
            for owner in last:
                owner.wait(20.0)
            return
        if any(child.exit_code is not None for child in others) or any(
                owner.exit_code for owner in last):
            return
        time.sleep(0.02)
