"""Which signals end a process."""

import signal
import subprocess
import sys

from mambo_ros.graph.ending_signals import ending, SIGNALS
import pytest


@pytest.fixture
def hangup():
    before = signal.getsignal(signal.SIGHUP)
    yield lambda handler: signal.signal(signal.SIGHUP, handler)
    signal.signal(signal.SIGHUP, before)


def test_the_end_of_the_terminal_ends_a_process_but_not_under_nohup(hangup):
    hangup(signal.SIG_DFL)
    assert ending() == list(SIGNALS)
    hangup(signal.SIG_IGN)
    assert ending() == [signal.SIGINT, signal.SIGTERM]


def test_a_program_that_begins_with_it_loads_nothing_slow():
    code = ('import sys; from mambo_ros.graph import ending_signals; '
            'print(*{"numpy", "numba", "rclpy"} & set(sys.modules))')
    done = subprocess.run([sys.executable, '-c', code], stdout=subprocess.PIPE, timeout=60)
    assert (done.stdout, done.returncode) == (b'\n', 0)
