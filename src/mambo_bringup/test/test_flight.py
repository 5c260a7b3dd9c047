"""The flight runner: its command line, the file it hands to the nodes, what it makes of them."""

import dataclasses
from pathlib import Path
import re
import signal
import subprocess
import sys
import time

from mambo_bags.reader import BagError
from mambo_bags.writer import BagWriter
from mambo_bringup import flight, processes, replay
from mambo_bringup.processes import FlightError
from mambo_control.controllers import REGISTRY as CONTROLLERS
from mambo_estimation.filters import REGISTRY as ESTIMATORS
from mambo_flight import scenario_file
from mambo_flight.scenario import (
    commented_yaml, from_yaml, landing_time, override, Scenario, scenario, to_yaml)
from mambo_model import schema
from mambo_model.motion.trajectory import TRAJECTORIES
from mambo_model.vehicle.parameters import preset, PRESETS
from mambo_ros.node import MamboNode
import pytest
import rclpy
from rclpy.signals import SignalHandlerOptions
import yaml

PATIENCE = 30.0  # s


def run(*arguments):
    """Return the scenario and bag that a command line would fly, or SystemExit."""
    seen = []

    def fly(flights, bags, composed, without):
        seen.append((flights['/mambo'], bags['/mambo']))
        raise FlightError('far enough')
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(flight, 'fly_several', fly)
        code = flight.main(list(arguments))
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
    assert flight.main(['--list-scenarios']) == 0
    text = capsys.readouterr().out
    for name in scenario_file.names():
        assert f'\n{name} ' in f'\n{text}'
    assert 'fig_6_1/simulation' in text and 'rises and falls' in text


def test_a_printed_scenario_can_be_flown(capsys, tmp_path):
    assert flight.main(['--scenario', 'fig_5_11', '--seed', '8', '--print-scenario']) == 0
    file = tmp_path / 'printed.yaml'
    file.write_text(capsys.readouterr().out)
    assert run('--scenario', str(file))[0] == run('--scenario', 'fig_5_11', '--seed', '8')[0]


@pytest.mark.parametrize('assignment, value', [
    ('sim_node.simulator.vehicle.mass=0.07', 0.07), ('sim_node.simulator.vehicle.mass=1', 1.0),
    ('sim_node.simulator.vehicle.inertia=[1.0e-4, 1.0e-4, 2.0e-4]', (1e-4, 1e-4, 2e-4)),
    ('sim_node.simulator.vehicle.inertia=[1e-4, 1e-4, 2e-4]', (1e-4, 1e-4, 2e-4)),
    ('sim_node.simulator.barometer.noise=1e-3', 0.001),
    ('sim_node.simulator.noise=false', False), ('sim_node.simulator.seed=12', 12),
    ('controller_node.cascaded.derivatives=no_rates', 'no_rates'),
    ('reference_node.plan.landing_time=20', 20.0), ('sim_node.speed = 3', 3.0)])
def test_set_takes_any_parameter(assignment, value):
    name = assignment.partition('=')[0].strip()
    assert schema.flatten(run('--set', assignment)[0])[name] == value


def test_set_can_be_repeated_and_comes_last():
    flown, _ = run('--seed', '3', '--set', 'optitrack_node.seed=4', '--set', 'sim_node.speed=5')
    assert (flown.seed, flown.optitrack_node.seed, flown.sim_node.speed) == (3, 4, 5.0)


