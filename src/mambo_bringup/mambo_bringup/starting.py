"""
Start a command so that Ctrl-C is one line from the first moment to the last.

Python loads for seconds before a command begins, and takes a moment to leave after it has ended:
a Ctrl-C in between would print where in the libraries it came. ``./run`` and ``./mambo`` start by
``python3 -m mambo_bringup.starting MODULE``; nothing is loaded here that takes time.
"""

from __future__ import annotations

from importlib import import_module
import signal
import sys

from .stopping import leave_at_once, stoppable

NAMES = {'flight': 'run', 'mambo': 'mambo'}
"""By module of this package: what its command is called."""


def main(module: str) -> int:
    """Load a module of ``NAMES`` and run its ``main``; return the exit code."""
    name = NAMES[module]
    before = signal.signal(signal.SIGINT, leave_at_once(name))
    command = import_module(f'.{module}', __package__)
    signal.signal(signal.SIGINT, before)
    try:
        return stoppable(name, command.main)
    finally:
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # what is left has no line to add


if __name__ == '__main__':
    chosen = sys.argv.pop(1)
    sys.exit(main(chosen))
