"""Every vehicle that can be is written and read back to the bit; every other is one line."""

import dataclasses

from hypothesis import given, strategies as st
from mambo_model import schema
from mambo_model.vehicle import parameters, vehicle_file
from mambo_model.vehicle.mass_properties import impossible
from mambo_model.vehicle.parameters import Vehicle
import pytest
from schema_strategies import allowed, words

FIELDS = dict(schema.walk(Vehicle))
WORDS = words(40)
SOURCES = WORDS.filter(lambda text: bool(text.strip()))


CHANGES = st.lists(st.sampled_from(sorted(FIELDS)), unique=True, max_size=6).flatmap(
    lambda names: st.fixed_dictionaries(
        {name: st.tuples(allowed(FIELDS[name], WORDS), SOURCES) for name in names}))


@pytest.fixture(scope='module')
def file(tmp_path_factory):
    return tmp_path_factory.mktemp('vehicles') / 'mine.yaml'


@given(values=CHANGES, description=SOURCES, base=st.sampled_from(sorted(parameters.PRESETS)))
def test_a_vehicle_reads_back_to_the_bit(file, values, description, base):
    file.write_text(vehicle_file.to_text(description, base, values, Vehicle))
    content = vehicle_file.read(file, Vehicle)
    assert content.base.value == base and content.markers == []
    assert content.values == {name: value for name, (value, _) in values.items()}
    if 'inertia' in values and (why := impossible(values['inertia'][0])):
        with pytest.raises(schema.ParameterError) as refused:
            parameters.load(file)
        assert str(refused.value) == f'{content.places["inertia"]}: inertia: {why}'
        return
    try:
        wanted = vehicle_file.replace(
            parameters.preset(base), {name: value for name, (value, _) in values.items()})
    except schema.ParameterError as error:  # each is in range, together they contradict
        with pytest.raises(schema.ParameterError) as refused:
            parameters.load(file)
        assert str(refused.value) == f'{file}: {error}'
        return
    assert parameters.load(file) == wanted


@given(name=st.sampled_from(sorted(name for name, field in FIELDS.items()
                                   if isinstance(field.default, float))),
       number=st.floats())
def test_a_number_is_in_its_range_or_refused_by_name(file, name, number):
    field, unit = FIELDS[name], FIELDS[name].metadata['unit']
    *sections, last = name.split('.')
    lines = ['description: x'] + [
        f'{"  " * depth}{section}:' for depth, section in enumerate(sections)]
    lines.append(f'{"  " * len(sections)}{last}: '
                 f'{{value: {number!r}, unit: "{unit}", source: x}}')
    file.write_text('\n'.join(lines))
    if field.metadata['low'] <= number <= field.metadata['high']:
        assert vehicle_file.read(file, Vehicle).values == {name: number}
    else:
        with pytest.raises(schema.ParameterError, match=last) as refused:
            vehicle_file.read(file, Vehicle)
        assert f'{file}:{len(lines)}: ' in str(refused.value)


@given(start=st.integers(0, 5000), length=st.integers(0, 60),
       other=st.text(st.sampled_from(':-[]{}\n #"\'0.e1kgxyz&*!|>'), max_size=8),
       name=st.sampled_from(sorted(parameters.PRESETS)))
def test_a_damaged_file_is_a_vehicle_or_one_line(file, start, length, other, name):
    text = (parameters.FOLDER / f'{name}.yaml').read_text()
    start %= len(text)
    file.write_text(text[:start] + other + text[start + length:])
    try:
        assert isinstance(parameters.load(file), Vehicle)
    except schema.ParameterError as error:
        assert str(file) in str(error) and '\n' not in str(error) and len(str(error)) < 2000


@given(values=CHANGES)
def test_flattened_parameters_build_the_same_again(values):
    flat = schema.flatten(Vehicle())
    try:
        changed = schema.build(Vehicle, {**flat, **{k: v for k, (v, _) in values.items()}})
    except schema.ParameterError:
        return
    assert schema.build(Vehicle, schema.flatten(changed)) == changed
    assert schema.build(Vehicle, dataclasses.asdict(changed)) == changed
