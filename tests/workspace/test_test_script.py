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
JUNIT = f'--junit-xml={RESULTS}/tests.xml'
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
        """Return what pytest, the lanes of colcon and the count got, by name."""
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
            if name == 'pytest' and f'--junit-xml={RESULTS}/graph.xml' in words:
                name = 'graph'
            assert name not in calls
            calls[name] = words
        return calls


@pytest.fixture
def checkout(tmp_path):
    """Return a checkout in a folder with a space."""
    return Checkout(tmp_path / 'a checkout')


@pytest.mark.parametrize('arguments, given, kind', [
    ([], ['-m', 'not sweep'], 'all'),
    (['--fast'], ['-m', 'not slow and not sweep'], 'chosen'),
    (['--sweeps'], ['-m', 'sweep'], 'chosen'),
    (['-k', 'a or b'], ['-m', 'not sweep', '-k', 'a or b'], 'chosen'),
    (['--fast', '-k', 'a', '-x'], ['-m', 'not slow and not sweep', '-k', 'a', '-x'], 'chosen')])
def test_without_files_the_options_go_to_every_lane_and_to_pytest(
        checkout, arguments, given, kind):
    colcon = [f' {word}' if word.startswith('-') else word for word in given]
    assert checkout.test(*arguments) == {
        'first': colcon, 'second': colcon, 'third': colcon,
        'pytest': [JUNIT, *given, 'tests', *(f'--ignore={one}' for one in WAITING)],
        'graph': [f'--junit-xml={RESULTS}/graph.xml', *given, *WAITING],
        'count': [kind, f'{RESULTS}/tests.xml:{RESULTS}/graph.xml']}


@pytest.mark.parametrize('arguments, given', [
    (['tests/test_a b.py'], ['tests/test_a b.py']),
    (['tests', 'src', '-x'], ['tests', 'src', '-x']),
    (['tests/test_a b.py::test_one'], ['tests/test_a b.py::test_one']),
    (['tests', '-k', 'a'], ['tests', '-k', 'a']),
    (['--fast', 'tests'], ['-m', 'not slow and not sweep', 'tests']),
    (['tests', '--sweeps'], ['-m', 'sweep', 'tests'])])
def test_files_go_to_one_pytest_with_their_sweeps_unless_options_choose(
        checkout, arguments, given):
    assert checkout.test(*arguments) == {
        'pytest': [JUNIT, *given], 'count': ['files', '.cache/test-results/tests.xml']}


@pytest.mark.parametrize('code, stages', [('5', []), ('1', ['pytest'])])
def test_no_chosen_test_is_no_failed_stage_and_a_failure_is_one(checkout, code, stages):
    (checkout.root / 'answer').write_text(code)
    assert checkout.test('tests')['count'] == ['files', '.cache/test-results/tests.xml', *stages]


def test_a_lane_in_which_pytest_fails_is_named(checkout):
    (checkout.root / 'answer').write_text('1')
    assert checkout.test()['count'][2:] == ['the', 'second', 'lane', 'the', 'third', 'lane']
