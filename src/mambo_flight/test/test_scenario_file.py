"""Scenario files: every experiment of the thesis can be flown, whatever is wrong is located."""

import json
import re

from mambo_flight import scenario_file
from mambo_flight.scenario import commented_yaml, override, scenario, to_yaml
from mambo_flight.scenario_file import find, from_settings, load, names, Place, read
from mambo_model import schema
from mambo_model.vehicle.parameters import preset
import pytest

FIGURES = [
    '3_3', '4_3', '4_4', *(f'5_{n}' for n in range(3, 14)), *(f'6_{n}' for n in range(1, 7)),
    *(f'c_{n}' for n in range(1, 9))]


@pytest.fixture
def file(tmp_path):
    def write(text):
        path = tmp_path / 'mine.yaml'
        path.write_text(text)
        return path
    return write


def test_every_flight_of_the_thesis_has_its_file_and_they_are_listed_in_order():
    assert [name for name in names() if name.startswith('fig_')] == [f'fig_{f}' for f in FIGURES]


@pytest.mark.parametrize('name', names())
def test_a_file_says_what_it_is_and_every_flight_of_it_can_be_built(name):
    experiment = read(find(name))
    assert experiment.name == name and experiment.flights
    if name.startswith('fig_'):
        figure = name.removeprefix('fig_').upper().replace('_', '.')
        assert experiment.title.startswith(f'Figure {figure}: ')
    for flight in experiment.flights.values():
        assert flight.sim_node.duration > 0.0


def test_a_file_with_nothing_but_a_title_is_the_default_flight(file):
    assert load(str(file('title: nothing special\n'))) == ('mine', scenario())


def test_keys_do_what_the_arguments_of_a_scenario_do(file):
    path = file(
        'title: all of it\ntrajectory: y_sine\ntakeoff: step\nlanding: false\nduration: 30\n'
        'vehicle: toolbox\nbelieved: identified\nestimator: kalman\ncontroller: toolbox\n'
        'noise: false\nseed: 7\nparameters:\n  estimator_node:\n'
        '    kalman.optical_flow.constant: 1.2\n'
        '  sim_node: {simulator: {imu: {accel_walk: 1e-3}}}\n')
    assert load(str(path))[1] == scenario(
        'y_sine', 'kalman', 'toolbox', 30.0, 7, 'toolbox', 'identified', False, False, {
            'reference_node.plan.takeoff': 'step', 'sim_node.simulator.imu.accel_walk': 1e-3,
            'estimator_node.kalman.optical_flow.constant': 1.2})


def test_flights_differ_from_the_rest_of_the_file_in_what_they_say(file):
    path = file(
        'title: two\nseed: 3\nparameters: {sim_node: {speed: 2.0, patience: 9}}\nflights:\n'
        '  one: {}\n  other:\n    seed: 4\n    parameters: {sim_node: {speed: 3.0}}\n')
    flights = read(path).flights
    assert list(flights) == ['one', 'other']
    assert [f.seed for f in flights.values()] == [3, 4]
    assert [f.sim_node.speed for f in flights.values()] == [2.0, 3.0]
    assert [f.sim_node.patience for f in flights.values()] == [9.0, 9.0]
    assert load(str(path)) == ('mine_one', flights['one'])
    assert load(f'{path}:other') == ('mine_other', flights['other'])
    with pytest.raises(schema.ParameterError, match="no flight 'third'; known: one, other"):
        load(f'{path}:third')


def test_a_flight_of_a_known_experiment_has_a_name():
    name, flight = load('fig_6_1/simulation')
    assert name == 'fig_6_1_simulation'
    assert flight.sim_node.simulator.vehicle == preset('frictionless')
    assert load('fig_6_1')[0] == 'fig_6_1_experiment_old_map'


def test_choices_given_beside_the_file_win():
    over = {'seed': Place(9, '--seed'), 'trajectory': Place('hover', '--trajectory')}
    _, flight = load('fig_5_11/x_and_y_exchanged', over)
    assert (flight.seed, flight.reference_node.plan.trajectory) == (9, 'hover')


