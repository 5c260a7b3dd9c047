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
    pytest.param('nbi', cut, marks=pytest.mark.long),
    pytest.param('nbi', zeroed, marks=pytest.mark.long),
    pytest.param('nbc', cut, marks=pytest.mark.long), ('nbc', changed)])
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


@pytest.mark.long
def test_code_that_was_compiled_for_other_types_is_compiled_again(tmp_path):
    """As where two commands compile at once: one wrote the index, the other the code."""
    environment = {**os.environ, 'NUMBA_CACHE_DIR': str(tmp_path)}
    sines = [sys.executable, '-c', 'from mambo_model.arithmetic.trigonometry import sin\n'
             'print(sin(0.5), sin(1), len(sin.for_python.stats.cache_hits))']

    def run():
        return subprocess.run(
            sines, env=environment, capture_output=True, text=True, timeout=120, check=True
        ).stdout.split()
    values = run()[:2]
    assert run() == [*values, '2']
    one, two = sorted(file for file in tmp_path.rglob('trigonometry.sin-*.nbc')
                      if 'inside' not in file.parts)
    first = one.read_bytes()
    one.write_bytes(two.read_bytes())
    two.write_bytes(first)
    assert run() == [*values, '0']
    assert run() == [*values, '2']


FULL = """
import errno
from mambo_model.compilation.checked_file import CheckedFile
from mambo_model.arithmetic.trigonometry import cos, sin

def full(self, path):
    raise OSError({error}, 'as said')
CheckedFile._open_for_write = full
print(sin(0.0), cos(0.0))
"""


@pytest.mark.long
@pytest.mark.parametrize('error, goes_on', [
    ('errno.ENOSPC', True), ('errno.EDQUOT', True), ('errno.EIO', False)])
def test_on_a_full_disk_code_is_compiled_and_used_with_one_line(error, goes_on, tmp_path):
    done = subprocess.run(
        [sys.executable, '-c', FULL.format(error=error)], capture_output=True, text=True,
        env={**os.environ, 'NUMBA_CACHE_DIR': str(tmp_path)}, timeout=120)
    assert (done.returncode == 0) == goes_on
    if goes_on:
        assert done.stdout == '0.0 1.0\n' and done.stderr.count('\n') == 1
        assert done.stderr.startswith('mambo: no space to keep compiled code')


@pytest.mark.long
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
