"""Child processes of a flight: started together, ended in order, never left behind."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
import contextlib
import ctypes
import gc
from importlib import import_module
import json
import multiprocessing
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import threading
import time

from ament_index_python.packages import get_package_prefix, PackageNotFoundError
from mambo_model import compiled
from mambo_model.errors import JobError

from .keeper import ASK, is_stopped, TELL

_PR_SET_PDEATHSIG, _PR_SET_NAME = 1, 15
_LIBC = ctypes.CDLL(None, use_errno=True)
_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_LOOK = 0.01  # s
_ONE = 0.3  # s within which a closing terminal sends its signals
_KILL = 5.0  # s within which the kernel ends a process
_WORKS = 0.2  # s of CPU a second: so busy a process is not hung, it closes a long bag
_LONGEST = 120.0  # s that a busy process may take to leave
_HURRIED = 1.0  # s that a recorder has after a second Ctrl-C
_HALTED = 1.0  # s for which a process may be stopped
_ENDED = re.compile(r'ended by (SIG\w+)')  # what a node says
_ENVIRONMENT = {'PYTHONUNBUFFERED': '1', 'RCUTILS_LOGGING_BUFFERED_STREAM': '0'}


class FlightError(JobError):
    """A flight cannot be flown or went wrong; the text says why in one line."""


class FlightInputError(FlightError):
    """A flight cannot be flown as asked; the text says why in one line."""

    exit_code = 2


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


def _die_with(parent: int) -> None:
    """Let the kernel interrupt this process when its parent is gone."""
    _LIBC.prctl(_PR_SET_PDEATHSIG, signal.SIGINT)
    if os.getppid() != parent:  # it was gone before that
        os.kill(os.getpid(), signal.SIGINT)


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
        super().__init__(target=_be, args=(module, arguments, write, os.getpid()))
        before = signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)  # not to our own handlers
        self.stdout = open(read, errors='replace')
        try:
            self.start()
        finally:  # where the system has no process to give, too
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            os.close(write)

    def poll(self) -> int | None:
        """Return the exit code, None while the process runs."""
        return self.exitcode

    def wait(self, seconds: float | None = None) -> int:
        """Wait for the end; return the exit code."""
        # join() waits for a pipe that the child holds open, and _be has closed all it holds
        limit = None if seconds is None else time.monotonic() + seconds
        while self.exitcode is None:
            if limit is not None and time.monotonic() >= limit:
                raise subprocess.TimeoutExpired(self.name, seconds)
            time.sleep(_LOOK)
        return self.exitcode

    def send_signal(self, number: int) -> None:
        """Send a signal to the process."""
        os.kill(self.pid, number)


def _be(module: str, arguments: list[str], output: int, parent: int) -> None:
    """Be a node: what a new process and the shell's redirections would have given it."""
    for number in _SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)
    os.setsid()
    _die_with(parent)
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
    label : str
        What messages call the node, default its name.

    """

    def __init__(self, package: str, name: str, arguments: list[str],
                 on_line: Callable[[str], None] | None = None, label: str = '') -> None:
        self.name, self.label = name, label or name
        self.lines: deque[str] = deque(maxlen=200)
        self._on_line = on_line
        self._asked = False
        self._halted_since: float | None = None
        parent, module = os.getpid(), f'{package}.{name}'
        self._process = _Copy(module, arguments) if module in _LOADED else subprocess.Popen(
            [str(executable(package, name)), *arguments], stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors='replace',
            start_new_session=True, preexec_fn=lambda: _die_with(parent),
            env={**os.environ, **_ENVIRONMENT})
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        for line in self._process.stdout:
            self.lines.append(line.rstrip())
            if self._on_line:
                with contextlib.suppress(OSError):  # the terminal is gone, the pipe is to be read
                    self._on_line(line.rstrip())

    @property
    def pid(self) -> int:
        """Return the number of the process."""
        return self._process.pid

    @property
    def halted(self) -> bool:
        """Return whether the process is stopped, and was so for a while, as often as asked."""
        if self.exit_code is not None or not is_stopped(self.pid):
            self._halted_since = None
            return False
        if self._halted_since is None:
            self._halted_since = time.monotonic()
        return time.monotonic() - self._halted_since > _HALTED

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
        self._asked = True
        self.send(signal.SIGINT)

    def resume(self) -> None:
        """Have the process go on if it is stopped."""
        if self.exit_code is None:
            self._process.send_signal(signal.SIGCONT)

    def send(self, number: int) -> None:
        """Send a signal, which a stopped process takes too."""
        if self.exit_code is None:
            self._process.send_signal(number)
            self._process.send_signal(signal.SIGCONT)

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
        end([self], seconds)
        return self.exit_code

    def cpu(self) -> float:
        """Return the time that the process has computed, s; 0 when it has ended."""
        try:
            fields = Path(f'/proc/{self.pid}/stat').read_text().rpartition(')')[2].split()
        except OSError:
            return 0.0
        return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')

    def trouble(self, owner: bool = False) -> str:
        """
        Return what is wrong with how the process ended or stands, empty if nothing is.

        Parameters
        ----------
        owner
            Whether the node may leave without being asked.

        """
        code = self.exit_code
        if code is None:
            return f'{self.label} was stopped by SIGSTOP'
        self._reader.join(1.0)
        if code > 0:
            return f'{self.label} ended with exit code {code}: {self.complaint()}'
        if self._asked and code in (0, -signal.SIGINT):
            # a node that is interrupted while Python still loads it ends by the signal
            return ''
        if code < 0:
            how = 'did not leave when asked, ended by' if self._asked else 'was ended by'
            return f'{self.label} {how} {signal.Signals(-code).name}'
        said = [found[1] for line in self.lines if (found := _ENDED.fullmatch(line))]
        if said:
            return f'{self.label} was ended by {said[-1]}'
        return '' if owner else f'{self.label} left before the flight was over'

    def complaint(self) -> str:
        """Return the last line that tells what went wrong."""
        telling = [line for line in self.lines if line.strip() and not line.startswith('  ')]
        errors = [line for line in telling if 'ERROR' in line or 'Error' in line]
        return (errors or telling or ['no output'])[-1]


class Interrupts:
    """
    Counts Ctrl-C, SIGTERM and SIGHUP instead of dying by them.

    Attributes
    ----------
    count : int
        How many have come.
    first : signal.Signals or None
        The first of them.

    """

    def __init__(self) -> None:
        self.count, self._last = 0, -_ONE
        self.first: signal.Signals | None = None

    def __enter__(self) -> Interrupts:
        self._before = [
            (number, signal.signal(number, self._on_signal)) for number in _SIGNALS
            if signal.getsignal(number) != signal.SIG_IGN or number != signal.SIGHUP]  # nohup
        return self

    def _on_signal(self, number: int, _: object) -> None:
        now = time.monotonic()
        if now - self._last > _ONE:
            self.count += 1
        self._last = now
        self.first = self.first or signal.Signals(number)

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before:
            signal.signal(number, handler)


def watch(children: Sequence[NodeProcess], interrupts: Interrupts, owners: int = 1) -> str:
    """
    Wait until the last children, which own time, have ended, one fails or the user stops.

    Returns
    -------
    What went wrong as a phrase that begins with the node, empty if nothing did.

    """
    last = children[-owners:]
    while not interrupts.count:
        flying = any(owner.exit_code is None for owner in last)
        for child in children:
            over = child.exit_code is not None and (flying or child in last)
            if over or child.exit_code or child.halted:
                if trouble := child.trouble(owner=child in last):
                    return trouble
        if not flying:
            return ''
        time.sleep(0.02)
    return ''


def end(children: Sequence[NodeProcess], seconds: float = ASK,
        interrupts: Interrupts | None = None) -> None:
    """
    End processes together: ask, then tell, then kill what does not listen.

    Parameters
    ----------
    children
        What to end.
    seconds : s
        How long a process may take after it was asked; one that computes may take longer.
    interrupts
        Of the user: the second one kills what has not left within a second, the next at once.

    """
    heard = interrupts.count if interrupts else 0
    allowed, seconds = max(1, heard), min(seconds, _HURRIED) if heard > 1 else seconds

    def wait(limit: float) -> list[NodeProcess]:
        """Return what has not left."""
        began = now = time.monotonic()
        before = {id(child): child.cpu() for child in children}
        while left := [child for child in children if child.exit_code is None]:
            if interrupts and interrupts.count > allowed:
                break
            now = time.monotonic()
            if now - began > limit:
                worked = [child.cpu() - before[id(child)] > _WORKS * limit for child in left]
                if limit <= 0.0 or not any(worked) or now - asked > _LONGEST:
                    break
                began, before = now, {id(child): child.cpu() for child in children}
            time.sleep(_LOOK)
        return left

    asked = time.monotonic()
    for child in children:
        child.interrupt()
    for child in wait(seconds):
        child.send(signal.SIGTERM)
    for child in wait(min(seconds, TELL)):
        child.send(signal.SIGKILL)
    for child in children:
        child.wait(_KILL)