def test_a_vehicle_file_is_found_beside_the_scenario(file, tmp_path):
    (tmp_path / 'heavy.yaml').write_text(
        'description: with a load\nbase: identified\n'
        'mass: {value: 0.08, unit: kg, source: kitchen scale}\n')
    flight = load(str(file('title: heavy\nvehicle: heavy.yaml\nbelieved: toolbox\n')))[1]
    assert flight.sim_node.simulator.vehicle.mass == 0.08
    assert flight.controller_node.vehicle == preset('toolbox')


def test_a_hand_carries_along_the_reference(file):
    flight = load(str(file('title: by hand\ntrajectory: hand_loop\ncarried: true\n')))[1]
    hand = flight.sim_node.simulator.hand
    assert hand.enabled and hand.plan == flight.reference_node.plan


@pytest.mark.parametrize('write', [to_yaml, commented_yaml])
def test_a_ros_parameter_file_is_a_scenario_too(file, write):
    flight = override(scenario('z_sine', seed=5), {'sim_node.simulator.vehicle.mass': 0.07})
    assert load(str(file(write(flight))))[1] == flight


def test_a_bag_is_no_scenario(tmp_path):
    bag = tmp_path / 'bag'
    bag.mkdir()
    (bag / 'metadata.yaml').touch()
    for name in (bag, tmp_path / 'flight.mcap'):
        with pytest.raises(schema.ParameterError, match=f'scenario .{name}. is a bag: give'):
            load(str(name))
    with pytest.raises(schema.ParameterError, match='is unknown: give a file'):
        load('x' * 300)


@pytest.mark.parametrize(('line', 'message'), [
    ('trajectory: spiral', ":2: trajectory: trajectory 'spiral' is unknown: give a file"),
    ('sed: 3', ':2: sed: unknown parameter; did you mean seed'),
    ('seed: 1.5', r':2: seed = 1.5 must be a whole number'),
    ('seed: -1', r':2: seed = -1 is outside \[0,'),
    ('duration: abc', ":2: duration: 'abc' is not a number"),
    ('duration: .nan', ":2: duration: '.nan' is not a number"),
    ('duration: nan', r':2: duration = nan s is outside \[0.005, 36000\]'),
    ('noise: maybe', ":2: noise = 'maybe' must be true or false"),
    ('vehicle: boat', ":2: vehicle: vehicle 'boat' is unknown; known: crazyflie"),
    ('believed: b.yaml', r':2: believed: .*b.yaml: No such file or directory'),
    ('seed: 1\nseed: 2', ':3: seed: duplicate key'),
    ('title: again', ':2: title: duplicate key'),
    ('parameters: {sim_node.speed: 2.0, sim_node: {speed: 3.0}}',
     ':2: sim_node.speed: is given twice, also at '),
    ('flights: {}', ':2: flights: holds no flight'),
    ('flights: 3', ':2: flights: must hold names and values'),
    ('flights:\n  a: {sead: 1}', ':3: sead: unknown parameter; did you mean seed'),
    ('parameters:\n  sim_node:\n    simulator: {vehicle: {mass: -1}}',
     r':4: sim_node.simulator.vehicle.mass = -1.0 kg is outside \[0.01, 1\]'),
    ('parameters: {sim_node: {durtion: 3}}', ':2: sim_node.durtion: unknown parameter; did you '),
    ('parameters: {sim_node: 3}', ':2: sim_node: must hold names and values'),
    ('parameters:\n  sim_node: {simulator: {vehicle: {inertia: [1, 2]}}}',
     ':3: sim_node.simulator.vehicle.inertia: must be 3 numbers'),
    ('parameters:\n  reference_node: {plan: {start_time: 2}}',
     ':3: reference_node.plan.start_time = 2 s is before the climb ends'),
    ('trajectory: [circle', r':\d: not valid YAML: '),
])
def test_what_is_wrong_is_named_by_file_line_and_key(file, line, message):
    path = file(f'title: wrong\n{line}\n')
    with pytest.raises(schema.ParameterError, match=re.escape(str(path)) + message) as error:
        load(str(path))
    assert '\n' not in str(error.value)