@pytest.mark.parametrize('arguments, last_error', [
    (['--set', 'nonsense'], 'node.parameter=value'),
    (['--set', 'sim_node.simulator.vehicle.mass'], 'node.parameter=value'),
    (['--set', 'sim_node.simulator.vehicle.mass=[0.1'], '--set sim_node.simulator.vehicle.mass'),
    (['--set', 'sim_node.simulator.vehicle.mass=heavy'], "mass = 'heavy' must be a number"),
    (['--set', 'sim_node.simulator.vehicle.mass='], 'mass = None must be a number'),
    (['--set', 'sim_node.simulator.vehicle.mas=1'], 'did you mean'),
    (['--set', 'sim_node.simulator.noise=0'], 'must be true or false'),
    (['--set', 'sim_node.simulator.seed=1.5'], 'must be a whole number'),
    (['--speed', '2'], '--speed 2 needs --mode realtime'),
    (['--duration', '0'], 'duration'), (['--duration', 'nan'], 'duration'),
    (['--seed', '-1'], 'seed = -1'), (['--vehicle', 'eagle'], "--vehicle: vehicle 'eagle' is un"),
    (['--believed', 'eagle'], 'known: crazyflie'), (['--vehicle', 'no.yaml'], 'No such file'),
    (['--scenario', 'fig_1_1'], 'one of fig_3_3'), (['--scenario', 'no.yaml'], 'No such file'),
    (['--scenario', 'fig_6_1/third'], 'experiment_old_map')])
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
        flight.main(['--help'])
    text = ' '.join(capsys.readouterr().out.split())
    assert end.value.code == 0
    words = re.split(r'[\s{},;]+', text)
    for name in (*TRAJECTORIES, *PRESETS, *ESTIMATORS.names, *CONTROLLERS.names, 'lockstep',
                 'realtime'):
        assert name in words, name


def test_the_runner_starts_what_the_scenario_has_parameters_for():
    names = {name for _, name in (*flight.FLIGHT_NODES, flight.SIMULATOR)}
    assert names == {field.name for field in dataclasses.fields(Scenario)}


@pytest.mark.parametrize('write', [to_yaml, commented_yaml])
def test_every_node_reads_from_the_file_what_was_written(tmp_path, write):
    flown = override(scenario(), {
        'sim_node.wait_for': 'one,two', 'sim_node.simulator.vehicle.power_a': 1 / 3e4,
        'sim_node.simulator.vehicle.inertia': (1e-6, 1 / 3e3, 2e-5), 'sim_node.speed': 2,
        'estimator_node.map_to_odom': False})
    file = tmp_path / 'scenario.yaml'
    file.write_text(write(flown))
    rclpy.init(args=['--ros-args', '--params-file', str(file)],
               signal_handler_options=SignalHandlerOptions.NO)
    try:
        for field in dataclasses.fields(Scenario):
            node = MamboNode(field.name, field.metadata['group'])
            assert node.params == getattr(flown, field.name), field.name
            node.destroy_node()
    finally:
        rclpy.try_shutdown()


NODES = [name for _, name in (*flight.FLIGHT_NODES, flight.RECORDER, flight.SIMULATOR)]
STAND_IN = """#!/usr/bin/env python3
import pathlib, shutil, signal, sys, time
signal.signal(signal.SIGINT, lambda *_: sys.exit(0))
here = pathlib.Path(__file__)
shutil.copy(here, here.parent / f'{here.name}.up')
while len(list(here.parent.glob('*.up'))) < NODES:
    time.sleep(0.01)
""".replace('NODES', str(len(NODES)))
QUIET = """
shutil.copy(here, here.parent / f'{here.name}.quiet')
while True:
    time.sleep(0.01)
"""
FLEW = """
while len(list(here.parent.glob('*.quiet'))) < OTHERS:
    time.sleep(0.01)
print('[INFO] [1.0] [mambo.sim_node]: flew 3.000 s in 1.500 s of wall time, '
      '2 steps without their motor command')
print('[INFO] [1.0] [mambo.sim_node]: IMU sample to motor command: p50 1.00 ms')
""".replace('OTHERS', str(len(NODES) - 1))
COPY = "shutil.copy(sys.argv[-1], f'{here}.yaml')\n"


@pytest.fixture
def graph(tmp_path, monkeypatch):
    """Return what replaces installed nodes by other programs; they begin when all are up."""
    monkeypatch.setattr(processes, 'executable', lambda package, name: tmp_path / name)
    monkeypatch.delenv('ROS_DOMAIN_ID', raising=False)

    def replace(**programs):
        for name in NODES:
            (tmp_path / name).write_text(STAND_IN + programs.get(name, QUIET))
            (tmp_path / name).chmod(0o755)
    return replace


def short():
    return scenario(duration=3.0, overrides={'sim_node.mode': 'lockstep'})


