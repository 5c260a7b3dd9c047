"""The command line of ``./run``: the flight and bag that it selects, and its last lines."""

import re
import signal
from types import SimpleNamespace

from mambo_bags.reader import Bag
from mambo_bringup import run as command
from mambo_bringup.flight import outcome as outcomes
from mambo_bringup.flight.outcome import Outcome
from mambo_bringup.processes import FlightError
from mambo_control.controllers import REGISTRY as CONTROLLERS
from mambo_estimation.filters import REGISTRY as ESTIMATORS
from mambo_flight import scenario_file
from mambo_flight.scenario import landing_time, override, scenario
from mambo_model import schema
from mambo_model.motion.trajectory import TRAJECTORIES
from mambo_model.vehicle.parameters import preset, PRESETS
import pytest


def run(*arguments):
    """Return the scenario and bag that a command line would fly, or SystemExit."""
    return started(*arguments)[:2]


def started(*arguments):
    """Return scenario, bag and whether the nodes share a process, or SystemExit."""
    seen = []

    def fly(flights, bags, composed, *_):
        first = next(iter(flights))
        seen.append((flights[first], bags[first], composed))
        raise FlightError('far enough')
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(command, 'fly_several', fly)
        patch.setattr(command.natnet, 'check_ports', lambda _: None)  # others may fly here
        code = command.main(list(arguments))
    if not seen:
        raise SystemExit(code)
    assert code == 1
    return seen[0]


def test_without_arguments_the_circle_is_flown_in_lockstep():
    flown, bag = run()
    assert flown == scenario(
        controller='flatness_drag', overrides={'sim_node.mode': 'lockstep'})
    assert flown.reference_node.plan.trajectory == 'circle'
    assert flown.sim_node.duration == 40.0 and flown.seed == 1
    assert bag.is_absolute() and bag.parent.name == 'bags'


def test_arguments_choose_trajectory_estimator_seed_vehicle_and_pace():
    flown, _ = run('--trajectory', 'z_sine', '--estimator', 'ground_truth', '--seed', '7',
                   '--duration', '30', '--vehicle', 'toolbox', '--believed', 'frictionless',
                   '--mode', 'realtime', '--speed', '2', '--no-noise')
    assert flown.reference_node.plan.trajectory == 'z_sine'
    assert flown.reference_node.plan.landing_time == landing_time(30.0) == 21.0
    assert flown.estimator_node.estimator == 'ground_truth'
    assert flown.seed == flown.optitrack_node.seed == 7
    assert flown.sim_node.simulator.vehicle == preset('toolbox')
    assert flown.controller_node.vehicle == flown.reference_node.vehicle == preset('frictionless')
    assert (flown.sim_node.mode, flown.sim_node.speed) == ('realtime', 2.0)
    assert not flown.sim_node.simulator.noise


def test_natnet_needs_real_time_and_processes(capsys):
    flown, _ = run('--scenario', 'motion_capture', '--natnet')
    assert flown.sim_node.mode == 'realtime' and flown.estimator_node.aided
    assert not flown.estimator_node.waits_for_capture
    for words in (['--composed'], ['--without', 'optitrack']):
        with pytest.raises(SystemExit, match='2'):
            run('--natnet', *words)
        assert ('run: --natnet serves drones with their nodes as processes: leave out '
                f'{" ".join(words)}\n') in capsys.readouterr().err
    with pytest.raises(SystemExit, match='2'):
        run('--natnet', '--mode', 'lockstep')
    assert 'run: --natnet needs --mode realtime, its default' in capsys.readouterr().err


@pytest.mark.parametrize('arguments, composed', [
    ([], True), (['--drones', '2'], True), (['--composed'], True), (['--processes'], False),
    (['--mode', 'realtime'], False), (['--mode', 'realtime', '--composed'], True),
    (['--without', 'controller'], False), (['--scenario', 'motion_capture', '--natnet'], False)])
def test_nodes_share_a_process_in_lockstep_or_as_asked(arguments, composed):
    assert started(*arguments)[2] is composed


