"""
A time limit on the exit of a process that depends on neither Python nor the middleware.

Fast DDS can deadlock while it destroys its entities, and rclpy then holds Python's lock: no
thread, signal handler or exit handler of Python runs any more. A timer of the C library does.
"""

from __future__ import annotations

import ctypes
import time

_SIGEV_THREAD = 2
_LIBC = ctypes.CDLL(None, use_errno=True)


class _SigEvent(ctypes.Structure):
    """``struct sigevent`` of 64-bit Linux."""

    _fields_ = (
        ('value', ctypes.c_ssize_t), ('signo', ctypes.c_int), ('notify', ctypes.c_int),
        ('function', ctypes.c_void_p), ('attributes', ctypes.c_void_p),
        ('_rest', ctypes.c_byte * 32))


class _TimerSpec(ctypes.Structure):
    """``struct itimerspec`` of 64-bit Linux."""

    _fields_ = (('interval', ctypes.c_long * 2), ('value', ctypes.c_long * 2))


def exit_after(seconds: float, code: int) -> None:
    """
    Have the C library end this process with ``_exit`` after ``seconds``, even if it hangs.

    Parameters
    ----------
    seconds : s
        Wall time.
    code : int
        Exit code, 0 to 255.

    Raises
    ------
    OSError
        If the system provides no timer.

    """
    ending = ctypes.cast(_LIBC._exit, ctypes.c_void_p).value
    event = _SigEvent(value=code, notify=_SIGEV_THREAD, function=ending)
    timer = ctypes.c_void_p()
    if _LIBC.timer_create(time.CLOCK_MONOTONIC, ctypes.byref(event), ctypes.byref(timer)):
        raise OSError(ctypes.get_errno(), 'timer_create')
    whole, part = divmod(round(seconds * 1e9), 1_000_000_000)
    spec = _TimerSpec(value=(whole, part))
    if _LIBC.timer_settime(timer, 0, ctypes.byref(spec), None):
        raise OSError(ctypes.get_errno(), 'timer_settime')
