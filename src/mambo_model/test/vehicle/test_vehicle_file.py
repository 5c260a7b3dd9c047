"""Vehicle files: what they say is what one gets; what they get wrong is named with its line."""

import dataclasses

from mambo_model.schema import flatten, ParameterError
from mambo_model.vehicle import parameters, vehicle_file
import pytest

HEAD = 'description: a test\nbase: identified\n\n'  # the next line is line 4
MASS = 'mass: {value: 0.07, unit: kg, source: scale}\n'
MARKER = 'markers:\n  - mass: {value: 1e-4, unit: kg, source: x}\n'


@pytest.fixture
def file(tmp_path):
    """Return a function that writes a vehicle file."""
    def write(text, name='mine.yaml'):
        path = tmp_path / name
        path.write_text(text)
        return path
    return write


def test_a_file_changes_what_it_names_and_nothing_else(file):
    path = file(HEAD + MASS + """
inertia:
  value: [7e-5, 8e-5, 1.5e-4]
  unit: kg m^2
  source: pendulum
thrust_map: {value: linear, source: mine}
drag:
  induced: {value: true, source: mine}
  induced_coefficient: {value: 1e-2, unit: s/m, source: mine}
""")
    base = parameters.preset('identified')
    assert parameters.load(path) == dataclasses.replace(
        base, mass=0.07, inertia=(7e-5, 8e-5, 1.5e-4), thrust_map='linear',
        drag=dataclasses.replace(base.drag, induced=True, induced_coefficient=0.01))
    assert parameters.load(str(path)) == parameters.load(path)


def test_without_a_base_the_rest_is_that_of_the_defaults(file):
    assert parameters.load(file('description: x\n' + MASS)) == parameters.Vehicle(mass=0.07)


def test_an_inertia_may_exceed_the_limit_of_a_body_by_its_error(file):
    text = 'inertia: {value: [1e-4, 1e-4, 2.19e-4], unit: kg m^2, source: x}\n'
    assert parameters.load(file(HEAD + text)).inertia[2] == 2.19e-4


def test_markers_are_added_to_the_mass_that_the_file_gives(file):
    marker = '  - mass: {value: 1e-4, unit: kg, source: x}\n' \
        '    position: {value: [0, 0, -0.02], unit: m, source: x}\n'
    got = parameters.load(file(HEAD + MASS + 'markers:\n' + marker * 2))
    assert got.mass == pytest.approx(0.0702, rel=1e-15)
    assert got.inertia[0] > parameters.Vehicle().inertia[0]
    assert got.inertia[2] == pytest.approx(parameters.Vehicle().inertia[2], rel=1e-12)


@pytest.mark.parametrize('text, line, message', [
    ('mass: 0.07\n', 4, 'mass: must hold names and values'),
    ('mass: {value: 0.07, unit: kg}\n', 4, 'mass: has no source; it takes value, unit, source'),
    ('mass: {value: 0.07, source: x}\n', 4, 'mass: has no unit'),
    ('mass: {unit: kg, source: x}\n', 4, 'mass: has no value'),
    ('mass: {value: 0.07, unit: kg, source: ""}\n', 4, 'mass: source: must be text'),
    ('mass: {value: 68, unit: g, source: x}\n', 4, 'mass: is in kg, not in g'),
    ('mass: {value: 68, unit: kg, source: x}\n', 4,
     r'vehicle.mass = 68.0 kg is outside \[0.01, 1\]'),
    ('mass: {value: heavy, unit: kg, source: x}\n', 4, "mass: 'heavy' is not a number"),
    ('mass: {value: nan, unit: kg, source: x}\n', 4, 'vehicle.mass = nan kg is outside'),
    ('mass: {value: [1], unit: kg, source: x}\n', 4, 'mass: must be text'),
    ('mass: {value: 0.07, unit: kg, source: x, note: y}\n', 4, "mass: has 'note'; it takes"),
    ('\nmas: {value: 0.07, unit: kg, source: x}\n', 5, 'mas: unknown parameter; did you mean'),
    (MASS + MASS, 5, 'mass: duplicate key'),
    ('inertia:\n  value: [1e-4, 1e-4]\n  unit: kg m^2\n  source: x\n', 5,
     'inertia: must be 3 numbers'),
    ('inertia: {value: 1e-4, unit: kg m^2, source: x}\n', 4, 'inertia: must be 3 numbers'),
    ('inertia: {value: [1e-5, 1e-5, 9e-4], unit: kg m^2, source: x}\n', 4,
     'inertia: the largest moment, 0.0009 kg m.2, exceeds the sum of the others by 4400 %'),
    ('inertia:\n  value: [2.3e-4, 1e-4, 1e-4]\n  unit: kg m^2\n  source: x\n', 5,
     'exceeds the sum of the others by 15 %, which no body can: check the axes and the unit'),
    ('thrust_map: {value: cubic, source: x}\n', 4,
     "vehicle.thrust_map = 'cubic' is not one of linear, power"),
    ('thrust_map: {value: power, unit: "1", source: x}\n', 4, "thrust_map: has 'unit'"),
    ('drag:\n  induced: {value: 1, source: x}\n', 5,
     "vehicle.drag.induced = '1' must be true or false"),
    ('drag:\n\n  induce: {value: true, source: x}\n', 6,
     'drag.induce: unknown parameter; did you mean drag.induced'),
    ('drag: {value: true, source: x}\n', 4, 'drag.value: unknown parameter'),
    ('drag: true\n', 4, 'drag: must hold names and values'),
    ('markers: 5\n', 4, 'markers: must be a list'),
    ('markers: [5]\n', 4, 'markers: must hold names and values'),
    (MARKER, 5, 'markers: each takes mass and position'),
    (MARKER + '    position: {value: [0, 0], unit: m, source: x}\n', 6,
     'markers: position: must be 3 numbers'),
    (MARKER + '    position: {value: [0, 0, 3], unit: m, source: x}\n', 6,
     r'markers: position: is outside \[-1, 1\] m'),
    (MARKER + '    position: {value: [0, 0, -30], unit: mm, source: x}\n', 6,
     'markers: position: is in m, not in mm')])