def test_composed_and_processes_exclude_each_other(capsys):
    with pytest.raises(SystemExit, match='2'):
        run('--composed', '--processes')
    assert capsys.readouterr().err == 'run: --composed and --processes exclude each other\n'


def test_no_landing_is_no_landing():
    assert run('--no-landing')[0].reference_node.plan.landing_time == 0.0
    assert run()[0].reference_node.plan.landing_time == 31.0


def test_a_scenario_is_flown_by_its_name_and_other_arguments_replace_its_choices():
    flown, bag = run('--scenario', 'fig_6_1/simulation', '--seed', '4', '--mode', 'realtime')
    name, wanted = scenario_file.load('fig_6_1/simulation', {
        'seed': scenario_file.Place(4, '--seed')})
    assert flown == override(wanted, {'sim_node.mode': 'realtime'})
    assert flown.sim_node.simulator.vehicle == preset('frictionless') and flown.seed == 4
    assert bag.name == f'{name}_seed4' == 'fig_6_1_simulation_seed4'


def test_scenarios_are_listed_with_their_flights(capsys):
    assert command.main(['--list-scenarios']) == 0
    text = capsys.readouterr().out
    for name in scenario_file.names():
        assert f'\n{name} ' in f'\n{text}'
    assert 'fig_6_1/simulation' in text and 'rises and falls' in text


def test_nodes_that_may_not_find_each_other_are_refused(monkeypatch, tmp_path, capsys):
    monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', 'OFF')
    assert command.main(['--processes', '-o', str(tmp_path / 'bag')]) == 2
    assert 'ROS_AUTOMATIC_DISCOVERY_RANGE=OFF keeps nodes' in capsys.readouterr().err


@pytest.mark.parametrize(('name', 'value', 'line', 'code'), [
    ('FASTRTPS_DEFAULT_PROFILES_FILE', 'missing.xml', 'missing.xml cannot be read', 1),
    ('ROS_DOMAIN_ID', 'one', "ROS_DOMAIN_ID = 'one' is not a whole number", 2)])
def test_an_environment_without_a_graph_is_refused_before_anything_is_compiled(
        monkeypatch, tmp_path, capsys, name, value, line, code):
    def load(modules):
        """Import and compile nothing."""
        raise AssertionError('the nodes were loaded')
    monkeypatch.setattr(command, 'load', load)
    monkeypatch.setenv(name, value)
    assert command.main(['--output', str(tmp_path / 'bag')]) == code
    assert line in capsys.readouterr().err
    assert not (tmp_path / 'bag').exists()


def test_a_printed_scenario_can_be_flown(capsys, tmp_path):
    assert command.main(['--print-scenario', '-o', str(tmp_path / 'bag')]) == 2
    assert 'leave out -o/--output' in capsys.readouterr().err
    assert command.main(['--scenario', 'fig_5_11', '--seed', '8', '--print-scenario']) == 0
    file = tmp_path / 'printed.yaml'
    file.write_text(capsys.readouterr().out)
    assert run('--scenario', str(file))[0] == run('--scenario', 'fig_5_11', '--seed', '8')[0]


@pytest.mark.parametrize('assignment, value', [
    ('sim_node.simulator.vehicle.mass=0.07', 0.07), ('sim_node.simulator.vehicle.mass=1', 1.0),
    ('sim_node.simulator.vehicle.inertia=[1.0e-4, 1.0e-4, 2.0e-4]', (1e-4, 1e-4, 2e-4)),
    ('sim_node.simulator.vehicle.inertia=[1e-4, 1e-4, 2e-4]', (1e-4, 1e-4, 2e-4)),
    ('sim_node.simulator.barometer.noise=1e-3', 0.001),
    ('sim_node.simulator.noise=false', False), ('sim_node.simulator.seed=12', 12),
    ('estimator_node.sensor_reliability=best_effort', 'best_effort'),
    ('reference_node.plan.landing_time=20', 20.0), ('sim_node.patience = 3', 3.0)])
