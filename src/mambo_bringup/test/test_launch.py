"""The launch files, with and without an installed launch."""

import ast
import hashlib
import importlib.util
from pathlib import Path
import tempfile

from mambo_bags.reader import BagError
from mambo_bags.recorder_parameters import RecorderNodeParams
from mambo_bags.replay_node import ReplayNodeParams
from mambo_bags.writer import BagWriter
from mambo_bringup import launching
from mambo_bringup.flight.nodes import (
    COMPOSED, FLIGHT_NODES, HALL_CAPTURE, RECORDER, SIMULATOR)
from mambo_bringup.launching import choices, PARAMETERS, replay_plan
from mambo_bringup.processes import FlightError
from mambo_bringup.replay import RECORDED
from mambo_flight import scenario_file
from mambo_flight.scenario import from_yaml, load, override, Scenario, scenario, to_yaml
from mambo_model import schema
from mambo_model.errors import MamboError
from mambo_model.motion import uav_trajectories
from mambo_model.motion.polynomial import Course
from mambo_ros import messages, topics
import numpy as np
import pytest
import yaml

SRC = Path(__file__).parents[2]
FILES = sorted((SRC / 'mambo_bringup/launch').iterdir())
NAMES = ['flight.launch.py', 'replay.launch.py']
installed = pytest.mark.skipif(
    importlib.util.find_spec('launch_ros') is None, reason='launch is not installed')


def declared(file):
    """Return {argument: {keyword: constant}} of a launch file, by its text."""
    calls = [node for node in ast.walk(ast.parse(file.read_text()))
             if isinstance(node, ast.Call) and getattr(node.func, 'id', '').startswith('Declare')]
    return {call.args[0].value: {
        keyword.arg: getattr(keyword.value, 'value', None) for keyword in call.keywords}
        for call in calls}


def arguments(name, **given):
    """Return all arguments of a launch file as texts, those not given by their default."""
    known = declared(SRC / 'mambo_bringup/launch' / name)
    assert set(given) <= set(known)
    return {argument: given.get(argument, about.get('default_value'))
            for argument, about in known.items()}


def flight(**given):
    return launching.flight(arguments('flight.launch.py', **given))


def flown(**given):
    """Return the scenario of the one drone of a flight."""
    [only] = flight(**given).scenarios.values()
    return only


def processes(folder, **given):
    folder.mkdir(exist_ok=True)
    return launching.processes(flight(**given), folder)


def parameters(one):
    """Return the parameters of a process that are on its command line, and its files."""
    words = list(zip(one.arguments, one.arguments[1:]))
    return ({word.partition(':=')[0]: yaml.safe_load(word.partition(':=')[2])
             for flag, word in words if flag == '-p'},
            [Path(word) for flag, word in words if flag == '--params-file'])


@pytest.fixture(autouse=True)
def elsewhere(tmp_path_factory, monkeypatch):
    """Have the folders that a launch clears up at its end where pytest does."""
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path_factory.mktemp('launch')))


@pytest.fixture
def bag(tmp_path):
    """Return a bag that says it was flown with a certain scenario."""
    with BagWriter(tmp_path / 'flown', attachments={'scenario.yaml': to_yaml(scenario(
            overrides={'estimator_node.kalman.optical_flow.constant': 1.1}))}) as writer:
        writer.add_topic('/mambo/barometer/pressure', topics.BAROMETER.type_name)
        writer.write('/mambo/barometer/pressure', messages.pressure(0, 101325.0, 1.0), 0)
    return tmp_path / 'flown'


def test_ros_2_launch_finds_them():
    assert [file.name for file in FILES] == NAMES
    assert "share/{package_name}/launch'" in (SRC / 'mambo_bringup/setup.py').read_text()


@pytest.mark.parametrize('file', FILES, ids=lambda file: file.name)
def test_a_launch_file_describes_every_argument(file):
    tree = ast.parse(file.read_text())
    assert 'ros2 launch mambo_bringup ' + file.name in ast.get_docstring(tree)
    assert 'generate_launch_description' in [getattr(node, 'name', '') for node in tree.body]
    known = declared(file)
    assert {'namespace', 'params_file', 'bag'} <= set(known)
    for argument, about in known.items():
        assert about['description'].endswith('.'), argument
        assert isinstance(about.get('default_value', ''), str), argument


