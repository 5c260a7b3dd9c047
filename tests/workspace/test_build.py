"""tools/build.bash: it builds what changed, and only then (colcon stands in as a small script)."""

import fcntl
import os
from pathlib import Path
import shutil
import subprocess

import pytest

ROOT = Path(__file__).parents[2]
COLCON = """#!/bin/bash
echo "$@" >> calls
echo "$MAKEFLAGS" > makeflags
mkdir -p install
touch install/local_setup.bash
if [[ -d src/mambo_interfaces ]]; then
    mkdir -p build/mambo_interfaces
    cat answer > build/mambo_interfaces/colcon_build.rc
fi
[[ "$*" != *"--packages-select mambo_interfaces" ]] || exit "$(cat answer)"
mkdir -p build/mambo_a install/mambo_a/lib/mambo_a
printf '#!"/a b/python3"\\nprint()\\n' > install/mambo_a/lib/mambo_a/node
cat answer > build/mambo_a/colcon_build.rc
echo '--- stderr: mambo_a'; echo 'what went wrong'; echo '---'
exit "$(cat answer)"
"""
CMAKE = """#!/bin/bash
[[ $1 == --build ]] || exit 0
echo made >> messages
mkdir -p .venv/share/tf2_msgs
exit "$(cat cmake_answer)"
"""


class Workspace:
    """A workspace of one package whose builds are counted."""

    def __init__(self, root):
        self.root = root
        (root / 'tools').mkdir(parents=True)
        shutil.copy(ROOT / 'tools/build.bash', root / 'tools')
        for folder in ('src/mambo_a/config', 'src/mambo_a/mambo_a', 'bin'):
            (root / folder).mkdir(parents=True)
        for file in ('package.xml', 'setup.py', 'mambo_a/node.py', 'config/default.yaml'):
            self.write(f'src/mambo_a/{file}')
        self.write('colcon.meta')
        self.write('answer', '0')
        self.write('bin/colcon', COLCON)
        (root / 'bin/colcon').chmod(0o755)
        for path in root.rglob('*'):
            os.utime(path, (1e9, 1e9))

    def write(self, file, text=''):
        """Write a file that is younger than any build so far."""
        (self.root / file).write_text(text)

    def build(self, *part, **variables):
        """Return (exit code, number of builds so far, stderr)."""
        done = subprocess.run(
            [self.root / 'tools/build.bash', *part], text=True, capture_output=True, timeout=30,
            env=os.environ | {'PATH': f'{self.root}/bin:{os.environ["PATH"]}',
                              'MAMBO_ROS': 'system'} | variables)
        calls = self.root / 'calls'
        return (done.returncode, len(calls.read_text().splitlines()) if calls.exists() else 0,
                done.stderr)

    def age(self):
        """Make the last build old, so that the clock's resolution does not matter."""
        os.utime(self.root / 'build/mambo_a/colcon_build.rc', (1.1e9, 1.1e9))


@pytest.fixture
def workspace(tmp_path):
    """Return a workspace, in a folder with a space, after its first build."""
    workspace = Workspace(tmp_path / 'a checkout')
    code, calls, error = workspace.build()
    assert (code, calls) == (0, 1)
    assert error.startswith('mambo: building the workspace\nmambo: built in ')
    workspace.age()
    return workspace


def test_nothing_new_builds_nothing_and_says_nothing(workspace):
    assert workspace.build() == (0, 1, '')


@pytest.mark.parametrize('file', ['src/mambo_a/package.xml', 'src/mambo_a/setup.py',
                                  'src/mambo_a/setup.cfg', 'src/mambo_a/CMakeLists.txt',
                                  'src/mambo_a/New.msg', 'src/mambo_a/config/new.yaml',
                                  'colcon.meta'])
def test_what_a_build_looks_at_builds(workspace, file):
    workspace.write(file)
    assert workspace.build()[:2] == (0, 2)
    assert workspace.build() == (0, 2, '')


@pytest.mark.parametrize('file', ['src/mambo_a/mambo_a/node.py', 'src/mambo_a/mambo_a/new.py',
                                  'src/mambo_a/config/default.yaml'])
def test_what_is_linked_needs_no_build(workspace, file):
    workspace.write(file)
    assert workspace.build() == (0, 1, '')


@pytest.mark.parametrize('given, used', [('', f'-j{len(os.sched_getaffinity(0))}'),
                                         ('-j3 -l2', '-j3 -l2')])
def test_make_uses_every_core_unless_told_otherwise(workspace, given, used):
    workspace.write('colcon.meta')
    assert workspace.build(MAKEFLAGS=given)[:2] == (0, 2)
    assert (workspace.root / 'makeflags').read_text() == f'{used}\n'


def test_a_new_package_builds(workspace):
    (workspace.root / 'src/mambo_b').mkdir()
    workspace.write('src/mambo_b/package.xml')
    assert workspace.build()[1] == 2


def test_a_build_that_is_interrupted_says_so(workspace):
    workspace.write('src/mambo_a/setup.py')
    workspace.write('bin/colcon', '#!/bin/bash\ntrap "exit 2" INT\nkill -INT $PPID $$\nsleep 9')
    code, _, error = workspace.build()
    assert code == 130
    assert error.splitlines()[-1] == 'mambo: the build was interrupted: start it again to go on'


