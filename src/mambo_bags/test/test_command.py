"""Whatever goes wrong in a tool is one line: its output, the disk, the memory."""

import os
import subprocess
import sys

from mambo_bags.command import guard
from mambo_bags.reader import BagError
import pytest

TOOL = """
import errno, os, sys
from mambo_bags.command import guard
def work():
    {work}
code = guard('tool', work)
sys.exit(code)
"""
MANY = 'for k in range(100000): print(k)'


def run(work, shell='"$@"'):
    """Run a tool by a shell, so that its output goes where that says."""
    return subprocess.run(
        ['bash', '-c', f'set -o pipefail; {shell}', 'bash', sys.executable, '-c',
         TOOL.format(work=work)], text=True, capture_output=True, timeout=100)


@pytest.mark.parametrize('work', ["print('short')", MANY], ids=['short', 'long'])
@pytest.mark.parametrize('where, said', [
    ('> /dev/full', 'tool: the output cannot be written: No space left on device\n'),
    ('>&-', 'tool: the output is closed: send it to /dev/null to do without\n'),
    ('>&- 2>&-', '')])
def test_an_output_that_takes_nothing_is_one_line(work, where, said):
    done = run(work, f'"$@" {where}')
    assert (done.returncode, done.stdout, done.stderr) == (1, '', said)


def test_a_reader_that_goes_is_no_word_worth():
    done = run(MANY, '"$@" | head -n 1')
    assert (done.returncode, done.stdout, done.stderr) == (1, '0\n', '')


@pytest.mark.parametrize('error, said', [
    (OSError(28, 'No space left on device', '/disk/bag'), '/disk/bag: No space left on device'),
    (OSError(28, 'No space left on device'), 'No space left on device'),
    (OSError(36, 'File name too long', 'x' * 9000), 'File name too long'),
    (MemoryError(), 'the memory of this machine is too small for that'),
    (RecursionError(), 'what is to be read is nested too deep'),
    (BagError('two\nlines'), 'two lines')])
def test_errors_are_one_short_line(error, said, capsys):
    def work():
        raise error
    assert guard('tool', work) == 1
    told = capsys.readouterr().err
    assert told.startswith('tool: ') and said in told
    assert told.count('\n') == 1 and len(told) < 2100


def test_an_error_of_ours_is_not_hidden():
    with pytest.raises(KeyError):
        guard('tool', lambda: {}['x'])


@pytest.mark.skipif(not os.access('/dev/full', os.W_OK), reason='no /dev/full')
def test_a_disk_that_is_full_is_named(tmp_path, capsys, monkeypatch):
    from mambo_bags import writer
    opened = writer.BagWriter._open

    def full(self):
        opened(self).close()
        return open('/dev/full', 'wb')
    monkeypatch.setattr(writer.BagWriter, '_open', full)

    def work():
        with writer.BagWriter(tmp_path / 'bag', {'a.txt': bytes(100_000)}) as bag:
            bag.close()
    assert guard('tool', work) == 1
    told = capsys.readouterr().err
    assert 'bag_0.mcap: No space left on device' in told and told.count('\n') == 1
