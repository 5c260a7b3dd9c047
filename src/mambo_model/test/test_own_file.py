"""A user's file as a module: one for each content, with the helpers beside it; errors by line."""

import os
import random
import signal
import sys
import threading
import time
from types import ModuleType

from mambo_model.own_file import describe, digest, fault_place, forget, load_file
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


def test_a_changed_file_is_not_taken_from_bytecode_of_its_second(write, monkeypatch):
    monkeypatch.setattr(sys, 'dont_write_bytecode', False)
    monkeypatch.setattr(sys, 'pycache_prefix', None)
    for size in (1, 2):  # as long, and of the same time
        os.utime(write(f'SIZE = {size}\n', 'helper.py'), (1e9, 1e9))
        path = write(f'from helper import SIZE\nanswer = {size}\n')
        os.utime(path, (1e9, 1e9))
        assert (load_file(path).answer, load_file(path).SIZE) == (size, size)
    assert sorted(file.name for file in path.parent.iterdir()) == ['helper.py', 'mine.py']


def test_a_helper_that_changes_in_a_session_counts(write):
    write('SIZE = 1\n', 'helper.py')
    path = write('import helper\n')
    first = load_file(path)
    write('SIZE = 2\n', 'helper.py')
    assert (load_file(path).helper.SIZE, first.helper.SIZE) == (2, 1)
    assert 'helper' not in sys.modules


def test_helpers_of_one_name_in_two_folders_are_told_apart(tmp_path):
    found = []
    for size in (1, 2):
        folder = tmp_path / str(size)
        folder.mkdir()
        (folder / 'helper.py').write_text(f'SIZE = {size}\n')
        (folder / 'mine.py').write_text('from helper import SIZE\n')
        found.append(load_file(folder / 'mine.py').SIZE)
    assert found == [1, 2]


def test_a_package_beside_a_file_belongs_to_it(write, tmp_path):
    (tmp_path / 'net' / 'deep').mkdir(parents=True)
    write('from .deep.weights import SCALE\n', 'net/__init__.py')
    write('import base\nSCALE = base.ONE\n', 'net/deep/weights.py')
    path = write('import net\nfrom net.deep import weights\nscale = net.SCALE\n')
    for one in (1, 2):
        write(f'ONE = {one}\n', 'base.py')
        module = load_file(path)
        assert (module.scale, module.weights.SCALE) == (one, one)
    assert not {'net', 'net.deep', 'base'} & set(sys.modules)


def test_what_is_imported_in_a_function_is_found_beside_the_file_too(write):
    write('TIMES = [0]\n', 'helper.py')
    path = write('import helper\n\n\ndef count():\n    import helper\n    import late\n'
                 '    helper.TIMES[0] += late.ONE\n    return helper.TIMES[0]\n')
    write('ONE = 1\n', 'late.py')
    module = load_file(path)
    assert [module.count(), module.count(), module.helper.TIMES] == [1, 2, [2]]


def test_a_session_keeps_its_own_module_of_a_helpers_name(write, monkeypatch):
    mine = ModuleType('helper')
    mine.__file__ = '/elsewhere/helper.py'
    monkeypatch.setitem(sys.modules, 'helper', mine)
    write('SIZE = 3\n', 'helper.py')
    assert load_file(write('from helper import SIZE\n')).SIZE == 3
    assert sys.modules['helper'] is mine


def test_a_file_beside_does_not_take_the_place_of_pythons_own(write):
    write('broken = True\n', 'random.py')
    assert load_file(write('import random\n')).random is random


def test_it_is_python_of_its_own(write):
    assert load_file(write('def f(x: 1):\n    pass\n')).f.__annotations__ == {'x': 1}


def test_after_forget_a_file_is_loaded_anew(write, tmp_path):
    (tmp_path / 'gain.txt').write_text('1')
    path = write('from pathlib import Path\n'
                 "GAIN = float(Path(__file__).with_name('gain.txt').read_text())\n")
    assert load_file(path).GAIN == 1.0
    (tmp_path / 'gain.txt').write_text('2')
    assert load_file(path).GAIN == 1.0
    forget()
    assert load_file(path).GAIN == 2.0


