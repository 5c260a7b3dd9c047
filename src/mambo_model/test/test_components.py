"""Components by name, file and entry point; wrong ones are refused in one line."""

import importlib.metadata
from pathlib import Path
import pickle
from types import SimpleNamespace

from mambo_model import components, schema
from mambo_model.components import absolute, own_components, Registry, remarks
from mambo_model.own_file import digest
from mambo_model.values import Parameters
import pytest

GOOD = '''
from dataclasses import dataclass
from mambo_model.schema import quantity
from mambo_model.values import Parameters

@dataclass(frozen=True)
class Params(Parameters):
    """Gains."""

    gain: float = quantity(2.0, '1/s', 0.0, 9.0, 'taste')

def initial(values):
    return 0

def step(memory, x, values):
    return memory + 1, x * values.gain

class Other:
    Params, initial, step = Params, staticmethod(initial), staticmethod(step)
'''


class Plain(Parameters):
    """A module of a built-in component."""

    initial = step = staticmethod(lambda *_: None)


@pytest.fixture
def registry():
    from dataclasses import dataclass

    @dataclass(frozen=True)
    class PlainParams(Parameters):
        """Of the built-in one."""

        mass: float = schema.quantity(1.0, 'kg', 0.0, 2.0, 'scale')
    return Registry('filter', ('memory', 'x', 'values'), {'plain': (PlainParams, Plain)},
                    others=('nothing',))


@pytest.fixture
def write(tmp_path):
    def write(text, name='mine.py'):
        (tmp_path / name).write_text(text)
        return str(tmp_path / name)
    return write


def test_built_in_ones_and_others_have_names(registry):
    assert registry.find('plain').name == 'plain' and not registry.find('plain').own
    assert registry.find('nothing') is None
    assert registry.names == ('plain', 'nothing')
    assert [registry.is_own(name) for name in ('plain', 'nothing', 'x.py')] == [0, 0, 1]


def test_a_file_is_a_component(registry, write):
    found = registry.find(write('__version__ = "1.2"' + GOOD))
    assert (found.name, found.version, found.compiled, found.own) == ('mine', '1.2', False, True)
    assert found.step(1, 3.0, found.params(gain=4.0)) == (2, 12.0)
    assert found.describe() == f'mine 1.2, sha256 {found.sha256}'
    assert found.sha256 == digest(found.path) and len(found.sha256) == 64


def test_a_compiled_file_that_has_not_changed_is_compiled_once(registry, write):
    text = GOOD.replace('\ndef ', '\n@jit\ndef ')
    text = text.replace('\n@dataclass', '\nfrom mambo_model.compiled import jit\n@dataclass')
    one = registry.find(write(text))
    assert one.compiled and one.params(gain=4.0).values().gain == 4.0  # it is used
    components.look_again()
    two = registry.find(write(text))
    assert two.step is one.step and two.params is one.params
    components.look_again()
    other = registry.find(write(text.replace('gain: float = quantity(2.0', 'gain: float = '
                                             'quantity(3.0')))
    assert other.step is not one.step and other.params().values().gain == 3.0


def test_a_name_in_a_file_is_one_too(registry, write):
    assert registry.find(f'{write(GOOD)}:Other').name == 'Other'
    with pytest.raises(schema.ParameterError, match=r'mine.py: has no Third$'):
        registry.find(f'{write(GOOD)}:Third')


def test_an_installed_package_is_one_too(registry, write, monkeypatch):
    module = components.load_file(Path(write(GOOD)))
    entry = SimpleNamespace(
        name='better', value='package:Other', load=lambda: module.Other,
        dist=SimpleNamespace(version='3.4'))
    monkeypatch.setattr(
        importlib.metadata, 'entry_points',
        lambda group: [entry] if group == 'mambo.filters' else [])
    found = registry.find('better')
    assert (found.name, found.version, found.path.name) == ('better', '3.4', 'mine.py')
    with pytest.raises(schema.ParameterError, match=(
            "filter 'bettr' is unknown: give a file .*entry point of mambo.filters[)] or one of "
            'plain, nothing')):
        registry.find('bettr')


