"""Signals of the user at a command line tool become one line and an exit code."""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import signal
import sys


def _stop(number: int, _: object) -> None:
    raise KeyboardInterrupt(signal.Signals(number))


def stoppable(name: str, work: Callable[[], int]) -> int:
    """
    Run a tool that SIGINT, SIGTERM and SIGHUP end; return its exit code.

    The exit code is that of ``work``, or 128 plus the number of the signal, as of a shell, behind
    one line on stderr that begins with the name of the tool.
    """
    before = [
        (number, signal.signal(number, _stop))
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN]  # nohup
    try:
        return work()
    except KeyboardInterrupt as stop:
        (number,) = stop.args or (signal.SIGINT,)
        with contextlib.suppress(OSError):
            print(f'{name}: ended by {number.name}', file=sys.stderr)
        return 128 + number
    finally:
        for number, handler in before:
            signal.signal(number, handler)
