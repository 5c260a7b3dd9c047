"""Values that compiled functions keep are found, wherever they stand; nothing else is."""

import threading
from types import ModuleType

from mambo_model.compilation import constants
from mambo_model.compilation.constants import kept
import numpy as np
import pytest

TEXT = """
import enum
import math
from typing import NamedTuple
import numba
import numpy as np
import inner

class Mode(enum.IntEnum):
    HOVER = {number}

class Pair(NamedTuple):
    a: float
    b: tuple

ONE = {number}
TABLE = np.array([{number}.0, 2.0])
PAIR = Pair(1.0, (2.0, {number}))
ROWS = [1.0, {number}]
NAMES = {{'a': {number}}}
OTHER = object()
UNREAD = {number}
MODE = Mode.HOVER

def factory(gain):
    @numba.njit
    def made(x):
        return gain * x
    return made

made = factory({number})

@numba.njit
def by_default(x, gain={number}):
    return gain * x

@numba.njit
def helper(x):
    return x + ONE

LAWS = helper, made

class Controller:
    @staticmethod
    @numba.njit
    def step(x):
        return {body}
"""


def load(body, number=1):
    """Return the module of a text in which the body of a step is this."""
    inner = ModuleType('own_inner')
    inner.GAIN, inner.UNREAD = number, number
    inner.deeper = ModuleType('own_inner.deeper')
    inner.deeper.LIMIT = number
    module = ModuleType('own_mine')
    text = TEXT.format(body=body, number=number).replace('import inner\n', '')
    vars(module)['inner'] = inner
    exec(compile(text, '/there/mine.py', 'exec'), vars(module))
    return module


@pytest.mark.parametrize(('body', 'name'), [
    ('x + ONE', 'ONE'), ('TABLE[0]', 'TABLE'), ('PAIR.b[1]', 'PAIR'), ('ROWS[1]', 'ROWS'),
    ('len(NAMES)', 'NAMES'), ('MODE + x', 'MODE'), ('Mode.HOVER + x', 'Mode'),
    ('inner.GAIN', 'inner.GAIN'), ('inner.deeper.LIMIT', 'inner.deeper.LIMIT'),
    ('LAWS[0](x)', 'ONE'), ('LAWS[1](x)', 'factory.<locals>.made.gain'),
    ('[ONE for _ in range(3)][0]', 'ONE'), ('helper(x)', 'ONE'),
    ('made(x)', 'factory.<locals>.made.gain'), ('by_default(x)', 'by_default, default 0')])
def test_a_value_that_is_read_is_kept_and_another_one_shows(body, name):
    place = f'mine.py: {name}'
    one, same, two = (kept(load(body, number), 'own_') for number in (1, 1, 2))
    assert place in one and one[place] == same[place] != two[place]
    assert not any('UNREAD' in key or 'OTHER' in key for key in one)


