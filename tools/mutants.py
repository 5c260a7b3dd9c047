"""
Breaks the equations on purpose, one place at a time, and sees whether a test notices.

A mutant is a copy of a package in which one place of one file is wrong: a sign, a term, an axis.
``tests/mutants/<package>.yaml`` lists them by hand: those that a tool makes by rule are hundreds a
file, most of no physical meaning. The tests of the file run with the copy before the real package
on the path, without compiling, and stop at the first that fails: it has killed the mutant.
Nothing is changed in the checkout. A place that no program of the product reaches is refused:
its test would hold nothing but itself.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ThreadPoolExecutor
import multiprocessing
from multiprocessing.connection import Connection
import os
from pathlib import Path
import shutil
import sys
import tempfile
import time
from typing import NamedTuple

from mambo_bags.cli.option_types import whole
import pytest
import yaml

sys.path.append(str(Path(__file__).parent))  # also where Python is told to leave it out

import called

ROOT = Path(__file__).resolve().parents[1]
LISTS = ROOT / 'tests/mutants'
REPORT = ROOT / 'docs/evidence/mutants.md'
HEAD = """# Mutants

Files of equations, of alignment, of bags and of nodes with ten errors put in, one at a time, and
the test of that file that fails. A mutant that no test kills shows code that no test holds. The
errors are listed in `tests/mutants/`; `tests/workspace/test_mutants.py` checks that each still
fits its file and that a program of the product calls it. This page is written by

    ./mutants --write                # all of them
    ./mutants mambo_sim --write      # those of a package or of a file, ./mutants rotor

