"""Small texts that would fill the memory or the stack, and numbers that no float holds."""

from pathlib import Path

from mambo_model import schema, yaml_nodes
from mambo_model.vehicle import parameters
import pytest
import yaml


def laughs(levels):
    lines = ['a0: &a0 [x, x, x, x, x, x, x, x, x, x]']
    return '\n'.join([*lines, *(
        f'a{k + 1}: &a{k + 1} [{", ".join([f"*a{k}"] * 10)}]' for k in range(levels))])


@pytest.mark.parametrize('text, message', [
    ('[' * 100_000, 'deeper than 64 levels; MAMBO_MAX_YAML_DEPTH (now 64) raises the limit'),
    ('a: ' + '{a: ' * 100_000, 'nested deeper than 64 levels'),
    ('- ' * 100_000, 'nested deeper than 64 levels'),
    (laughs(9), 'MAMBO_MAX_YAML_NODES (now 100000) raises the limit'),
    ('a: &a [*a]', 'refers to the node that contains it'),
    ('a: ' + 'x' * 17_000_000, 'MAMBO_MAX_YAML_NODES (now 100000) raises the limit'),
    ('- 0\n' * 100_001, 'MAMBO_MAX_YAML_NODES (now 100000) raises the limit')],
    ids=['flow', 'mapping', 'block', 'aliases', 'itself', 'long', 'many'])
@pytest.mark.parametrize('read', [yaml_nodes.load, yaml_nodes.compose])
def test_a_text_is_measured_before_it_is_built(text, message, read):
    with pytest.raises(yaml.YAMLError) as refused:
        read(text)
    assert message in yaml_nodes.reason(refused.value)
    assert '\n' not in yaml_nodes.reason(refused.value)


def test_aliases_within_bounds_are_read():
    assert yaml_nodes.load('a: &a [1, 2]\nb: [*a, *a]') == {'a': [1, 2], 'b': [[1, 2], [1, 2]]}


def test_the_limit_can_be_raised(monkeypatch):
    monkeypatch.setenv('MAMBO_MAX_YAML_NODES', '200000')
    assert len(yaml_nodes.load('- 0\n' * 100_001)) == 100_001


def test_the_depth_can_be_raised_to_what_the_stack_takes(monkeypatch):
    monkeypatch.setenv('MAMBO_MAX_YAML_DEPTH', '400')
    for read in (yaml_nodes.load, yaml_nodes.compose):
        assert read('[' * 400 + ']' * 400)
    monkeypatch.setenv('MAMBO_MAX_YAML_DEPTH', '401')
    with pytest.raises(schema.ParameterError, match='a whole number from 1 to 400'):
        yaml_nodes.load('a: 1')


@pytest.mark.parametrize('value', ['many', '0', '-3', '1e6', '9' * 30])
def test_a_limit_that_is_none_is_named(monkeypatch, value):
    monkeypatch.setenv('MAMBO_MAX_YAML_NODES', value)
    with pytest.raises(schema.ParameterError, match='MAMBO_MAX_YAML_NODES'):
        yaml_nodes.load('a: 1')


@pytest.mark.parametrize('text', [
    '!!int x', '2001-13-45', '9' * 5000, '!!timestamp 1', '? [a]\n: b', '!!binary \N{SNOWMAN}'])
def test_what_is_no_value_is_no_yaml(text):
    with pytest.raises(yaml.YAMLError):
        yaml_nodes.load(text)


@pytest.mark.parametrize('text, message', [
    ('description: x\nmass: {value: 1e400, unit: kg, source: x}', 'vehicle.mass = inf'),
    (f'description: x\nmass: {{value: {"9" * 1000}, unit: kg, source: x}}', 'vehicle.mass = inf'),
    (f'description: x\nmass: {{value: {"x" * 5000}, unit: kg, source: x}}', '(5002 characters)'),
    (f'description: x\n{"x" * 900}: 1', 'unknown parameter'),
    (f'description: x\nmass: {{value: 1, unit: {"x" * 5000}, source: x}}', 'is in kg, not in xxx'),
    (laughs(9), 'MAMBO_MAX_YAML_NODES'), ('a: ' + '[' * 5000, 'nested deeper')])
def test_a_vehicle_gets_a_short_line(tmp_path, text, message):
    file = tmp_path / 'vehicle.yaml'
    file.write_text(text)
    with pytest.raises(schema.ParameterError) as refused:
        parameters.load(file)
    assert message in str(refused.value) and str(file) in str(refused.value)
    assert '\n' not in str(refused.value) and len(str(refused.value)) < 1500


@pytest.mark.parametrize('name', ['x' * 5000 + '.yaml', 'a\0b.yaml'])
def test_a_name_that_no_file_has_gets_a_short_line(name):
    with pytest.raises(schema.ParameterError) as refused:
        parameters.load(Path(name))
    assert len(str(refused.value)) < 300 and '\0' not in str(refused.value)


@pytest.mark.parametrize('value', [10**400, -10**400, 10**5000, float('inf')], ids=[
    'large', 'negative', 'endless', 'infinite'])
@pytest.mark.parametrize('name', ['mass', 'inertia'])
def test_a_number_that_no_float_holds_is_out_of_range(name, value):
    given = (value,) * 3 if name == 'inertia' else value
    with pytest.raises(schema.ParameterError, match=name) as refused:
        schema.build(parameters.Vehicle, {name: given})
    assert len(str(refused.value)) < 300
    with pytest.raises(schema.ParameterError, match=name):
        parameters.Vehicle(**{name: given})


@pytest.mark.parametrize('loader', [yaml_nodes.Loader, yaml.SafeLoader])
def test_what_is_written_can_be_read_again_whatever_the_names(loader):
    data = {'b': ['fl\udcfcg', 'é', 'a\nb', '1', True, 0.1], 'a\udcff': {'c': '\ud800'}}
    text = yaml_nodes.dump(data)
    assert list(yaml.load(text, loader).items()) == [
        ('b', [r'fl\xfcg', 'é', 'a\nb', '1', True, 0.1]), (r'a\xff', {'c': r'\ud800'})]
    assert yaml.load(f'a: {yaml_nodes.dump_value(data["b"])} # b', loader)['a'][0] == r'fl\xfcg'


def test_a_value_is_written_in_one_line_to_stand_behind_its_name():
    assert yaml_nodes.dump_value('a ' * 500) == f"'{'a ' * 500}'"
    assert yaml_nodes.dump_value([0.5, 'x: y']) == "[0.5, 'x: y']"
