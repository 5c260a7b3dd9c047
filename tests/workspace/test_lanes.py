"""tools/lanes.py: jobs side by side, each line whole and named, and nothing left of them."""

import importlib.util
import os
from pathlib import Path
import re
import signal
import subprocess
import sys
import time

import pytest

LANES = Path(__file__).parents[2] / 'tools/lanes.py'
SLEEPER = 'trap "exit 3" INT; echo up; while true; do sleep 0.1; done'


def lanes(*words, at_once=3):
    return subprocess.Popen(
        [sys.executable, LANES, str(at_once), *words], stdout=subprocess.PIPE, text=True)


def bash(text):
    """Return the command that runs a script, quoted for bash."""
    return f"bash -c '{text}'"


def test_lines_are_whole_and_named_and_come_as_they_are_printed():
    run = lanes('one', bash('printf a; sleep 0.5; echo b; read; sleep 2; echo c'),
                'second', bash('echo d >&2; exit 0'))
    began = time.monotonic()
    lines = [(line.rstrip('\n'), time.monotonic() - began) for line in run.stdout]
    assert run.wait() == 0
    texts = [text for text, _ in lines]
    assert [text for text in texts if 'exit code' not in text] == [
        'second | d', 'one    | ab', 'one    | c']
    assert [bool(re.fullmatch(r'(one|second) +\| exit code 0 after \d+ s', text))
            for text in texts].count(True) == 2
    assert lines[texts.index('one    | c')][1] - lines[texts.index('one    | ab')][1] > 1.0


@pytest.mark.parametrize(('codes', 'found'), [((0, 0), 0), ((4, 0), 1), ((0, 5), 1), ((1, 1), 1)])
def test_the_exit_code_says_whether_a_job_failed(codes, found):
    run = lanes(*(word for k, code in enumerate(codes) for word in (f'{k}', bash(f'exit {code}'))))
    assert 'exit code' in run.communicate()[0]
    assert run.returncode == found


def test_the_next_job_begins_when_one_of_those_that_run_ends():
    run = lanes('a', bash('echo begins; sleep 1.5; echo ends'), 'b', bash('echo short'),
                'c', bash('echo begins; sleep 0.2'), 'd', bash('echo last; exit 3'), at_once=2)
    out = [line for line in run.communicate()[0].splitlines() if 'exit code' not in line]
    assert {*out[:2]} == {'a | begins', 'b | short'}
    assert out[2:] == ['c | begins', 'd | last', 'a | ends'] and run.returncode == 1
    run = lanes('a', bash('sleep 1; echo a'), 'b', bash('echo b'), at_once=1)
    out = [line for line in run.communicate()[0].splitlines() if 'exit code' not in line]
    assert out == ['a | a', 'b | b'] and run.returncode == 0


def test_words_are_passed_on_as_they_are_quoted(tmp_path):
    run = lanes('a', r"printf %s\\n 'b c' $'d\'e'")
    assert run.communicate()[0].splitlines()[:2] == ['a | b c', "a | d'e"]


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_ends_every_job_once_and_begins_none(number):
    run = lanes('a', bash(SLEEPER), 'b', bash(SLEEPER), 'c', bash('echo c'), at_once=2)
    assert [run.stdout.readline() for _ in 'ab'] and run.poll() is None
    run.send_signal(number)
    out, _ = run.communicate(timeout=20.0)
    assert run.returncode == 128 + number and 'c | ' not in out


def test_a_command_can_be_interrupted_itself():
    """One that a shell starts in the background ignores SIGINT, and so do all its children."""
    run = lanes('a', f'{sys.executable} -c "import signal; print(signal.getsignal(2))"')
    assert 'default_int_handler' in run.communicate()[0]


def test_one_that_does_not_end_is_killed(tmp_path):
    stubborn = bash(f'trap "" INT; echo $$ > {tmp_path}/pid; echo up; '
                    'while true; do sleep 0.1; done')
    run = subprocess.Popen(
        [sys.executable, '-c', f'import sys; sys.path.insert(0, "{LANES.parent}"); import lanes; '
         f'lanes.PATIENCE = 0.5; sys.exit(lanes.run(1, {{"a": {stubborn!r}}}))'],
        stdout=subprocess.PIPE, text=True)
    assert run.stdout.readline() == 'a | up\n'
    run.send_signal(signal.SIGINT)
    assert run.wait(20.0) == 130
    with pytest.raises(ProcessLookupError):
        os.kill(int((tmp_path / 'pid').read_text()), 0)
    run.stdout.close()


def test_two_runs_have_two_ros_domains(monkeypatch):
    mine = os.environ['ROS_DOMAIN_ID']
    monkeypatch.setenv('ROS_DOMAIN_ID', mine)  # so that it is as it was afterwards
    spec = importlib.util.spec_from_file_location('again', LANES.parents[1] / 'conftest.py')
    again = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(again)
    assert os.environ['ROS_DOMAIN_ID'] != mine