def test_every_node_of_a_replay_is_installed_and_has_the_parameters(bag, tmp_path):
    plan = replay_plan(arguments(
        'replay.launch.py', bag=str(bag), output=str(tmp_path / 'new')))
    own = {'recorder_node': RecorderNodeParams, 'replay_node': ReplayNodeParams}
    for package, executable, values in plan.nodes:
        assert is_installed(package, executable)
        if executable in own:
            schema.build(own[executable], values)
        else:
            assert not values


def is_installed(package, executable):
    return f"'{executable} = mambo_ros.entry:{package}.{executable}'" in (
        SRC / package / 'setup.py').read_text()


def listed():
    """Return the nodes that the launch file of a flight lists, by its text."""
    tree = ast.parse((SRC / 'mambo_bringup/launch/flight.launch.py').read_text())
    return [tuple(word.value for word in call.args) for call in ast.walk(tree)
            if isinstance(call, ast.Call) and getattr(call.func, 'attr', '') == 'nodes']


@pytest.mark.parametrize('given', [
    {}, {'bag': 'BAG'}, {'bag': 'BAG', 'composed': 'true'}, {'drones': '3', 'bag': 'BAG'},
    {'drones': '2'}, {'drones': '2', 'bag': 'BAG', 'composed': 'true'},
    {'description': 'false'}], ids=str)
def test_every_process_of_a_flight_is_listed_once_and_installed(given, tmp_path):
    given = {name: value.replace('BAG', str(tmp_path / 'bag')) for name, value in given.items()}
    found = processes(tmp_path / 'files', **given)
    assert len(listed()) == len(set(listed())) == 9
    drones, composed = int(given.get('drones', 1)), 'composed' in given
    cameras = FLIGHT_NODES[:1] if drones == 1 else (HALL_CAPTURE,)
    wanted = [*cameras, *FLIGHT_NODES[1:] * drones] if not composed else []
    wanted += [RECORDER] * drones if 'bag' in given and not composed else []
    wanted += [('mambo_bringup', 'composed_node')] if composed or drones > 1 else [SIMULATOR]
    wanted += [] if 'description' in given else [('mambo_description', 'description_node')]
    assert sorted(one[:2] for one in found) == sorted(wanted)
    for one in found:
        assert one[:2] in listed() and is_installed(*one[:2])
        assert all(file.is_file() for file in parameters(one)[1])


def test_a_flight_without_arguments_is_the_circle_in_real_time_until_stopped():
    assert flown() == scenario(duration=0.0)
    assert flown().sim_node.mode == 'realtime'


@pytest.mark.parametrize('given, expected', [
    ({'vehicle': 'toolbox'}, lambda: scenario(vehicle='toolbox', duration=0.0)),
    ({'scenario': 'fig_5_11', 'seed': '9', 'mode': 'lockstep'}, lambda: override(
        scenario_file.load('fig_5_11')[1], {
            'sim_node.simulator.seed': 9, 'optitrack_node.seed': 9, 'sim_node.mode': 'lockstep'})),
    ({'scenario': 'fig_5_11', 'vehicle': 'toolbox'}, lambda: scenario_file.load('fig_5_11', {
        'vehicle': scenario_file.Place('toolbox', '')})[1])])
def test_a_scenario_and_a_vehicle_are_those_of_the_runner(given, expected):
    assert flown(**given) == expected()


@pytest.mark.parametrize('given, line', [
    ({'scenario': 'fig_5_11', 'params_file': 'a.yaml'},
     'scenario:=fig_5_11 cannot be combined with params_file:=a.yaml: leave one out'),
    ({'vehicle': 'toolbox', 'params_file': 'a.yaml'},
     'params_file:=a.yaml cannot be combined with vehicle:=toolbox'),
    ({'scenario': 'nothing'}, "scenario 'nothing' is unknown"),
    ({'vehicle': 'bee'}, "vehicle 'bee' is unknown"),
    ({'drones': '2', 'namespace': 'mine'}, 'namespace:=mine is for one drone'),
    ({'drones': '99'}, 'drones = 99'), ({'drones': 'two'}, "drones = 'two'"),
    ({'composed': 'true'}, 'composed:=true records always: give bag:=')])
