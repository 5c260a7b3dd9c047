"""The small ros2: the arguments, lines and exit codes of ros2run and ros2pkg."""

import os
from pathlib import Path
import signal
import subprocess
import sys

import pytest

ROS2 = Path(__file__).parents[2] / 'tools/ros2'


@pytest.fixture
def prefix(tmp_path, monkeypatch):
    """Return a ROS prefix, in a folder with a space, with a package ``demo``."""
    index = tmp_path / 'a prefix/share/ament_index/resource_index/packages'
    index.mkdir(parents=True)
    prefix = tmp_path / 'a prefix'
    for package in ('demo', 'bare'):
        (index / package).touch()
        (prefix / 'share' / package).mkdir()
    (prefix / 'share/demo/package.xml').write_text(
        '<package format="3"><name>demo</name><version>1.2.3</version></package>')
    program(prefix, 'say', 'echo "$@"')
    program(prefix, 'fail', 'exit 7')
    (prefix / 'lib/demo/notes.txt').write_text('not executable')
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(prefix))
    return prefix


def program(prefix, name, body, shebang='#!/bin/sh'):
    """Add an executable to the package demo."""
    path = prefix / 'lib/demo' / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f'{shebang}\n{body}\n')
    path.chmod(0o755)
    return path


def ros2(*arguments):
    """Return (exit code, stdout, stderr) of the command."""
    done = subprocess.run([sys.executable, str(ROS2), *arguments], text=True,
                          capture_output=True, timeout=30)
    return done.returncode, done.stdout, done.stderr


def test_run_passes_every_argument_as_it_is(prefix):
    arguments = ['--ros-args', '-p', 'text:=a  b', '--prefix', '--help', '']
    assert ros2('run', 'demo', 'say', *arguments) == (
        0, '--ros-args -p text:=a  b --prefix --help \n', '')


def test_run_returns_the_exit_code_of_the_executable(prefix):
    assert ros2('run', 'demo', 'fail') == (7, '', '')


def test_run_does_without_an_output(prefix):
    program(prefix, 'demo', 'exit 3')
    done = subprocess.run(
        ['bash', '-c', '"$@" >&-', 'bash', sys.executable, str(ROS2), 'run', 'demo', 'demo'],
        text=True, capture_output=True, timeout=30)
    assert (done.returncode, done.stderr) == (3, '')


def test_run_finds_an_executable_in_a_subfolder_but_not_in_a_hidden_one(prefix):
    program(prefix, 'sub/deep', 'echo deep')
    program(prefix, '.hidden/secret', 'echo secret')
    assert ros2('run', 'demo', 'deep') == (0, 'deep\n', '')
    assert ros2('run', 'demo', 'secret') == (1, '', 'No executable found\n')


def test_run_of_an_unknown_package(prefix):
    assert ros2('run', 'nowhere', 'say') == (1, '', "Package 'nowhere' not found\n")
    assert ros2('run', '../demo', 'say') == (1, '', "Package '../demo' not found\n")


@pytest.mark.parametrize('name', ['nothing', 'notes.txt', 'sa'])
def test_run_of_an_unknown_executable(prefix, name):
    assert ros2('run', 'demo', name) == (1, '', 'No executable found\n')
    assert ros2('run', 'bare', name) == (1, '', 'No executable found\n')


def test_run_of_a_package_alone_says_what_there_is(prefix):
    code, out, error = ros2('run', 'demo')
    assert (code, out) == (2, '')
    assert error == 'ros2 run demo needs one of its executables:\n  fail\n  say\n'
    assert ros2('run', 'bare') == (2, '', "Package 'bare' has no executables\n")
    assert ros2('run', 'nowhere') == (1, '', "Package 'nowhere' not found\n")


@pytest.mark.long
def test_run_of_a_package_of_ours_alone_has_a_line_for_each_executable():
    code, _, error = ros2('run', 'mambo_analysis')
    lines = dict(line.split(maxsplit=1) for line in error.splitlines()[1:])
    assert code == 2 and lines['recover'].startswith('Recover a bag whose recorder was killed')
    assert {'compare', 'fly', 'import_motive', 'sweep'} <= set(lines)


def test_run_of_a_name_that_two_executables_have(prefix):
    paths = [prefix / 'lib/demo/say', program(prefix, 'sub/say', '')]
    assert ros2('run', 'demo', 'say') == (
        1, '', f'Multiple executables found:\n- {paths[0]}\n- {paths[1]}\n')


