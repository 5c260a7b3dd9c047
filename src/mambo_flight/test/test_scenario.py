"""A flight as a text file: what is written is read back, what is wrong is named."""

import dataclasses
import math

from mambo_flight import scenario as scenarios
from mambo_flight.gym.task import TaskParams
from mambo_flight.scenario import (
    commented_yaml, from_yaml, landing_time, load, LONGEST, override, Scenario, scenario, SEEDS,
    to_yaml)
from mambo_flight.scenario_file import Settings
from mambo_flight.sweep.design import HEAD
from mambo_model import schema
from mambo_model.vehicle.parameters import preset
from mambo_ros.parameter_texts import describe, key_of, TEXTS
from mambo_sim.parameters import STEP_NS
import pytest
import yaml

LEAVES = dict(schema.walk(Scenario))
ODD = {  # far from every default, numbers that need all their digits
    'sim_node.simulator.vehicle.inertia': (1 / 3e4, 1e-6, 0.01),
    'sim_node.simulator.vehicle.power_a': 1e-7, 'sim_node.wait_for': "one, 'two': {three} # four",
    'sim_node.mode': 'lockstep', 'sim_node.simulator.noise': False,
    'sim_node.simulator.seed': 2**31 - 1, 'sim_node.simulator.plant.initial_position': (-1.5,) * 3,
    'controller_node.cascaded.tilt_limit': math.pi, 'estimator_node.estimator': 'ground_truth'}


def odd():
    return override(scenario('z_sine', seed=9), ODD)


def section(node, **values):
    return yaml.safe_dump({f'/mambo/{node}': {'ros__parameters': values}})


@pytest.mark.parametrize('write', [to_yaml, commented_yaml])
@pytest.mark.parametrize('namespace', ['/mambo', '/hall/second'])
def test_what_is_written_is_read_back(write, namespace):
    for flight in (Scenario(), scenario(), odd()):
        text = write(flight, namespace)
        assert from_yaml(text) == flight
        assert set(yaml.safe_load(text)) == {
            f'{namespace}/{field.name}' for field in dataclasses.fields(Scenario)}


@pytest.mark.parametrize('write', [to_yaml, commented_yaml])
def test_the_name_of_a_course_that_is_not_utf_8_is_written_readably(write):
    named = override(scenario(), {'reference_node.plan.course': '# fl\udcfcg.csv\n1, 2\n'})
    text = write(named)
    assert text.encode() and from_yaml(text).reference_node.plan.course.startswith(
        '# fl\\xfcg.csv\n')


@pytest.mark.parametrize('write', [to_yaml, commented_yaml])
def test_a_component_without_parameters_has_no_group(write, tmp_path):
    """The parser of ROS refuses an empty group: "No value at line 713"."""
    file = tmp_path / 'plain.py'
    file.write_text("""
from dataclasses import dataclass
from mambo_control.command import thrust_and_torque
from mambo_model.values import Parameters
@dataclass(frozen=True)
class Params(Parameters):
    'None.'
def initial(values):
    return 0
def step(memory, state, reference, dt, gains, vehicle):
    return memory, thrust_and_torque(
        vehicle.mass * vehicle.gravity, (0.0, 0.0, 0.0), state, reference, vehicle)
""")
    flight = scenario(controller=str(file))
    text = write(flight)
    assert 'plain' not in yaml.safe_load(text)['/mambo/controller_node']['ros__parameters']
    assert from_yaml(text) == flight


def test_both_files_hold_the_same_values():
    for flight in (scenario(), odd()):
        assert yaml.safe_load(commented_yaml(flight)) == yaml.safe_load(to_yaml(flight))


def test_every_parameter_is_explained_beside_its_value():
    explained = [line.strip() for line in commented_yaml(scenario()).splitlines()
                 if '#' in line and not line.startswith('#')]
    assert len(explained) == len(LEAVES)
    for line, (name, field) in zip(explained, LEAVES.items(), strict=True):
        assignment, _, comment = line.partition(' # ')
        assert assignment.startswith(f'{field.name}: '), name
        assert comment.endswith(field.metadata['source']), name
        if 'unit' in field.metadata:
            assert comment.startswith(f"[{field.metadata['unit']}] "), name
        for option in field.metadata.get('options', ()):
            assert option in comment, name


@pytest.mark.parametrize('line', [
    'mass: 0.068                             # [kg] 0.01..1, weighed, thesis sec. 4.4',
    'seed: 1                                   # [1] 0..2147483647, design choice',
    'mode: realtime                              # realtime | lockstep, how time advances',
    'drag_feedforward: false                   # true | false, chapter 7: believed drag in the',
    "wait_for: ''                                # names of nodes to wait for, separated by"])
def test_a_comment_reads_like_this(line):
    assert line in commented_yaml(scenario())


def test_what_a_file_leaves_out_keeps_its_default():
    text = section('sim_node', simulator={'vehicle': {'mass': 0.07}})
    assert from_yaml(text) == override(Scenario(), {'sim_node.simulator.vehicle.mass': 0.07})


