"""Settings at which libraries end with a traceback are one line before these are imported."""

import os
import resource
import subprocess
import sys

from mambo_bags.cli import environment
from mambo_bags.cli.environment import complaint
import pytest

FREE = resource.RLIM_INFINITY
MAMBO = [sys.executable, '-m', 'mambo_bringup.mambo']


@pytest.mark.parametrize('text', ['abc', '', '-5', '1e400', '9' * 20, '1.5', '\u0665'])
def test_a_date_that_is_none_is_named(text, monkeypatch):
    monkeypatch.setenv('SOURCE_DATE_EPOCH', text)
    assert complaint() == (f'SOURCE_DATE_EPOCH={text!r} must be a whole number of seconds since '
                           '1970: set or unset it')


@pytest.mark.parametrize('text', ['0', '1700000000', '253402300799'])
def test_a_date_passes(text, monkeypatch):
    monkeypatch.setenv('SOURCE_DATE_EPOCH', text)
    assert complaint() == ''


@pytest.mark.parametrize('text', ['0', '-1', '', 'two', '1.5', '\u0665'])
def test_a_number_of_threads_that_is_none_is_named(text, monkeypatch):
    monkeypatch.delenv('SOURCE_DATE_EPOCH', raising=False)
    monkeypatch.setenv('NUMBA_NUM_THREADS', text)
    assert complaint() == (f'NUMBA_NUM_THREADS={text!r} must be a whole number of threads, 1 or '
                           'more: set or unset it')
    monkeypatch.setenv('NUMBA_NUM_THREADS', '1')
    assert complaint() == ''


def test_a_middleware_that_is_not_installed_is_named_where_ros_is_used(tmp_path, monkeypatch):
    folder = tmp_path / 'share/ament_index/resource_index/rmw_typesupport'
    folder.mkdir(parents=True)
    for name in ('rmw_implementation', 'rmw_one', 'rmw_other'):
        (folder / name).touch()
    monkeypatch.delenv('SOURCE_DATE_EPOCH', raising=False)
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'/none:{tmp_path}')
    monkeypatch.setenv('RMW_IMPLEMENTATION', 'nonsense')
    assert complaint(ros=True) == ("RMW_IMPLEMENTATION='nonsense' is not installed: unset it, or "
                                   'set it to rmw_one or rmw_other')
    assert complaint() == ''
    for name in ('rmw_one', ''):
        monkeypatch.setenv('RMW_IMPLEMENTATION', name)
        assert complaint(ros=True) == ''
    monkeypatch.setenv('RMW_IMPLEMENTATION', 'nonsense')
    monkeypatch.setenv('AMENT_PREFIX_PATH', '/none')  # nobody knows which there are
    assert complaint(ros=True) == ''


@pytest.mark.parametrize('limit, wrong', [
    (400_000_000,
     'the limit of memory, 400 MB, is too low: set it to 1000 MB or more (ulimit -v)'),
    (1_000_000_000, ''), (resource.RLIM_INFINITY, '')])
def test_a_limit_of_memory_that_no_library_bears_is_named(limit, wrong, monkeypatch):
    monkeypatch.delenv('SOURCE_DATE_EPOCH', raising=False)
    monkeypatch.setattr(environment.resource, 'getrlimit', lambda kind: (limit, limit))
    assert complaint() == wrong


def test_threads_that_cannot_be_started_are_told(monkeypatch):
    monkeypatch.delenv('SOURCE_DATE_EPOCH', raising=False)
    monkeypatch.setattr(environment.os, 'sched_getaffinity', lambda pid: {0, 1, 2})
    start, started = environment.threading.Thread.start, []

    def limited(thread):
        started.append(thread)
        if len(started) == 2:
            raise RuntimeError("can't start new thread")
        start(thread)

    monkeypatch.setattr(environment.threading.Thread, 'start', limited)
    assert complaint() == (
        '2 of 3 threads, one for each processor, cannot be started: allow more processes and '
        'threads (ulimit -u), or end others')
    assert complaint() == ''  # all of them are over
    assert not any(thread.is_alive() for thread in started)


@pytest.mark.parametrize('memory, count, said', [
    (FREE, FREE, ''), (FREE, 30_000, ''),
    (FREE, 13, '; this shell limits processes and threads to 13 (ulimit -u)'),
    (2_000_000_000, FREE, '; this shell limits memory to 2000 MB (ulimit -v)'),
    (2_000_000_000, 13, '; this shell limits memory to 2000 MB (ulimit -v) and processes and '
     'threads to 13 (ulimit -u)')])
def test_low_limits_are_named(memory, count, said, monkeypatch):
    values = {resource.RLIMIT_AS: memory, resource.RLIMIT_NPROC: count}
    monkeypatch.setattr(environment.resource, 'getrlimit', lambda kind: (values[kind],) * 2)
    assert environment.low_limits() == said


@pytest.mark.parametrize('start, variable', [
    ([*MAMBO, 'compare', 'none'], 'SOURCE_DATE_EPOCH'), ([*MAMBO, 'stop'], 'RMW_IMPLEMENTATION'),
    ([sys.executable, '-m', 'mambo_bringup.starting', 'run'], 'RMW_IMPLEMENTATION'),
    ([sys.executable, '-m', 'mambo_bringup.starting', 'run'], 'SOURCE_DATE_EPOCH')])
def test_a_command_says_so_and_ends(start, variable):
    assert f": {variable}='abc' " in refused(start, variable, 'abc')


@pytest.mark.parametrize('start', [
    [*MAMBO, 'fly'], [sys.executable, '-m', 'mambo_bringup.starting', 'run']])
@pytest.mark.parametrize('variable, value, said', [
    ('PYTHONOPTIMIZE', '2', ': Python without docstrings, of which help texts are made, cannot '
     'be used: unset PYTHONOPTIMIZE, or set it to 1\n'),
    ('NUMBA_NUM_THREADS', '0', ": NUMBA_NUM_THREADS='0' must be a whole number of threads, ")])
def test_a_setting_of_python_or_of_the_compiler_is_named(start, variable, value, said):
    assert said in refused(start, variable, value)


def refused(start, variable, value):
    """Return the one line of a command that the environment keeps from starting."""
    done = subprocess.run(start, env={**os.environ, variable: value}, capture_output=True,
                          text=True, timeout=60)
    assert done.returncode == 2 and done.stdout == '' and done.stderr.count('\n') == 1
    return done.stderr
