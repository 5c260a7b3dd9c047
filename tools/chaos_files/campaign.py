"""Try many damaged files and command lines, count what survived, keep what did not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
import contextlib
from importlib import import_module
from itertools import product
import os
from pathlib import Path
import random
import select
import shutil
import sys
import tempfile
import time

from mambo_bringup import mambo
from mambo_ros.graph.domains import HIGHEST

from . import extreme, lines, ROOT
from .attempt import Attempt, COMPILING_S, CPU_S
from .kinds import Kind, kinds
from .tables import table, with_outcome

LINE = 'line'  # the kind of the command lines
EXTREME = 'extreme'  # that of the flights with extreme parameters
COMPILED = ('estimate', 'fly', 'trajectory check', 'trajectory plan', 'sweep')


def warm(all_kinds: dict[str, Kind], folder: Path, names: Collection[str] = ()) -> None:
    """Import every command, and compile what the good files need, before the forks."""
    for entry in mambo.COMMANDS.values():
        if not mambo.is_script(entry):
            import_module(entry.module)
    if EXTREME in names:
        for estimator, controller in product(extreme.ESTIMATORS, extreme.CONTROLLERS):
            _quietly(['fly', '--duration', '1', '--estimator', estimator, '--controller',
                      controller, '--no-landing', '-o', str(folder / f'{estimator}_{controller}')])
    compiled = [(file, command) for kind in all_kinds.values() for command in kind.commands
                if command.startswith(COMPILED) for file in kind.files]
    for number, (file, command) in enumerate(compiled):
        _quietly(worded(command, file, folder, folder / f'warm_{number}'))


def _quietly(words: list[str]) -> None:
    """Run a command in this process without its output."""
    with open(os.devnull, 'w') as nowhere, contextlib.redirect_stdout(
            nowhere), contextlib.redirect_stderr(nowhere):
        mambo.main(words)


def worded(command: str, file: Path, base: Path, out: Path) -> list[str]:
    """Return the words of a template."""
    return [word.format(
        file=file, out=out, good=base / 'flight', examples=ROOT / 'examples',
        map=base / 'map.yaml', table=base / 'table.csv') for word in command.split()]


def begin(kind: str, number: int, seed: int, all_kinds: dict[str, Kind], base: Path,
          folder: Path) -> Attempt:
    """Start one input in an empty folder; it depends on kind, number and seed alone."""
    rng, spoil = (random.Random(f'{seed} {kind} {number} {what}') for what in ('line', 'file'))
    inside, out = folder / 'work', folder / 'out'
    inside.mkdir(parents=True)
    if kind == LINE:
        os.mkfifo(folder / 'fifo')
        file = folder / 'file.csv'
        file.write_text('a,b\n1,2\n')
        words = lines.line(rng, {
            'good': str(base / 'flight'), 'file': str(file), 'out': str(out),
            'folder': str(inside), 'fifo': str(folder / 'fifo')})
        return Attempt(words, inside, lambda: None)
    if kind == EXTREME:
        return Attempt(extreme.line(rng, out, extreme.numbers()), inside, lambda: None, out,
                       COMPILING_S, lambda words: extreme.wrong(out, words))
    chosen = all_kinds[kind]
    good, command = rng.choice(chosen.files), rng.choice(chosen.commands)
    file = folder / (f'damaged{good.suffix}' if kind != 'metadata' else 'damaged')
    return Attempt(worded(command, file, base, out), inside,
                   lambda: chosen.damage(spoil, good, file),
                   out if '{out}' in command.split() else None,
                   COMPILING_S if command.startswith(COMPILED) else CPU_S)


def files(count: int, seed: int, jobs: int, only: str = '', start: int = 0,
          keep: Path = ROOT / '.cache/chaos', shown: bool = True) -> int:
    """
    Try inputs of some kinds in turn; print the lost ones and a table.

    Parameters
    ----------
    count
        Number of inputs.
    seed
        Of their choice.
    jobs
        Processes at a time.
    only
        Names of the kinds to try, separated by commas; empty: all files and command lines.
    start
        Number of the first input of a kind.
    keep
        Folder for the files of lost inputs.
    shown
        Whether to print the table.

    Returns
    -------
    lost
        How many inputs were lost.

    """
    os.environ['ROS_DOMAIN_ID'] = str(HIGHEST)  # no command of a line reaches a flight
    tried: Counter[tuple[str, str]] = Counter()
    slowest = (0.0, '')
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix='chaos_') as name:
        base = Path(name)
        all_kinds = kinds(base)
        names = only.split(',') if only else [*all_kinds, LINE]
        fixed = {LINE, EXTREME}
        if unknown := set(names) - {*all_kinds, *fixed}:
            sys.exit(f'chaos: --kind {min(unknown)} is not one of '
                     f'{", ".join([*all_kinds, LINE, EXTREME])}')
        chosen = {name: all_kinds[name] for name in names if name not in fixed}
        # a line may be of any command
        warm(all_kinds if LINE in names else chosen, base, names)
        all_kinds = chosen

        running: dict[Attempt, tuple[str, int, Path]] = {}
        index = 0
        while index < count or running:
            while index < count and len(running) < jobs:
                kind, number = names[index % len(names)], start + index // len(names)
                folder = base / f'{kind}_{number}'
                running[begin(kind, number, seed, all_kinds, base, folder)] = kind, number, folder
                index += 1
            handles = select.select(
                [each.handle for each in running], [], [], min(each.left for each in running))[0]
            for each in [each for each in running if each.handle in handles or not each.left]:
                kind, number, folder = running.pop(each)
                end = each.end()
                tried[kind, 'lost' if end.wrong else end.outcome] += 1
                slowest = max(slowest, (end.took, f'{kind} {number}'))
                if end.wrong:
                    _report(f'{kind} {seed} {number}', each.words, end.wrong)
                    shutil.copytree(folder, keep / f'{kind}_{seed}_{number}', dirs_exist_ok=True,
                                    ignore=shutil.ignore_patterns('fifo'))
                shutil.rmtree(folder, ignore_errors=True)
    lost = with_outcome(tried, 'lost')
    if shown:
        print(table(tried, names, ('done', 'refused', 'failed', 'lost')))
        print(f'tried {count}, survived {count - lost}, lost {lost}; '
              f'{time.monotonic() - began:.0f} s, the slowest ({slowest[1]}) {slowest[0]:.1f} s')
    return lost


def _report(name: str, words: list[str], wrong: str) -> None:
    """Print a lost input: its number, its command line and what was wrong."""
    text = f'lost {name}: mambo {" ".join(words)[:500]}\n  {wrong}'
    print(text.encode('utf-8', 'backslashreplace').decode(), flush=True)