def test_what_the_simulator_says_is_the_outcome(graph, tmp_path):
    graph(sim_node=FLEW)
    outcome = flight.fly(short(), tmp_path / 'bag')
    assert (outcome.bag, outcome.flown, outcome.took) == (tmp_path / 'bag', 3.0, 1.5)
    assert outcome.real_time_factor == 2.0 and not outcome.stopped
    assert outcome.missed == 2
    assert outcome.delay == 'IMU sample to motor command: p50 1.00 ms'


def test_what_nodes_used_is_told_in_cores_the_greediest_first(graph, tmp_path):
    graph(sim_node=FLEW + "print('used 0.60 s of CPU and 120 MB')",
          estimator_node="signal.signal(signal.SIGINT, lambda *_: sys.exit(print("
                         "'used 0.90 s of CPU and 90 MB')))\n" + QUIET)
    outcome = flight.fly(short(), tmp_path / 'bag')
    assert outcome.used == {'sim_node': (0.6, 120), 'estimator_node': (0.9, 90)}
    assert outcome.spent() == (
        'CPU: 1.00 cores: estimator 0.60, sim 0.40; memory: 120 MB at most')  # in 1.5 s


def test_what_nodes_refused_is_of_the_outcome_the_last_count_of_each(graph, tmp_path, capsys):
    says = "print('[WARN] [1.0] [mambo.%s]: refused messages: %d /mambo/motor_pwm not finite')\n"
    graph(sim_node=FLEW + says % ('sim_node', 1) + says % ('sim_node', 35))
    outcome = flight.fly(short(), tmp_path / 'bag')
    assert outcome.refused == {'sim_node': '35 /mambo/motor_pwm not finite'}
    flight._print_outcome(outcome, tmp_path / 'bag', no_report=True)
    assert ('warning: sim_node refused messages: 35 /mambo/motor_pwm not finite'
            in capsys.readouterr().out.splitlines())


def test_when_time_is_real_all_but_the_recorder_go_before_others(graph, tmp_path, monkeypatch):
    hurried = []
    monkeypatch.setattr(
        processes.NodeProcess, 'raise_priority', lambda process: hurried.append(process.name))
    graph(sim_node="print('[INFO] [1.0] [mambo.sim_node]: flying in lockstep mode')" + FLEW)
    flight.fly(short(), tmp_path / 'first')
    assert not hurried
    graph(sim_node="print('[INFO] [1.0] [mambo.sim_node]: flying in realtime mode')" + FLEW)
    flight.fly(short(), tmp_path / 'second')
    assert sorted(hurried) == sorted(set(NODES) - {'recorder_node'})


def test_every_node_gets_the_scenario_and_the_simulator_waits_for_all(graph, tmp_path):
    graph(sim_node=COPY + FLEW, controller_node=COPY + QUIET)
    flight.fly(short(), tmp_path / 'bag')
    for name in ('sim_node', 'controller_node'):
        given = from_yaml((tmp_path / f'{name}.yaml').read_text())
        assert set(given.sim_node.wait_for.split(',')) == set(NODES) - {'sim_node'}
        assert override(given, {'sim_node.wait_for': ''}) == short()


@pytest.mark.parametrize('name', ['sim_node', 'estimator_node', 'recorder_node'])
def test_a_node_that_dies_ends_the_flight_and_is_named_with_its_complaint(graph, tmp_path, name):
    graph(**{name: 'raise ValueError("out of paint")'})
    with pytest.raises(FlightError) as error:
        flight.fly(short(), tmp_path / 'bag')
    assert str(error.value) == f'{name} ended with exit code 1: ValueError: out of paint'


def test_a_missing_node_ends_the_flight_before_it_begins(tmp_path, monkeypatch):
    monkeypatch.delenv('ROS_DOMAIN_ID', raising=False)
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path))
    with pytest.raises(FlightError, match='recorder_node is not installed'):
        flight.fly(short(), tmp_path / 'bag')


def test_an_existing_bag_is_never_touched(graph, tmp_path):
    graph()
    (tmp_path / 'bag').mkdir()
    with pytest.raises(FlightError, match='bag exists: give another --output or remove it'):
        flight.fly(short(), tmp_path / 'bag')


