"""Pictures of commands are files that look the same whatever the user's settings are."""

from __future__ import annotations

from contextlib import suppress
import logging
import os
from pathlib import Path
import sys
import time

_STALE = 10.0  # s of age of a lock that nobody holds any more; a list of fonts takes a second
_RC = 'matplotlibrc'  # matplotlib reads it from the working directory first


def draw_files_only() -> None:
    """
    Make matplotlib use the backend Agg and its own defaults in this process and its children.

    ``MPLBACKEND``, ``MATPLOTLIBRC`` and files called matplotlibrc may name an unknown backend,
    a device without end or settings that change every picture; a command needs none of them. Where
    its own folder cannot be written, matplotlib takes a temporary one and would say so in two
    lines. To be called before matplotlib is imported.
    """
    _remove_stale_locks()
    logging.getLogger('matplotlib').setLevel(logging.ERROR)
    os.environ['MPLBACKEND'] = 'agg'
    os.environ['MATPLOTLIBRC'] = os.devnull
    if 'matplotlib' in sys.modules or not os.path.lexists(_RC):
        return
    here = os.open('.', os.O_PATH)
    os.chdir(Path(__file__).parent)  # where there is no such file
    try:
        import matplotlib  # noqa: F401 (reads its settings now)
    finally:
        os.fchdir(here)
        os.close(here)


def _remove_stale_locks() -> None:
    """
    Remove locks of matplotlib's folder that a process left when it was ended.

    Each later one would wait for them, five seconds, and then not keep its list of fonts.
    """
    folder = os.environ.get('MPLCONFIGDIR')
    with suppress(OSError):
        for lock in Path(folder).glob('*.matplotlib-lock') if folder else ():
            if time.time() - lock.stat().st_mtime > _STALE:
                lock.unlink()