@pytest.mark.parametrize(('text', 'message'), [
    ('', 'must hold names and values'), ('- a\n', 'must hold names and values'),
    ('seed: 1\n', 'title: missing'), ('a\x00b', 'not a text file'),
    ('/mambo/sim_node:\n  ros__parameters:\n    durtion: 3\n', ':3: sim_node.durtion: unknown'),
    ('/mambo/reference_node:\n  ros__parameters: {plan: {start_time: 2}}\n',
     ':2: reference_node.plan.start_time = 2 s is before the climb ends'),
    ('/mambo/odd_node:\n  ros__parameters: {}\n',
     ':1: /mambo/odd_node: is not a node of a flight'),
    ('/mambo/sim_node: {duration: 3}\n', ':1: /mambo/sim_node: must hold ros__parameters'),
])
def test_what_is_no_scenario_is_refused(file, text, message):
    with pytest.raises(schema.ParameterError, match=message):
        load(str(file(text)))


def test_unknown_names_and_missing_files_are_named(tmp_path):
    with pytest.raises(schema.ParameterError, match=r"'fig_9_9' is unknown: .* of fig_3_3, fi"):
        load('fig_9_9')
    for path in ('/dev/zero', 'folder/fig_3_3'):
        with pytest.raises(schema.ParameterError, match=f"'{path}' is unknown"):
            load(path)
    with pytest.raises(schema.ParameterError, match=r'none\.yaml: No such file'):
        load(str(tmp_path / 'none.yaml'))
    with pytest.raises(schema.ParameterError, match=r"no flight 'x'; known: one without a name"):
        load('fig_3_3/x')


def test_choices_without_a_file_say_where_they_came_from():
    with pytest.raises(schema.ParameterError, match="^--vehicle: vehicle 'boat' is unknown"):
        from_settings({'vehicle': Place('boat', '--vehicle')})
    assert from_settings({}) == scenario()


def test_every_choice_is_documented():
    for name, field in scenario_file.FIELDS.items():
        assert field.metadata['source'], name


def test_a_file_of_several_drones_is_refused_where_one_is_flown(file):
    name = str(file('title: three\nworld: {drones: 3, spacing: 1.0}\n'))
    with pytest.raises(schema.ParameterError, match=f'^{name}: world.drones = 3: only one drone'):
        scenario_file.load_alone(name)
    assert scenario_file.load_alone(str(file('title: one\n')))[1] == scenario()


@pytest.mark.parametrize('settings, parameters, found', [
    ({'seed': 2}, {}, None),
    ({'seed': None, 'speed': 2.0}, {'sim_node.speed': 2.0}, None),
    ({'speed': 2.0}, {'sim_node.speed': 3.0}, ('speed', 'sim_node.speed')),
    ({'paused': True}, {'sim_node.paused': False}, ('paused', 'sim_node.paused')),
    ({'paused': True}, {'sim_node.paused': True}, None),
    ({'landing': True}, {'reference_node.plan.landing_time': 20.0}, None),
    ({'landing': False}, {'reference_node.plan.landing_time': 20.0},
     ('landing', 'reference_node.plan.landing_time'))])
def test_a_parameter_contradicts_a_setting_that_gives_it_another_value(
        settings, parameters, found):
    assert scenario_file.contradicted(settings, parameters) == found


@pytest.mark.parametrize('name', ['../escaped', 'a/b', '.hidden', 'two words', 'x' * 200])
def test_a_name_of_a_flight_that_can_leave_the_folder_of_bags_is_refused(tmp_path, name):
    file = tmp_path / 'own.yaml'
    file.write_text(f'title: x\nflights:\n  good: {{}}\n  {json.dumps(name)}: {{seed: 1}}\n')
    with pytest.raises(schema.ParameterError, match=r'own\.yaml:4: flights: .* is no name of a f'):
        scenario_file.read(file)


def test_the_other_flights_of_a_file_are_named_as_they_are_loaded(tmp_path):
    file = tmp_path / 'own.yaml'
    file.write_text('title: x\nflights:\n  first: {seed: 1}\n  se-cond: {seed: 2}\n')
    assert scenario_file.select(str(file)).others == [f'{file}:se-cond']
    assert scenario_file.load(f'{file}:se-cond')[1].seed == 2
    assert scenario_file.select(f'{file}:first').others == scenario_file.select(
        'fig_5_11').others == []
    with pytest.raises(schema.ParameterError, match=f'a flight of a file is written {file}:sec'):
        scenario_file.load(f'{file}/second')
