"""Turn signals to a command-line tool into one line and an exit code."""

from __future__ import annotations

from collections.abc import Callable
import contextlib
import os
import signal
import sys
import threading
from typing import Any

from mambo_bags.cli import supervisor
from mambo_ros.graph.ending_signals import ending

_AGAIN = 0.1  # s after which an interrupt that a library has dropped is tried again


def _line(name: str, number: int, *notes: str) -> str:
    return '; '.join((f'{name}: ended by {signal.Signals(number).name}', *notes)) + '\n'


def leave_at_once(name: str) -> Callable[[int, object], None]:
    """Return a signal handler that prints one line and ends the process without clean-up."""
    def leave(number: int, _: object) -> None:
        with contextlib.suppress(OSError):
            os.write(2, _line(name, number).encode())
        os._exit(128 + number)
    return leave


def stoppable(name: str, work: Callable[[], int]) -> int:
    """
    Run a tool that SIGINT, SIGTERM and SIGHUP end; return its exit code.

    The exit code is that of ``work``. After a signal it is 128 plus the signal's number, as in a
    shell, and one line on stderr that begins with the name of the tool and ends with what
    ``work`` has added to the arguments of the KeyboardInterrupt. A second signal ends the process
    at once, without clean-up.
    """
    tool = os.getpid()
    received: list[int] = []

    def stop(number: int, _: object) -> None:
        """Raise KeyboardInterrupt with the signal; in a fork use the default action."""
        pid = os.getpid()
        if pid != tool and not supervisor.is_command(pid):  # a worker process of the tool
            signal.signal(number, signal.SIG_DFL if number != signal.SIGINT
                          else signal.default_int_handler)
            os.kill(os.getpid(), number)
            return
        if not received:
            supervisor.handled(number)
        received.append(number)
        for each, _handler in before:
            signal.signal(each, leave_at_once(name))
        raise KeyboardInterrupt(signal.Signals(number))

    def dropped(what: Any) -> None:
        """
        Interrupt again: a library called Python that was interrupted, and dropped the error.

        The compiler does so for each function that it has compiled.
        """
        if not received or not issubclass(what.exc_type, KeyboardInterrupt):
            hook(what)
            return
        for each, _handler in before:
            signal.signal(each, stop)
        again = threading.Timer(_AGAIN, os.kill, (os.getpid(), received[0]))
        again.daemon = True
        again.start()

    before = [(number, signal.getsignal(number)) for number in ending()]
    hook, sys.unraisablehook = sys.unraisablehook, dropped
    try:
        for number, _ in before:
            signal.signal(number, stop)
        code = work()
        if received and not code:  # a library dropped the interrupt at the very end
            raise KeyboardInterrupt(signal.Signals(received[0]))
        return code
    except (KeyboardInterrupt, Exception) as end:
        if not isinstance(end, KeyboardInterrupt) and not received:
            raise
        # an error may follow an interrupt that was dropped
        given = end.args if isinstance(end, KeyboardInterrupt) else ()
        number = received[0] if received else (given or (signal.SIGINT,))[0]
        with contextlib.suppress(OSError):
            sys.stderr.write(_line(name, number, *given[1:]))
        return 128 + number
    finally:
        sys.unraisablehook = hook
        for number, handler in before:
            signal.signal(number, handler)
