"""Try commands that lack something, and count what survived."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
import os
from pathlib import Path
import random
import tempfile
import time
from typing import NamedTuple

from mambo_model import compiled

from .scarce import AS_ROOT, MOUNTED, OF_OUTPUT, SCARCITIES
from .starved import End, permitted, Starved
from .tables import table, with_outcome
from .tasks import enough, Made, TASKS

_WIDTH = 17


class Attempt(NamedTuple):
    """A command and what it lacks."""

    number: int
    task: str   # of TASKS
    lacks: str  # of SCARCITIES


def chosen(number: int, seed: int, names: Sequence[str] = tuple(SCARCITIES),
           commands: Sequence[str] = tuple(TASKS)) -> Attempt:
    """Return an attempt; every scarcity has its turn before one is tried again."""
    turn, index = divmod(number, len(names))
    lacks = random.Random(f'{seed} {turn} order').sample(names, len(names))[index]
    fitting = [name for name in commands if lacks not in OF_OUTPUT or TASKS[name].writes]
    return Attempt(number, random.Random(f'{seed} {number} command').choice(fitting), lacks)


def attempt(tried: Attempt, seed: int, base: Path, whole: Made, private: bool) -> End:
    """Try one."""
    with tempfile.TemporaryDirectory(prefix='attempt_', dir=base) as folder:
        return Starved(
            TASKS[tried.task], tried.lacks, random.Random(f'{seed} {tried.number} lack'),
            Path(folder), base, whole, Path(compiled.numba.config.CACHE_DIR), private).end()


def resources(count: int, seed: int, start: int = 0, jobs: int = 1,
              commands: Sequence[str] = tuple(TASKS)) -> int:
    """
    Try commands under scarcities; print what was lost and a table.

    Parameters
    ----------
    count
        Number of attempts.
    seed
        Of their choice.
    start
        Number of the first one.
    jobs
        Attempts at a time.
    commands
        Names of the commands.

    Returns
    -------
    lost
        How many were lost.

    """
    reason = permitted()
    names = [name for name in SCARCITIES if not (reason and name in MOUNTED) and not (
        os.geteuid() and name in AS_ROOT)]
    if left := [name for name in SCARCITIES if name not in names]:
        print(f'left out: {", ".join(left)}: {reason or "this needs root"}')
    every = [chosen(number, seed, names, commands) for number in range(start, start + count)]
    outcomes: Counter[tuple[str, str]] = Counter()
    began = time.monotonic()
    slowest = (0.0, 0)
    with tempfile.TemporaryDirectory(prefix='chaos_') as name, ThreadPoolExecutor(jobs) as pool:
        base = Path(name)
        base.chmod(0o755)
        whole = {task: enough(TASKS[task], base) for task in sorted({one.task for one in every})}
        ends = pool.map(lambda one: attempt(one, seed, base, whole[one.task], not reason), every)
        for one, end in zip(every, ends, strict=True):
            outcomes[one.lacks, 'lost' if end.wrong else end.outcome] += 1
            slowest = max(slowest, (end.took, one.number))
            if end.wrong:
                print(f'lost {one.number}: {one.task}, {one.lacks}\n  {end.wrong}', flush=True)
    lost = with_outcome(outcomes, 'lost')
    print(table(outcomes, names, ('done', 'refused', 'failed', 'lost'), _WIDTH))
    print(f'tried {count}, survived {count - lost}, lost {lost}; '
          f'{time.monotonic() - began:.0f} s, the slowest ({slowest[1]}) {slowest[0]:.1f} s')
    return lost
