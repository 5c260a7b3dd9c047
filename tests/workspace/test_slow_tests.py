"""The tests that ./test --fast leaves out: how they are found, and that they exist."""

from pathlib import Path
import re
import subprocess
import sys

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / 'tools'))
import slow_tests  # noqa: E402 (a script of tools/, not a package)

RESULTS = """<testsuites><testsuite>
<testcase classname="mambo_x.src.mambo_x.test.part.test_a" name="test_one[2.0-b]" time="0.2"/>
<testcase classname="mambo_x.src.mambo_x.test.part.test_a" name="test_one[3.0-b]" time="0.4"/>
<testcase classname="tests.nodes.test_b.TestB" name="test_two" time="0.1"/>
<testcase classname="tests.gone.test_c" name="test_three" time="9.0"/>
</testsuite></testsuites>"""


def test_the_cases_of_a_test_are_one_time(tmp_path):
    for name in ('src/mambo_x/test/part/test_a.py', 'tests/nodes/test_b.py'):
        (tmp_path / name).parent.mkdir(parents=True)
        (tmp_path / name).touch()
    (tmp_path / 'pytest.xml').write_text(RESULTS)
    times = slow_tests.times([tmp_path / 'pytest.xml'], tmp_path)
    assert {name: round(seconds, 6) for name, seconds in times.items()} == {
        'src/mambo_x/test/part/test_a.py::test_one': 0.6,
        'tests/nodes/test_b.py::TestB::test_two': 0.1}


def test_every_test_of_the_list_exists():
    for name in (ROOT / slow_tests.LIST).read_text().splitlines():
        file, *_, function = name.split('::')
        assert re.search(rf'^ *def {function}\(', (ROOT / file).read_text(), re.MULTILINE), (
            f'{name} is gone: delete its line, or run ./test and tools/slow_tests.py')


def test_a_test_of_the_list_is_left_out_and_another_is_not():
    chosen = {}
    for marks in ('slow', 'not slow'):
        done = subprocess.run(
            [sys.executable, '-m', 'pytest', '-m', marks, '--collect-only', '-q', __file__],
            cwd=ROOT, text=True, capture_output=True, timeout=60)
        chosen[marks] = {line.partition('::')[2] for line in done.stdout.splitlines()
                         if '::' in line}
    itself = test_a_test_of_the_list_is_left_out_and_another_is_not.__name__
    assert itself in chosen['slow'] and itself not in chosen['not slow']
    assert test_every_test_of_the_list_exists.__name__ in chosen['not slow']
