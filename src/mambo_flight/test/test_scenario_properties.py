"""Every flight that can be is printed and read back the same; every damaged one is one line."""

from hypothesis import given, settings, strategies as st
from mambo_flight import scenario_file
from mambo_flight.scenario import (
    commented_yaml, from_yaml, landing_time, LEAVES, override, Scenario, scenario, to_yaml)
from mambo_model import schema
from mambo_model.motion.trajectory import TRAJECTORIES
from mambo_model.yaml_nodes import load
import pytest
from schema_strategies import allowed, words
import yaml

WORDS = words(30).filter(lambda text: bool(text.strip()))


def changes(most):
    """Return parameters of any nodes, {name: allowed value}."""
    return st.lists(st.sampled_from(sorted(LEAVES)), unique=True, max_size=most).flatmap(
        lambda names: st.fixed_dictionaries(
            {name: allowed(LEAVES[name], WORDS) for name in names}))


@st.composite
def flights(draw):
    """Draw any flight; of parameters that contradict each other the last drawn are left out."""
    values = draw(changes(8))
    while True:
        try:
            return override(Scenario(), values)
        except schema.ParameterError:
            values.popitem()


@pytest.mark.long
@settings(max_examples=25)
@given(flights(), st.sampled_from([to_yaml, commented_yaml]))
def test_any_flight_reads_back_equal(flight, write):
    assert from_yaml(write(flight)) == flight


@pytest.mark.long
@settings(max_examples=25)
@given(flights())
def test_both_ways_to_print_say_the_same(flight):
    assert load(commented_yaml(flight)) == load(to_yaml(flight))
    assert all(len(line) < 1000 for line in commented_yaml(flight).splitlines())


FILES = {  # names that may be files, too
    'vehicle': ['identified', 'toolbox'], 'believed': ['identified', 'toolbox'],
    'trajectory': sorted(TRAJECTORIES)}
SETTINGS = st.fixed_dictionaries({}, optional={
    name: st.sampled_from(FILES[name]) if name in FILES else allowed(field, WORDS)
    for name, field in scenario_file.FIELDS.items()})


@pytest.fixture(scope='module')
def file(tmp_path_factory):
    return tmp_path_factory.mktemp('scenarios') / 'mine.yaml'


@pytest.mark.long
@settings(max_examples=25)
@given(choices=SETTINGS, title=WORDS)
def test_a_scenario_file_does_what_its_choices_do(file, choices, title):
    file.write_text(yaml.safe_dump({'title': title, **choices}))
    name = {'noise': 'noise', 'landing': 'land'}
    try:
        wanted = scenario(**{name.get(key, key): value for key, value in choices.items()
                             if key != 'takeoff'}, overrides={
            'reference_node.plan.takeoff': choices.get('takeoff', 'smooth')})
    except schema.ParameterError:
        with pytest.raises(schema.ParameterError, match='mine.yaml'):
            scenario_file.load(str(file))
        return
    assert scenario_file.load(str(file))[1] == wanted
    again = scenario_file.read(file)
    assert again.title == title and list(again.flights.values()) == [wanted]
    file.write_text(to_yaml(wanted))
    assert scenario_file.load(str(file))[1] == wanted


TEXTS = {name: scenario_file.find(name).read_text() for name in scenario_file.names()}


@pytest.mark.long
@settings(max_examples=120)
@given(name=st.sampled_from(sorted(TEXTS)), start=st.integers(0, 10_000),
       length=st.integers(0, 40),
       other=st.text(st.sampled_from(':-[]{}\n #"\'0.e1kgxyz&*!|>%@\t\x00'), max_size=8))
def test_a_damaged_file_is_a_flight_or_one_line(file, name, start, length, other):
    text = TEXTS[name]
    start %= len(text)
    file.write_text(text[:start] + other + text[start + length:])
    try:
        assert all(isinstance(flight, Scenario)
                   for flight in scenario_file.read(file).flights.values())
    except schema.ParameterError as error:
        assert '.yaml' in str(error)  # this file, or a vehicle's that it names
        assert '\n' not in str(error) and len(str(error)) < 3000


NUMBERS = sorted(name for name, field in LEAVES.items() if 'unit' in field.metadata)


@given(st.sampled_from(NUMBERS), st.sampled_from([
    'x', '', [], {}, None, [1.0] * 7, float('nan'), -1e300, 10**40, {'a': 1}, True]))
def test_a_parameter_of_another_kind_is_refused_with_its_line(name, wrong):
    """Whatever stands where a number belongs, the line and the name are said."""
    node, _, key = name.partition('.')
    text = yaml.safe_dump({f'/mambo/{node}': {'ros__parameters': {key: wrong}}})
    try:
        flight = from_yaml(text, 'mine.yaml')
    except schema.ParameterError as error:
        assert 'mine.yaml:' in str(error) and key.rpartition('.')[2] in str(error)
        assert '\n' not in str(error)
    else:  # some numbers are allowed where the range is wide
        found = schema.flatten(flight)[name]
        assert found == wrong or list(found) == wrong


@given(st.floats(0.005, 36000.0))
def test_landing_leaves_time_to_land(duration):
    begin = landing_time(duration)
    # blend out 3 s, descent 4 s, rest; and a flight of 10 s before it, or none
    assert begin == 0.0 or (begin >= 10.0 and duration - begin == pytest.approx(9.0, abs=1e-9))
    assert (begin > 0.0) == (duration >= 19.0)
