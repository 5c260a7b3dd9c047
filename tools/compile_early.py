#!/usr/bin/env python3
"""
Compile the default estimator while the first build is under way, on what that leaves idle.

usage: tools/compile_early.py

It is a third of what the first flight compiles. The flight waits for it by the lock that this
process holds (:func:`mambo_bringup.compiling.compile_ahead`). No ROS and no message is needed.
Runs in a shell of env.bash, beside the links to the packages that tools/build.bash makes.
"""

from __future__ import annotations

import fcntl
import os
from pathlib import Path
import sys

BUILD = Path(__file__).resolve().parents[1] / 'build'
ZERO = (0.0, 0.0, 0.0)


def main() -> None:
    """Take the lock and compile one step."""
    lock = (Path(os.environ['MAMBO_CACHE_DIR']) / 'early.lock').open('w')
    fcntl.flock(lock, fcntl.LOCK_EX)
    sys.path[:0] = [str(folder) for folder in sorted(BUILD.glob('mambo_*'))]
    from mambo_estimation.filters import DEFAULT, REGISTRY
    from mambo_model.compiled import typeof
    estimator = REGISTRY.built_in[DEFAULT]
    values = estimator.params().values()
    given = estimator.initial(values), 0.0, ZERO, ZERO, 0.0, ZERO[:2], 0, 0.0, values
    estimator.step.compile(tuple(map(typeof, given)))  # as the compiled step of a node calls it


if __name__ == '__main__':
    main()
