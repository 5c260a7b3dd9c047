"""
Entry points of the nodes: a signal while a node loads its modules ends it with one line.

The modules take most of a second to load, in which Ctrl-C would print a traceback. A ``setup.py``
therefore names this module, which imports nothing slow, and the node behind the colon::

    'sim_node = mambo_ros.entry:mambo_sim.sim_node'
"""

from __future__ import annotations

import contextlib
from importlib import import_module
import os
import resource
import signal
import sys

from .graph.ending_signals import ending


class Entry:
    """
    A module by its dotted name, whose ``main`` a call runs.

    Parameters
    ----------
    name
        For example ``mambo_sim.sim_node``; its last part is what the line on stderr begins with.

    """

    def __init__(self, name: str) -> None:
        self.name = name

    def __getattr__(self, name: str) -> Entry:
        return Entry(f'{self.name}.{name}')

    def __call__(self) -> None:
        """Load the module and run its ``main``; exit with 128 plus a signal that comes before."""
        def leave(number: int, _: object) -> None:
            with contextlib.suppress(OSError):
                os.write(2, f'{self.name.rpartition(".")[2]}: ended by '
                         f'{signal.Signals(number).name}\n'.encode())
            os._exit(128 + number)

        if resource.getrlimit(resource.RLIMIT_FSIZE)[0] != resource.RLIM_INFINITY:
            # Python takes a file that the limit cut off for whole, and would read it ever after
            sys.dont_write_bytecode = True
        for number in ending():
            signal.signal(number, leave)
        sys.exit(import_module(self.name).main())


def __getattr__(name: str) -> Entry:
    if name.startswith('__'):
        raise AttributeError(f'module {__name__} has no attribute {name}')
    return Entry(name)