def test_a_second_build_says_that_it_waits(workspace):
    workspace.write('src/mambo_a/setup.py')
    (workspace.root / '.cache').mkdir(exist_ok=True)
    with (workspace.root / '.cache/build.lock').open('w') as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        waiting = subprocess.Popen(
            [workspace.root / 'tools/build.bash'], text=True, stderr=subprocess.PIPE,
            env=os.environ | {'PATH': f'{workspace.root}/bin:{os.environ["PATH"]}',
                              'MAMBO_ROS': 'system'})
        assert waiting.stderr.readline() == 'mambo: waiting for a build that is under way\n'
    assert waiting.communicate(timeout=30)[1].startswith('mambo: building the workspace\n')
    assert waiting.returncode == 0


def test_a_minute_of_compiling_is_announced_only_before_the_first(workspace):
    for folder, said in (('.cache', True), ('.cache/numba-1', False)):
        (workspace.root / folder).mkdir(exist_ok=True)
        workspace.write('src/mambo_a/setup.py')
        assert ('compiles for about a minute' in workspace.build()[2]) == said


@pytest.fixture
def unbuilt(tmp_path):
    """Return a workspace with messages before its first build."""
    workspace = Workspace(tmp_path / 'a checkout')
    for file in ('package.xml', 'CMakeLists.txt', 'msg/New.msg'):
        (workspace.root / f'src/mambo_interfaces/{file}').parent.mkdir(parents=True, exist_ok=True)
        workspace.write(f'src/mambo_interfaces/{file}')
    for path in workspace.root.rglob('*'):
        os.utime(path, (1e9, 1e9))
    return workspace


def test_a_first_flight_needs_the_messages_and_links_alone(unbuilt):
    calls = unbuilt.root / 'calls'
    assert unbuilt.build('flight')[:2] == (0, 1)
    assert calls.read_text().endswith('--packages-select mambo_interfaces\n')
    linked = unbuilt.root / 'build/mambo_a/mambo_a'
    assert linked.samefile(unbuilt.root / 'src/mambo_a/mambo_a')
    assert unbuilt.build('flight') == (0, 1, '')
    unbuilt.write('src/mambo_interfaces/msg/New.msg', 'float64 x')
    assert unbuilt.build('flight')[:2] == (0, 2)
    linked.unlink()
    assert unbuilt.build('flight') == (0, 2, '') and linked.exists()
    assert unbuilt.build()[:2] == (0, 3)  # anything else builds the rest
    assert '--packages-select' not in calls.read_text().splitlines()[-1]
    assert unbuilt.build('flight') == unbuilt.build() == (0, 3, '')
    unbuilt.write('src/mambo_a/setup.py')
    assert unbuilt.build('flight')[:2] == (0, 4)
    assert '--packages-select' not in calls.read_text().splitlines()[-1]


def test_a_failed_build_says_why_and_is_tried_again(workspace):
    workspace.write('answer', '2')
    workspace.write('src/mambo_a/setup.py')
    for calls in (2, 3):
        code, count, error = workspace.build()
        assert (code, count) == (1, calls)
        assert 'what went wrong' in error
        assert '.cache/build.log' in error


def test_a_build_that_fails_with_many_lines_ends_with_what_to_read(workspace):
    colcon = (workspace.root / 'bin/colcon').read_text()
    workspace.write('bin/colcon', colcon.replace(
        "echo 'what went wrong'", "seq 100000 | sed 's/^/what went wrong /'"))
    workspace.write('answer', '2')
    workspace.write('src/mambo_a/setup.py')
    code, _, error = workspace.build()
    assert code == 1 and len(error.splitlines()) < 50
    assert error.splitlines()[-1].startswith('mambo: the build failed: see ')


def test_scripts_can_be_executed_although_the_path_has_a_space(workspace):
    script = workspace.root / 'install/mambo_a/lib/mambo_a/node'
    assert script.read_text() == '#!/usr/bin/env python3\nprint()\n'


@pytest.fixture
def wheels(workspace):
    """Return the workspace with the sources of messages that have no wheel."""
    (workspace.root / 'compat/tf2_msgs/msg').mkdir(parents=True)
    for file in ('package.xml', 'CMakeLists.txt', 'msg/TFMessage.msg'):
        workspace.write(f'compat/tf2_msgs/{file}', 'one')
    workspace.write('cmake_answer', '0')
    workspace.write('bin/cmake', CMAKE)
    (workspace.root / 'bin/cmake').chmod(0o755)
    return workspace


def test_messages_without_a_wheel_are_built_once_for_the_wheels_alone(wheels):
    assert wheels.build() == (0, 1, '')  # beside an installed ROS
    made = wheels.root / 'messages'
    assert not made.exists()
    for content, count in (('one', 1), ('two', 2)):
        wheels.write('compat/tf2_msgs/msg/TFMessage.msg', content)
        for _ in range(2):
            code, _, error = wheels.build(MAMBO_ROS='wheels')
            assert code == 0, error
            assert made.read_text() == 'made\n' * count


def test_messages_that_cannot_be_built_are_one_line_and_are_tried_again(wheels):
    wheels.write('cmake_answer', '1')
    for count in (1, 2):
        code, _, error = wheels.build(MAMBO_ROS='wheels')
        assert code == 1
        assert error == (
            'mambo: building the workspace\nmambo: could not build compat/tf2_msgs: see '
            f'{wheels.root}/.cache/tf2_msgs.log\n')
        assert (wheels.root / 'messages').read_text() == 'made\n' * count
