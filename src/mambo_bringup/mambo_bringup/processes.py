"""Child processes of a flight: start them together and end them in order."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Sequence
import contextlib
import gc
from importlib import import_module
import json
import math
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
from mambo_bags.cli.environment import low_limits
from mambo_bags.cli.parent_end import end_with, LIBC
from mambo_model import compiled
from mambo_model.errors import JobError, readable
from mambo_model.whole_file import refuse_existing
from mambo_ros.graph.ending_signals import ending, SIGNALS

from .watchdog import INTERRUPT_TIMEOUT, is_stopped, TERMINATE_TIMEOUT

_PR_SET_NAME = 15
_LOOK = 0.01  # s
_ONE = 0.3  # s within which a closing terminal sends its signals
_KILL = 5.0  # s within which the kernel ends a process
_WORKS = 0.2  # s of CPU per second; a process this busy does not hang but closes a long bag
_LONGEST = 120.0  # s that a busy process may take to exit
_HURRIED = 1.0  # s that a recorder has after a second Ctrl-C
_HALTED = 1.0  # s for which a process may be stopped
_LINE = 1 << 16  # most characters of a line that a node prints; a longer one is taken in parts
_ENDED = re.compile(r'ended by (SIG\w+)')  # printed by a node
_REFUSAL = re.compile(r'\b\w+_node: .*')  # printed by a node, perhaps within another line
_LOGGED = re.compile(r'\[(?:ERROR|FATAL)\] \[[\d.]+\] \[([\w.]+)\]: ')  # before a logged message
_COLOUR = '\x1b['  # is in every line that the middleware prints
_ENVIRONMENT = {  # lines are read as they are written, whatever the user's own nodes log like
    'PYTHONUNBUFFERED': '1', 'RCUTILS_LOGGING_BUFFERED_STREAM': '0',
    'RCUTILS_LOGGING_USE_STDOUT': '0', 'RCUTILS_COLORIZED_OUTPUT': '0',
    'RCUTILS_CONSOLE_OUTPUT_FORMAT': '[{severity}] [{time}] [{name}]: {message}'}


class FlightError(JobError):
    """A flight cannot be flown or failed; the message gives the reason in one line."""


class FlightInputError(FlightError):
    """A flight cannot be flown as specified; the message gives the reason in one line."""

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


def refuse_not_utf8(path: Path, instead: str = 'rename the file or folder') -> None:
    """
    Refuse a path that is not UTF-8, before a node is to open it: ROS has no other text.

    Parameters
    ----------
    path
        Absolute, as the node gets it.
    instead
        What the user can do.

    Raises
    ------
    FlightInputError
        If a part of it is not UTF-8.

    """
    shown = readable(str(path))
    if shown != str(path):
        raise FlightInputError(f'{shown} is not UTF-8, and no node can open it: {instead}')


def refuse_bag(bag: Path, instead: str = 'give another --output') -> None:
    """
    Refuse a bag to record that exists, or whose absolute path is not UTF-8.

    Parameters
    ----------
    bag
        Directory that a recorder will create.
    instead
        What the user can do besides removing or renaming it.

    Raises
    ------
    FlightInputError
        In one line that names it.

    """
    refuse_existing(bag, instead, FlightInputError)
    refuse_not_utf8(bag.absolute(), f'{instead}, or rename the folder')


def parameter(name: str, text: str | Path) -> list[str]:
    """Return the arguments that set a text parameter verbatim, protected from YAML parsing."""
    return ['-p', f'{name}:={json.dumps(str(text), ensure_ascii=False)}']


_FORK = multiprocessing.get_context('fork')
_LOADED = set[str]()  # modules of nodes that a copy of this process can run


def load(modules: Iterable[str]) -> bool:
    """
    Import node modules, so that each node starts as a fork of this process and not a new Python.

    Forks share the memory of the imported modules. Nothing is imported, and False returned, if
    this process uses ROS already: it may have threads of the middleware, which no fork gets.
    """
    if 'rclpy' in sys.modules:
        return False
    for module in modules:
        import_module(module)
        _LOADED.add(module)
    compiled.hold(None, None, None)  # what numba loads for its first function
    gc.collect()
    gc.freeze()  # keeps the garbage collector off the shared memory
    return True


def session(leader: int) -> list[int]:
    """Return the processes of the session of a process that have not ended."""
    found = []
    for entry in Path('/proc').glob('[0-9]*/stat'):
        with contextlib.suppress(OSError):  # it has just ended
            fields = entry.read_text(errors='replace').rpartition(')')[2].split()
            if int(fields[3]) == leader and fields[0] not in 'ZX':
                found.append(int(entry.parent.name))
    return found


class _Copy(_FORK.Process):
    """A node as a fork of this process, with the interface of ``Popen``."""

    def __init__(self, module: str, arguments: list[str]) -> None:
        read, write = os.pipe()
        super().__init__(target=_run_node, args=(module, arguments, write, os.getpid()))
        # do not run the handlers of this process
        before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
        self.stdout = open(read, encoding='utf-8', errors='replace')
        try:
            self.start()
        finally:  # also if the system refuses to fork
            signal.pthread_sigmask(signal.SIG_SETMASK, before)
            os.close(write)

    def poll(self) -> int | None:
        """Return the exit code, None while the process runs."""
        return self.exitcode

    def wait(self, seconds: float | None = None) -> int:
        """Wait for the end; return the exit code."""
        # join() waits for a pipe that the child keeps open, but _run_node has closed all of them
        limit = None if seconds is None else time.monotonic() + seconds
        while self.exitcode is None:
            if limit is not None and time.monotonic() >= limit:
                raise subprocess.TimeoutExpired(self.name, seconds)
            time.sleep(_LOOK)
        return self.exitcode

    def send_signal(self, number: int) -> None:
        """Send a signal to the process."""
        os.kill(self.pid, number)


def _run_node(module: str, arguments: list[str], output: int, parent: int) -> None:
    """Run a node in this fork, set up like a new process with redirected output."""
    for number in SIGNALS:
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
    os.setsid()
    end_with(parent, signal.SIGINT)
    name = module.rpartition('.')[2]
    LIBC.prctl(_PR_SET_NAME, name.encode())
    for number, stream in enumerate((os.open(os.devnull, os.O_RDONLY), output, output)):
        os.dup2(stream, number)
    os.closerange(3, os.sysconf('SC_OPEN_MAX'))
    # whatever they were in this process, a notebook's or a test's
    sys.stdout, sys.stderr = (
        open(number, 'w', buffering=1, encoding='utf-8', errors='backslashreplace',
             closefd=False)
        for number in (1, 2))
    os.environ.update(_ENVIRONMENT)
    sys.argv = [name, *arguments]
    sys.modules[module].main()


class NodeProcess:
    """
    One node as a process.

    Parameters
    ----------
    package, name : str
        Executable to start.
    arguments : list[str]
        Command-line arguments.
    on_line : callable
        Called from a thread with each line that the node prints.
    label : str
        Name of the node in messages; default: ``name``.
    command : list[str]
        Command line to start instead: a node of the user. It ends when all processes that it has
        started have ended, and signals go to all of them.

    Raises
    ------
    FlightError
        If it is not installed.
    FlightInputError
        If there is no such command.

    """

    def __init__(self, package: str, name: str, arguments: list[str],
                 on_line: Callable[[str], None] | None = None, label: str = '',
                 command: Sequence[str] = ()) -> None:
        self.name, self.label = name, label or name
        self.lines: deque[str] = deque(maxlen=200)
        self._on_line = on_line
        self._asked = False
        self._several = bool(command)
        self._halted_since: float | None = None
        parent, module = os.getpid(), f'{package}.{name}'
        if module in _LOADED and not command:
            self._process = _Copy(module, arguments)
        else:
            start = [*command] or [str(executable(package, name)), *arguments]
            try:
                self._process = subprocess.Popen(
                    start, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
                    stderr=subprocess.STDOUT, text=True, errors='replace',
                    start_new_session=True, preexec_fn=lambda: end_with(parent, signal.SIGINT),
                    env={**os.environ, **_ENVIRONMENT})
            except OSError as error:
                raise FlightInputError(f'{start[0]}: {error.strerror}') from None
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        for line in iter(lambda: self._process.stdout.readline(_LINE), ''):
            self.lines.append(line.rstrip())
            if self._on_line:
                with contextlib.suppress(OSError):  # the terminal is closed; keep reading the pipe
                    self._on_line(line.rstrip())

    @property
    def pid(self) -> int:
        """Return the number of the process."""
        return self._process.pid

    @property
    def halted(self) -> bool:
        """Return whether the process has been stopped for a while, over repeated calls."""
        if self.exit_code is not None or not is_stopped(self.pid):
            self._halted_since = None
            return False
        if self._halted_since is None:
            self._halted_since = time.monotonic()
        return time.monotonic() - self._halted_since > _HALTED

    @property
    def exit_code(self) -> int | None:
        """Return the exit code, None while the process runs."""
        code = self._process.poll()
        return None if code is not None and self._several and session(self.pid) else code

    def raise_priority(self) -> None:
        """Raise the priority of this process, if the user is allowed to."""
        try:
            for thread in os.listdir(f'/proc/{self._process.pid}/task'):
                os.sched_setscheduler(int(thread), os.SCHED_RR, os.sched_param(1))
        except OSError:  # not permitted, or it has just ended
            pass

    def interrupt(self) -> None:
        """Ask the process to finish."""
        self._asked = True
        self.send(signal.SIGINT)

    def resume(self) -> None:
        """Resume the process if it is stopped."""
        if self.exit_code is None:
            self._process.send_signal(signal.SIGCONT)

    def send(self, number: int) -> None:
        """Send a signal; resume the process first if it is stopped."""
        if self.exit_code is None:
            for one in session(self.pid) if self._several else [self.pid]:
                with contextlib.suppress(ProcessLookupError):
                    os.kill(one, number)
                    os.kill(one, signal.SIGCONT)

    def wait(self, seconds: float) -> int | None:
        """Wait for the end; return the exit code, None if the process still runs."""
        began = time.monotonic()
        try:
            self._process.wait(seconds)
        except subprocess.TimeoutExpired:
            return None
        while (code := self.exit_code) is None:
            if time.monotonic() - began > seconds:
                return None
            time.sleep(_LOOK)
        self._reader.join(1.0)
        return code

    def end(self, seconds: float) -> int:
        """Interrupt, wait, and kill the process if it still runs; return the exit code."""
        end([self], seconds)
        return self.exit_code

    def cpu(self) -> float:
        """Return the CPU time of the process, s; 0 after it has ended."""
        try:
            fields = Path(f'/proc/{self.pid}/stat').read_text().rpartition(')')[2].split()
        except OSError:
            return 0.0
        return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')

    def trouble(self, owner: bool = False) -> str:
        """
        Return what is wrong with the process or its end; empty if nothing is.

        Parameters
        ----------
        owner
            Whether the node may end by itself.

        """
        code = self.exit_code
        if code is None:
            return f'{self.label} was stopped by SIGSTOP'
        self._reader.join(1.0)
        if code > 0:
            return f'{self.label} ended with exit code {code}: {self.last_error()}'
        if self._asked and code in (0, -signal.SIGINT):
            # a node that is interrupted while Python still imports ends by the signal
            return ''
        if code < 0:
            how = 'did not exit when interrupted, ended by' if self._asked else 'was ended by'
            why = low_limits() if code == -signal.SIGABRT else ''  # so a library gives up
            return f'{self.label} {how} {signal.Signals(-code).name}{why}'
        signals = [found[1] for line in self.lines if (found := _ENDED.fullmatch(line))]
        if signals:
            return f'{self.label} was ended by {signals[-1]}'
        return '' if owner else self.early_end()

    def early_end(self) -> str:
        """Return the line for an end without a reason."""
        return f'{self.label} ended before the flight was over'

    def last_error(self) -> str:
        """Return the last printed line that describes the error."""
        printed = [line for line in self.lines if line.strip() and not line.startswith('  ')]
        errors = [line for line in printed if 'ERROR' in line or 'Error' in line]
        own = [line for line in errors if _COLOUR not in line] or [
            found[0] for line in printed if (found := _REFUSAL.search(line))]
        said = (own or errors or printed or ['no output'])[-1]
        if (found := _LOGGED.match(said)) is None:
            return said
        node, text = found[1].rpartition('.')[2], said[found.end():]
        return text if self.label.endswith(node) else f'{node}: {text}'


class Interrupts:
    """
    Counts SIGINT (Ctrl-C), SIGTERM and SIGHUP instead of ending the process.

    Attributes
    ----------
    count : int
        Number of signals received.
    first : signal.Signals or None
        The first signal.

    """

    def __init__(self) -> None:
        self.count, self._last = 0, -_ONE
        self.first: signal.Signals | None = None

    def __enter__(self) -> Interrupts:
        self._before = [
            (number, signal.signal(number, self._on_signal)) for number in ending()]
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


def watch(children: Sequence[NodeProcess], interrupts: Interrupts, owners: int = 1,
          late: Callable[[float], str] = lambda _: '', limit: float = math.inf,
          hung: Callable[[], str] = str) -> str:
    """
    Wait until the last children, which own time, end, any child fails, or the user stops.

    Parameters
    ----------
    children
        Processes, those that own time last.
    interrupts
        Signals of the user.
    owners
        How many own time.
    late
        Returns the label of a process whose time has not begun, '' if all have; gets the wall
        time since the start in s.
    limit : s
        Wall time until none may be late.
    hung
        Returns which process does nothing any more, and has killed it; '' if none.

    Returns
    -------
    What went wrong, beginning with the name of the node; empty if nothing did.

    """
    last = children[-owners:]
    started = time.monotonic()
    while not interrupts.count:
        flying = any(owner.exit_code is None for owner in last)
        for child in children:
            over = child.exit_code is not None and (flying or child in last)
            if over or child.exit_code or child.halted:
                if trouble := child.trouble(owner=child in last):
                    return trouble
        if not flying:
            return ''
        if trouble := hung():
            return trouble
        seconds = time.monotonic() - started
        if (waiting := late(seconds)) and seconds > limit:
            return f'{waiting} did not begin within {limit:g} s'
        time.sleep(0.02)
    return ''


def end(children: Sequence[NodeProcess], seconds: float = INTERRUPT_TIMEOUT,
        interrupts: Interrupts | None = None) -> None:
    """
    End processes together by SIGINT, then SIGTERM, then SIGKILL.

    Parameters
    ----------
    children
        Processes to end.
    seconds : s
        Time to exit after SIGINT; a busy process gets more.
    interrupts
        Signals of the user: the second kills what still runs after a second, the next at once.

    """
    heard = interrupts.count if interrupts else 0
    allowed, seconds = max(1, heard), min(seconds, _HURRIED) if heard > 1 else seconds

    def wait(limit: float) -> list[NodeProcess]:
        """Return the processes that still run."""
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
    for child in wait(min(seconds, TERMINATE_TIMEOUT)):
        child.send(signal.SIGKILL)
    for child in children:
        child.wait(_KILL)
