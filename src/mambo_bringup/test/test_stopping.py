"""Signals of the user become one line and an exit code, however many come and whenever."""

import signal
import subprocess
import sys

import pytest

BEGIN = """
import multiprocessing, os, signal, sys, time
from mambo_bringup.stopping import stoppable


def strike(number):
    os.kill(os.getpid(), number)
    time.sleep(20.0)


"""


def run(text, *arguments):
    return subprocess.run([sys.executable, '-c', BEGIN + text, *arguments], capture_output=True,
                          text=True, timeout=60)


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_is_one_line_and_the_exit_code_of_a_shell(number):
    done = run(f'sys.exit(stoppable("tool", lambda: strike({int(number)})))')
    assert (done.returncode, done.stdout) == (128 + number, '')
    assert done.stderr == f'tool: ended by {number.name}\n'


def test_work_may_add_what_becomes_of_it():
    done = run("""
def work():
    try:
        strike(signal.SIGTERM)
    except KeyboardInterrupt as end:
        raise KeyboardInterrupt(*end.args, 'two of ten are kept') from None

sys.exit(stoppable('tool', work))
""")
    assert (done.returncode, done.stderr) == (
        143, 'tool: ended by SIGTERM; two of ten are kept\n')


def test_a_second_signal_ends_what_is_cleared_away():
    done = run("""
def work():
    try:
        strike(signal.SIGINT)
    finally:
        strike(signal.SIGINT)

sys.exit(stoppable('tool', work))
""")
    assert (done.returncode, done.stderr) == (130, 'tool: ended by SIGINT\n')


@pytest.mark.parametrize('code', [0, 4])
def test_an_interrupt_that_was_dropped_as_the_work_ended_is_no_success(code):
    """Python drops an error in ``__del__``; the work then ends before it is interrupted again."""
    done = run(f"""
class Dropping:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGTERM)
        sum(range(10))


def work():
    Dropping()
    return {code}


code = stoppable('tool', work)
sys.stderr.flush()
os._exit(code)
""")
    line = '' if code else 'tool: ended by SIGTERM\n'
    assert (done.returncode, done.stderr) == (code or 143, line)


def test_a_copy_that_works_for_the_tool_is_ended_as_ever():
    done = run("""
def work():
    copy = multiprocessing.get_context('fork').Process(target=time.sleep, args=(20.0,))
    copy.start()
    time.sleep(0.2)
    copy.terminate()
    copy.join()
    print(copy.exitcode)
    return 0

sys.exit(stoppable('tool', work))
""")
    assert (done.returncode, done.stdout, done.stderr) == (0, '-15\n', '')


CALLED_BY_A_LIBRARY = """
import ctypes
@ctypes.CFUNCTYPE(None)
def callback():
    os.kill(os.getpid(), signal.SIGINT)
    time.sleep(0.01)

def work():
    callback()  # drops the error, as the compiler does
"""


@pytest.mark.parametrize('after', ['time.sleep(20.0)', 'raise RuntimeError("no compiled object")'])
def test_a_signal_that_a_library_drops_is_not_lost(after):
    done = run(f'{CALLED_BY_A_LIBRARY}    {after}\n\nsys.exit(stoppable("tool", work))')
    assert (done.returncode, done.stderr) == (130, 'tool: ended by SIGINT\n')


def test_errors_that_python_ignores_are_still_printed():
    done = run("""
class Noisy:
    def __del__(self):
        raise ValueError('mine')

def work():
    Noisy()
    return 0

sys.exit(stoppable('tool', work))
""")
    assert done.returncode == 0 and 'ValueError: mine' in done.stderr
