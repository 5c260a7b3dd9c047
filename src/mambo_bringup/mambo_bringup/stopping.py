"""Signals of the user at a command line tool become one line and an exit code."""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import os
import signal
import sys

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def _line(name: str, number: int) -> str:
    return f'{name}: ended by {signal.Signals(number).name}\n'


def leave_at_once(name: str) -> Callable[[int, object], None]:
    """Return a handler that ends the process behind one line: there is nothing to clear away."""
    def leave(number: int, _: object) -> None:
        with contextlib.suppress(OSError):
            os.write(2, _line(name, number).encode())
        os._exit(128 + number)
    return leave


def stoppable(name: str, work: Callable[[], int]) -> int:
    """
    Run a tool that SIGINT, SIGTERM and SIGHUP end; return its exit code.

    The exit code is that of ``work``, or 128 plus the number of the signal, as of a shell, behind
    one line on stderr that begins with the name of the tool. A second signal ends the process at
    once, whatever the tool still clears away.
    """
    tool = os.getpid()

    def stop(number: int, _: object) -> None:
        """Raise KeyboardInterrupt with the signal; in a copy of the process do as without us."""
        if os.getpid() != tool:  # a copy that works for the tool: as without us
            signal.signal(number, signal.SIG_DFL if number != signal.SIGINT
                          else signal.default_int_handler)
            os.kill(os.getpid(), number)
            return
        for each, _handler in before:
            signal.signal(each, leave_at_once(name))
        raise KeyboardInterrupt(signal.Signals(number))

    before = [
        (number, signal.getsignal(number)) for number in _SIGNALS
        if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN]  # nohup
    try:
        for number, _ in before:
            signal.signal(number, stop)
        return work()
    except KeyboardInterrupt as end:
        (number,) = end.args or (signal.SIGINT,)
        with contextlib.suppress(OSError):
            sys.stderr.write(_line(name, number))
        return 128 + number
    finally:
        for number, handler in before:
            signal.signal(number, handler)