def test_set_takes_any_parameter(assignment, value):
    name = assignment.partition('=')[0].strip()
    assert schema.flatten(run('--set', assignment)[0])[name] == value


@pytest.mark.parametrize(('options', 'synchronise'), [
    (['--scenario', 'motion_capture', '--without', 'optitrack'], 'arrival'),
    (['--scenario', 'motion_capture'], 'watermark'), (['--without', 'optitrack'], 'watermark')])
def test_poses_of_a_hall_of_ones_own_are_not_waited_for(options, synchronise):
    """It publishes no ticks, which would say whether a pose is to come."""
    assert run(*options)[0].estimator_node.synchronise == synchronise


def test_set_can_be_repeated_and_comes_last():
    flown, _ = run('--seed', '3', '--set', 'optitrack_node.seed=4', '--mode', 'realtime',
                   '--set', 'sim_node.speed=5')
    assert (flown.seed, flown.optitrack_node.seed, flown.sim_node.speed) == (3, 4, 5.0)


def test_the_speed_of_a_scenario_is_flown_in_real_time(tmp_path):
    file = tmp_path / 'own.yaml'
    file.write_text('/**/sim_node:\n  ros__parameters: {speed: 2.0, duration: 9.0}\n')
    for options, speed in ((['--mode', 'realtime'], 2.0), (['--natnet'], 2.0), ([], 1.0),
                           (['--mode', 'realtime', '--speed', '3'], 3.0)):
        flown, _ = run('--scenario', str(file), *options)
        assert flown.sim_node.speed == speed, options


@pytest.mark.parametrize('arguments, last_error', [
    (['--set', 'nonsense'], 'node.parameter=value'),
    (['--set', 'sim_node.simulator.vehicle.mass'], 'node.parameter=value'),
    (['--set', 'sim_node.simulator.vehicle.mass=[0.1'], '--set sim_node.simulator.vehicle.mass'),
    (['--set', 'sim_node.simulator.vehicle.mass=heavy'], "mass = 'heavy' must be a number"),
    (['--set', 'sim_node.simulator.vehicle.mass='], 'mass = None must be a number'),
    (['--set', 'sim_node.simulator.vehicle.mas=1'], 'did you mean'),
    (['--set', 'natnet_server_node.data_port=1'],
     'unknown parameter; known: controller_node.*, estimator_node.*, optitrack_node.*'),
    (['--set', 'sim_node.simulator.noise=0'], 'must be true or false'),
    (['--set', 'sim_node.simulator.seed=1.5'], 'must be a whole number'),
    (['--speed', '2'], '--speed 2 needs --mode realtime'),
    (['--set', 'sim_node.speed=2'], '--set sim_node.speed 2 needs --mode realtime'),
    (['--print-scenario', '--drones', '2', '--set', 'world.spacing=inf'],
     "world.spacing = 'inf' must be a number"),
    (['--print-scenario', '--set', 'world.spacing=3'], 'needs several drones: give --drones'),
    (['--duration', '0'], 'duration'), (['--duration', 'nan'], 'duration'),
    (['--seed', '-1'], '--seed: -1 must be within 0'),
    (['--vehicle', 'eagle'], "--vehicle: vehicle 'eagle' is un"),
    (['--believed', 'eagle'], 'known: crazyflie'), (['--vehicle', 'no.yaml'], 'No such file'),
    (['--scenario', 'fig_1_1'], 'one of fig_3_3'), (['--scenario', 'no.yaml'], 'No such file'),
    (['--scenario', 'fig_6_1/third'], 'experiment_old_map'),
    (['--commanded', '--stretch', '2'], '--stretch: has no effect, as the flight is made by'),
    (['--commanded', '--no-landing'], '--no-landing: has no effect'),
    (['--mode', 'realtime', '--set', 'sim_node.mode=lockstep'], 'contradicts --mode realtime'),
    (['--mode', 'realtime', '--speed', '2', '--set', 'sim_node.speed=3'], '--speed 2:'),
    (['--paused', '--set', 'sim_node.paused=false'], 'contradicts --paused'),
    (['--commanded', '--set', 'reference_node.commands.enabled=false'],
     'contradicts --commanded')])
