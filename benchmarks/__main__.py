"""The command line of ``./bench``."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from importlib.metadata import version
import json
import os
from pathlib import Path
import platform
import re
import subprocess
import sys

from . import agents, graph, in_c, loops, measure, report, rotorpy_peer, sweeping

ROOT = Path(__file__).parents[1]
PAGE = ROOT / 'docs' / 'evidence' / 'performance.md'
FOLDER = ROOT / '.cache' / 'bench'
GROUPS = ('reference', 'closed_loop', 'rotorpy', 'sweep', 'gym', 'graph', 'endurance', 'replay',
          'profile', 'idle')


def _output_of(*command: str) -> str:
    """Return the first line that a command prints, empty without the command."""
    try:
        done = subprocess.run(command, text=True, capture_output=True)
        return (done.stdout.splitlines() or [''])[0]
    except OSError:
        return ''


def machine() -> dict[str, str]:
    """Return what the numbers depend on besides the code."""
    found = re.search(r'model name\s*: (.*)', Path('/proc/cpuinfo').read_text())
    packages = ', '.join(f'{name} {version(name)}' for name in ('numba', 'numpy'))
    return {
        'processor': f'{found[1] if found else platform.machine()}, {os.cpu_count()} cores',
        'software': f'Python {platform.python_version()}, {packages}, '
                    f'{_output_of("gcc", "--version") or "no gcc"}',
        'commit': _output_of(
            'git', '-C', str(ROOT), 'describe', '--always', '--dirty') or 'unknown'}


def chosen(names: list[str], quick: bool, folder: Path) -> Iterator[measure.Contender]:
    """Yield the contenders of the groups or rows that are named, all without names."""
    for module in (in_c, loops, rotorpy_peer, sweeping, agents, graph):
        for contender in module.contenders(quick, folder):
            if not names or {contender.group, contender.name} & set(names):
                yield contender


def parser() -> argparse.ArgumentParser:
    """Return the command line."""
    out = argparse.ArgumentParser(
        prog='bench', formatter_class=argparse.RawDescriptionHelpFormatter,
        description='Measure speed: closed loop, graph and replay beside C and RotorPy.',
        epilog='Without names everything is measured and docs/evidence/performance.md written.\n'
               'RotorPy is installed into .cache/bench the first time.\n')
    out.add_argument('names', nargs='*', metavar='NAME',
                     help=f"of a group ({', '.join(GROUPS)}), or of a row of the JSON file")
    out.add_argument('--quick', action='store_true',
                     help='shorter flights, 2 repetitions: to see that it works')
    out.add_argument('--repetitions', type=int, metavar='N', help='default: 5')
    out.add_argument('--output', type=Path, metavar='FILE',
                     help='page to write '
                     '(default: docs/evidence/performance.md if all is measured)')
    out.add_argument('--json', type=Path, metavar='FILE', help='write every sample')
    return out


def main(arguments: list[str] | None = None) -> int:
    """Entry point of ``./bench``."""
    options = parser().parse_args(arguments)
    repetitions = options.repetitions or (2 if options.quick else 5)
    if repetitions < 1:
        print('bench: --repetitions must be 1 or more', file=sys.stderr)
        return 2
    FOLDER.mkdir(parents=True, exist_ok=True)
    contenders = list(chosen(options.names, options.quick, FOLDER))
    known = {*GROUPS, *(c.name for c in chosen([], options.quick, FOLDER))}
    if unknown := [name for name in options.names if name not in known]:
        print(f'bench: {unknown[0]} is unknown; groups: {", ".join(GROUPS)}', file=sys.stderr)
        return 2
    before = measure.load()
    results = measure.measure(
        contenders, repetitions, lambda line: print(f'bench: {line}', file=sys.stderr))
    about = {**machine(), 'load': f'{before:.1f} before, {measure.load():.1f} after '
                                  '(processes that ran or waited, mean of a minute)'}
    page = report.text(results, about, repetitions)
    print(page)
    everything = not options.names and not options.quick
    for path, content in (
            (options.output or (PAGE if everything else None), page),
            (options.json, json.dumps(report.data(results, about), indent=1) + '\n')):
        if path:
            path.write_text(content)
            print(f'bench: wrote {path}', file=sys.stderr)
    return 1 if any(result.gap for result in results) else 0


if __name__ == '__main__':
    sys.exit(main())
