"""A stranger in the graph publishes wrong messages on every input of every node, in flight."""

from contextlib import contextmanager
from pathlib import Path
import subprocess
import sys

from mambo_bags.reader import read_bag
from mambo_bringup.domain import Domain
from mambo_bringup.flight.nodes import FLIGHT_NODES, RECORDER, SIMULATOR
from mambo_bringup.processes import NodeProcess
from mambo_bringup.replay import replay
from mambo_flight import closed_loop
from mambo_flight.scenario import override, scenario, to_yaml
from mambo_ros import messages, topics
from mambo_ros.graph import publisher_guard
import numpy as np
import pytest

INPUTS = {
    'sim_node': ['motor_pwm'], 'reference_node': ['/clock'],
    'controller_node': ['reference', 'estimate/odom', '/clock'],
    'estimator_node': ['imu/data_raw', 'sonar/range', 'optical_flow', 'barometer/pressure',
                       'sensor_tick']}


@contextmanager
def stranger(rounds, flood=0.0):
    """Have a stranger wait for a flight in this domain, from then on until the end."""
    process = subprocess.Popen(
        [sys.executable, str(Path(__file__).with_name('stranger.py')), str(rounds), str(flood)],
        stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == 'there\n'
        yield
    finally:
        process.kill()
        process.communicate()


@pytest.mark.parametrize('mode', ['lockstep', pytest.param('realtime', marks=pytest.mark.long)])
def test_a_stranger_on_every_input_changes_nothing(tmp_path, mode):
    seconds, rounds = (80.0, 40) if mode == 'lockstep' else (9.0, 45)
    assert 10 * rounds < publisher_guard.FLOOD  # messages of each topic: no flood if read at once
    names = ','.join(name for _, name in (*FLIGHT_NODES, RECORDER))
    flight = override(scenario(duration=seconds, seed=3, land=False), {
        'sim_node.mode': mode, 'sim_node.wait_for': names})
    bag, file = tmp_path / 'flight', tmp_path / 'scenario.yaml'
    file.write_text(to_yaml(flight))
    arguments = ['--ros-args', '--params-file', str(file)]
    flood = 4.0 if mode == 'lockstep' else 0.0  # s
    with Domain(), stranger(rounds, flood):
        nodes = [NodeProcess(*RECORDER, [
            '--ros-args', '-p', f'bag:={bag}', '-p', 'topics:=ground_truth/odom,/diagnostics'])]
        nodes += [NodeProcess(*node, arguments) for node in (*FLIGHT_NODES, SIMULATOR)]
        try:
            code = nodes[-1].wait(400.0)
        finally:
            codes = [node.end(20.0) for node in reversed(nodes)]
    output = {node.name: '\n'.join(node.lines) for node in nodes}
    assert code == 0 and set(codes) == {0}, output
    recorded = read_bag(bag)
    truth = [messages.decode_odometry(data)[1]
             for data in recorded['/mambo/ground_truth/odom'].raw]
    height = -np.array([state.rho[2] for state in truth])
    if mode == 'lockstep':  # what is refused has no effect at all
        np.testing.assert_array_equal(
            closed_loop.fly(flight).truth[:, :3], [state.rho for state in truth])
    else:  # 1.5 m alone; where the nodes believe the stranger, 0.4 m and the height limit
        assert 'height limit' not in output['controller_node']
        assert height.max() < 3.0  # 2.04 m seen, landing beside four busy processes
        assert height.max() > 1.0 or 'lost or unusable' in output['controller_node']  # other work
    reports = {}
    for message in recorded['/diagnostics'].objects():
        for status in message.status:
            if status.name.endswith(': inputs'):
                reports.setdefault(status.name.split(':')[0], {}).update(
                    {pair.key: int(pair.value) for pair in status.values})
    for name, inputs in INPUTS.items():
        assert 'Traceback' not in output[name]
        assert 'malformed' not in output[name]  # the stranger is refused before it is decoded
        for topic in inputs:
            full = topic if topic.startswith('/') else f'/mambo/{topic}'
            assert reports[name][f'{full} from a second publisher'] > 0
            assert f'{full}: 2 publishers (' in output[name], output[name]
    flooded = [line for lines in output.values() for line in lines.splitlines()
               if '/stranger floods /' in line]
    assert bool(flooded) == (mode == 'lockstep')


@pytest.mark.long
def test_a_stranger_on_every_input_changes_nothing_in_a_replay(tmp_path, monkeypatch):
    with Domain() as domain:
        monkeypatch.setenv('ROS_DOMAIN_ID', str(domain.number))
    recording = Path(__file__).parents[2] / 'bags/circle_short'
    with stranger(10_000):  # also while the nodes end
        refused = replay(recording, tmp_path / 'replayed', 1.0)
    assert set(refused) == {'estimator_node', 'recorder_node', 'replay_node'}
    for topic in (topics.ESTIMATE, topics.ESTIMATOR_STATE, topics.CLOCK, topics.IMU):
        ours, theirs = (read_bag(bag)[topic.name].raw
                        for bag in (tmp_path / 'replayed', recording))
        assert ours == theirs, topic.name