def test_a_bag_gets_a_name_that_is_free(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run()[1] == tmp_path / 'bags/circle_kalman_seed1'
    (tmp_path / 'bags/circle_kalman_seed1').mkdir(parents=True)
    assert run()[1] == tmp_path / 'bags/circle_kalman_seed1_2'
    (tmp_path / 'bags/circle_kalman_seed1_2').mkdir()
    assert run()[1] == tmp_path / 'bags/circle_kalman_seed1_3'
    assert run('--output', 'mine')[1] == tmp_path / 'mine'


def test_an_interrupt_of_the_runner_ends_every_node_in_order(graph, tmp_path):
    graph()
    runner = subprocess.Popen([sys.executable, '-c', f"""
import pathlib
from mambo_bringup import flight, processes, replay
from mambo_flight.scenario import scenario
folder = pathlib.Path({str(tmp_path)!r})
processes.executable = lambda package, name: folder / name
print(flight.fly(scenario(duration=3.0), folder / 'bag').stopped.name)
"""], stdout=subprocess.PIPE, text=True)
    limit = time.monotonic() + PATIENCE
    while len(list(tmp_path.glob('*.up'))) < len(NODES) and time.monotonic() < limit:
        time.sleep(0.01)
    runner.send_signal(signal.SIGINT)
    out, _ = runner.communicate(timeout=PATIENCE)
    assert (runner.returncode, out) == (0, 'SIGINT\n')


def test_a_damaged_bag_is_not_replayed(tmp_path, monkeypatch):
    with BagWriter(tmp_path / 'bag') as bag:
        bag.add_topic('/clock', 'rosgraph_msgs/msg/Clock')
        bag.write('/clock', bytes(12), 0)
    data = bag.file.read_bytes()
    bag.file.write_bytes(data[:len(data) // 2])
    monkeypatch.setattr(replay, 'NodeGroup', None)  # nothing is started
    with pytest.raises(BagError, match='recover'):
        replay.replay(tmp_path / 'bag', tmp_path / 'out', estimator_file=tmp_path / 'file.yaml')
    bag.file.write_bytes(data)
    with pytest.raises(processes.FlightInputError, match='file.yaml: there is no such parameter'):
        replay.replay(tmp_path / 'bag', tmp_path / 'out', estimator_file=tmp_path / 'file.yaml')


def test_names_of_bags_are_written_for_ros_as_they_are(tmp_path):
    name = "it's: a \N{GRINNING FACE} #\n{bag"
    file = tmp_path / 'scenario.yaml'
    (_, arguments), = flight._nodes(file, tmp_path / name, True, '/mambo')
    parameters = yaml.safe_load(Path(arguments[-1]).read_text())['/mambo/recorder_node']
    assert parameters['ros__parameters']['bag'] == str(tmp_path / name)
    _, arguments = flight._nodes(file, tmp_path / name, False, '/mambo')[0]
    given = dict(text.split(':=', 1) for text in arguments if ':=' in text)
    assert yaml.safe_load(given['bag']) == str(tmp_path / name)


@pytest.mark.parametrize('number, flown, whole, reports', [
    (signal.SIGINT, 4.0, False, 1), (signal.SIGINT, 4.0, True, 0), (signal.SIGINT, 0.0, False, 0),
    (signal.SIGTERM, 4.0, False, 0)])
def test_ctrl_c_after_all_was_flown_or_before_ends_without_a_report(
        tmp_path, monkeypatch, number, flown, whole, reports):
    asked = []
    monkeypatch.setattr(
        flight, 'report', lambda *arguments: asked.append(arguments) or (tmp_path, []))
    outcome = flight.Outcome(tmp_path, flown, 1.0, 0, '', number, {}, {}, True, whole=whole)
    assert flight._print_outcome(outcome, tmp_path, no_report=False) == []
    assert len(asked) == reports


def test_a_bag_that_is_not_closed_is_a_failure_even_if_no_node_complained(tmp_path):
    outcome = flight.Outcome(tmp_path, 0.0, 0.0, 0, '', None, {}, {}, False)
    assert flight._print_outcome(outcome, tmp_path, no_report=True) == [
        f'{tmp_path} is not closed']
