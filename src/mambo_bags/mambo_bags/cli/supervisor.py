"""
Notice when a user's code ends a command without a word.

A component of a user runs in the process of the command. It may end that process (``os._exit``)
or crash it (a segmentation fault in a library), and then nobody is left to say so. Before the
first code of a user is loaded, the process therefore forks. The copy continues with the command.
The original waits, passes signals on, and exits as the copy did. A copy that does not answer a
signal, as its code is stuck in a library, is killed, and so is one that is stopped while the
original is not. If the copy ended before the command did, the original raises an error, which
becomes one line and exit code 1, and the clean-up of whatever the original had begun is done.
"""

from __future__ import annotations

import contextlib
import mmap
import os
from pathlib import Path
import select
import signal
import sys
import threading
import time
from typing import NoReturn
import warnings

from mambo_model.errors import JobError
from mambo_ros.graph.ending_signals import SIGNALS

from .parent_end import end_with

_DELAY = 0.05  # s: the terminal sends Ctrl-C to the copy, too, which counts it within this time

_DEAF = 10.0  # s that the copy may take to answer a signal
_HURRY = 1.0  # s, likewise, to answer the second one
_LOOK = 1.0  # s between two looks whether the copy is stopped
_HALTED = 3  # looks in a row at which it is; Ctrl-Z stops the original, too

_copy = 0  # number of the process that continues with the command; 0: nothing was split
_notes = mmap.mmap(-1, signal.NSIG)  # shared: signals that the copy has handled, by number
_ENDED = 0  # index of the note that the command has ended


def enable() -> None:
    """Fork this process before a user's code is loaded; it must run one command only."""
    from mambo_model import own_file  # slow to import: a command that starts does without
    own_file.before_loading = _split


def is_command(pid: int) -> bool:
    """Return whether a process is the copy that continues with the command."""
    return pid == _copy


def handled(number: int) -> None:
    """Note that the command has handled a signal, which it then need not be sent again."""
    _notes[number] = min(_notes[number] + 1, 255)


def ended() -> None:
    """Note that the command has ended by itself and has printed what there was to say."""
    _notes[_ENDED] = 1


def _split(path: Path) -> None:
    """Fork; return in the copy. The original exits as the copy, or raises JobError."""
    global _copy
    from mambo_model import own_file
    own_file.before_loading = own_file.nothing
    if threading.current_thread() is not threading.main_thread():
        return
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, AttributeError):
            stream.flush()  # or both would write it
    original = os.getpid()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    with warnings.catch_warnings():
        warnings.simplefilter('ignore', DeprecationWarning)  # the copy needs no other thread
        child = os.fork()
    if not child:
        _copy = os.getpid()
        end_with(original)
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
        return
    status, unanswered = _status_of(child, before)
    if unanswered:
        raise KeyboardInterrupt(unanswered)  # one line and the exit code, as of any command
    _exit_as(status, path)


def _status_of(
    child: int, mask: set[signal.Signals],
) -> tuple[int, signal.Signals | None]:
    """
    Wait for a child and pass signals on to it; kill it if it does not answer one.

    Returns
    -------
    status
        Its exit code, negative for a signal; that of SIGSTOP if it was stopped, and killed.
    unanswered
        The signal for which it was killed, or at which it crashed.

    """
    # a signal may come to any thread, so it is read from a pipe that Python's handler writes
    read, write = os.pipe2(os.O_NONBLOCK | os.O_CLOEXEC)
    signal.set_wakeup_fd(write, warn_on_full_buffer=False)
    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, lambda *_: None)
    signal.pthread_sigmask(signal.SIG_SETMASK, mask)
    handle = os.pidfd_open(child)
    seen = [0] * signal.NSIG
    latest: signal.Signals | None = None
    waiting: signal.Signals | None = None  # for an answer to this signal, until the time below
    until, halted = 0.0, 0
    while True:
        left = max(until - time.monotonic(), 0.0) if waiting else _LOOK
        ready = select.select([handle, read], [], [], left)[0]
        numbers = os.read(read, 256) if read in ready else b''
        if numbers:
            latest = signal.Signals(numbers[-1])
        if handle in ready:
            code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
            if code < 0 and select.select([read], [], [], _DELAY)[0]:
                # of the terminal, whose signal came to the child first
                latest = signal.Signals(os.read(read, 256)[-1])
            return code, latest if code < 0 and -code not in SIGNALS else None
        for number in numbers:
            seen[number] += 1
            if select.select([handle], [], [], _DELAY)[0] or _notes[number] >= seen[number]:
                continue
            os.kill(child, number)
            latest_answer = time.monotonic() + (_DEAF if sum(seen) == 1 else _HURRY)
            until = min(until, latest_answer) if waiting else latest_answer
            waiting = signal.Signals(number)
        halted = halted + 1 if not ready and _is_stopped(child) else 0
        if halted == _HALTED:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return -signal.SIGSTOP, None
        if waiting and _notes[waiting] >= seen[waiting]:
            waiting = None
        elif waiting and time.monotonic() >= until:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return -signal.SIGKILL, waiting


def _is_stopped(child: int) -> bool:
    """Return whether a child is stopped by a signal."""
    return os.waitid(os.P_PID, child, os.WSTOPPED | os.WNOHANG | os.WNOWAIT) is not None


def _exit_as(code: int, path: Path) -> NoReturn:
    """End this process as its copy ended; JobError if the copy did not end by itself."""
    signal.set_wakeup_fd(-1)
    if code >= 0 and (_notes[_ENDED] or code - 128 in SIGNALS and _notes[code - 128]):
        os._exit(code)  # also of a signal that the command has answered by its line
    if -code in SIGNALS:  # no handler for it, as if there were one process
        signal.signal(-code, signal.SIG_DFL)
        os.kill(os.getpid(), -code)
    how = (f'exit code {code}' if code >= 0 else
           f'{signal.Signals(-code).name}, {signal.strsignal(-code)}')
    raise JobError(f'{path}: this file, or code that it calls, ended the command ({how}) before '
                   'its result was written; it must return or raise an error')
