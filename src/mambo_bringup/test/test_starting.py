"""A signal is one line while Python loads a command and after the command has ended, too."""

import os
import signal
import subprocess
import sys

import pytest

BEGIN = """
import os, signal, sys
from types import SimpleNamespace
from mambo_bringup import starting


def strike(*_):
    os.kill(os.getpid(), signal.{signal})


"""
ENDING = ['SIGINT', 'SIGTERM', 'SIGHUP']


def run(text, signal='SIGINT'):
    begin = BEGIN.replace('{signal}', signal)
    return subprocess.run([sys.executable, '-c', begin + text], capture_output=True, text=True,
                          timeout=60)


@pytest.mark.parametrize('sent', ENDING)
@pytest.mark.parametrize('name', ['run', 'mambo'])
def test_a_signal_while_python_loads_a_command_is_one_line(name, sent):
    done = run(f'starting.import_module = strike\nsys.exit(starting.main({name!r}))', sent)
    assert (done.returncode, done.stdout) == (128 + signal.Signals[sent], '')
    assert done.stderr == f'{name}: ended by {sent}\n'


def test_ctrl_c_in_a_command_is_one_line():
    done = run("""
starting.import_module = lambda *_: SimpleNamespace(main=strike)
sys.exit(starting.main('mambo'))
""")
    assert (done.returncode, done.stderr) == (130, 'mambo: ended by SIGINT\n')


@pytest.mark.parametrize('sent', ENDING)
def test_a_signal_after_a_command_is_one_line(sent):
    done = run("""
starting.import_module = lambda *_: SimpleNamespace(main=lambda: 0)
starting.main('mambo')
strike()
""", sent)
    assert (done.returncode, done.stderr) == (
        128 + signal.Signals[sent], f'mambo: ended by {sent}\n')


def test_an_end_of_the_terminal_that_is_to_be_ignored_is_ignored():
    done = run("""
signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
starting.import_module = lambda *_: SimpleNamespace(main=lambda: strike() or 7)
starting.main('mambo')
strike()
print('here')
""", 'SIGHUP')
    assert (done.returncode, done.stdout, done.stderr) == (0, 'here\n', '')


def test_a_command_returns_its_exit_code():
    done = run("""
starting.import_module = lambda *_: SimpleNamespace(main=lambda: 7)
sys.exit(starting.main('run'))
""")
    assert (done.returncode, done.stderr) == (7, '')


def test_python_is_not_taken_down_but_exit_handlers_run():
    done = run("""
class Loaded:
    def __del__(self):
        print('taken down')


import atexit
loaded = Loaded()
starting.import_module = lambda *_: SimpleNamespace(
    main=lambda: (atexit.register(print, 'handled'), 3)[1])
sys.exit(starting.run('mambo'))
""")
    assert (done.returncode, done.stdout, done.stderr) == (3, 'handled\n', '')


def test_a_signal_in_code_from_a_text_is_no_other_signal_at_the_end(tmp_path):
    """Python ends ``-m`` by SIGINT after a KeyboardInterrupt in exec(), even if it was caught."""
    (tmp_path / 'text.py').write_text(BEGIN.replace('{signal}', 'SIGTERM') + """
starting.import_module = lambda *_: SimpleNamespace(main=lambda: exec('strike()'))
sys.exit(starting.run('mambo'))
""")
    path = os.pathsep.join([str(tmp_path), os.environ.get('PYTHONPATH', '')])
    done = subprocess.run([sys.executable, '-m', 'text'], capture_output=True, text=True,
                          timeout=60, env={**os.environ, 'PYTHONPATH': path})
    assert (done.returncode, done.stderr) == (143, 'mambo: ended by SIGTERM\n')


def test_an_error_in_a_command_ends_python_as_always():
    done = run("""
starting.import_module = lambda *_: SimpleNamespace(main=lambda: 1 / 0)
sys.exit(starting.run('mambo'))
""")
    assert done.returncode == 1 and 'ZeroDivisionError' in done.stderr


@pytest.mark.skipif(not os.path.exists('/dev/full'), reason='no /dev/full')
def test_output_that_cannot_be_written_at_the_end_is_no_success():
    with open('/dev/full', 'w') as full:
        done = subprocess.run([sys.executable, '-c', BEGIN.replace('{signal}', 'SIGINT') + """
starting.import_module = lambda *_: SimpleNamespace(main=lambda: print('text') or 0)
sys.exit(starting.run('mambo'))
"""], stdout=full, timeout=60)
    assert done.returncode != 0


def test_libraries_that_are_not_found_are_one_line_with_the_remedy():
    done = run("""
def command():
    raise ImportError('librcl.so: cannot open shared object file: No such file\\nThe C extension')
starting.import_module = lambda *_: SimpleNamespace(main=command)
sys.exit(starting.main('run'))
""")
    assert (done.returncode, done.stderr) == (
        1, 'run: librcl.so: cannot open shared object file: No such file: source env.bash again '
        'in this shell, which sets LD_LIBRARY_PATH\n')


@pytest.mark.parametrize('raised, line', [
    ("OSError(24, 'Too many open files', 'x')", "[Errno 24] Too many open files: 'x'"),
    ('MemoryError', 'out of memory'),
    ("ImportError('a.so: failed to map segment from shared object')",
     'a.so: failed to map segment from shared object')])
def test_a_library_that_cannot_be_loaded_for_lack_of_something_is_one_line(raised, line):
    done = run(f"""
def command():
    raise {raised}
starting.import_module = lambda *_: SimpleNamespace(main=command)
sys.exit(starting.main('mambo'))
""")
    assert (done.returncode, done.stderr) == (1, f'mambo: {line}\n')


def test_a_thread_that_never_ends_does_not_hold_up_the_exit():
    done = run("""
import threading, time
starting._THREADS = 0.2
def main():
    threading.Thread(target=lambda: time.sleep(600)).start()
    print('done')
    return 3
starting.import_module = lambda *_: SimpleNamespace(main=main)
sys.exit(starting.main('mambo'))
""")
    assert (done.returncode, done.stdout) == (3, 'done\n')
    assert done.stderr == 'mambo: a thread was still running and was ended\n'


def test_a_thread_that_ends_soon_is_waited_for():
    done = run("""
import threading, time
def main():
    threading.Thread(target=lambda: (time.sleep(0.5), print('late'))).start()
    return 0
starting.import_module = lambda *_: SimpleNamespace(main=main)
sys.exit(starting.main('mambo'))
""")
    assert (done.returncode, done.stdout, done.stderr) == (0, 'late\n', '')


def test_a_current_folder_that_was_removed_is_one_line(tmp_path):
    done = run(f"""
os.mkdir({str(tmp_path / 'gone')!r})
os.chdir({str(tmp_path / 'gone')!r})
os.rmdir({str(tmp_path / 'gone')!r})
sys.exit(starting.main('mambo'))
""")
    assert done.returncode == 1
    assert done.stderr == ('mambo: the current folder cannot be used (No such file or directory): '
                           'change to another one\n')
