"""Functions and classes of scripts: their source, and functions as components."""

import hashlib
import inspect
from pathlib import Path

from mambo_model.components import Registry
from mambo_model.schema import ParameterError
from mambo_model.script import script_source, WithoutMemory
import pytest


def law(x, dt):
    """Return something."""
    return x + dt


class Kept:
    """A component."""

    def initial(self, values):
        """Return the memory."""


@pytest.mark.parametrize('thing', [law, Kept])
def test_a_source_is_that_of_the_text(thing):
    path, sha256 = script_source(thing)
    assert path == Path(__file__)
    assert sha256 == hashlib.sha256(inspect.getsource(thing).encode()).hexdigest()
    assert script_source(Kept()) == script_source(Kept)


def test_without_a_text_the_code_counts():
    def typed(text):
        space = {'__name__': 'typed'}
        exec(compile(text, '<prompt>', 'exec'), space)
        return script_source(space['f'])[1]
    one, two = typed('def f(x):\n    return abs(x)\n'), typed('def f(x):\n    return max(x)\n')
    assert one != two and one == typed('def f(x):\n    return abs(x)\n')


def test_a_function_is_asked_without_memory_and_parameters():
    found = WithoutMemory(law, ('memory', 'x', 'dt', 'gains'), 'law')
    assert found.initial(None) is None and found.step(None, 1.0, 0.5, None) == (None, 1.5)
    with pytest.raises(ParameterError, match=r'^law\(x, dt\) must take 3 arguments: x, y, dt$'):
        WithoutMemory(law, ('memory', 'x', 'y', 'dt', 'gains'), 'law')


def test_arguments_that_python_cannot_tell_are_refused():
    with pytest.raises(ParameterError, match='^type: Python cannot tell its arguments'):
        WithoutMemory(type, ('x', 'dt'), 'type')


def test_a_lambda_is_refused_as_one():
    with pytest.raises(ParameterError, match='is a lambda, which has no name: write it as a fun'):
        Registry('law', ('memory', 'x', 'dt', 'gains'), {}).offer(lambda x, dt: x)


def test_an_offered_one_is_found_by_its_name_alone():
    registry = Registry('law', ('memory', 'x', 'dt', 'gains'), {})
    name = registry.offer(law)
    assert name.startswith('law of a script, sha256 ') and registry.is_own(name)
    found = registry.find(name)
    assert found.name == 'law' and not found.compiled and found.own
    with pytest.raises(ParameterError, match='has no Params, initial, step; a law has'):
        registry.offer(WithoutMemory.Params())
    for thing in (3, print, dict):
        with pytest.raises(ParameterError, match='is not written in Python: call it'):
            registry.offer(thing)
    with pytest.raises(ParameterError, match='unknown'):
        Registry('law', ('memory', 'x', 'dt', 'gains'), {}).find(name)
