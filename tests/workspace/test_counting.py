"""The end of ./test: what it counts, and what it does not let pass in silence."""

from pathlib import Path
import subprocess
import sys

import pytest

TOOLS = Path(__file__).parents[2] / 'tools'
sys.path.insert(0, str(TOOLS))
import count_tests as summary  # noqa: E402 (a script of tools/, not a package)

Count = summary.Count
PASSED = {'mambo_model': Count(4, 0, 1), 'tests': Count(2, 0, 0)}


def junit(folder, **numbers):
    """Write a JUnit file with the given numbers."""
    file = folder / 'results.xml'
    text = ' '.join(f'{key}="{value}"' for key, value in numbers.items())
    file.write_text(f'<testsuites><testsuite name="pytest" {text}/></testsuites>')
    return file


def test_a_file_is_counted_with_errors_as_failures(tmp_path):
    file = junit(tmp_path, tests=10, failures=1, errors=2, skipped=3)
    assert summary.count(file) == Count(passed=4, failed=3, skipped=3)


@pytest.mark.parametrize('text', [None, '', '<testsuites><testsuite'])
def test_a_file_that_is_missing_or_cut_off_is_a_failure(tmp_path, text):
    file = tmp_path / 'results.xml'
    if text is not None:
        file.write_text(text)
    assert summary.count(file) == Count(failed=1)


def test_the_tests_across_packages_are_counted_from_every_file(tmp_path, monkeypatch, capsys):
    (tmp_path / 'one').mkdir()
    files = [junit(tmp_path / 'one', tests=10, skipped=3), junit(tmp_path, tests=2, failures=0)]
    monkeypatch.delenv('MAMBO_TEST_RUN', raising=False)
    for gone, total in (('', 'total: 9 passed, 0 failed, 3 skipped'),
                        (':gone.xml', 'total: 9 passed, 1 failed, 3 skipped')):
        monkeypatch.setattr(sys, 'argv', ['count', 'files', ':'.join(map(str, files)) + gone])
        assert summary.main() == (1 if gone else 0)
        assert capsys.readouterr().out.splitlines()[-1] == total


def test_failed_tests_are_named_before_the_counts(tmp_path, monkeypatch, capsys):
    cases = ''.join(
        f'<testcase classname="test.test_a" name="test_{number}"><{kind} message="{said}"/>'
        '</testcase>' for number, (kind, said) in enumerate([
            ('failure', 'assert 1 == 2&#10; +  where'), ('error', 'no fixture'), ('skipped', '')]))
    file = tmp_path / 'results.xml'
    file.write_text('<testsuites><testsuite tests="4" failures="1" errors="1" skipped="1">'
                    f'<testcase classname="test.test_a" name="good"/>{cases}'
                    '</testsuite></testsuites>')
    monkeypatch.delenv('MAMBO_TEST_RUN', raising=False)
    monkeypatch.setattr(sys, 'argv', ['count', 'files', f'{file}:{tmp_path}/gone.xml', 'pytest'])
    assert summary.main() == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[1:4] == [
        'FAILED tests: test.test_a::test_0: assert 1 == 2',
        'FAILED tests: test.test_a::test_1: no fixture',
        f'FAILED tests: {tmp_path}/gone.xml: missing or incomplete']
    assert lines[-1] == 'total: 1 passed, 3 failed, 1 skipped'
    monkeypatch.setattr(summary, 'MAX_NAMED', 1)
    assert summary.main() == 1
    assert capsys.readouterr().out.splitlines()[2] == 'and 2 more'


def test_the_last_line_counts():
    lines, total = summary.summarise(PASSED, 'all', [], [])
    assert lines[-1] == 'total: 6 passed, 0 failed, 1 skipped'
    assert total == Count(6, 0, 1)


def test_a_package_without_a_test_is_a_failure_unless_options_chose():
    rows = PASSED | {'mambo_sim': Count()}
    lines, total = summary.summarise(rows, 'all', [], [])
    assert total.failed == 1
    assert any('mambo_sim' in line and 'NO TEST RAN' in line for line in lines)
    assert summary.summarise(rows, 'chosen', [], [])[1].failed == 0


def test_choosing_no_test_at_all_is_a_failure():
    assert summary.summarise({'tests': Count()}, 'chosen', [], [])[1].failed == 1


def test_a_stage_that_failed_counts_once_and_only_if_no_test_says_so():
    assert summary.summarise(PASSED, 'all', ['colcon test'], [])[1].failed == 1
    rows = PASSED | {'mambo_sim': Count(0, 2, 0)}
    assert summary.summarise(rows, 'all', ['colcon test'], [])[1].failed == 2


@pytest.mark.long
def test_what_is_left_running_is_ended_and_counts(monkeypatch):
    monkeypatch.setenv('MAMBO_TEST_RUN', 'of this test')
    sleeper = 'import signal, time; signal.signal(signal.SIGINT, signal.SIG_IGN); '\
        'print(flush=True); time.sleep(60)'
    with subprocess.Popen([sys.executable, '-c', sleeper], stdout=subprocess.PIPE) as process:
        process.stdout.readline()
        monkeypatch.setenv('MAMBO_TEST_RUN', 'of another')
        assert summary.leftovers('nothing like it') == {}
        assert list(summary.leftovers('of this test')) == [process.pid]
        process_ended = summary.end_leftovers('of this test')
        assert process.wait(5) != 0
    assert 'time.sleep(60)' in process_ended[0]
    lines, total = summary.summarise(PASSED, 'all', [], process_ended)
    assert total.failed == 1
    assert lines[-2].startswith('left running: ')
