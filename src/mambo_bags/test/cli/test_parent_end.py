"""A process ends with its parent, also if that one has ended before."""

import os
import signal
import subprocess
import sys
import time

import pytest

WAITS = ('import os, signal, sys, time\n'
         'from mambo_bags.cli.parent_end import end_with\n'
         'end_with(int(sys.argv[1]), signal.Signals(int(sys.argv[2])))\n'
         'print("waiting", flush=True)\ntime.sleep(60)\n')
PARENT = ('import os, subprocess, sys\n'
          'child = subprocess.Popen([sys.executable, "-c", sys.argv[1], str(os.getpid()), "9"],'
          ' stdout=subprocess.PIPE)\n'
          'child.stdout.readline()\nprint(child.pid, flush=True)\nos._exit(0)\n')


def is_alive(pid):
    try:
        with open(f'/proc/{pid}/stat') as file:
            return file.read().rpartition(')')[2].split()[0] not in 'ZX'
    except OSError:
        return False


def test_it_is_killed_when_its_parent_ends():
    said = subprocess.run([sys.executable, '-c', PARENT, WAITS], capture_output=True, text=True,
                          timeout=60, check=True)
    limit = time.monotonic() + 10.0
    while is_alive(int(said.stdout)):
        assert time.monotonic() < limit
        time.sleep(0.02)


@pytest.mark.parametrize('number', [signal.SIGKILL, signal.SIGTERM])
def test_without_its_parent_it_ends_at_once_by_the_signal(number):
    code = subprocess.run([sys.executable, '-c', WAITS, '1' if os.getpid() != 1 else '2',
                           str(int(number))], timeout=60).returncode
    assert code == -number
