"""Any text is values or one line, soon; what is written reads back the same."""

import time

from hypothesis import given, settings, strategies as st
from mambo_model import limits, yaml_nodes
from mambo_model.schema import ParameterError
import pytest
import yaml

LETTERS = st.text(st.characters(exclude_categories=('Cs',)), max_size=60)
# what YAML is made of, so that a random text is not merely one long word
PIECES = st.sampled_from([
    ': ', '- ', '[', ']', '{', '}', ', ', '\n', '\n  ', '&a ', '*a', '!!int ', '!!binary ', '!x ',
    '"', "'", '#', '|', '>', '? ', '%', '@', '\t', '---\n', '...', '<<: ', '1e3', '.nan', '-.inf',
    '0x1f', '0o7', '1_000', '2001-13-45', '12:30:45', 'yes', 'null', '~', '\x00', '\u2028', 'mass',
    '\N{SNOWMAN}', '\\', '=', '9' * 40])
TEXTS = st.one_of(LETTERS, st.lists(PIECES, max_size=40).map(''.join))
LEAVES = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(allow_nan=False), LETTERS, st.dates())
VALUES = st.recursive(
    LEAVES, lambda below: st.lists(below, max_size=4) | st.dictionaries(
        LETTERS | st.integers() | st.booleans(), below, max_size=4), max_leaves=20)
SOON = 2.0  # s for a text of a kilobyte at most; it takes a thousandth


@settings(max_examples=150)
@given(TEXTS)
def test_any_text_has_a_value_or_one_error_of_yaml(text):
    began = time.monotonic()
    for read in (yaml_nodes.load, yaml_nodes.compose):
        try:
            read(text)
        except yaml.YAMLError as error:
            message = yaml_nodes.reason(error)
            assert message and '\n' not in message and len(message) < 1000
    assert time.monotonic() - began < SOON


@settings(max_examples=150)
@given(TEXTS)
def test_any_text_has_a_mapping_or_one_line_that_names_it(text):
    reader = yaml_nodes.Reader('mine.yaml')
    try:
        assert isinstance(reader.parse(text), yaml.MappingNode)
    except ParameterError as error:
        assert str(error).startswith('mine.yaml') and '\n' not in str(error)


@given(VALUES)
def test_what_is_dumped_is_loaded_again(value):
    text = yaml.safe_dump(value)
    assert yaml_nodes.load(text) == value
    assert type(yaml_nodes.load(text)) is type(value)


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_numbers_read_back_to_the_bit_however_they_are_written(number):
    # repr writes 1e-07, which YAML 1.1 takes for text; %e writes 1.000000e-07
    for text in (repr(number), f'{number:.17e}'):
        assert float.hex(float(yaml_nodes.load(text))) == float.hex(float(text))
        assert isinstance(yaml_nodes.load(text), float)


@given(st.binary(max_size=200))
def test_any_bytes_of_a_file_are_text_or_one_line(tmp_path_factory, data):
    path = tmp_path_factory.getbasetemp() / 'bytes.yaml'
    path.write_bytes(data)
    try:
        assert yaml_nodes.read_text(path) == data.decode().replace('\r\n', '\n').replace(
            '\r', '\n')
    except ParameterError as error:
        assert str(error) == f'{path}: not a text file'
        with pytest.raises(UnicodeDecodeError):
            data.decode()


@given(st.integers(1, 200), st.sampled_from(['[', '{a: ', '- ']))
def test_the_depth_has_one_limit(levels, opening):
    text = opening * levels
    text += 'x' + {'[': ']', '{a: ': '}', '- ': ''}[opening] * levels
    if levels > limits.YAML_DEPTH.value():
        with pytest.raises(yaml.YAMLError, match='nested deeper'):
            yaml_nodes.load(text)
    else:
        value = yaml_nodes.load(text)
        for _ in range(levels):
            value = value['a'] if isinstance(value, dict) else value[0]
        assert value == 'x'


@given(st.integers(1, 12), st.integers(2, 12))
def test_aliases_count_as_what_they_stand_for(levels, width):
    lines = ['a0: &a0 x'] + [
        f'a{k + 1}: &a{k + 1} [{", ".join([f"*a{k}"] * width)}]' for k in range(levels)]
    began = time.monotonic()
    try:
        value = yaml_nodes.load('\n'.join(lines))
        assert width ** levels < 200_000  # about the limit on nodes: no less is refused
        assert len(value[f'a{levels}']) == width
    except yaml.YAMLError as error:
        assert 'MAMBO_MAX_YAML_NODES' in yaml_nodes.reason(error)
        assert width ** levels > 50_000
    assert time.monotonic() - began < SOON
