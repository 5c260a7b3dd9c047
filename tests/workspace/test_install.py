"""tools/install.bash: an installation that is interrupted can be started again."""

import os
from pathlib import Path
import shutil
import subprocess

ROOT = Path(__file__).parents[2]
PYTHON = """#!/bin/bash
[[ $1 != -m ]] || exit 1
"""
FIND = """#!/bin/bash
kill -INT $PPID
"""


def program(file, text):
    """Write a script that stands in for a program."""
    file.parent.mkdir(exist_ok=True)
    file.write_text(text)
    file.chmod(0o755)


def install(root):
    """Return (exit code, stderr) of an installation whose python3 makes no environment."""
    done = subprocess.run(
        [root / 'tools/install.bash', 'wheels'], text=True, capture_output=True, timeout=30,
        env=os.environ | {'PATH': f'{root}/bin:{os.environ["PATH"]}'})
    return done.returncode, done.stderr.splitlines()


def test_an_interrupted_installation_of_a_moved_checkout_goes_on(tmp_path):
    """The environment of the old place is still known as this project's."""
    root = tmp_path / 'a checkout'
    shutil.copytree(ROOT / 'requirements', root / 'requirements')
    (root / 'tools').mkdir()
    for file in ('install.bash', 'relocate_wheels.py', 'local_setup.sh'):
        shutil.copy(ROOT / 'tools' / file, root / 'tools')
    program(root / 'bin/python3', PYTHON)
    program(root / 'bin/uname', 'echo Linux x86_64')
    for file in ('lib/one', 'bin/pip', '.mambo'):
        (root / '.venv' / file).parent.mkdir(parents=True, exist_ok=True)
        (root / '.venv' / file).write_text('wheels, Python 3.11, /elsewhere\n')
    program(root / 'bin/find', FIND)
    code, lines = install(root)
    assert code == 130
    assert lines[-1] == 'mambo: the installation was interrupted: start it again to go on'
    (root / 'bin/find').unlink()
    assert install(root) == (1, [
        'mambo: installing ROS 2 Jazzy and the Python packages into .venv (once, about 0.8 GB)',
        f'mambo: could not make {root}/.venv: see {root}/.cache/install.log'])
    assert [file.name for file in (root / '.venv').iterdir()] == ['.mambo']