def test_arguments_that_make_no_flight_get_one_line(given, line):
    with pytest.raises(MamboError, match=line) as refusal:
        flight(**given)
    assert '\n' not in str(refusal.value)


def test_a_scenario_with_a_world_of_one_drone_is_refused_with_what_it_lacks(tmp_path):
    path = tmp_path / 'mine.yaml'
    path.write_text('title: mine\nworld: {spacing: 2.0}\n')
    with pytest.raises(MamboError, match='world: has no effect, as one drone flies'):
        flight(scenario=str(path))
    assert len(flight(scenario=str(path), drones='2').scenarios) == 2


def test_what_is_published_otherwise_is_in_a_file_of_each_drone(tmp_path):
    given = {'start_date': '2026-05-01', 'prefixed': 'true', 'hardware_ids': 'true',
             'sensor_frames': 'true'}
    found = processes(tmp_path / 'files', drones='2', **given)
    for one in found[:-3]:
        wire = yaml.safe_load(parameters(one)[1][-1].read_text())
        assert wire == {f'{one.namespace}/*': {'ros__parameters': {'wire': {
            'start_date': '2026-05-01', 'frame_prefix': f'{one.namespace[1:]}/',
            'hardware_id': one.namespace[1:], 'sensor_frames': True}}}}
    for one in found[-2:]:  # the cameras and the simulators of both drones
        assert sum(file.name.startswith('wire') for file in parameters(one)[1]) == 2
    for one in processes(tmp_path / 'plain'):
        assert not [file for file in parameters(one)[1] if file.name.startswith('wire')]


@pytest.mark.parametrize('given, line', [
    ({'start_date': 'soon'}, "start_date = 'soon' is not a date"),
    ({'prefixed': 'true'}, 'prefixed:=true is for several drones')])
def test_what_cannot_be_published_is_refused(given, line):
    with pytest.raises(MamboError, match=line):
        flight(**given)


def test_several_drones_have_namespaces_seeds_and_bags_of_their_own(tmp_path):
    found = processes(tmp_path / 'files', drones='2', seed='5', bag=str(tmp_path / 'two'))
    by_drone = {space: [one for one in found if one.namespace == space]
                for space in ('/mambo1', '/mambo2')}
    for number, (space, own) in enumerate(by_drone.items()):
        recorder, *others = own
        assert parameters(recorder)[0]['bag'] == str(tmp_path / 'two' / space[1:])
        for one in own:
            assert f'__ns:={space}' in one.arguments and '/clock:=clock' in one.arguments
            assert '/tf_static:=tf_static' in one.arguments
        [file] = parameters(others[0])[1]
        assert f'{space}/sim_node:' in file.read_text() and f'seed: {5 + number}' in (
            file.read_text())
    world, = (one for one in found if one.executable == 'composed_node')
    assert found[-1] is world and '--simulators' in world.arguments
    description, = (one for one in found if one.executable == 'description_node')
    given, _ = parameters(description)
    assert given['drones'] == '/mambo1,/mambo2' and given['prefixed'] is True
    assert [len(place.split()) for place in given['places'].split(';')] == [3, 3]


def test_arguments_of_a_flight_are_parameters():
    given = flown(trajectory='z_sine', estimator='ground_truth', mode='realtime', speed='2',
                  duration='30', seed='7')
    assert given == scenario(
        'z_sine', 'ground_truth', duration=30.0, seed=7,
        overrides={'sim_node.mode': 'realtime', 'sim_node.speed': 2.0})
    assert given.reference_node.plan.landing_time == 21.0  # as the runner lands


def test_a_trajectory_is_a_name_or_the_file_of_a_course(tmp_path):
    file = tmp_path / 'course.csv'
    file.write_text(uav_trajectories.to_text(Course(
        np.array([4.0]), np.array([[[0.0, 0.0], [0.0, 0.5], [-1.0, 0.0], [0.0, 0.0]]]))))
    plan = flown(trajectory=str(file)).reference_node.plan
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    assert (plan.trajectory, plan.course) == (
        'course', f'# course.csv, sha256 {digest}\n{file.read_text()}')
    with pytest.raises(schema.ParameterError, match="trajectory 'loop' is unknown: give a file"):
        flight(trajectory='loop')


