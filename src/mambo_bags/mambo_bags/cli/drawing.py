"""Pictures of commands are files that look the same whatever the user's settings are."""

from __future__ import annotations

import logging
import os
from pathlib import Path
import sys

_RC = 'matplotlibrc'  # matplotlib reads it from the working directory first


def draw_files_only() -> None:
    """
    Make matplotlib use the backend Agg and its own defaults in this process and its children.

    ``MPLBACKEND``, ``MATPLOTLIBRC`` and files called matplotlibrc may name an unknown backend,
    a device without end or settings that change every picture; a command needs none of them. Where
    its own folder cannot be written, matplotlib takes a temporary one and would say so in two
    lines. To be called before matplotlib is imported.
    """
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