def test_dotted_names_are_nested_ones():
    assert from_yaml(section('sim_node', **{'simulator.vehicle.mass': 0.07})) == from_yaml(
        section('sim_node', simulator={'vehicle': {'mass': 0.07}}))


@pytest.mark.parametrize('text, value', [
    ('1e-3', 0.001), ('1E-3', 0.001), ('-2e5', -2e5), ('+1.e2', 100.0), ('.5e1', 5.0),
    ('1.0e3', 1000.0), ('1.5', 1.5), ('7', 7), ('[1e-3, 2]', [0.001, 2]), ('true', True),
    ('circle', 'circle'), ("'1e-3'", '1e-3'), ('1e', '1e'), ('e5', 'e5'), ('1e-3x', '1e-3x')])
def test_a_number_may_be_written_as_ros_reads_it(text, value):
    read = scenarios.read_value(text)
    assert read == value and type(read) is type(value)


def test_a_file_may_hold_such_numbers():
    text = '/mambo/sim_node:\n  ros__parameters:\n    simulator: {barometer: {noise: 1e-2}}\n'
    assert from_yaml(text).sim_node.simulator.barometer.noise == 0.01


@pytest.mark.parametrize(('word', 'value'), [
    ('true', True), ('True', True), ('yes', True), ('off', False), ('FALSE', False)])
def test_a_switch_may_be_written_as_ros_reads_it(word, value):
    text = f'/mambo/sim_node:\n  ros__parameters:\n    simulator: {{noise: {word}}}\n'
    assert from_yaml(text).sim_node.simulator.noise is value


@pytest.mark.parametrize('text, complaint', [
    (section('sim_nod', speed=1.0),
     r'x\.yaml:1: /mambo/sim_nod: is not a node of a flight; known: sim_node, optitrack_node'),
    (section('sim_node', duraton=1.0),
     r'x\.yaml:3: sim_node\.duraton: unknown parameter; did you mean sim_node\.duration'),
    (section('sim_node', simulator={'vehicle': {'mas': 1.0}}),
     r'x\.yaml:5: sim_node\.simulator\.vehicle\.mas: unknown parameter; did you mean sim_node\.s'),
    (section('sim_node', simulator={'vehicle': {'mass': -1.0}}),
     r'x\.yaml:5: sim_node\.simulator\.vehicle\.mass = -1\.0 kg is outside \[0\.01, 1\]'),
    (section('sim_node', simulator={'vehicle': 'heavy'}),
     r'x\.yaml:4: sim_node\.simulator\.vehicle: must hold names and values'),
    (section('sim_node', mode='slow'),
     r"x\.yaml:3: sim_node\.mode = 'slow' is not one of realtime"),
    ('', r'x\.yaml: must hold names and values'),
    ('- 1\n', r'x\.yaml: must hold names and values'),
    ('/mambo/sim_node: 1\n', r'x\.yaml:1: /mambo/sim_node: must hold names and values'),
    ('/mambo/sim_node: {speed: 1}\n',
     r'x\.yaml:1: /mambo/sim_node: must hold ros__parameters and'),
    ('a: [1\nb: 2\n', r'x\.yaml:\d: not valid YAML: '),
    ('a: \x07', r'x\.yaml: not a text file'),
    (section('sim_node', speed=1.0) + section('sim_node', speed=2.0).replace('/mambo', '/two'),
     r'x\.yaml:4: /two/sim_node: is a second section for sim_node'),
])
def test_a_wrong_file_gets_one_line_that_names_the_place(text, complaint):
    with pytest.raises(schema.ParameterError, match=complaint) as refusal:
        from_yaml(text, 'x.yaml')
    assert '\n' not in str(refusal.value)


def test_files_that_cannot_be_read_get_one_line_too(tmp_path):
    binary = tmp_path / 'binary.yaml'
    binary.write_bytes(b'\xff\xfe\x00')
    for path, why in ((tmp_path / 'none.yaml', 'No such file or directory'),
                      (tmp_path, 'Is a directory'), (binary, 'not a text file')):
        with pytest.raises(schema.ParameterError) as refusal:
            load(path)
        assert str(refusal.value) == f'{path}: {why}'


def test_a_file_is_loaded_under_its_own_name(tmp_path):
    file = tmp_path / 'flight.yaml'
    file.write_text(commented_yaml(odd()))
    assert load(file) == odd()
    file.write_text(section('sim_node', speed=0.0))
    with pytest.raises(schema.ParameterError, match=r'flight\.yaml:3: sim_node\.speed = 0'):
        load(file)


def beyond(field):
    """Return a value just outside the range of a parameter."""
    high = field.metadata['high']
    wrong = high + 1 if isinstance(field.default, int) else math.nextafter(high, math.inf)
    return (wrong,) * len(field.default) if isinstance(field.default, tuple) else wrong


