"""
Third-party readers of untrusted files, run in a process with limited memory and time.

On a damaged file the reader of MATLAB files may raise anything, allocate any amount of memory or
run for ever, and it is compiled: only a separate process can be ended reliably.
"""

from __future__ import annotations

from collections.abc import Callable
import faulthandler
import gc
import multiprocessing
from multiprocessing.connection import Connection
import os
from pathlib import Path
import resource
from typing import Any
import warnings

from mambo_model import limits
from mambo_model.errors import MamboError

LONGEST, MOST = 120, 1000  # characters of a reason by a reader, and of one of our own
_COPIES = 1.75  # of the most that may be unpacked: below 1 GB in all, unless the file is large
_FORK = multiprocessing.get_context('fork')


class UnreadableError(MamboError, ValueError):
    """A file cannot be read; the message says why."""


def call(function: Callable[[Path], Any], path: Path) -> Any:
    """
    Call a function with a file in a separate process and return its result.

    Parameters
    ----------
    function
        What it returns must be picklable.
    path
        Of the file. The process may take ``MAMBO_MAX_UNPACKED_MB`` (default 512) or 20 times its
        size, whichever is more, 1.75 times, and ``MAMBO_MAX_READING_S`` (120).

    Raises
    ------
    UnreadableError
        If the function raises anything but OSError, takes too much or too long, or crashes.
    mambo_model.schema.ParameterError
        If the path is a pipe, a device or a file of the kernel.
    OSError
        As the function.

    """
    limits.check_regular(path)
    limits.UNPACKED_MB.value()  # raised here if it is no number
    seconds = limits.READING_S.value()
    receive, send = _FORK.Pipe(duplex=False)
    process = _FORK.Process(target=_work, args=(function, path, send), daemon=True)
    _start(process)
    send.close()
    try:
        if not receive.poll(seconds):
            raise UnreadableError(f'reading it took more than {seconds} s; '
                                  f'{limits.raised_by(limits.READING_S)}')
        result, error = receive.recv()
    except EOFError:
        process.join()
        raise UnreadableError('it makes its reader crash') from None
    finally:
        process.kill()
        process.join()
        receive.close()
    if error is not None:
        raise error
    return result


def _start(process: multiprocessing.process.BaseProcess) -> None:
    """Start a process that collects no garbage before its function begins."""
    collects = gc.isenabled()
    gc.disable()
    try:
        process.start()
    finally:
        if collects:
            gc.enable()


def _work(function: Callable[[Path], Any], path: Path, send: Connection) -> None:
    """Call the function within bounds and send what it returns or raises."""
    gc.freeze()  # what is garbage here, such as nodes of ROS, is the caller's to destroy
    gc.enable()
    warnings.simplefilter('ignore')  # of what is damaged; the caller gets one line
    faulthandler.disable()  # a reader that crashes says so at length
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    own = int(Path('/proc/self/statm').read_text().split()[0]) * os.sysconf('SC_PAGE_SIZE')
    try:
        room = own + int(_COPIES * limits.unpacked(path.stat().st_size))
        _, hard = resource.getrlimit(resource.RLIMIT_AS)
        room = room if hard == resource.RLIM_INFINITY else min(room, hard)
        resource.setrlimit(resource.RLIMIT_AS, (room, hard))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        send.send((function(path), None))
    except OSError as error:
        send.send((None, error))
    except MemoryError:
        send.send((None, UnreadableError(
            f'it needs more memory than allowed; {limits.raised_by(limits.UNPACKED_MB)}')))
    except UnicodeDecodeError as error:
        send.send((None, UnreadableError(
            f'byte {error.start} is no text in UTF-8: save it in this encoding')))
    except Exception as error:  # readers of damaged bytes raise anything
        # those of our own are long, if they list names
        most = MOST if isinstance(error, ValueError) else LONGEST
        reason = ' '.join(str(error).split())[:most] or 'its content is damaged'
        send.send((None, UnreadableError(reason)))