def test_a_wrong_value_gets_one_line_and_exit_code_2(capsys, arguments, last_error):
    with pytest.raises(SystemExit) as end:
        run(*arguments)
    out, err = capsys.readouterr()
    assert end.value.code == 2 and out == ''
    assert err.startswith('run: ') and last_error in err and len(err.splitlines()) == 1


@pytest.mark.parametrize('arguments', [
    ['--trajectory', 'loop'], ['--estimator', 'guess'], ['--controller', 'pid'],
    ['--mode', 'slow'], ['--duration', 'long'],
    ['--seed', '1.5'], ['--speed', 'fast'], ['--unknown'], ['bag']])
def test_a_wrong_argument_is_usage_and_exit_code_2(capsys, arguments):
    with pytest.raises(SystemExit) as end:
        run(*arguments)
    (line,) = capsys.readouterr().err.splitlines()
    assert end.value.code == 2
    assert line.startswith('run: ') and arguments[-1] in line


def test_help_names_every_choice(capsys):
    with pytest.raises(SystemExit) as end:
        command.main(['--help'])
    text = ' '.join(capsys.readouterr().out.split())
    assert end.value.code == 0
    words = re.split(r'[\s{},;]+', text)
    for name in (*TRAJECTORIES, *PRESETS, *ESTIMATORS.names, *CONTROLLERS.names, 'lockstep',
                 'realtime'):
        assert name in words, name


