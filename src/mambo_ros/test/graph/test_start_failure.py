"""A node that cannot start for lack of something says so in one line."""

import os
import subprocess
import sys

import pytest

NODE = """
from mambo_ros import process
def node():
    raise {}
process.compose([node])
"""


def start(folder, error, *words, **variables):
    """Run a node that raises an error; return exit code and stderr."""
    (folder / 'one_node.py').write_text(NODE.format(error))
    done = subprocess.run(
        [sys.executable, 'one_node.py', *words], cwd=folder, text=True, timeout=60,
        capture_output=True, env={**os.environ, **variables})
    return done.returncode, done.stderr


@pytest.mark.parametrize('error, line', [
    ("OSError(24, 'Too many open files', 'a.so')", "[Errno 24] Too many open files: 'a.so'"),
    ("RuntimeError('pthread_create failed: Resource temporarily unavailable')",
     'pthread_create failed: Resource temporarily unavailable'),
    ('MemoryError', 'out of memory')])
def test_what_the_machine_is_out_of_is_one_line(tmp_path, error, line):
    assert start(tmp_path, error) == (1, f'one_node: {line}\n')


@pytest.mark.parametrize('words', [('-p', 'port:=1'), ('--nope',), ('x', '--ros-args')])
def test_arguments_that_are_not_of_ros_are_refused(tmp_path, words):
    code, line = start(tmp_path, 'MemoryError', *words)
    assert code == 2 and line.startswith(f'one_node: {words[0]!r} is no argument of a node: it ')
    assert line.count('\n') == 1


@pytest.mark.long
def test_a_missing_file_is_wrong_input(tmp_path):
    code, line = start(tmp_path, "FileNotFoundError(2, 'No such file or directory', 'a')")
    assert (code, line) == (2, "one_node: [Errno 2] No such file or directory: 'a'\n")


@pytest.mark.long
def test_any_other_error_keeps_its_traceback(tmp_path):
    code, text = start(tmp_path, "ValueError('x')")
    assert code == 1 and text.startswith('Traceback') and text.endswith('ValueError: x\n')


@pytest.mark.long
@pytest.mark.parametrize('folder', ['/proc', '/proc/none'])
def test_a_folder_for_logs_that_cannot_be_written_is_named(tmp_path, folder):
    code, line = start(tmp_path, 'AssertionError', ROS_LOG_DIR=folder)
    assert code == 1 and line.count('\n') == 1 and folder in line
    assert line.startswith('one_node: ROS cannot start: ')
    assert line.endswith(': set ROS_LOG_DIR to a folder that can be written\n')
