"""A user's file as a module: one for each content, with the helpers beside it; errors by line."""

import signal
import sys
import time

from mambo_model.own_file import describe, digest, fault_place, load_file
from mambo_model.schema import ParameterError
import pytest


@pytest.fixture
def write(tmp_path):
    def write(text, name='mine.py'):
        (tmp_path / name).write_text(text)
        return tmp_path / name
    return write


def test_a_file_is_loaded_once_for_each_content(write):
    path = write('answer = 1\n')
    first = load_file(path)
    assert load_file(path) is first and first.answer == 1
    write('answer = 2\n')
    assert load_file(path).answer == 2
    write('answer = 1\n')
    assert load_file(path) is first


def test_the_digest_is_that_of_the_file_and_of_what_it_imports_beside_it(write):
    write('SIZE = 1\n', 'helper.py')
    write('UNUSED = 1\n', 'other.py')
    path = write('from helper import SIZE\nimport math\n')
    before = digest(path)
    write('UNUSED = 2\n', 'other.py')
    assert digest(path) == before
    write('SIZE = 2\n', 'helper.py')
    assert digest(path) != before


def test_helpers_that_import_each_other_have_an_end(write):
    write('import b\n', 'a.py')
    write('import a\n', 'b.py')
    assert digest(write('import a\n')) == digest(write('import a\n'))


def test_named_tuples_of_two_versions_have_names_of_their_own(write):
    text = 'from typing import NamedTuple\n\n\nclass State(NamedTuple):\n    x: float\n'
    first = load_file(write(text)).State
    second = load_file(write(f'{text}    y: float\n')).State
    assert first.__name__ != second.__name__
    assert first.__name__.startswith('State_') and second(1.0, 2.0).y == 2.0


@pytest.mark.parametrize(('text', 'wanted'), [
    ('x = (\n', r"mine.py:1: '\(' was never closed"),
    ('def f():\n    return 1\n\n\nf() / 0\n', 'mine.py:5: ZeroDivisionError: division by zero'),
    # its kind depends on the version of Python
    ('x = 1\0\n', 'mine.py: (ValueError: )?source code string cannot contain null bytes'),
    ('raise SystemExit(5)\n', 'mine.py:1: SystemExit: 5'),
    ('def f():\n    f()\n\n\nf()\n', 'mine.py:2: RecursionError'),
    ('class E(Exception):\n    def __str__(self):\n        return None\n\n\nraise E\n',
     'mine.py:6: E: its text cannot be read'),
    ('import no_such_module\n', 'mine.py:1: ModuleNotFoundError')])
def test_what_fails_while_it_is_loaded_is_told_by_line(write, text, wanted):
    path, before = write(text), list(sys.path)
    with pytest.raises(ParameterError, match=wanted) as caught:
        load_file(path)
    assert '\n' not in str(caught.value) and sys.path == before
    assert not [name for name in sys.modules if name.endswith(digest(path)[:16])]


def test_a_file_that_never_ends_is_ended_though_it_passes_over_errors(write, monkeypatch):
    monkeypatch.setenv('MAMBO_MAX_READING_S', '1')
    path = write('while True:\n    try:\n        import time\n        time.sleep(60)\n'
                 '    except Exception:\n        pass\n')
    handler, began = signal.getsignal(signal.SIGALRM), time.monotonic()
    with pytest.raises(ParameterError, match=(
            r'mine.py:4: takes more than 1 s; MAMBO_MAX_READING_S \(now 1\) raises the limit')):
        load_file(path)
    assert time.monotonic() - began < 20.0
    assert signal.getsignal(signal.SIGALRM) is handler
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_an_error_is_described_in_one_line_with_its_kind():
    assert describe(ValueError('a\n  b')) == 'ValueError: a b'
    assert describe(KeyError()) == 'KeyError: no message'


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(ParameterError, match='none.py: No such file or directory'):
        load_file(tmp_path / 'none.py')


def test_a_fault_is_at_the_innermost_line_of_the_users_folder(write):
    write('def inner():\n    return [][3]\n', 'own_helper.py')
    path = write('import own_helper\n\n\ndef outer():\n    return own_helper.inner()\n')
    try:
        load_file(path).outer()
    except IndexError as error:
        assert fault_place(path, error) == f'{path.parent / "own_helper.py"}:2'
        assert fault_place(None, error) == 'None'
    sys.modules.pop('own_helper', None)
