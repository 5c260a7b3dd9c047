"""A reader in a process of its own ends in time and stays within the limits of the user."""

import gc
import os
from pathlib import Path
import signal
import subprocess
import sys
import time

from mambo_analysis.importers import bounded
from mambo_model.schema import ParameterError
import numpy as np
import pytest


def asleep(path):
    time.sleep(60.0)


def test_a_reader_that_takes_too_long_is_ended_and_the_limit_named(monkeypatch):
    monkeypatch.setenv('MAMBO_MAX_READING_S', '1')
    began = time.monotonic()
    with pytest.raises(bounded.UnreadableError, match=r'1 s; MAMBO_MAX_READING_S \(now 1\)'):
        bounded.call(asleep, Path(__file__))
    assert time.monotonic() - began < 20.0


LIMITED = """
from pathlib import Path
import resource
from mambo_analysis.importers import bounded
resource.setrlimit(resource.RLIMIT_AS, (6 << 30, 6 << 30))
print(bounded.call(lambda path: resource.getrlimit(resource.RLIMIT_AS), Path('.')))
"""


def test_a_limit_that_the_user_has_set_stays():
    done = subprocess.run([sys.executable, '-c', LIMITED], capture_output=True, text=True,
                          env={**os.environ, 'MAMBO_MAX_UNPACKED_MB': '4000'}, timeout=60)
    assert (done.stdout, done.stderr) == (f'{(6 << 30, 6 << 30)}\n', '')


@pytest.fixture
def file(tmp_path):
    path = tmp_path / 'a.mat'
    path.write_bytes(b'content')
    return path


def test_what_a_reader_returns_comes_back_whole(file):
    rows = np.random.default_rng(0).normal(size=(2000, 50))  # more than a pipe holds
    found = bounded.call(lambda path: {path.name: rows, 'text': path.read_bytes()}, file)
    np.testing.assert_array_equal(found['a.mat'], rows)
    assert found['text'] == b'content'


def test_a_reader_works_in_a_process_of_its_own(file):
    known = []

    def read(_):
        known.append(1)
        os.environ['MAMBO_TEST_LEFT'] = 'behind'
        return os.getpid()
    assert bounded.call(read, file) != os.getpid()
    assert not known and 'MAMBO_TEST_LEFT' not in os.environ


@pytest.mark.parametrize(('error', 'text'), [
    (ValueError('a\nb   c'), 'a b c'), (KeyError('name'), "'name'"),
    (RuntimeError(''), 'its content is damaged'), (ZeroDivisionError('x' * 500), 'x' * 120)])
def test_whatever_a_reader_raises_is_one_short_line(file, error, text):
    def read(_):
        raise error
    with pytest.raises(bounded.UnreadableError) as caught:
        bounded.call(read, file)
    assert str(caught.value) == text


def test_an_error_of_the_file_system_stays_one(tmp_path):
    with pytest.raises(FileNotFoundError) as caught:
        bounded.call(Path.read_bytes, tmp_path / 'none')
    assert caught.value.strerror == 'No such file or directory'


def test_a_reader_that_crashes_is_told_and_nothing_is_printed(file, capfd):
    def crash(_):
        os.write(2, b'Fatal Python error: Segmentation fault')
        os.kill(os.getpid(), signal.SIGSEGV)
    with pytest.raises(bounded.UnreadableError, match='^it makes its reader crash$'):
        bounded.call(crash, file)
    assert not capfd.readouterr().err


def test_garbage_of_the_caller_is_not_destroyed_by_the_reader(file):
    class Node:
        """Has a thread, which a copy of its process has not."""

        def __init__(self):
            self.itself, self.process = self, os.getpid()

        def __del__(self):
            if os.getpid() != self.process:
                os.kill(os.getpid(), signal.SIGSEGV)
    gc.disable()
    Node()
    try:
        assert bounded.call(lambda _: gc.collect() >= 0, file)
    finally:
        gc.enable()
        gc.collect()


def test_garbage_of_the_caller_is_not_destroyed_before_the_reader_begins(file, monkeypatch):
    monkeypatch.setattr(bounded, '_work', lambda function, path, send: send.send(
        (gc.isenabled(), None)))
    assert not bounded.call(Path.read_bytes, file)
    assert gc.isenabled()


def test_a_reader_that_wants_too_much_memory_is_stopped_and_the_limit_named(file, monkeypatch):
    monkeypatch.setenv('MAMBO_MAX_UNPACKED_MB', '10')
    with pytest.raises(bounded.UnreadableError, match='more memory than allowed; '
                                                      'MAMBO_MAX_UNPACKED_MB .now 10.'):
        bounded.call(lambda _: bytes(200_000_000), file)
    assert len(bounded.call(lambda _: bytes(5_000_000), file)) == 5_000_000


def test_a_limit_that_is_no_number_is_told_before_anything_is_read(file, monkeypatch):
    monkeypatch.setenv('MAMBO_MAX_READING_S', 'long')
    with pytest.raises(ParameterError, match="MAMBO_MAX_READING_S='long' must be a whole number"):
        bounded.call(lambda _: pytest.fail('read'), file)
