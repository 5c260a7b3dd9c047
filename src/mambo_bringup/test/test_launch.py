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
from mambo_bringup.launching import choices, flight_plan, MEANING, replay_plan
from mambo_bringup.processes import FlightError
from mambo_bringup.replay import RECORDED
from mambo_flight.scenario import from_yaml, load, override, Scenario, scenario, to_yaml
from mambo_model import schema
from mambo_model.motion import uav_trajectories
from mambo_model.motion.polynomial import Course
from mambo_ros import messages, topics
from mambo_sim.parameters import SimNodeParams
import numpy as np
import pytest

SRC = Path(__file__).parents[2]
FILES = sorted((SRC / 'mambo_bringup/launch').iterdir())
PARAMETERS = {'sim_node': SimNodeParams, 'recorder_node': RecorderNodeParams,
              'replay_node': ReplayNodeParams}
PLANS = {'flight.launch.py': flight_plan, 'replay.launch.py': replay_plan}
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
    return flight_plan(arguments('flight.launch.py', **given))


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
    assert [file.name for file in FILES] == list(PLANS)
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


@pytest.mark.parametrize('name', PLANS)
def test_every_node_is_installed_by_its_package_and_has_the_parameters(name, bag, tmp_path):
    given = {'bag': str(bag), 'output': str(tmp_path / 'new')} if name.startswith('replay') else {
        'bag': str(tmp_path / 'new')}
    plan = PLANS[name](arguments(name, **given))
    for package, executable, parameters in plan.nodes:
        assert f"'{executable} = {package}.{executable}:main'" in (
            SRC / package / 'setup.py').read_text()
        if executable in PARAMETERS:
            schema.build(PARAMETERS[executable], parameters)
        else:
            assert not parameters


def test_a_flight_without_arguments_is_the_circle_in_real_time_until_stopped():
    plan = flight()
    assert plan.scenario == scenario(duration=0.0)
    assert plan.scenario.sim_node.mode == 'realtime'
    assert [executable for _, executable, _ in plan.nodes] == [
        'optitrack_node', 'estimator_node', 'reference_node', 'controller_node', 'sim_node']


def test_arguments_of_a_flight_are_parameters():
    plan = flight(trajectory='z_sine', estimator='ground_truth', mode='lockstep', speed='2',
                  duration='30', seed='7')
    assert plan.scenario == scenario(
        'z_sine', 'ground_truth', duration=30.0, seed=7,
        overrides={'sim_node.mode': 'lockstep', 'sim_node.speed': 2.0})
    assert plan.scenario.reference_node.plan.landing_time == 21.0  # as the runner lands


def test_a_trajectory_is_a_name_or_the_file_of_a_course(tmp_path):
    file = tmp_path / 'course.csv'
    file.write_text(uav_trajectories.to_text(Course(
        np.array([4.0]), np.array([[[0.0, 0.0], [0.0, 0.5], [-1.0, 0.0], [0.0, 0.0]]]))))
    plan = flight(trajectory=str(file)).scenario.reference_node.plan
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    assert (plan.trajectory, plan.course) == (
        'course', f'# course.csv, sha256 {digest}\n{file.read_text()}')
    with pytest.raises(schema.ParameterError, match="trajectory 'loop' is unknown: give a file"):
        flight(trajectory='loop')


def test_the_parameter_file_comes_before_the_arguments(tmp_path):
    file, written = tmp_path / 'mine.yaml', override(scenario('z_sine', seed=4, land=False), {
        'sim_node.simulator.vehicle.mass': 0.07})
    file.write_text(to_yaml(written))
    assert flight(params_file=str(file)).scenario == written
    assert flight(params_file=str(file), seed='5', trajectory='hover').scenario == override(
        written, {'sim_node.simulator.seed': 5, 'optitrack_node.seed': 5,
                  'reference_node.plan.trajectory': 'hover'})