def test_the_parameter_file_comes_before_the_arguments(tmp_path):
    file, written = tmp_path / 'mine.yaml', override(scenario('z_sine', seed=4, land=False), {
        'sim_node.simulator.vehicle.mass': 0.07})
    file.write_text(to_yaml(written))
    assert flown(params_file=str(file)) == written
    assert flown(params_file=str(file), seed='5', trajectory='hover') == override(
        written, {'sim_node.simulator.seed': 5, 'optitrack_node.seed': 5,
                  'reference_node.plan.trajectory': 'hover'})


def test_a_trajectory_that_commands_do_not_fly_is_refused(tmp_path):
    file = tmp_path / 'commanded.yaml'
    file.write_text('/mambo/reference_node:\n  ros__parameters:\n    commands: {enabled: true}\n')
    assert flown(params_file=str(file)).reference_node.commands.enabled
    with pytest.raises(schema.ParameterError, match='^trajectory:=circle: has no effect'):
        flown(params_file=str(file), trajectory='circle')
    file.write_text('title: up\ncommands: [{time: 1, takeoff: {height: 1.0}}]\n')
    with pytest.raises(schema.ParameterError, match='^trajectory:=circle: has no effect'):
        flown(scenario=str(file), trajectory='circle')


def test_the_simulator_is_last_and_waits_for_every_other_node(tmp_path):
    for given, recorded in (({}, False), ({'bag': str(tmp_path / 'new')}, True)):
        *others, last = processes(tmp_path / 'files', **given)
        assert last[:2] == SIMULATOR
        [file] = parameters(last)[1]
        waited = yaml.safe_load(file.read_text())['/mambo/sim_node']['ros__parameters'][
            'wait_for'].split(',')
        assert sorted(waited) == sorted(
            one.executable for one in others if one.executable != 'description_node')
        assert ('recorder_node' in waited) == recorded


