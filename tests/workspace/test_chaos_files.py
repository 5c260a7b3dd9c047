"""Damaged files and command lines end well or in one line; and what does not is noticed."""

import os
from pathlib import Path
import random
import re
import select
import subprocess
import sys
import time

import pytest

ROOT = Path(__file__).parents[2]
sys.path.append(str(ROOT / 'tools'))
from chaos_files import attempt, lines  # noqa: E402 (scripts of tools/, not a package)

COUNT = 200
KINDS = ('bag', 'metadata', 'db3', 'scenario', 'vehicle', 'table', 'parquet', 'map', 'mat',
         'bench')
"""Whose commands compile nothing."""


def test_a_few_inputs_of_every_kind_are_survived():
    done = subprocess.run(
        [sys.executable, str(ROOT / 'tools/chaos.py'), 'files', '--count', str(COUNT), '--seed',
         '10', '--jobs', '2', '--kind', ','.join(KINDS)],
        text=True, capture_output=True, timeout=280,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(filter(None, sys.path))})
    assert (done.returncode, done.stderr) == (0, ''), done.stdout
    assert f'tried {COUNT}, survived {COUNT}, lost 0;' in done.stdout
    rows = [re.findall(r'\d+', line.split(maxsplit=1)[1])
            for line in done.stdout.splitlines()[1:-1]]
    assert all(sum(map(int, row)) == COUNT // len(rows) for row in rows)
    assert sum(int(row[0]) for row in rows) > 5  # not everything is refused


def end_of(main, folder, monkeypatch, made=None):
    monkeypatch.setattr(attempt.mambo, 'main', main)
    (folder / 'work').mkdir()
    running = attempt.Attempt(['tool'], folder / 'work', lambda: None, made)
    select.select([running.handle], [], [], running.left)
    return running.end()


def says(code, *words):
    def main(_):
        for word in words:
            print(word, file=sys.stderr)
        return code
    return main


@pytest.mark.parametrize('main, outcome', [
    (says(0), 'done'), (says(1, 'mambo x: disk full'), 'failed'),
    (says(2, 'mambo x: no'), 'refused')])
def test_an_end_in_one_line_is_survived(main, outcome, tmp_path, monkeypatch):
    end = end_of(main, tmp_path, monkeypatch)
    assert (end.outcome, end.wrong) == (outcome, '') and end.took < 10.0


def leaves(_):
    Path('.1.part').touch()
    return 0


def forks(_):
    if not os.fork():
        time.sleep(60)
        os._exit(0)
    return 0


def grows(_):
    bytearray(2 << 30)


def makes(_):
    Path('made').touch()
    return says(2, 'mambo x: no')(_)


@pytest.mark.parametrize('main, wrong', [
    (says(2), 'exit code 2 behind 0 lines'), (says(2, 'a', 'b'), 'exit code 2 behind 2 lines'),
    (says(2, 'x: no'), 'behind 1 lines'), (says(3), 'exit code 3'),
    (says(2, 'mambo x: ValueError(1)'), 'ValueError('), (lambda _: 1 / 0, 'Traceback'),
    (says(2, f'mambo x: {"y" * 3000}'), '3009 characters'),
    (says(0, *['z'] * 2, 'y' * 3000), '3000 characters'),
    (says(1, 'mambo x: out of memory'), 'memory'), (grows, 'Traceback'),
    (lambda _: os.abort(), 'ended by SIGABRT'), (leaves, '.1.part is left'),
    (forks, 'processes are left'), (makes, 'made is left')])
def test_any_other_end_is_lost(main, wrong, tmp_path, monkeypatch):
    assert wrong in end_of(main, tmp_path, monkeypatch, tmp_path / 'work/made').wrong


@pytest.mark.parametrize('main', [lambda _: time.sleep(60), lambda _: any(iter(int, 1))])
def test_what_does_not_end_is_killed(main, tmp_path, monkeypatch):
    monkeypatch.setattr(attempt, 'WALL_S', 0.3)
    assert end_of(main, tmp_path, monkeypatch).wrong == 'did not end within 0.3 s'


def test_the_same_seed_gives_the_same_inputs():
    first, again, other = (lines.line(random.Random(seed), {}) for seed in (1, 1, 2))
    assert first == again != other
