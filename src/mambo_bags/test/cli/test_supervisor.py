"""A user's code that ends the process is one line and exit code 1; signals end it as ever."""

import os
from pathlib import Path
import signal
import subprocess
import sys
import time

import pytest

TOOL = """
import os, sys, tempfile
from pathlib import Path
from mambo_bags.command import guard, own_process
from mambo_bringup.stopping import stoppable
from mambo_model.own_file import load_file
own_process()
print('before', flush=False)


def work():
    with tempfile.TemporaryDirectory(prefix='kept_', dir='.'):
        module = load_file(Path('mine.py'))
        print(module.work())


sys.exit(stoppable('tool', lambda: guard('tool', work)))
"""
WAITS = """
import time
from pathlib import Path
def work():
    Path('ready').touch()
    time.sleep(60)
"""


def start(folder, code, tool=TOOL):
    (folder / 'mine.py').write_text(code)
    return subprocess.Popen([sys.executable, '-c', tool], text=True, cwd=folder,
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                            start_new_session=True)


@pytest.mark.long
@pytest.mark.parametrize('code, how', [
    ('import os; os._exit(0)', 'exit code 0'),
    ('import os\ndef work(): os._exit(7)', 'exit code 7'),
    ('import sys\ndef work(): sys.exit(0)', 'exit code 0'),
    ('import ctypes\ndef work(): ctypes.string_at(0)', 'SIGSEGV, Segmentation fault'),
    ('import os\ndef work(): os.abort()', 'SIGABRT, Aborted'),
    ('import os\ndef work(): os.kill(os.getpid(), 9)', 'SIGKILL, Killed'),
    ('import os\ndef work(): os.kill(os.getpid(), 19)', 'SIGSTOP, Stopped (signal)')])
def test_code_that_ends_the_process_is_one_line(code, how, tmp_path):
    tool = start(tmp_path, code)
    out, err = tool.communicate(timeout=60)
    assert (tool.returncode, out) == (1, 'before\n')
    assert err == (f'tool: mine.py: this file, or code that it calls, ended the command ({how}) '
                   'before its result was written; it must return or raise an error\n')
    assert not list(tmp_path.glob('kept_*'))  # what the command had begun is cleared away


@pytest.mark.long
@pytest.mark.parametrize('code, status, out, err', [
    ('def work(): return 5', 0, 'before\n5\n', ''),
    ('def work(): open("none")', 2, 'before\n', 'tool: none: No such file or directory\n')])
def test_code_that_returns_or_raises_is_as_ever(code, status, out, err, tmp_path):
    tool = start(tmp_path, code)
    assert (*tool.communicate(timeout=60), tool.returncode) == (out, err, status)


@pytest.mark.parametrize('group', [False, True], ids=['process', 'terminal'])
@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_to_one_or_both_is_one_line(number, group, tmp_path):
    tool = start(tmp_path, WAITS)
    wait_for(tmp_path / 'ready')
    (os.killpg if group else os.kill)(tool.pid, number)
    _, err = tool.communicate(timeout=30)
    assert (tool.returncode, err) == (128 + number, f'tool: ended by {number.name}\n')
    assert not list(tmp_path.glob('kept_*'))


@pytest.mark.long
def test_a_crash_at_a_signal_is_no_fault_of_the_file(tmp_path):
    code = WAITS.replace('    Path(', """    import os, signal
    signal.signal(signal.SIGINT, lambda *_: os.kill(os.getpid(), signal.SIGSEGV))
    Path(""")
    tool = start(tmp_path, code)
    wait_for(tmp_path / 'ready')
    os.killpg(tool.pid, signal.SIGINT)
    out, err = tool.communicate(timeout=60)
    assert (tool.returncode, out, err) == (130, 'before\n', 'tool: ended by SIGINT\n')


@pytest.mark.parametrize('stuck', [
    'sum(range(10**13))',  # in C code that looks at no signals
    'os.kill(os.getpid(), signal.SIGSTOP)',
    'signal.signal(signal.SIGINT, signal.SIG_IGN); time.sleep(60)'])
@pytest.mark.parametrize('signals', [1, 1000])
def test_code_that_answers_no_signal_is_ended(stuck, signals, tmp_path):
    patient = TOOL.replace('own_process()\n', 'own_process()\n'
                           'from mambo_bags.cli import supervisor\nsupervisor._DEAF = 2.0\n')
    tool = start(tmp_path, 'import os, signal\n' + WAITS.replace('time.sleep(60)', stuck),
                 patient if signals == 1 else TOOL)
    wait_for(tmp_path / 'ready')
    began = time.monotonic()
    for _ in range(signals):  # of two that come before the first is seen, the kernel keeps one
        tool.send_signal(signal.SIGINT)
        time.sleep(0.2)
        if tool.poll() is not None or time.monotonic() - began > 8.0:
            break
    _, err = tool.communicate(timeout=30)
    # a further signal may come when Python has already ended; a shell calls that 130, too
    assert tool.returncode in ((130,) if signals == 1 else (130, -signal.SIGINT))
    assert err == 'tool: ended by SIGINT\n'
    assert time.monotonic() - began < 8.0  # s: of the 10 that one signal is given
    assert not list(tmp_path.glob('kept_*'))


@pytest.mark.long
def test_a_command_that_ctrl_z_stopped_goes_on(tmp_path):
    tool = start(tmp_path, WAITS.replace('sleep(60)', 'sleep(1)'))
    wait_for(tmp_path / 'ready')
    os.killpg(tool.pid, signal.SIGSTOP)
    time.sleep(5.0)  # more than a copy that is stopped alone is given
    os.killpg(tool.pid, signal.SIGCONT)
    out, err = tool.communicate(timeout=30)
    assert (tool.returncode, out, err) == (0, 'before\nNone\n', '')


@pytest.mark.long
def test_the_command_ends_with_the_process_above_it(tmp_path):
    tool = start(tmp_path, WAITS.replace(
        '.touch()', '.write_text(str(__import__("os").getpid()))'))
    wait_for(tmp_path / 'ready')
    time.sleep(0.1)
    pid = int((tmp_path / 'ready').read_text())
    assert pid != tool.pid
    tool.kill()
    tool.communicate(timeout=30)  # its outputs are closed: by the copy, too
    assert not Path(f'/proc/{pid}/exe').exists()


def wait_for(file):
    limit = time.monotonic() + 60.0
    while not file.exists():
        assert time.monotonic() < limit
        time.sleep(0.01)
    time.sleep(0.05)
