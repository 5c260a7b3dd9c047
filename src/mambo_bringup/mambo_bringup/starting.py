"""
Start a command so that a signal prints one line at any moment.

Python imports for seconds before a command begins and takes a moment to exit after it has ended;
at these times Ctrl-C would print a traceback, and SIGTERM or SIGHUP nothing. ``./run`` and
``./mambo`` therefore start by ``tools/start``, which calls :func:`main` here; this module imports
nothing slow.
"""

from __future__ import annotations

import atexit
import contextlib
from importlib import import_module
import os
import signal
import sys
import threading
import time

from mambo_bags.cli import drawing, environment
from mambo_ros.graph.ending_signals import ending

from .stopping import leave_at_once, stoppable

_THREADS = 5.0  # s that threads of a user's code may take to end after the command


def run(module: str) -> int:
    """
    Return what :func:`main` returns, and end the process before Python takes itself down.

    With a compiler loaded that takes half a second, in which a signal would be lost. What is
    registered with :mod:`atexit` runs.
    """
    codes: list[int] = []
    atexit.register(_leave, codes)  # the first that is registered runs last
    codes.append(main(module))
    return codes[0]


def _leave(codes: list[int]) -> None:
    """End the process with the code, if there is one and all output can be written."""
    try:
        sys.stdout.flush()
        sys.stderr.flush()
    except (OSError, ValueError, AttributeError):
        return
    if codes:
        os._exit(codes[0])


def main(module: str) -> int:
    """Load ``run`` or ``mambo``, run its ``main`` and return the exit code."""
    for number in ending():  # before and after the command
        signal.signal(number, leave_at_once(module))
    signal.pthread_sigmask(signal.SIG_UNBLOCK, (signal.SIGINT,))  # held back by tools/start
    try:
        os.getcwd()
    except OSError as error:  # a package that is loaded below asks for it
        sys.stderr.write(f'{module}: the current folder cannot be used ({error.strerror}): change '
                         'to another one\n')
        return 1
    if wrong := environment.complaint(ros=module == 'run'):
        sys.stderr.write(f'{module}: {wrong}\n')
        return 2
    try:
        drawing.draw_files_only()
        command = import_module(f'.{module}', __package__)
        code = stoppable(module, command.main)
    except (ImportError, MemoryError, OSError) as error:  # while a library is loaded
        text = str(error).partition('\n')[0] or 'out of memory'
        if isinstance(error, ImportError) and 'shared object' not in text:
            raise
        hint = ': source env.bash again in this shell, which sets LD_LIBRARY_PATH'
        sys.stderr.write(f'{module}: {text}{hint if "No such file" in text else ""}\n')
        return 1
    _end_threads(module, code)
    return code


def _end_threads(module: str, code: int) -> None:
    """Wait for other threads, as Python would; exit with the code if they do not end."""
    until = time.monotonic() + _THREADS
    threads = [thread for thread in threading.enumerate()
               if thread is not threading.main_thread() and not thread.daemon]
    for thread in threads:
        thread.join(max(until - time.monotonic(), 0.0))
    if any(thread.is_alive() for thread in threads):
        with contextlib.suppress(OSError, ValueError, AttributeError):
            sys.stderr.write(f'{module}: a thread was still running and was ended\n')
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


if __name__ == '__main__':
    chosen = sys.argv.pop(1)
    sys.exit(run(chosen))
