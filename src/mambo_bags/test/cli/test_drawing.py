"""Pictures of commands do not depend on the user's settings of matplotlib, which may be wrong."""

import os
import subprocess
import sys

from mambo_bags.cli import drawing
import pytest

DRAW = """
from mambo_bags.command import own_process
own_process()
import matplotlib
from matplotlib.figure import Figure
Figure().savefig('picture.png')
print(matplotlib.get_backend().lower(), matplotlib.rcParams['lines.linewidth'])
"""


@pytest.mark.long
@pytest.mark.parametrize('wrong', [
    {'MPLBACKEND': 'nonsense'}, {'MATPLOTLIBRC': '/dev/zero'}, {'MATPLOTLIBRC': '/'},
    {'MATPLOTLIBRC': 'mine'}, {'MPLCONFIGDIR': '/proc/none'},
    {'MPLBACKEND': 'nonsense', 'MATPLOTLIBRC': '/dev/zero'}])
def test_settings_of_the_environment_are_not_used(wrong, tmp_path):
    (tmp_path / 'mine').write_text('lines.linewidth: 77\n')
    check(tmp_path, wrong)


@pytest.mark.long
@pytest.mark.parametrize('make', [
    lambda path: path.symlink_to('/dev/zero'), os.mkfifo,
    lambda path: path.write_text('lines.linewidth: 77\nbackend: nonsense\n')])
def test_settings_of_the_working_directory_are_not_used(make, tmp_path):
    make(tmp_path / 'matplotlibrc')
    check(tmp_path, {})


def check(folder, environment):
    done = subprocess.run([sys.executable, '-c', DRAW], text=True, capture_output=True, timeout=60,
                          cwd=folder, env={**os.environ, **environment})
    assert (done.returncode, done.stdout, done.stderr) == (0, 'agg 1.5\n', '')
    assert (folder / 'picture.png').is_file()


def test_a_lock_that_an_ended_process_left_is_removed_and_that_of_a_living_one_is_not(
        tmp_path, monkeypatch):
    monkeypatch.setenv('MPLCONFIGDIR', str(tmp_path))
    old, new, other = (tmp_path / name for name in (
        'fontlist-v1.json.matplotlib-lock', 'new.matplotlib-lock', 'fontlist-v1.json'))
    for file in (old, new, other):
        file.touch()
    for file in (old, other):
        os.utime(file, (1e9, 1e9))
    drawing._remove_stale_locks()
    assert sorted(tmp_path.iterdir()) == sorted([new, other])
    monkeypatch.setenv('MPLCONFIGDIR', str(tmp_path / 'none'))
    drawing._remove_stale_locks()
