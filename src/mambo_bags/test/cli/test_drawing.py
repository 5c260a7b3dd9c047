"""Pictures of commands do not depend on the user's settings of matplotlib, which may be wrong."""

import os
import subprocess
import sys

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
