"""The arguments of ./test: what goes to colcon and to pytest, for which scripts stand in."""

import os
from pathlib import Path
import shlex
import shutil
import subprocess

import pytest

ROOT = Path(__file__).parents[2]
RECORD = """#!/bin/bash
printf '%q ' {name} "$@" | sed 's/ $/\\n/' >> calls
"""
COLCON = RECORD.format(name='colcon')
# a run of pytest is recorded and ends with the code in the file answer; others are real
PYTHON = RECORD.format(name='pytest').replace(
    '#!/bin/bash\n', '#!/bin/bash\n[[ "$1 $2" == "-m pytest" ]] || exec REAL "$@"\nshift 2\n'
) + 'exit "$(cat answer)"\n'
COUNT = """import sys
open('calls', 'a').write('count ' + ' '.join(sys.argv[1:]) + '\\n')
"""
RESULTS = '.cache/test-results'
WAITING = ['tests/graph', 'tests/workspace/test_chaos_a.py']


class Checkout:
    """A copy of ./test whose pytest and colcon only record their arguments."""

    def __init__(self, root):
        self.root = root
        for folder in ('tools', 'bin', '.cache', 'build', 'tests/workspace', 'src'):
            (root / folder).mkdir(parents=True)
        for file in ('test', 'tools/lanes.py'):
            shutil.copy(ROOT / file, root / file)
        for file, text in (
                ('env.bash', ''), ('tools/docs.py', ''), ('tools/count_tests.py', COUNT),
                ('tests/test_a b.py', ''), (WAITING[1], ''), ('answer', '0'),
                ('bin/colcon', COLCON),
                ('bin/python3', PYTHON.replace('REAL', shlex.quote(shutil.which('python3'))))):
            (root / file).write_text(text)
        for file in ('colcon', 'python3'):
            (root / 'bin' / file).chmod(0o755)

    def test(self, *arguments):
        """Return what colcon, each pytest (by the name of its results) and the count got."""
        (self.root / 'calls').write_text('')
        done = subprocess.run(
            [self.root / 'test', *arguments], text=True, capture_output=True, timeout=30,
            cwd=self.root, env=os.environ | {'PATH': f'{self.root}/bin:{os.environ["PATH"]}'})
        assert done.returncode == 0, done.stderr
        calls = {}
        for line in (self.root / 'calls').read_text().splitlines():
            name, *words = shlex.split(line)
            if name == 'colcon' and 'test-result' in words:
                continue
            if name == 'colcon':
                name = words[words.index('--log-base') + 1].removeprefix('log/')
                words = words[words.index('--pytest-args') + 1:]
            if name == 'pytest':
                name = words.pop(0).removeprefix(f'--junit-xml={RESULTS}/')
            assert name not in calls
            calls[name] = words
        return calls


@pytest.fixture
def checkout(tmp_path):
    """Return a checkout in a folder with a space."""
    return Checkout(tmp_path / 'a checkout')


@pytest.mark.parametrize('arguments, given, kind', [
    ([], ['-m', 'not long'], 'all'),
    (['--fast'], ['-m', 'not slow and not long'], 'chosen'),
    (['--long'], ['-m', 'long'], 'chosen'),
    (['-k', 'a or b'], ['-m', 'not long', '-k', 'a or b'], 'chosen'),
    (['--fast', '-k', 'a', '-x'], ['-m', 'not slow and not long', '-k', 'a', '-x'], 'chosen')])
def test_without_files_the_options_go_to_every_colcon_and_pytest(
        checkout, arguments, given, kind):
    colcon = [f' {word}' if word.startswith('-') else word for word in given]
    assert checkout.test(*arguments) == {
        **dict.fromkeys(('graph', 'analysis', 'steps', 'flight', 'drawing'), colcon),
        'graph.xml': [*given, *WAITING],
        'workspace.xml': [*given, 'tests/workspace', *(f'--ignore={one}' for one in WAITING)],
        'flights.xml': [*given, 'tests', '--ignore=tests/workspace', '--ignore=tests/graph'],
        'count': [kind, ':'.join(
            f'{RESULTS}/{one}.xml' for one in ('graph', 'workspace', 'flights'))]}


@pytest.mark.parametrize('arguments, given', [
    (['tests/test_a b.py'], ['tests/test_a b.py']),
    (['tests', 'src', '-x'], ['tests', 'src', '-x']),
    (['tests/test_a b.py::test_one'], ['tests/test_a b.py::test_one']),
    (['tests', '-k', 'a'], ['tests', '-k', 'a']),
    (['--fast', 'tests'], ['-m', 'not slow and not long', 'tests']),
    (['tests', '--long'], ['-m', 'long', 'tests'])])
def test_files_go_to_one_pytest_with_their_long_ones_unless_options_choose(
        checkout, arguments, given):
    assert checkout.test(*arguments) == {
        'tests.xml': given, 'count': ['files', '.cache/test-results/tests.xml']}


@pytest.mark.parametrize('code, stages', [('5', []), ('1', ['pytest'])])
def test_no_chosen_test_is_no_failed_stage_and_a_failure_is_one(checkout, code, stages):
    (checkout.root / 'answer').write_text(code)
    assert checkout.test('tests')['count'] == ['files', '.cache/test-results/tests.xml', *stages]


def test_a_job_in_which_pytest_fails_is_said(checkout):
    (checkout.root / 'answer').write_text('1')
    assert checkout.test()['count'][2:] == ['a', 'job']


def test_every_package_and_test_belongs_to_one_job(checkout):
    checkout.test()
    selected, skipped = [], set()
    for line in (checkout.root / 'calls').read_text().splitlines():
        words = shlex.split(line)
        if words[0] == 'colcon' and 'test' in words:
            names = words[words.index('sequential') + 3:words.index('--pytest-args')]
            if names[0] == '--packages-skip':
                skipped = {*names[1:]}
            else:
                assert names[0] == '--packages-select'
                selected += names[1:]
    assert sorted(selected) == sorted(skipped) and skipped
    assert skipped < {setup.parent.name for setup in (ROOT / 'src').glob('*/setup.py')}