def test_the_simulator_is_last_and_waits_for_every_other_node(tmp_path):
    for given, recorded in (({}, False), ({'bag': str(tmp_path / 'new')}, True)):
        *others, (package, executable, parameters) = flight(**given).nodes
        assert (package, executable) == ('mambo_sim', 'sim_node')
        assert parameters['wait_for'].split(',') == [name for _, name, _ in others]
        assert ('recorder_node' in parameters['wait_for']) == recorded


def test_a_bag_is_named_from_where_the_user_is(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv('HOME', '/home/student')
    for name, path in (('mine', f'{tmp_path}/mine'), ('~/mine', '/home/student/mine'),
                       ('/bags/a b', '/bags/a b')):
        (_, _, recorder), *_ = flight(bag=name).nodes
        assert recorder == {'bag': path}


def test_choices_are_those_of_the_nodes_and_to_leave_it_open():
    assert choices('mode') == ('', 'realtime', 'lockstep')
    for argument, names in MEANING.items():
        assert argument in declared(FILES[0])
        for name in names:
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
    assert plan.scenario == scenario(estimator='kalman')


def test_a_bag_without_parameters_is_replayed_with_the_defaults(tmp_path):
    with BagWriter(tmp_path / 'plain') as writer:
        writer.add_topic('/clock', topics.CLOCK.type_name)
        writer.write('/clock', messages.clock(0), 0)
    plan = replay_plan(arguments('replay.launch.py', bag=str(tmp_path / 'plain'), rate='0',
                                 output=str(tmp_path / 'new')))
    assert plan.scenario is None
    assert plan.nodes[0] == (
        'mambo_bags', 'recorder_node', {'bag': str(tmp_path / 'new'), 'topics': RECORDED})
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


@installed
def test_launch_starts_the_nodes_of_the_plan(tmp_path):
    context, actions = launched('flight.launch.py', seed='7', namespace='/two/',
                                bag=str(tmp_path / 'new bag'))
    nodes = nodes_of(actions)
    assert [(node.node_package, node.node_executable) for node in nodes] == [
        node[:2] for node in flight(bag=str(tmp_path / 'new bag')).nodes]
    from launch_ros.utilities import evaluate_parameters
    recorder, *_, simulator = nodes
    file, own = evaluate_parameters(context, recorder._Node__parameters)
    assert own == {'bag': str(tmp_path / 'new bag'), 'scenario': str(file)}
    text = Path(file).read_text()
    assert from_yaml(text) == scenario(duration=0.0, seed=7)
    assert text.startswith('/two/sim_node:\n')
    _, own = evaluate_parameters(context, simulator._Node__parameters)
    assert own['wait_for'].split(',') == [node.node_executable for node in nodes[:-1]]


@installed
def test_launch_ends_when_a_node_does_and_clears_up():
    from launch.events import Shutdown
    context, actions = launched('flight.launch.py')
    for node in nodes_of(actions):
        assert 'Shutdown' in repr(node._ExecuteLocal__on_exit)
    (handler,) = [action.event_handler for action in actions if hasattr(action, 'event_handler')]
    from launch_ros.utilities import evaluate_parameters
    (file,) = evaluate_parameters(context, nodes_of(actions)[0]._Node__parameters)
    assert Path(file).is_file()
    handler.handle(Shutdown(), context)
    assert not Path(file).parent.exists()


@installed
def test_launch_replays_a_bag(bag):
    context, actions = launched('replay.launch.py', bag=str(bag))
    assert [node.node_executable for node in nodes_of(actions)] == [
        'estimator_node', 'replay_node']
    from launch_ros.utilities import evaluate_parameters
    _, own = evaluate_parameters(context, nodes_of(actions)[1]._Node__parameters)
    assert own == {'bag': str(bag), 'rate': 1.0, 'source_namespace': '/mambo',
                   'wait_for': 'estimator_node'}


@installed
def test_launch_refuses_what_is_no_choice():
    with pytest.raises(RuntimeError, match='loop'):
        launched('flight.launch.py', trajectory='loop')