Without `--write` they only run. The exit code is 1 if one survives.
"""
SERVER = multiprocessing.get_context('forkserver')  # has imported what every test imports
SERVER.set_forkserver_preload(['numba', 'numpy', 'pytest', 'scipy.spatial.transform'])
SLOWER = 5.0  # times what the tests take without a mutant: then it never ends


class MutantError(Exception):
    """A list that cannot be run as it stands."""


class Mutant(NamedTuple):
    """One error in one file."""

    what: str
    old: str
    new: str


class Target(NamedTuple):
    """A file with its mutants and the tests that should kill them."""

    package: str
    path: str                # below the folder of the package
    tests: tuple[str, ...]   # below the package's test folder, or tests/ of the workspace
    without: tuple[str, ...]  # tests of these that need compiled code
    mutants: tuple[Mutant, ...]

    @property
    def name(self) -> str:
        """Return package and path, as the report calls the file."""
        return f'{self.package}/{self.path}'

    @property
    def source(self) -> Path:
        """Return the file itself."""
        return ROOT / 'src' / self.package / self.package / self.path


class Outcome(NamedTuple):
    """What became of one mutant, or of the file as it is."""

    killer: str     # name of the test that failed; empty: none did
    seconds: float


def load() -> list[Target]:
    """Return every file of the lists; raises MutantError where a list has other keys."""
    targets = []
    for file in sorted(LISTS.glob('*.yaml')):
        for path, entry in yaml.safe_load(file.read_text()).items():
            try:
                mutants = tuple(Mutant(**one) for one in entry.pop('mutants'))
                tests, without = tuple(entry.pop('tests')), tuple(entry.pop('without', ()))
            except (AttributeError, KeyError, TypeError) as error:
                raise MutantError(f'{file.relative_to(ROOT)}: {path}: {error}') from None
            if entry:
                raise MutantError(f'{file.relative_to(ROOT)}: {path}: unknown key {min(entry)}')
            targets.append(Target(file.stem, path, tests, without, mutants))
    return targets


def choose(targets: list[Target], names: list[str]) -> list[Target]:
    """Return the targets of these names: ``mambo_sim``, ``sensors/sonar``, ``mambo_sim/plant``."""
    chosen = []
    for name in names:
        end = '/' + name.removesuffix('.py') + '.py'
        found = [target for target in targets
                 if name == target.package or ('/' + target.name).endswith(end)]
        if not found:
            raise MutantError(f'{name}: no such file in tests/mutants; there are '
                              + ' '.join(target.name for target in targets))
        chosen += [target for target in found if target not in chosen]
    return chosen if names else targets


def mutated(source: str, mutant: Mutant, name: str) -> str:
    """Return a source with the error in it; raises MutantError unless it has one place for it."""
    count = source.count(mutant.old)
    if count != 1:
        raise MutantError(f'{name}: {mutant.what}: "{mutant.old}" is there {count} times, not '
                          'once: adjust the entry in tests/mutants')
    return source.replace(mutant.old, mutant.new)


def refuse_dead(target: Target, source: str, dead: list[called.Definition]) -> None:
    """Raise MutantError for a mutant without one place, or in a function that nothing calls."""
    for mutant in target.mutants:
        mutated(source, mutant, target.name)
        line = source[:source.index(mutant.old)].count('\n') + 1
        for definition in dead:
            if definition.file == target.source and definition.first <= line <= definition.last:
                raise MutantError(
                    f'{target.name}: {mutant.what}: no program calls {definition.name}: take it '
                    'out with its tests, or let the product use it')


def tests_of(target: Target, names: tuple[str, ...]) -> list[str]:
    """Return tests of a target as pytest takes them, from the root of the workspace."""
    found = []
    for test in names:
        folders = (ROOT / 'src' / target.package / 'test', ROOT / 'tests')
        paths = [folder / test for folder in folders if (folder / test.split('::')[0]).is_file()]
        if not paths:
            raise MutantError(f'{target.name}: there is no test {test}')
        found.append(str(paths[0].relative_to(ROOT)))
    return found


class FirstFailure:
    """What pytest tells of a run: the first test, or file of tests, that failed."""

    def __init__(self) -> None:
        self.name = ''

    def note(self, report) -> None:
        """Keep the name of a test or file that failed, as file and name."""
        if report.failed and not self.name:
            file, _, test = report.nodeid.partition('::')
            self.name = f"{Path(file).stem.removeprefix('test_')}: {test or 'import'}"

    pytest_runtest_logreport = pytest_collectreport = note


def test_copy(folder: str, package: str, arguments: list[str], end: Connection) -> None:
    """Run pytest in a process of its own with a package from a folder; send what failed."""
    null = os.open(os.devnull, os.O_RDWR)
    for stream in range(3):
        os.dup2(null, stream)
    os.chdir(ROOT)
    sys.path.insert(0, folder)
    sys.dont_write_bytecode = True
    first = FirstFailure()
    code = pytest.main(arguments, plugins=[first])
    origin = getattr(sys.modules.get(package), '__file__', None) or ''
    end.send((int(code), first.name, origin))


def try_source(target: Target, source: str, limit: float) -> Outcome:
    """Run the tests of a target with another source of its file, for at most limit s."""
    began = time.monotonic()
    arguments = ['-x', '-q', '-p', 'no:cacheprovider', '-W', 'ignore',
                 *tests_of(target, target.tests)]
    for test in tests_of(target, target.without):
        arguments += ['--deselect', test]
    with tempfile.TemporaryDirectory(prefix='mutant-') as folder:
        package = ROOT / 'src' / target.package / target.package
        copy = Path(folder) / target.package
        shutil.copytree(package, copy, ignore=shutil.ignore_patterns('*.pyc'))
        (copy / target.path).write_text(source)
        here, there = SERVER.Pipe(duplex=False)
        process = SERVER.Process(  # no daemon: a test may start processes
            target=test_copy, args=(folder, target.package, arguments, there))
        process.start()
        there.close()
        ended = here.poll(limit)
        if not ended:
            process.kill()
        process.join()
        if not ended:
            return Outcome(f'no end within {limit:.0f} s', time.monotonic() - began)
        try:
            code, name, origin = here.recv()
        except EOFError:
            raise MutantError(f'{target.name}: pytest ended without a word') from None
    if not origin.startswith(folder):
        raise MutantError(f'{target.package} came from {origin or "nowhere"}, not from the copy')
    if bool(code) != bool(name):
        raise MutantError(f'{target.name}: pytest ended with {code}')
    return Outcome(name, time.monotonic() - began)


def run(target: Target, pool: ThreadPoolExecutor) -> list[Outcome]:
    """Run every mutant of a file, and print what becomes of it; raises MutantError."""
    source = target.source.read_text()
    broken = [mutated(source, mutant, target.name) for mutant in target.mutants]
    clean = try_source(target, source, 600.0)
    if clean.killer:
        raise MutantError(f'{target.name}: {clean.killer} fails without any mutant')
    print(f'\n{target.name}  (tests: {clean.seconds:.1f} s)', flush=True)
    limit = 30.0 + SLOWER * clean.seconds
    outcomes = []
    for mutant, outcome in zip(
            target.mutants, pool.map(lambda text: try_source(target, text, limit), broken)):
        verdict = outcome.killer or 'SURVIVED'
        print(f'  {outcome.seconds:5.1f} s  {mutant.what}: {verdict}', flush=True)
        outcomes.append(outcome)
    return outcomes


def section(target: Target, outcomes: list[Outcome]) -> str:
    """Return the table of a file for the report."""
    killed = sum(bool(outcome.killer) for outcome in outcomes)
    rows = [
        f'| {mutant.what} | {outcome.killer.replace("|", chr(92) + "|") or "**survived**"} |'
        for mutant, outcome in zip(target.mutants, outcomes)]
    return '\n'.join((
        f'## {target.name}: {killed} of {len(rows)}', '', '| error | killed by |', '|---|---|',
        *rows)) + '\n'


def write(targets: list[Target], results: dict[str, list[Outcome]]) -> None:
    """Write the report: tables of this run, those of other files as they were."""
    text = REPORT.read_text() if REPORT.exists() else HEAD
    tables = {part.split(':')[0]: '## ' + part.rstrip('\n') + '\n'
              for part in text.split('\n## ')[1:]}
    for target in targets:
        if target.name in results:
            tables[target.name] = section(target, results[target.name])
    known = [tables[target.name] for target in targets if target.name in tables]
    REPORT.write_text('\n'.join([HEAD, *known]))


def main() -> int:
    """Run the command; return its exit code."""
    parser = argparse.ArgumentParser(prog='mutants', description=__doc__.split('\n\n')[0].strip())
    parser.add_argument('files', nargs='*', help='rotor, sensors/sonar, mambo_sim; all')
    parser.add_argument('--jobs', type=whole(1, 1024), default=1, help='how many at a time (1)')
    parser.add_argument('--write', action='store_true',
                        help='write the tables to docs/evidence/mutants.md')
    options = parser.parse_args()
    os.nice(10)
    os.environ |= {'NUMBA_DISABLE_JIT': '1', 'OPENBLAS_NUM_THREADS': '1'}
    began, results, pool = time.monotonic(), {}, ThreadPoolExecutor(options.jobs)
    try:
        targets, dead = load(), called.uncalled(*called.read())
        for target in targets:
            refuse_dead(target, target.source.read_text(), dead)
        for target in choose(targets, options.files):
            results[target.name] = run(target, pool)
    except MutantError as error:
        print(f'mutants: {error}', file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print('mutants: interrupted', file=sys.stderr)
        return 130
    finally:
        pool.shutdown(cancel_futures=True)
    seconds = time.monotonic() - began
    if options.write:
        write(targets, results)
    outcomes = [outcome for one in results.values() for outcome in one]
    killed = sum(bool(outcome.killer) for outcome in outcomes)
    print(f'\n{killed} of {len(outcomes)} killed, {len(outcomes) - killed} survived, '
          f'{seconds:.0f} s')
    return 0 if killed == len(outcomes) else 1


if __name__ == '__main__':
    sys.exit(main())