def test_every_number_is_refused_outside_its_range():
    for name, field in LEAVES.items():
        if 'unit' in field.metadata:
            with pytest.raises(schema.ParameterError, match=rf'\.{field.name} = .* is outside'):
                override(Scenario(), {name: beyond(field)})


def test_overrides_are_applied_last():
    flight = scenario(seed=3, overrides={
        'optitrack_node.seed': 4, 'reference_node.plan.landing_time': 20,
        'sim_node.simulator.imu.gyro_bias': [0, 0.01, 0]})
    assert (flight.seed, flight.optitrack_node.seed) == (3, 4)
    assert flight.reference_node.plan.landing_time == 20.0
    assert flight.sim_node.simulator.imu.gyro_bias == (0.0, 0.01, 0.0)


@pytest.mark.parametrize('name, complaint', [
    ('sim_node.simulator.vehicle.mas', r'did you mean .*sim_node\.simulator\.vehicle\.mass'),
    ('mass', 'mass: unknown parameter'), ('sim_node.simulator', 'unknown parameter')])
def test_an_unknown_override_is_named(name, complaint):
    with pytest.raises(schema.ParameterError, match=complaint):
        scenario(overrides={name: 1.0})


def test_an_override_out_of_range_is_named():
    with pytest.raises(schema.ParameterError, match=r'sim_node.simulator.vehicle.mass = -1\.0 kg'):
        scenario(overrides={'sim_node.simulator.vehicle.mass': -1})


def test_one_seed_serves_every_noise_stream():
    flight = scenario(seed=11)
    assert flight.seed == flight.sim_node.simulator.seed == flight.optitrack_node.seed == 11


def test_the_controller_believes_in_the_true_vehicle_unless_told_otherwise():
    same, other = scenario(vehicle='toolbox'), scenario(vehicle='toolbox', believed='identified')
    for flight, believed in ((same, 'toolbox'), (other, 'identified')):
        assert flight.sim_node.simulator.vehicle == preset('toolbox')
        assert flight.reference_node.vehicle == preset(believed)
        assert flight.controller_node.vehicle == preset(believed)


def test_without_noise_neither_sensors_nor_cameras_have_any():
    flight = scenario(noise=False)
    assert not flight.sim_node.simulator.noise and not flight.optitrack_node.optitrack.noise
    assert scenario().sim_node.simulator.noise and scenario().optitrack_node.optitrack.noise


@pytest.mark.parametrize('choices, complaint', [
    ({'trajectory': 'loop'}, "trajectory = 'loop' is not one of"),
    ({'estimator': 'guess'}, "estimator_node.estimator: estimator 'guess' is unknown: give"),
    ({'controller': 'pid'}, "controller 'pid' is unknown: give .* one of cascaded, toolbox"),
    ({'vehicle': 'eagle'}, 'eagle'), ({'believed': 'eagle'}, 'eagle'),
    ({'seed': -1}, 'seed = -1'), ({'seed': 1.5}, r'seed = 1\.5 must be a whole number'),
    ({'duration': -1.0}, 'duration'), ({'duration': math.nan}, 'duration = nan')])
def test_a_wrong_choice_is_named(choices, complaint):
    with pytest.raises(schema.ParameterError, match=complaint):
        scenario(**choices)


def test_a_landing_fits_into_the_flight_or_is_left_out():
    assert landing_time(40.0) == 31.0  # 3 s to the hover point, 4 s down, 2 s of rest
    assert landing_time(19.0) == 10.0  # 2 s of trajectory after the blend
    assert landing_time(18.9) == 0.0
    assert scenario(duration=30.0).reference_node.plan.landing_time == 21.0
    assert scenario(duration=30.0, land=False).reference_node.plan.landing_time == 0.0
    assert scenario(duration=9.0).reference_node.plan.landing_time == 0.0


def test_limits_of_one_quantity_are_the_same_wherever_it_is_set():
    """Settings of files, tasks and sweeps are bounded by the parameters that they become."""
    settings, tasks = dict(schema.walk(Settings)), dict(schema.walk(TaskParams))
    high = {name: field.metadata.get('high') for name, field in LEAVES.items()}
    for field in (settings['duration'], tasks['episode']):
        assert field.metadata['high'] == high['reference_node.plan.landing_time'] == LONGEST
        assert field.metadata['low'] == 1e-9 * STEP_NS
    for name in SEEDS:
        assert settings['seed'].metadata['high'] == HEAD['seed'].metadata['high'] == high[name]
    assert high['sim_node.duration'] >= LONGEST


def test_every_parameter_of_a_flight_says_what_it_is():
    names = [name.partition('.')[2] for name in LEAVES]
    explained = {'wait_for', 'start_patience', 'patience'}  # by what else is declared
    assert {name for name in names if not describe(name)} == explained
    assert {key_of(name) for name in names} - {''} == TEXTS.keys()  # and none describes nothing
    bare = {name for name in names if '.' in name and '.' not in key_of(name)}
    assert not bare, 'described by the words for another parameter'