def test_run_puts_the_prefix_before_the_executable(prefix):
    assert ros2('run', '--prefix', "env 'A=x  y' sh", 'demo', 'say', '1') == (0, '1\n', '')
    code, _, error = ros2('run', '--prefix', 'no-such-command', 'demo', 'say')
    assert (code, error) == (1, 'no-such-command: No such file or directory\n')


def test_run_of_a_script_whose_interpreter_path_has_a_space(prefix):
    program(prefix, 'spaced', 'print("ran")', shebang='#!"/a b/python3"')
    assert ros2('run', 'demo', 'spaced') == (0, 'ran\n', '')


WAITS = """import signal, sys, time
caught = []
for number in (signal.SIGINT, signal.SIGTERM):
    signal.signal(number, lambda n, frame: caught.append(n))
print('ready', flush=True)
while not caught:
    time.sleep(0.01)
time.sleep(0.2)  # a second copy of the signal would come now
print(*caught, flush=True)
sys.exit(5)"""


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize('send', [os.kill, os.killpg], ids=['kill', 'terminal'])
def test_a_signal_reaches_the_executable_once_and_its_exit_code_comes_back(prefix, send, number):
    program(prefix, 'wait', WAITS, shebang='#!/usr/bin/env python3')
    with subprocess.Popen([sys.executable, str(ROS2), 'run', 'demo', 'wait'], text=True,
                          stdout=subprocess.PIPE, start_new_session=True) as process:
        assert process.stdout.readline() == 'ready\n'
        send(process.pid, number)
        assert process.stdout.read() == f'{int(number)}\n'
        assert process.wait(10) == 5


def test_killing_the_command_leaves_nothing_behind(prefix):
    program(prefix, 'wait', 'echo $$; exec sleep 60')
    with subprocess.Popen([sys.executable, str(ROS2), 'run', 'demo', 'wait'], text=True,
                          stdout=subprocess.PIPE) as process:
        executable = int(process.stdout.readline())
        process.kill()
        process.wait(10)
    with pytest.raises(ProcessLookupError):
        os.kill(executable, 0)


def test_pkg_list_names_every_package_in_order(prefix):
    assert ros2('pkg', 'list') == (0, 'bare\ndemo\n', '')


def test_pkg_executables_of_one_package_and_of_all(prefix):
    names = 'demo fail\ndemo say\n'
    paths = f'{prefix}/lib/demo/fail\n{prefix}/lib/demo/say\n'
    assert ros2('pkg', 'executables', 'demo') == (0, names, '')
    assert ros2('pkg', 'executables') == (0, names, '')
    assert ros2('pkg', 'executables', '--full-path', 'demo') == (0, paths, '')
    assert ros2('pkg', 'executables', 'bare') == (0, '', '')
    assert ros2('pkg', 'executables', 'nowhere') == (1, '', "Package 'nowhere' not found\n")


def test_pkg_prefix_and_share(prefix):
    assert ros2('pkg', 'prefix', 'demo') == (0, f'{prefix}\n', '')
    assert ros2('pkg', 'prefix', '--share', 'demo') == (0, f'{prefix}/share/demo\n', '')
    for options in ([], ['--share']):
        assert ros2('pkg', 'prefix', *options, 'nowhere') == (1, '', 'Package not found\n')


def test_pkg_xml_whole_and_by_tag(prefix):
    assert '<name>demo</name>' in ros2('pkg', 'xml', 'demo')[1]
    assert ros2('pkg', 'xml', 'demo', '-t', 'version') == (0, '1.2.3\n', '')
    assert ros2('pkg', 'xml', 'demo', '--tag', 'author') == (1, '', 'XML tag not found\n')
    assert ros2('pkg', 'xml', 'bare') == (1, '', 'Package XML manifest not found\n')
    assert ros2('pkg', 'xml', 'nowhere') == (1, '', 'Package not found\n')


def test_commands_that_need_an_installed_ros_say_so(prefix):
    code, out, error = ros2('topic', 'list')
    assert (code, out) == (1, '')
    assert 'installed ROS 2' in error


@pytest.mark.parametrize('arguments', [[], ['pkg'], ['--help'], ['run', '--help']])
def test_help_is_printed_where_a_verb_is_missing(prefix, arguments):
    code, out, error = ros2(*arguments)
    assert (code, error) == (0, '')
    assert out.startswith('usage: ros2')