def test_a_bag_gets_a_name_that_is_free(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run()[1] == tmp_path / 'bags/circle_joint_seed1'
    (tmp_path / 'bags/circle_joint_seed1').mkdir(parents=True)
    assert run()[1] == tmp_path / 'bags/circle_joint_seed1_2'
    (tmp_path / 'bags/circle_joint_seed1_2').mkdir()
    assert run()[1] == tmp_path / 'bags/circle_joint_seed1_3'
    (tmp_path / 'bags/circle_joint_seed1_3').symlink_to('gone')
    assert run()[1] == tmp_path / 'bags/circle_joint_seed1_4'
    assert run('--output', 'mine')[1] == tmp_path / 'mine'


def test_a_bag_that_no_node_can_open_is_refused_before_anything_is_loaded(
        tmp_path, monkeypatch, capsys):
    course = tmp_path / 'fl\udcfcg.csv'
    course.write_text('t, x, y, height\n0, 0, 0, 1\n8, 1, 0, 1\n')
    folder = tmp_path / 'd\udcfc'
    folder.mkdir()
    with pytest.raises(SystemExit, match='2'):
        run('--output', f'{folder}/bag')
    monkeypatch.chdir(folder)
    with pytest.raises(SystemExit, match='2'):
        run()
    hint = 'is not UTF-8, and no node can open it: give another --output, or rename the folder'
    assert capsys.readouterr().err == (
        f'run: {tmp_path}/d\\xfc/bag {hint}\n'
        f'run: {tmp_path}/d\\xfc/bags/circle_joint_seed1 {hint}\n')
    monkeypatch.chdir(tmp_path)
    assert run('--trajectory', str(course))[1] == tmp_path / r'bags/fl\xfcg_joint_seed1'


def test_a_link_that_leads_nowhere_is_no_bag_to_create(tmp_path, capsys):
    (tmp_path / 'bag').symlink_to('gone')
    with pytest.raises(SystemExit, match='2'):
        run('--output', str(tmp_path / 'bag'))
    assert capsys.readouterr().err == (
        f'run: {tmp_path / "bag"} exists: give another --output or remove it\n')


@pytest.mark.parametrize('number, flown, whole, reports', [
    (signal.SIGINT, 4.0, False, 1), (signal.SIGINT, 4.0, True, 0), (signal.SIGINT, 0.0, False, 0),
    (signal.SIGTERM, 4.0, False, 0)])
def test_ctrl_c_after_all_was_flown_or_before_ends_without_a_report(
        tmp_path, monkeypatch, number, flown, whole, reports):
    asked = []
    monkeypatch.setattr(
        command, 'report', lambda *arguments: asked.append(arguments) or (tmp_path, []))
    outcome = Outcome(tmp_path, flown, 1.0, 0, '', number, {}, {}, True, whole=whole)
    assert command._print_outcome(outcome, tmp_path, no_report=False) == []
    assert len(asked) == reports


@pytest.mark.parametrize(('drones', 'raises', 'line'), [
    (1, False, 'low; far'), (1, True, 'node died; low; far'),
    (2, True, 'node died; /mambo1: low; /mambo1: far; /mambo2: low; /mambo2: far')])
def test_the_last_line_names_every_reason_once(
        tmp_path, monkeypatch, capsys, drones, raises, line):
    fault = 'node died' if raises else ''

    def fly(flights, bags, *_):
        ended = [Outcome(tmp_path, 4.0, 1.0, 0, '', None, {}, {}, True, fault) for _ in flights]
        if raises:
            raise outcomes.FlightEndedError(ended)
        return ended
    monkeypatch.setattr(command, 'fly_several', fly)
    monkeypatch.setattr(command, '_print_outcome', lambda outcome, *_: [
        *([outcome.fault] if outcome.fault else []), 'low', 'far'])
    monkeypatch.setattr(command, '_print_separation', lambda *_: [])
    assert command.main(['--drones', str(drones), '-o', str(tmp_path / 'bag')]) == 1
    assert capsys.readouterr().err == f'run: {line}\n'


def test_a_bag_that_is_not_closed_is_a_failure_even_if_no_node_complained(tmp_path):
    outcome = Outcome(tmp_path, 0.0, 0.0, 0, '', None, {}, {}, False)
    assert command._print_outcome(outcome, tmp_path, no_report=True) == [
        f'{tmp_path} is not closed']


def test_without_a_report_the_note_of_a_flight_that_is_over_in_the_air_is_printed(
        tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(command, 'read_bag', lambda path, _: Bag(path))
    monkeypatch.setattr(command, 'ended_early', lambda *_: [])
    monkeypatch.setattr(command, 'ended_in_the_air', lambda bag: [f'over: {bag.path.name}'])
    monkeypatch.setattr(command, 'landed_by_itself', lambda bag: ['alone'])
    outcome = Outcome(tmp_path, 18.0, 1.0, 0, '', None, {}, {}, True, whole=True)
    assert command._print_outcome(outcome, tmp_path, no_report=True) == []
    assert capsys.readouterr().out.endswith(f'\nnote: alone\nnote: over: {tmp_path.name}\n')


def test_commands_of_the_scenario_that_were_refused_are_a_reason_and_a_failure(
        tmp_path, monkeypatch, capsys):
    line = '2 commands of the scenario refused in flight, first go_to at t = 15 s: on the floor'
    node = SimpleNamespace(lines=[
        '[WARN] [1.0] [mambo.reference_node]: t = 15.000 s: go_to refused: on the floor',
        f'[WARN] [2.0] [mambo.reference_node]: {line}', '[INFO] [2.0]: used 1.0 s of CPU'])
    assert outcomes.dropped([SimpleNamespace(lines=[]), node]) == [line]
    assert outcomes.dropped([SimpleNamespace(lines=node.lines[:1])]) == []
    monkeypatch.setattr(command, 'read_bag', lambda path, _: Bag(path))
    monkeypatch.setattr(command, 'ended_early', lambda *_: [])
    outcome = Outcome(tmp_path, 18.0, 1.0, 0, '', None, {}, {}, True, whole=True, dropped=[line])
    assert command._print_outcome(outcome, tmp_path, no_report=True) == [line]
    assert line in capsys.readouterr().out
