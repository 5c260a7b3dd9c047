"""
Write tests/slow.txt, the tests that ``./test --fast`` leaves out, from the times of the last run.

usage: slow_tests.py [SECONDS]

A test is slow if all its cases together took longer than SECONDS, 0.3 if not given. Run the whole
``./test`` before. Tests marked slow by hand are left out as well.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import Path
import sys
import xml.etree.ElementTree as ElementTree

ROOT = Path(__file__).resolve().parents[1]
LIST = Path('tests', 'slow.txt')
LIMIT = 0.3  # s


def name(case: ElementTree.Element, root: Path = ROOT) -> str:
    """
    Return the name of a test case without its parameters, as pytest writes it; empty: unknown.

    JUnit separates folders, file and class by dots; a prefix of the package may come before.
    """
    words = case.get('classname', '').split('.')
    if words[1:2] == ['src']:
        del words[0]
    for end in range(len(words), 0, -1):
        file = Path(*words[:end]).with_suffix('.py')
        if (root / file).is_file():
            function = case.get('name', '').partition('[')[0]
            return '::'.join([file.as_posix(), *words[end:], function])
    return ''


def times(files: Iterable[Path], root: Path = ROOT) -> Counter[str]:
    """Return the time of each test in s, that of all its cases, of JUnit files."""
    out: Counter[str] = Counter()
    for file in files:
        for case in ElementTree.parse(file).iter('testcase'):
            out[name(case, root)] += float(case.get('time', 0))
    del out['']
    return out


def main() -> int:
    """Write the list; return 1 if nothing was measured."""
    limit = float(sys.argv[1]) if len(sys.argv) > 1 else LIMIT
    files = [*ROOT.glob('build/*/pytest.xml'), *ROOT.glob('.cache/test-results/*.xml')]
    found = times(files)
    if not found:
        print('slow_tests: no results: run ./test first', file=sys.stderr)
        return 1
    slow = sorted(test for test, seconds in found.items() if seconds > limit)
    (ROOT / LIST).write_text('\n'.join(slow) + '\n')
    rest = sum(found.values()) - sum(found[test] for test in slow)
    print(f'{LIST}: {len(slow)} of {len(found)} tests; the others took {rest:.0f} s')
    return 0


if __name__ == '__main__':
    sys.exit(main())
