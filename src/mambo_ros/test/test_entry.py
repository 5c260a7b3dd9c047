"""A node that gets a signal while it loads its modules ends with one line."""

import signal
import subprocess
import sys

from mambo_ros import entry
import pytest

SLOW = """
import sys, time
print("loading", flush=True)
time.sleep(30)
"""
NODE = """
import signal, sys
def main():
    print(sys.argv[1:], signal.getsignal(signal.SIGINT).__qualname__)
    return 3
"""
RUN = 'import sys; sys.path.insert(0, ""); from mambo_ros import entry; entry.package.{}_node()'


def start(folder, name, text, *words, **options):
    """Start the entry point of a node whose module has a text."""
    (folder / 'package').mkdir()
    (folder / 'package' / f'{name}_node.py').write_text(text)
    return subprocess.Popen(
        [sys.executable, '-c', RUN.format(name), *words], cwd=folder, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE, text=True, **options)


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_while_modules_load_is_one_line(tmp_path, number):
    node = start(tmp_path, 'slow', SLOW)
    assert node.stdout.readline() == 'loading\n'
    node.send_signal(number)
    assert node.communicate(timeout=20)[1] == f'slow_node: ended by {number.name}\n'
    assert node.returncode == 128 + number


def test_what_is_ignored_stays_so(tmp_path):
    node = start(tmp_path, 'slow', SLOW.replace('30', '1'), preexec_fn=lambda: signal.signal(
        signal.SIGHUP, signal.SIG_IGN))  # nohup
    assert node.stdout.readline() == 'loading\n'
    node.send_signal(signal.SIGHUP)
    assert "has no attribute 'main'" in node.communicate(timeout=20)[1]


def test_the_node_has_its_arguments_and_its_exit_code(tmp_path):
    node = start(tmp_path, 'one', NODE, '--ros-args')
    assert node.communicate(timeout=20) == ("['--ros-args'] Entry.__call__.<locals>.leave\n", '')
    assert node.returncode == 3


def test_names_of_python_are_not_modules():
    assert not hasattr(entry, '__wrapped__') and entry.a.b_node.name == 'a.b_node'