def test_a_bag_is_named_from_where_the_user_is(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('HOME', '/home/student')
    for name, path in (('mine', f'{tmp_path}/mine'), ('~/mine', '/home/student/mine'),
                       ('/bags/a b', '/bags/a b')):
        recorder, *_ = processes(tmp_path / 'files', bag=name)
        given, _ = parameters(recorder)
        assert given == {'bag': path, 'scenario': str(tmp_path / 'files/scenario.yaml')}


def test_choices_are_those_of_the_nodes_and_to_leave_it_open():
    assert choices('mode') == ('', 'realtime', 'lockstep')
    for argument in PARAMETERS:
        assert argument in declared(FILES[0])
        for name in scenario_file.SETS[argument]:
            assert name in dict(schema.walk(Scenario))


@pytest.mark.parametrize('given, last_error', [
    ({'duration': 'long'}, "duration = 'long' must be a number"),
    ({'duration': '-1'}, 'duration = -1'), ({'seed': '1.5'}, 'seed = 1.5'),
    ({'params_file': 'nowhere.yaml'}, 'nowhere.yaml: No such file'),
    ({'speed': '['}, r'speed:=\[: ')])
def test_a_wrong_argument_gets_one_line(given, last_error):
    with pytest.raises(schema.ParameterError, match=last_error) as refusal:
        flight(**given)
    assert '\n' not in str(refusal.value)


def test_what_exists_is_not_recorded_over(bag):
    with pytest.raises(FlightError, match='flown exists: name another bag or remove it'):
        flight(bag=str(bag))
    with pytest.raises(FlightError, match='flown exists'):
        replay_plan(arguments('replay.launch.py', bag=str(bag), output=str(bag)))


def test_paths_that_no_node_can_open_are_refused(tmp_path, bag):
    other = str(tmp_path / 'd\udcfc')
    for refused in (
            lambda: flight(bag=other),
            lambda: replay_plan(arguments('replay.launch.py', bag=other)),
            lambda: replay_plan(arguments('replay.launch.py', bag=str(bag), output=other))):
        with pytest.raises(FlightError, match=r'd\\xfc is not UTF-8, and no node can open it: '):
            refused()


def test_a_replay_uses_the_parameters_of_the_bag(bag):
    plan = replay_plan(arguments('replay.launch.py', bag=str(bag)))
    assert plan.scenario.estimator_node.kalman.optical_flow.constant == 1.1
    (_, estimator, nothing), (_, player, parameters) = plan.nodes
    assert (estimator, player, nothing) == ('estimator_node', 'replay_node', {})
    assert parameters == {'bag': str(bag), 'rate': 1.0, 'source_namespace': '/mambo',
                          'wait_for': 'estimator_node', 'capture': False}


def test_a_replay_uses_other_parameters_where_a_file_is_given(bag, tmp_path):
    file = tmp_path / 'other.yaml'
    file.write_text(to_yaml(scenario(seed=9)))
    plan = replay_plan(arguments('replay.launch.py', bag=str(bag), params_file=str(file)))
    assert plan.scenario == load(file)


def test_a_flight_by_the_true_state_is_replayed_by_the_filter(tmp_path):
    with BagWriter(tmp_path / 'true', attachments={'scenario.yaml': to_yaml(
            scenario(estimator='ground_truth'))}) as writer:
        writer.add_topic('/clock', topics.CLOCK.type_name)
        writer.write('/clock', messages.clock(0), 0)
    plan = replay_plan(arguments('replay.launch.py', bag=str(tmp_path / 'true')))
    assert plan.scenario == scenario()


def test_a_bag_without_parameters_is_replayed_with_the_defaults(tmp_path):
    with BagWriter(tmp_path / 'plain') as writer:
        writer.add_topic('/clock', topics.CLOCK.type_name)
        writer.write('/clock', messages.clock(0), 0)
    plan = replay_plan(arguments('replay.launch.py', bag=str(tmp_path / 'plain'), rate='0',
                                 output=str(tmp_path / 'new')))
    assert plan.scenario is None
    assert plan.nodes[0] == ('mambo_bags', 'recorder_node', {
        'bag': str(tmp_path / 'new'), 'topics': RECORDED, 'whole': False})
    assert plan.nodes[-1][2]['wait_for'] == 'recorder_node,estimator_node'
    assert set(RECORDED.split(',')) <= {topic.name for topic in topics.RECORDED}


def test_a_bag_that_is_none_is_named():
    with pytest.raises(BagError, match='nowhere: no such bag'):
        replay_plan(arguments('replay.launch.py', bag='nowhere'))


def launched(name, **given):
    """Return a launch context and the actions that a launch file comes to."""
    from launch import LaunchContext
    from launch.actions import DeclareLaunchArgument
    from launch.launch_description_sources import get_launch_description_from_python_launch_file
    context, actions = LaunchContext(), []
    context.launch_configurations.update(given)

    def visit(entity):
        if not isinstance(entity, DeclareLaunchArgument):
            actions.append(entity)
        if isinstance(entity, DeclareLaunchArgument) or type(entity).__name__ == 'OpaqueFunction':
            for inner in entity.visit(context) or ():
                visit(inner)
    file = SRC / 'mambo_bringup/launch' / name
    for entity in get_launch_description_from_python_launch_file(str(file)).entities:
        visit(entity)
    return context, actions


def nodes_of(actions):
    return [action for action in actions if hasattr(action, 'node_executable')]


def words(context, node):
    """Return the command line of a node, without the program."""
    from launch.utilities import perform_substitutions
    return [perform_substitutions(context, list(word)) for word in node.cmd[1:]]


@installed
def test_launch_starts_the_nodes_of_the_plan(tmp_path):
    bag = str(tmp_path / 'new bag')
    context, actions = launched('flight.launch.py', seed='7', namespace='/two/', bag=bag,
                                log_level='warn')
    nodes = nodes_of(actions)
    assert [(node.node_package, node.node_executable) for node in nodes] == [
        node for node in listed() if node not in (COMPOSED, HALL_CAPTURE)]
    recorder, *_, simulator, _ = nodes
    given = words(context, recorder)
    assert f'bag:="{bag}"' in given and '__ns:=/two' in given
    assert given[given.index('--log-level') + 1] == 'warn'
    given = words(context, simulator)
    text = Path(given[given.index('--params-file') + 1]).read_text()
    assert from_yaml(text).seed == 7 and '/two/sim_node:' in text


@pytest.mark.parametrize('name', NAMES)
@pytest.mark.parametrize('namespace', ['a b', '1st', 'm-2', 'a//b', 'm\n', '/'])
def test_a_namespace_that_no_drone_can_have_is_refused(name, namespace):
    plan = {'flight.launch.py': launching.flight, 'replay.launch.py': replay_plan}[name]
    with pytest.raises(MamboError, match='^drone ') as refusal:
        plan(arguments(name, namespace=namespace, bag='there'))
    assert '\n' not in str(refusal.value)


def test_a_speed_in_lockstep_is_refused():
    with pytest.raises(FlightError, match='speed:=2 needs mode:=realtime'):
        flight(mode='lockstep', speed='2')


def test_a_name_that_is_almost_an_argument_is_told():
    known = declared(FILES[0])
    assert list(launching.almost(['trajectry', 'use_rviz', 'bag', 'my_robot'], known)) == [
        'trajectry:= is unknown and ignored; did you mean trajectory:= ?']


@installed
@pytest.mark.parametrize(('ends', 'code', 'other'), [
    ('exit 0', 0, 'goes on'), ('exit 3', 1, 'ended'), ('kill -9 $$', 1, 'ended')])
def test_nodes_end_together_and_those_of_another_flight_only_after_a_failure(
        tmp_path, monkeypatch, ends, code, other):
    from launch import LaunchDescription, LaunchService
    from launch.actions import ExecuteProcess
    from mambo_bringup.flight import launch_actions
    monkeypatch.setattr(launch_actions, 'Node', ExecuteProcess)
    flight, beside = launch_actions._Together(), launch_actions._Together()
    log, slow = tmp_path / 'log', "trap 'echo ended >> {0}; exit 0' INT; sleep {1} & wait $!; {2}"
    nodes = [
        flight.node(cmd=['bash', '-c', f'sleep 1; {ends}']),
        flight.node(cmd=['bash', '-c', slow.format(log, 20, 'true')]),
        flight.node(cmd=['bash', '-c', slow.format(log, 20, 'true')], watches=True),
        beside.node(cmd=['bash', '-c', slow.format(log, 2, f'echo goes on >> {log}')])]
    service = LaunchService()
    service.include_launch_description(LaunchDescription(nodes))
    assert service.run() == code
    assert sorted(log.read_text().split('\n')) == sorted(['', 'ended', 'ended', other])


@installed
def test_launch_clears_up():
    from launch.events import Shutdown
    context, actions = launched('flight.launch.py')
    nodes = nodes_of(actions)
    [handler] = [action.event_handler for action in actions if hasattr(action, 'event_handler')]
    given = words(context, nodes[0])
    file = Path(given[given.index('--params-file') + 1])
    assert file.is_file()
    handler.handle(Shutdown(), context)
    assert not file.parent.exists()


@installed
def test_launch_flies_several_drones_by_one_argument():
    _, actions = launched('flight.launch.py', drones='3', description='false')
    names = [node.node_executable for node in nodes_of(actions)]
    assert {name: names.count(name) for name in names} == {
        'estimator_node': 3, 'reference_node': 3, 'controller_node': 3, 'hall_capture_node': 1,
        'composed_node': 1}


@installed
def test_launch_replays_a_bag(bag):
    context, actions = launched('replay.launch.py', bag=str(bag))
    assert [node.node_executable for node in nodes_of(actions)] == [
        'estimator_node', 'replay_node']
    from launch_ros.utilities import evaluate_parameters
    _, own = evaluate_parameters(context, nodes_of(actions)[1]._Node__parameters)
    assert own == {'bag': str(bag), 'rate': 1.0, 'source_namespace': '/mambo',
                   'wait_for': 'estimator_node', 'capture': False}


@installed
def test_launch_refuses_what_is_no_choice():
    with pytest.raises(RuntimeError, match='sometimes'):
        launched('flight.launch.py', mode='sometimes')