CHOICES = {
    'two functions of one factory': 'low, high = factory({n}.0), factory(2.0)\n{jit}'
                                    'def step(x):\n    return low(x) + high(x)',
    'functions with defaults': 'laws = []\nfor k in ({n}.0, 2.0):\n    {jit2}    '
                               'def law(x, k=k):\n        return k * x\n    laws.append(law)\n'
                               'first, second = laws\n{jit}'
                               'def step(x):\n    return first(x) + second(x)',
    'one of two own functions': '{jit}def a(x):\n    return x\n{jit}def b(x):\n    return -x\n'
                                'law = (a, b)[{n} - 1]\n{jit}def step(x):\n    return law(x)',
    'the step itself': '{jit}def a(x):\n    return x\n{jit}def b(x):\n    return -x\n'
                       'step = (a, b)[{n} - 1]',
    'one of two of Python': 'law = (math.sin, math.cos)[{n} - 1]\n{jit}'
                            'def step(x):\n    return law(x)',
    'a module': 'm = (math, np)[{n} - 1]\n{jit}def step(x):\n    return m.sin(x)',
    'one of two of numpy': 'law = (np.sin, np.cos)[{n} - 1]\n{jit}def step(x):\n    return law(x)',
    'one of two of the workspace': 'from mambo_model.motion import quaternion\n'
                                   'law = (quaternion.conjugate, quaternion.rotate)[{n} - 1]\n'
                                   '{jit}def step(x):\n    return law(x)',
    'a type': 'kind = (np.float32, np.float64)[{n} - 1]\n{jit}def step(x):\n    return kind(x)',
    'a type of numba': 'kind = (numba.float32, numba.int64)[{n} - 1]\n{jit}'
                       'def step(x):\n    return kind(x)',
    'functions in tuples in a tuple': 'laws = ((factory({n}.0),),)\n{jit}'
                                      'def step(x):\n    return laws[0][0](x)',
    'a function of an object': 'class Law:\n    def __init__(self, k):\n'
                               '        self.f = factory(k)\nf = Law({n}.0).f\n{jit}'
                               'def step(x):\n    return f(x)',
    'a row of a table': 'T = np.zeros(1, [("k", "f8", 2000)])\nT["k"][0, 999] = {n}\nrow = T[0]\n'
                        '{jit}def step(x):\n    return row.k[999] * x',
    'the default of a tuple': 'class P(NamedTuple):\n    k: float = {n}.0\n{jit}'
                              'def step(x):\n    return P().k * x',
    'the names of fields': 'P = NamedTuple("P", [(k, float) for k in ("ab", "ba")[{n} - 1]])\n'
                           '{jit}def step(x):\n    return P(x, 1.0).a',
    'a member of its own': 'import enum\nimport functools\nclass M(enum.Enum):\n    A = {n}\n'
                           '    B = functools.partial(print)\n{jit}'
                           'def step(x):\n    return x if M.A is M.B else -x',
    'a compiled class': 'from numba.experimental import jitclass\nK = {n}.0\n'
                        '@jitclass([("x", numba.float64)])\nclass C:\n'
                        '    def __init__(self):\n        self.x = K\n{jit}'
                        'def step(x):\n    return C().x * x',
    'a slice': 'S = slice({n}, 9)\n{jit}def step(x):\n    return x[S]',
    'a number of its own kind': 'class F(float):\n    pass\nK = F({n})\n{jit}'
                                'def step(x):\n    return K * x',
    'what a module makes when asked': 'import types\nm = types.ModuleType("own_m")\n'
                                      'm.__getattr__ = lambda name: {n}.0\n{jit}'
                                      'def step(x):\n    return m.GAIN * x',
    'a stencil': 'K = {n}.0\n@numba.stencil\ndef law(a):\n    return K * a[0]\n{jit}'
                 'def step(x):\n    return law(x)',
    'types of variables': 'T = (numba.float32, numba.float64)[{n} - 1]\n'
                          '@numba.njit(locals={"y": T})\ndef step(x):\n    y = x\n    return y',
    'a signature': '@numba.njit(("f8(f8)", "f4(f4)")[{n} - 1])\ndef step(x):\n    return x',
    'options in a set': '@numba.njit(fastmath={"nnan"} if {n} == 1 else {"ninf"})\n'
                        'def step(x):\n    return x',
    'an intrinsic': 'from numba.extending import intrinsic\nK = {n}.0\n@intrinsic\n'
                    'def law(context, x):\n    return K\n{jit}def step(x):\n    return law(x)',
    'an overload': 'from numba.extending import overload\nK = {n}.0\ndef law(x):\n    pass\n'
                   '@overload(law)\ndef typed(x):\n    return lambda x: K * x\n{jit}'
                   'def step(x):\n    return law(x)',
    'options': '@numba.njit(fastmath={n} == 1)\ndef step(x):\n    return x',
    'a vectorized function': '@numba.vectorize\ndef law(x):\n    return K * x\nK = {n}.0\n{jit}'
                             'def step(x):\n    return law(x)',
    'a text that is executed': 'exec("def law(x):\\n    return {n} * x")\nlaw = numba.njit(law)\n'
                               '{jit}def step(x):\n    return law(x)'}


@pytest.mark.parametrize('text', CHOICES.values(), ids=CHOICES)
def test_another_choice_is_another_version(text):
    def made(number):
        module = ModuleType('own_mine')
        head = ('import math\nfrom typing import NamedTuple\nimport numba\n'
                'import numpy as np\n\ndef factory(gain):\n    @numba.njit\n    def law(x):\n'
                '        return gain * x\n    return law\n\n')
        body = text.replace('{n}', str(number)).replace('{jit2}', '@numba.njit\n').replace(
            '{jit}', '@numba.njit\n')
        exec(compile(head + body, '/there/mine.py', 'exec'), vars(module))
        return kept(module, 'own_')
    assert made(1) == made(1) != made(2)


def test_modules_that_import_each_other_have_an_end():
    parts = [ModuleType(f'own_mine__{name}') for name in 'abcdef']
    for part in parts:
        vars(part).update({other.__name__[-1]: other for other in parts}, x=1.0)
    module = load('a.b.x + b.a.x + c.d.x + e.f.x')
    vars(module).update({part.__name__[-1]: part for part in parts})
    found = kept(module, 'own_')
    assert 'mine.py: a.x' in found and len(found) < 100


