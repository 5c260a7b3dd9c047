"""
Start a command so that Ctrl-C prints one line at any moment.

Python imports for seconds before a command begins and takes a moment to exit after it has ended;
a Ctrl-C at these times would print a traceback. ``./run`` and ``./mambo`` therefore start with
``python3 -m mambo_bringup.starting MODULE``, which imports nothing slow.
"""

from __future__ import annotations

from importlib import import_module
import signal
import sys

from .stopping import leave_at_once, stoppable


def main(module: str) -> int:
    """Load ``run`` or ``mambo``, run its ``main`` and return the exit code."""
    before = signal.signal(signal.SIGINT, leave_at_once(module))
    command = import_module(f'.{module}', __package__)
    signal.signal(signal.SIGINT, before)
    try:
        return stoppable(module, command.main)
    finally:
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # later signals need no message


if __name__ == '__main__':
    chosen = sys.argv.pop(1)
    sys.exit(main(chosen))
