"""
Summarise the results of a test run and name the tests that failed; the end of ``./test``.

usage: count_tests.py all|chosen|files TESTS_XML[:TESTS_XML] [STAGE ...]

``all``: every Python package and tests/ must have run something; ``chosen``: options chose tests,
so that one package may have none; ``files``: only TESTS_XML was written. STAGE names what ended
with a failure, which counts even if no test says so. Runs from the root of the workspace.
"""

from __future__ import annotations

import os
from pathlib import Path
import signal
import sys
import time
from typing import NamedTuple
import xml.etree.ElementTree as ElementTree

MAX_LINE = 300  # characters of the line for a failed test
MAX_NAMED = 100  # failed tests that are named


class Count(NamedTuple):
    """Tests that passed, failed (or could not run) and were skipped."""

    passed: int = 0
    failed: int = 0
    skipped: int = 0

    @property
    def total(self) -> int:
        """All of them."""
        return sum(self)


def add(*counts: Count) -> Count:
    """Return the sum of counts."""
    return Count(*map(sum, zip(*counts))) if counts else Count()


def _read(file: Path) -> ElementTree.Element | None:
    """Return a JUnit file; None if it is missing or broken."""
    try:
        return ElementTree.parse(file).getroot()
    except (OSError, ElementTree.ParseError):
        return None


def count(file: Path) -> Count:
    """
    Return the counts of one JUnit file.

    A missing or broken file counts as one failure: whoever should have written it did not.
    """
    root = _read(file)
    if root is None:
        return Count(failed=1)
    counts = []
    for suite in root.iter('testsuite'):
        number = {key: int(suite.get(key, 0))
                  for key in ('tests', 'failures', 'errors', 'skipped')}
        failed = number['failures'] + number['errors']
        passed = number['tests'] - failed - number['skipped']
        counts.append(Count(max(passed, 0), failed, number['skipped']))
    return add(*counts)


def failures(file: Path) -> list[str]:
    """Return a line for each failed test of a JUnit file: its name and what it says first."""
    root = _read(file)
    if root is None:
        return [f'{file}: missing or incomplete']
    lines = []
    for case in root.iter('testcase'):
        for found in (*case.findall('failure'), *case.findall('error')):
            said = (found.get('message') or '').strip().splitlines()[:1]
            name = f'{case.get("classname")}::{case.get("name")}'
            lines.append(': '.join([name, *said])[:MAX_LINE])
    return lines


def leftovers(run: str) -> dict[int, str]:
    """Return (process id: command) of every process of a test run but this one."""
    found = {}
    for folder in Path('/proc').glob('[0-9]*'):
        try:
            environment = (folder / 'environ').read_bytes().split(b'\0')
            command = (folder / 'cmdline').read_bytes().replace(b'\0', b' ').decode(
                errors='replace')
        except OSError:
            continue  # gone, or not ours
        if f'MAMBO_TEST_RUN={run}'.encode() in environment and int(folder.name) != os.getpid():
            found[int(folder.name)] = command.strip()
    return found


def end_leftovers(run: str) -> list[str]:
    """Return the commands that outlived the tests of a run, after ending them."""
    time.sleep(0.2)  # what is about to end may
    found = leftovers(run)
    for number in (signal.SIGINT, signal.SIGKILL):
        for process in leftovers(run):
            try:
                os.kill(process, number)
            except ProcessLookupError:
                pass
        deadline = time.monotonic() + 3.0
        while leftovers(run) and time.monotonic() < deadline:
            time.sleep(0.05)
    return list(found.values())


def summarise(rows: dict[str, Count], kind: str, stages: list[str],
              running: list[str]) -> tuple[list[str], Count]:
    """
    Return the lines of the summary, the last of which counts, and the counts.

    Parameters
    ----------
    rows
        Counts by package or folder.
    kind
        ``all``, ``chosen`` or ``files``; see the module.
    stages
        What ended with a failure.
    running
        Commands that outlived the tests.

    """
    lines, extra = [], 0
    for name, row in rows.items():
        silent = kind == 'all' and not row.total
        extra += silent
        lines.append(f'{name:20} {row.passed:5} passed, {row.failed} failed, {row.skipped} skipped'
                     + (': NO TEST RAN' if silent else ''))
    total = add(*rows.values())
    if not total.total and not extra:
        lines.append('no test was chosen')
        extra += 1
    for command in running:
        lines.append(f'left running: {command}')
        extra += 1
    if stages and not total.failed and not extra:
        lines.append(f'failed without a failed test: {", ".join(stages)}')
        extra += 1
    total = total._replace(failed=total.failed + extra)
    lines.append(
        f'total: {total.passed} passed, {total.failed} failed, {total.skipped} skipped')
    return lines, total


def main() -> int:
    """Print the summary; return 1 if anything failed."""
    kind, tests, *stages = sys.argv[1:]
    files = {'tests': [Path(file) for file in tests.split(':')]}
    if kind != 'files':
        packages = sorted(setup.parent.name for setup in Path('src').glob('*/setup.py'))
        files = {name: [Path('build') / name / 'pytest.xml'] for name in packages} | files
    rows = {name: add(*map(count, written)) for name, written in files.items()}
    run = os.environ.get('MAMBO_TEST_RUN')
    lines, total = summarise(rows, kind, stages, end_leftovers(run) if run else [])
    failed = [f'FAILED {name}: {line}' for name, written in files.items()
              for file in written for line in failures(file)]
    more = [f'and {len(failed) - MAX_NAMED} more'] if len(failed) > MAX_NAMED else []
    print('', *failed[:MAX_NAMED], *more, *lines, sep='\n')
    return 1 if total.failed else 0


if __name__ == '__main__':
    sys.exit(main())