COMPILED = """
from pathlib import Path
from mambo_model.compiled import jit
GAIN = float(Path(__file__).with_name('gain.txt').read_text())
UNUSED = (1, "two")

@jit
def step(x):
    return GAIN * x
"""


def test_compiled_code_is_that_of_the_values_that_it_keeps(write, tmp_path):
    path = write(COMPILED)
    found = []
    for gain in ('1', '2', '1'):
        (tmp_path / 'gain.txt').write_text(gain)
        forget()
        found.append(load_file(path))
    assert [module.step(3.0) for module in found] == [3.0, 6.0, 3.0]
    assert found[2] is found[0] and found[1].__name__ != found[0].__name__
    assert len([name for name in sys.modules if name.startswith('mambo_own_mine_') and getattr(
        sys.modules[name], '__file__', None) == str(path)]) == 2


def test_modules_with_compiled_functions_never_share_a_name(write, tmp_path):
    text = ('from typing import NamedTuple\nfrom mambo_model.compiled import jit\n\n\n'
            'class Pair(NamedTuple):\n    x: float\n\n\n@jit\ndef step(x):\n    return Pair(x)\n')
    found = [load_file(write(text))]
    forget()
    assert load_file(write(text)) is found[0]  # it has not changed
    (tmp_path / 'beside').mkdir()
    found.append(load_file(write(text, 'beside/mine.py')))
    odd = f'{text}\nimport threading\nLOCK = threading.Lock()\n'  # that cannot be compared
    for _ in range(2):
        forget()
        found.append(load_file(write(odd)))
    assert len({module.__name__ for module in found}) == len(found) == 4
    assert all(type(module.step(1.0)) is module.Pair for module in found)
    assert len({module.Pair.__name__ for module in found}) == 4


def test_objects_of_the_files_own_classes_are_no_reason_to_refuse_it(write):
    load_file(write('from mambo_model.compiled import jit, objmode\n\n\nclass Net:\n    pass\n\n\n'
                    'net = Net()\n\n\n@jit\ndef step(x):\n    with objmode():\n'
                    '        net.x = x\n    return x\n'))


def test_a_global_that_a_function_assigns_is_no_constant_of_compiled_code(write):
    text = ('from mambo_model.compiled import jit\nGAIN = 1.0\n\n\ndef initial(values):\n'
            '    global GAIN\n    GAIN = values.gain\n\n\n@jit\ndef step(x):\n'
            '    return GAIN * x\n')
    with pytest.raises(ParameterError, match=r'/mine.py: GAIN is assigned in flight, and'):
        load_file(write(text))
    for called in ('Mine', 'helper'):
        with pytest.raises(ParameterError, match=r'/mine.py: GAIN is assigned in flight, and'):
            load_file(write(text.replace('def initial', 'def helper') + (
                '\n\ndef initial(values):\n    helper(values)\n' if called == 'helper' else
                '\n\nclass Mine:\n    @staticmethod\n    def initial(values):\n'
                '        helper(values)\n')))
    at_load = text.replace('def initial(values)', 'def load()').replace('values.gain', '3.0')
    assert load_file(write(f'{at_load}\n\nload()\n')).step(1.0) == 3.0
    assert load_file(write(text.replace('GAIN * x', 'x'))).step(1.0) == 1.0


def test_a_value_that_differs_each_time_is_no_constant_of_compiled_code(write, tmp_path):
    (tmp_path / 'gain.txt').write_text('1')
    path = write(COMPILED.replace(
        'float(', '__import__("time").monotonic() + float('))
    with pytest.raises(ParameterError, match=(
            r'/mine.py: GAIN has another value each time the file is loaded, and compiled code '
            'keeps one: make it a parameter, or leave out @jit$')):
        load_file(path)