@pytest.mark.parametrize(('old', 'new', 'message'), [
    (GOOD[GOOD.index('def step'):], '',
     r'mine.py(:1)?: has no step; a filter has Params, initial, step'),
    ('(memory, x, values)', '(memory, x)',
     r'mine.py:15: step\(memory, x\) must take 3 arguments: memory, x, values'),
    ('initial(values)', 'initial()', r'mine.py:12: initial\(\) must take 1 arguments: values'),
    ("quantity(2.0, '1/s', 0.0, 9.0, 'taste')", '2.0',
     'mine.py:6: parameter gain: declare it with quantity, choice, flag'),
    ('2.0,', '12.0,', r'mine.py:6: the defaults are refused: gain = 12.0 1/s is outside'),
    ('@dataclass(frozen=True)', '@dataclass', 'must be a frozen dataclass|cannot be loaded'),
    ('@dataclass(frozen=True)', '', r'mine.py:\d: Params must be a dataclass'),
    ('return 0', 'return 0 +', r'mine.py:13: invalid syntax'),
    ('class Other', 'def __getattr__(name):\n    raise OSError(name)\n\nclass Other',
     'mine.py:19: OSError: __version__'),
    ('class Other', '1 / 0\nclass Other', r'mine.py:18: ZeroDivisionError: division by zero')])
def test_a_wrong_one_is_refused_in_one_line(registry, write, old, new, message):
    with pytest.raises(schema.ParameterError, match=message) as error:
        registry.find(write(GOOD.replace(old, new, 1)))
    assert '\n' not in str(error.value)


def test_a_file_that_is_not_there_or_has_a_taken_name_is_refused(registry, write, tmp_path):
    with pytest.raises(schema.ParameterError, match=r'none.py: No such file or directory'):
        registry.find(str(tmp_path / 'none.py'))
    with pytest.raises(schema.ParameterError, match='must have a name that is a word and not one'):
        registry.find(write(GOOD, 'plain.py'))
    with pytest.raises(schema.ParameterError, match='must have a name that is a word'):
        registry.find(write(GOOD, 'my-filter.py'))


def test_a_file_that_no_scenario_can_name_is_refused(registry, tmp_path):
    with pytest.raises(schema.ParameterError) as error:
        registry.find(f'{tmp_path}/fl\udcfcg/mine.py:Other')
    assert str(error.value).encode('utf-8', 'surrogateescape').endswith(
        b'/fl\xfcg/mine.py is not UTF-8, and no scenario can name it: rename the file or folder')


def test_another_content_or_helper_is_another_component(registry, write):
    write('FACTOR = 1')
    path = write('import helper' + GOOD)
    write('FACTOR = 1', 'helper.py')
    first = digest(Path(path))
    one = components.load_file(Path(path))
    assert components.load_file(Path(path)) is one
    write('FACTOR = 2', 'helper.py')
    assert digest(Path(path)) != first
    assert components.load_file(Path(path)).__name__ != one.__name__


def test_paths_are_relative_to_a_folder():
    assert absolute('cascaded', Path('/a')) == 'cascaded'
    assert absolute('b/mine.py:X', Path('/a')) == '/a/b/mine.py:X'
    assert absolute('/c/mine.py', Path('/a')) == '/c/mine.py'


def test_parameters_of_the_chosen_one_belong_to_its_owner(registry, write):
    from dataclasses import dataclass

    @components.built_in_groups(registry, before='rate')
    @dataclass(frozen=True)
    class Node:
        """A node."""

        chosen: str = schema.component('plain', registry, 'which one')
        rate: float = schema.quantity(1.0, 'Hz', 0.0, 9.0, 'taste')

        def __post_init__(self):
            schema.check(self)

    assert [name for name, _ in schema.walk(Node)] == ['chosen', 'plain.mass', 'rate']
    path = write(GOOD)
    node = schema.build(Node, {'chosen': path, 'mine.gain': 3})
    assert node.mine.gain == 3.0 and isinstance(node, Node)
    assert schema.flatten(node)['mine.gain'] == 3.0
    assert schema.build(Node, schema.flatten(node)) == node
    assert [c.name for c in own_components(node)] == ['mine']
    assert 'mine is plain Python: it flies slower' in remarks(node)[0]
    assert not remarks(Node())
    with pytest.raises(schema.ParameterError, match='gane: unknown parameter; did you mean gain'):
        schema.build(Node, {'chosen': path, 'mine.gane': 3})
    with pytest.raises(schema.ParameterError, match='mine: unknown parameter'):
        schema.build(Node, {'mine.gain': 3})
    with pytest.raises(schema.ParameterError, match='chosen|none.py: No such file'):
        schema.build(Node, {'chosen': '/none.py'})


def test_modules_that_are_not_loaded_do_not_keep_an_index_from_being_read():
    found = pickle.loads(b'\x80\x04' + b'\x8c\x14mambo_own_gone_01234\x8c\rParams.Values\x93.')
    assert found.__qualname__ == 'Params.Values'
    assert pickle.loads(pickle.dumps(found)) is found
