"""A process that ends with the one that started it, however that one ends."""

from __future__ import annotations

from contextlib import suppress
import ctypes
import os
import signal

LIBC = ctypes.CDLL(None)
_PR_SET_PDEATHSIG = 1  # of Linux: the signal that a process gets when its parent ends


def end_with(parent: int, number: signal.Signals = signal.SIGKILL) -> None:
    """
    Have the kernel send this process a signal when its parent ends; now, if it has ended already.

    Parameters
    ----------
    parent
        Number of the process that started this one, taken before the start.
    number
        The signal.

    """
    with suppress(AttributeError):  # not Linux
        LIBC.prctl(_PR_SET_PDEATHSIG, number)
    if os.getppid() != parent:
        os.kill(os.getpid(), number)
