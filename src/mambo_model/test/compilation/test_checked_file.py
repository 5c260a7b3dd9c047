"""Compiled code whose files are cut off, zeroed or changed is compiled again, without a word."""

import os
import subprocess
import sys

import pytest


def cut(data):
    return data[:len(data) // 2]


def zeroed(data):
    return bytes(len(data))


def changed(data):
    """Return other bytes of the same length, as pickle reads them: the machine code differs."""
    return data[:-40] + bytes([data[-40] ^ 1]) + data[-39:]


@pytest.mark.slow
@pytest.mark.parametrize('kind, damage', [
    ('nbi', cut), ('nbi', zeroed), ('nbc', cut), ('nbc', changed)])
def test_compiled_code_that_is_damaged_is_compiled_again(kind, damage, tmp_path):
    environment = {**os.environ, 'NUMBA_CACHE_DIR': str(tmp_path)}
    sine = [sys.executable, '-c', 'from mambo_model.arithmetic.trigonometry import sin\n'
            'print(sin(0.5), len(sin.for_python.stats.cache_hits))']

    def run():
        done = subprocess.run(sine, env=environment, capture_output=True, text=True, timeout=120)
        assert (done.returncode, done.stderr) == (0, '')
        return done.stdout.split()
    value, hits = run()
    assert hits == '0' and run() == [value, '1']
    files = sorted(tmp_path.rglob(f'*.{kind}'))
    assert files
    for file in files:
        file.write_bytes(damage(file.read_bytes()))
    assert run() == [value, '0']
    assert run() == [value, '1']


def test_types_of_a_module_that_is_gone_keep_nothing_from_being_compiled(tmp_path):
    environment = {**os.environ, 'NUMBA_CACHE_DIR': str(tmp_path)}
    (tmp_path / 'theirs.py').write_text(
        'from typing import NamedTuple\n\n\nclass Mine(NamedTuple):\n    a: float\n')

    def held(where, value):
        done = subprocess.run(
            [sys.executable, '-c', f'from mambo_model.compiled import hold, memory_of\n{value}'],
            env={**environment, 'PYTHONPATH': f'{where}:{environment["PYTHONPATH"]}'},
            capture_output=True, text=True, timeout=120)
        assert (done.returncode, done.stderr) == (0, '')
        return done.stdout
    mine = 'from theirs import Mine\nprint(memory_of(hold(Mine(1.0), None, None)))'
    assert held(tmp_path, mine) == 'Mine(a=1.0)\n'
    (tmp_path / 'theirs.py').unlink()
    assert held(tmp_path, 'print(memory_of(hold((2.0,), None, None)))') == '(2.0,)\n'