def test_other_values_than_those_of_compiled_code_are_new_too(write, tmp_path):
    path = write(COMPILED.replace('GAIN = float', 'ONE = 1.0\nGAIN = float').replace(
        'return GAIN * x', 'return ONE * x'))
    found = []
    for gain in ('1', '2', '2'):
        (tmp_path / 'gain.txt').write_text(gain)
        forget()
        found.append(load_file(path))
    assert [module.GAIN for module in found] == [1.0, 2.0, 2.0]
    assert found[2] is found[1] and [module.step(3.0) for module in found] == [3.0] * 3


def test_what_a_helper_reads_is_new_too(write, tmp_path):
    write('from pathlib import Path\n'
          "GAIN = float(Path(__file__).with_name('gain.txt').read_text())\n", 'helper.py')
    path = write('import helper\nfrom mambo_model.compiled import jit\nONE = 1.0\n\n\n@jit\n'
                 'def step(x):\n    return ONE * x\n\n\ndef gain():\n    return helper.GAIN\n')
    found = []
    for gain in ('1', '2', '2'):
        (tmp_path / 'gain.txt').write_text(gain)
        forget()
        found.append(load_file(path))
    assert [module.gain() for module in found] == [1.0, 2.0, 2.0] and found[2] is found[1]


@pytest.mark.parametrize('text', [
    'from pkg import gains\nanswer = gains.ONE\n', 'from pkg import *\nanswer = gains.ONE\n',
    'import pkg\nanswer = pkg.gains.ONE\n', 'from pkg.gains import ONE as answer\n',
    'def late():\n    from pkg import gains\n    return gains.ONE\n\n\nimport pkg\n'
    'answer = late()\n',
    'try:\n    from pkg import nothing\nexcept ImportError:\n    from pkg import gains\n'
    'answer = gains.ONE\n'])
def test_a_module_is_imported_from_its_package(write, tmp_path, text):
    (tmp_path / 'pkg').mkdir()
    write('from . import gains\n__all__ = ["gains"]\n' if 'import pkg' in text
          else '__all__ = ["gains"]\n', 'pkg/__init__.py')
    for one in (1, 2):
        write(f'ONE = {one}\n', 'pkg/gains.py')
        module = load_file(write(text))
        assert module.answer == one
        if 'late' in text:
            assert module.late() == one
    assert not {'pkg', 'pkg.gains'} & set(sys.modules)


def test_a_module_that_a_package_lacks_is_an_import_error(write, tmp_path):
    (tmp_path / 'pkg').mkdir()
    write('', 'pkg/__init__.py')
    with pytest.raises(ParameterError, match=r"mine.py:1: ImportError: cannot import name 'none'"):
        load_file(write('from pkg import none\n'))
    write('1 / 0\n', 'pkg/none.py')
    with pytest.raises(ParameterError, match=r'mine.py:1: ZeroDivisionError'):
        load_file(write('from pkg import none\n'))


def test_a_class_that_holds_itself_is_none_of_our_business(write):
    assert load_file(write('class Node:\n    pass\n\n\nNode.child = Node\n')).Node


def test_a_file_that_takes_its_folder_out_of_the_path_leaves_nothing(write):
    write('ONE = 1\n', 'helper.py')
    before = list(sys.meta_path)
    load_file(write('import sys\nsys.path = [p for p in sys.path if p != __file__[:-8]]\n'
                    'import helper\n'))
    assert sys.meta_path == before and 'helper' not in sys.modules


def test_threads_load_one_after_the_other(tmp_path):
    found, threads = {}, []
    for name in ('a', 'b'):
        folder = tmp_path / name
        folder.mkdir()
        (folder / 'helper.py').write_text(f'import time\ntime.sleep(0.01)\nX = {name!r}\n')
        (folder / 'mine.py').write_text('import helper\n\n\ndef late():\n    import helper\n'
                                        '    return helper.X\n')

        def work(name=name, path=folder / 'mine.py'):
            for _ in range(10):
                module = load_file(path)
                found.setdefault(name, set()).update({module.helper.X, module.late()})
                if name == 'a':
                    forget()
        threads.append(threading.Thread(target=work))
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(60)
    assert found == {'a': {'a'}, 'b': {'b'}}