@pytest.mark.parametrize('value', [
    'object()', 'numba.typeof(factory(1))', 'Sentinel', 'print', 'np.random.default_rng(1)',
    'Net()'])
def test_values_without_numbers_are_the_same_each_time(value):
    def made():
        module = load('OTHER is None')
        exec('import enum\nclass Sentinel(enum.Enum):\n    A = object()\nclass Net:\n    pass\n'
             f'OTHER = {value}', vars(module))
        return kept(module, 'own_')
    assert made() == made()


def test_what_cannot_be_told_serves_this_process_alone(monkeypatch):
    module = load('OTHER is None')
    vars(module)['OTHER'] = threading.Lock()
    one = kept(module, 'own_')
    assert one == kept(module, 'own_')
    monkeypatch.setattr(constants, '_UNKNOWN', 'another process')
    assert one != kept(module, 'own_')


def test_files_of_one_name_in_two_folders_are_told_apart(tmp_path):
    found = []
    for pitch in (1.0, 2.0):
        module = ModuleType('own_mine')
        module.__file__ = str(tmp_path / 'mine.py')
        for name, gain in (('roll', 1.0), ('pitch', pitch)):
            part = ModuleType(f'own_mine__{name}__law')
            text = f'import numba\nK = {gain}\n@numba.njit\ndef law(x):\n    return K * x\n'
            exec(compile(text, str(tmp_path / name / 'law.py'), 'exec'), vars(part))
            vars(module)[name] = part.law
        exec('import numba\n@numba.njit\ndef step(x):\n    return roll(x) + pitch(x)\n',
             vars(module))
        found.append(kept(module, 'own_'))
    assert {'roll/law.py: K', 'pitch/law.py: K'} <= set(found[0])
    assert {name for name in found[0] if found[1][name] != found[0][name]} == {'pitch/law.py: K'}


def test_what_python_and_libraries_hold_is_followed_no_further():
    found = kept(load('math.pi * x + np.float64(OTHER is None)'), 'own_')
    assert found == kept(load('math.pi * x + np.float64(OTHER is None)'), 'own_')
    assert 'mine.py: math.pi' in found and 'mine.py: math.tau' not in found
    ours = load('helper(x)')
    ours.helper.py_func.__module__ = 'mambo_model.frames'
    assert 'mine.py: ONE' not in kept(ours, 'own_')
    plain = ModuleType('own_plain')
    exec('def f(x):\n    return x + 1\n\n\nLIST = [1]', vars(plain))
    assert kept(plain, 'own_') == {}


def test_a_compiled_function_of_a_package_counts_with_its_source(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    source = tmp_path / 'lab_functions.py'
    source.write_text('import numba\nGAIN = 2.0\n\n\n@numba.njit\ndef gained(x):\n'
                      '    return GAIN * x\n\n\ndef plain(x):\n    return GAIN * x\n')
    import lab_functions
    module = load('gained(x)')
    module.gained = lab_functions.gained
    before = kept(module, 'own_')
    assert {str(source), 'lab_functions.py: GAIN'} <= set(before)
    source.write_text(source.read_text().replace('GAIN * x', '-GAIN * x'))
    after = kept(module, 'own_')
    assert {name for name in before if after[name] != before[name]} == {str(source)}
    module.gained = lab_functions.plain
    assert str(source) not in kept(module, 'own_')


def test_an_array_differs_in_type_and_shape():
    parts = [np.zeros(4), np.zeros((2, 2)), np.zeros(4, np.int64), np.zeros(8, np.float32)]
    found = []
    for part in parts:
        module = load('TABLE[0]')
        module.TABLE = part
        found.append(kept(module, 'own_')['mine.py: TABLE'])
    assert len(set(found)) == len(parts)


@pytest.mark.parametrize('holder', ['SimpleNamespace(step=make(3))', 'Holder(make(3))'])
def test_functions_that_an_object_holds_are_looked_at(holder):
    found = []
    for gain in (3, 4):
        module = ModuleType('own_mine')
        exec('from types import SimpleNamespace\nimport numba\n\n\ndef make(gain):\n'
             '    @numba.njit\n    def step(x):\n        return gain * x\n    return step\n\n\n'
             'class Holder:\n    def __init__(self, step):\n        self.step = step\n\n\n'
             f'mine = {holder.replace("3", str(gain))}\n', vars(module))
        found.append(kept(module, 'own_'))
    assert found[0].keys() == found[1].keys() and found[0] and found[0] != found[1]


def test_a_list_that_holds_itself_has_an_end():
    module = load('ROWS[1]')
    module.ROWS.append(module.ROWS)
    assert 'mine.py: ROWS' in kept(module, 'own_')