def test_what_is_wrong_is_named_with_file_line_and_key(file, text, line, message):
    path = file(HEAD + text)
    with pytest.raises(ParameterError, match=message) as error:
        parameters.load(path)
    assert str(error.value).startswith(f'{path}:{line}: ')
    assert '\n' not in str(error.value)


@pytest.mark.parametrize('text, message', [
    ('', 'must hold names and values'),
    ('- 1\n', 'must hold names and values'),
    ('mass: [\n', ':2: not valid YAML'),
    ('a: 1\n---\nb: 2\n', ':2: not valid YAML: but found another document'),
    (MASS, 'has no description'),
    (HEAD + 'pwm_max: {value: 5, unit: PWM, source: x}\n', 'pwm_min = 10 PWM must be below'),
    (HEAD + 'markers:\n  - {mass: {value: 0.002, unit: kg, source: x}, '
     'position: {value: [0.05, 0, 0], unit: m, source: x}}\n', 'centre of mass by')])
def test_what_is_wrong_with_the_whole_is_named_with_the_file(file, text, message):
    path = file(text)
    with pytest.raises(ParameterError, match=message) as error:
        parameters.load(path)
    assert str(error.value).startswith(f'{path}:')
    assert '\n' not in str(error.value)


def test_unknown_base_names_the_known_ones(file):
    path = file('description: x\nbase: mambo\n')
    with pytest.raises(ParameterError, match="mine.yaml:2: base: vehicle 'mambo' is unknown"):
        parameters.load(path)


def test_missing_file_and_folder_are_named(tmp_path):
    with pytest.raises(ParameterError, match='none.yaml: No such file'):
        parameters.load(tmp_path / 'none.yaml')
    with pytest.raises(ParameterError, match='Is a directory'):
        parameters.load(tmp_path)


def test_files_that_start_from_each_other_are_refused(file, tmp_path, monkeypatch):
    file('description: x\nbase: b\n', 'a.yaml')
    file('description: x\nbase: a\n', 'b.yaml')
    monkeypatch.setattr(parameters, 'FOLDER', tmp_path)
    monkeypatch.setattr(parameters, 'PRESETS', parameters._Presets(tmp_path))
    with pytest.raises(ParameterError, match='a.yaml: base: vehicles that start from each other'):
        parameters.preset('a')


def test_a_written_file_reads_back_to_the_bit(file):
    third = dataclasses.replace(
        parameters.preset('toolbox'), mass=0.1 / 3.0, inertia=(1e-4 / 3.0, 7e-5, 1e-4),
        thrust_map='power', vertical_drag_coefficient=2.0 ** -30,
        drag=dataclasses.replace(parameters.Vehicle().drag, induced=True, profile='linear'),
        battery=dataclasses.replace(parameters.Vehicle().battery, capacity=0.55))
    values = {name: (value, 'a "source", with: signs {}#\n and lines')
              for name, value in flatten(third).items()}
    text = vehicle_file.to_text('mine: #1', 'identified', values, parameters.Vehicle)
    assert parameters.load(file(text)) == third


def test_a_written_file_can_be_read_whatever_the_recording_is_called(file):
    text = vehicle_file.to_text(
        'what fl\udcfcg tells', 'toolbox', {'mass': (0.06, 'fl\udcfcg')}, parameters.Vehicle)
    assert r'what fl\xfcg tells' in text and r'source: fl\xfcg' in text
    assert parameters.load(file(text)).mass == 0.06


def test_a_written_file_names_only_what_changes(file):
    text = vehicle_file.to_text(
        'lighter', 'toolbox', {'mass': (0.06, 'scale')}, parameters.Vehicle)
    assert text == ('description: lighter\nbase: toolbox\n\n'
                    'mass: {value: 0.06, unit: kg, source: scale}\n')
    expected = dataclasses.replace(parameters.preset('toolbox'), mass=0.06)
    assert parameters.load(file(text)) == expected


@pytest.mark.parametrize('name, value, message', [
    ('mas', 0.06, 'mas: unknown parameter; did you mean'),
    ('mass', 60.0, r'vehicle.mass = 60.0 kg is outside'),
    ('mass', float('nan'), 'vehicle.mass = nan kg is outside'),
    ('thrust_map', 'cubic', 'is not one of linear, power')])
def test_nothing_is_written_that_could_not_be_read(name, value, message):
    with pytest.raises(ParameterError, match=message):
        vehicle_file.to_text('x', 'toolbox', {name: (value, 'x')}, parameters.Vehicle)
