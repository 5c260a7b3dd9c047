"""Modules of one source are the same if their values are; not, if that cannot be told."""

from types import ModuleType

from mambo_model.compilation.twins import twins
import pytest

HEAD = """
import abc
import collections
import dataclasses
import enum
import functools
import logging
import math
from pathlib import Path
import re
import threading
from types import SimpleNamespace
from typing import NamedTuple
import numba
import numpy as np

"""


def made(text, name):
    module = ModuleType(name)
    exec(compile(HEAD + text, 'mine.py', 'exec'), vars(module))
    return module


def compared(text, other=None):
    return twins(made(text, 'mambo_own_a'), made(text if other is None else other, 'mambo_own_b'))


@pytest.mark.parametrize('text', [
    'x = {n}', 'x = float({n})', 'x = "{n}"', 'x = [1, ({n},)]', 'x = {{"a": {n}}}',
    'x = {{{n}, 7}}', 'x = np.array([{n}, 2.0])', 'x = np.array([{n}, None], dtype=object)',
    'x = Path("a{n}")', 'x = re.compile("{n}")', 'x = np.random.default_rng({n})',
    'x = SimpleNamespace(a={n})', 'x = collections.deque([{n}])',
    'x = functools.partial(print, {n})',
    'def f(x, gain={n}):\n    return x', 'def f(x, *, gain={n}):\n    return x',
    'def g(gain):\n    return lambda x: gain * x\nf = g({n})',
    'def f(x):\n    return x\nf.gain = {n}',
    'f = (lambda: 1) if {n} == 1 else (lambda: 2)',
    '@numba.njit\ndef f(x, gain={n}):\n    return x',
    '@functools.lru_cache\ndef f(x, gain={n}):\n    return x',
    'class C:\n    py_func = 1\nx = C()\nx.gain = {n}',
    '@dataclasses.dataclass(frozen=True, slots=True)\nclass C:\n    gain: float = {n}\nx = C()',
    'class C:\n    gain = {n}', '__x = {n}', 'class C:\n    def __call__(self, gain={n}): pass',
    'class C:\n    def __init__(self, gain={n}): pass', 'import types\nm = types.ModuleType("m")\n'
    'm.gain = {n}', 'space = {{"gain": {n}}}\nexec("def f():\\n    return gain", space)\n'
    'f = space.pop("f")\ndel space', 'x = collections.defaultdict(lambda gain={n}: gain)',
    'class D(dict):\n    pass\nx = D()\nx.gain = {n}',
    'class F(float):\n    pass\nx = F(1.0)\nx.gain = {n}',
    'x = np.zeros(1, [("k", "f8", 2000)])\nx["k"][0, 999] = {n}\nx = x[0]',
    'class A:\n    pass\nclass B:\n    pass\nclass C((A, B)[{n} - 1]):\n    pass',
    'class C:\n    @staticmethod\n    def f(gain={n}): pass',
    'class C:\n    @property\n    def f(self, gain={n}): pass',
    'class C:\n    @functools.cached_property\n    def f(self, gain={n}): pass',
    'class C(abc.ABC):\n    gain = {n}',
    'class C:\n    pass\nx = C()\nx.gain = {n}',
    'class C:\n    __slots__ = ("gain",)\nx = C()\nx.gain = {n}',
    'class C(enum.IntEnum):\n    ONE = {n}\nx = C.ONE',
    'class C(NamedTuple):\n    gain: float = {n}\nx = C()',
    '@dataclasses.dataclass(frozen=True)\nclass C:\n    gain: float = {n}\nx = C()',
    '@dataclasses.dataclass\nclass C:\n    gain: float = dataclasses.field(default=1.0, '
    'metadata={{"most": {n}}})'])
def test_a_value_counts_wherever_it_stands(text):
    assert compared(text.format(n=1))
    assert not compared(text.format(n=1), text.format(n=2))


@pytest.mark.parametrize('text', [
    'from math import sin', 'log = logging.getLogger(__name__)', 'x = np.sin', 'x = float("nan")',
    'class Node:\n    pass\nNode.child = Node\nNode.one = Node()\nNode.one.all = [Node.one]'])
def test_the_same_of_python_and_libraries_is_the_same(text):
    assert compared(text)


@pytest.mark.parametrize(('one', 'two'), [
    ('x = 1', 'x = 1.0'), ('x = 1', 'x = True'), ('x = 0.0', 'x = -0.0'), ('x = 1', 'y = 1'),
    ('x = (1,)', 'x = [1]'), ('x = 1', 'x = 1\ny = 1'), ('from math import sin as f',
                                                          'from math import cos as f'),
    ('x = np.zeros(2)', 'x = np.zeros((2, 1))'), ('import math as m', 'import re as m'),
    ('class C: pass\nx = C()', 'class D: pass\nclass C: pass\nx = D()')])
def test_values_of_another_kind_differ(one, two):
    assert not compared(one, two)


@pytest.mark.parametrize('text', [
    'x = threading.Lock()', 'x = (i for i in range(3))',
    'class C:\n    def __reduce_ex__(self, version):\n        1 / 0\nx = C()',
    '@functools.lru_cache\ndef f(x):\n    return x\nf(1)',
    'class C:\n    def __reduce__(self):\n        return C, ()\nx = C()',
    'class C:\n    def __getstate__(self):\n        return {}\nx = C()',
    'class C:\n    def __reduce_ex__(self, version):\n        return C, (C(),)\nx = C()'])
def test_what_cannot_be_compared_is_not_taken_for_the_same(text):
    assert not compared(text)
