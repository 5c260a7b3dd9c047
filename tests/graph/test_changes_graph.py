"""Parameters that change while the graph flies: refused or recorded, and flown again."""

from contextlib import contextmanager
import subprocess
import sys
import time

from flown_again import assert_one_process_gives, assert_the_graph_gives
from mambo_analysis.compare import estimate
from mambo_bags.reader import read_bag
from mambo_bringup.replay import replay
from mambo_flight import changes, commanded
from mambo_model.errors import JobError
from mambo_ros.commands import client
import pytest

pytestmark = pytest.mark.long

BUSY = 240.0  # s that the start may take on a loaded machine
GAIN = 'controller_node.cascaded.k_p'
NOISE = 'estimator_node.kalman.sonar.noise'
SENSOR = 'sim_node.simulator.imu.gyro_noise'
RUN = ('--trajectory', 'circle', '--no-landing', '--composed', '--duration', '6', '--no-report',
       '--paused')


def change(**values):
    """Set parameters of a node, __ for a dot; return the answer, once the flight is there."""
    limit = time.monotonic() + BUSY
    while True:
        try:
            return client.send('set', parameters={
                name.replace('__', '.'): value for name, value in values.items()})
        except JobError as error:
            if not any(early in str(error) for early in ('no flight', 'has no', 'no answer')):
                raise
            assert time.monotonic() < limit, error


@contextmanager
def running(path, *options):
    """Start a flight in lockstep, paused; wait for its end."""
    process = subprocess.Popen(
        [sys.executable, '-m', 'mambo_bringup.run', *RUN, *options, '-o', str(path)])
    try:
        yield
        assert process.wait(BUSY) == 0
    finally:
        process.kill()


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Return a flight in lockstep whose parameters were changed in pauses and as it flew."""
    path = tmp_path_factory.mktemp('graph') / 'changed'
    with running(path, '--controller', 'cascaded', '--estimator', 'kalman'):
        assert change(**{GAIN: 3}) == 'from t = 0.000 s'
        assert change(**{GAIN: 2.8}) == 'from t = 0.000 s'
        for name, value, words in (
                (GAIN, 30.0, 'k_p = 30.0 m/s^2 is outside [0.01, 9]'),
                (GAIN, 'high', "k_p = 'high' must be a number"),
                ('controller_node.cascaded.kp', 1.0, 'did you mean cascaded.k_p'),
                ('controller_node.toolbox.yaw_gain', 1.0, 'the flight has the controller'),
                ('controller_node.vehicle.mass', 0.1, 'it is fixed when the node starts'),
                ('optitrack_node.seed', 3, 'it is fixed when the node starts'),
                ('sim_node.simulator.wind.gust', [1, 1, 1], 'wind.changeable=true'),
                ('sim_node.speed', 2.0, 'lockstep flies as fast as the machine can'),
                ('sim_node.simulator.faults.sonar.kind', 'missing', 'faults.changeable=true')):
            with pytest.raises(JobError) as error:
                change(**{name: value})
            assert words in str(error.value) and '\n' not in str(error.value)
        assert client.send('step', steps=600) == 'to t = 2.995 s'  # it flies during the next two
        assert change(**{NOISE: 0.3}).startswith('from t = ')
        change(**{GAIN: 3.5, 'controller_node.failsafe.hold': 0.2})
        change(**{SENSOR: [0.1, 0.05, 0]})
        client.send('resume')
    return path


@pytest.fixture(scope='module')
def disturbed(tmp_path_factory):
    """Return a flight in which wind rises, the sonar fails and a noise changes."""
    path, simulator = tmp_path_factory.mktemp('graph') / 'disturbed', 'sim_node.simulator'
    with running(path, '--set', f'{simulator}.wind.changeable=true',
                 '--set', f'{simulator}.faults.changeable=true'):
        assert change(**{f'{simulator}.wind.velocity': [1.0, 0.5, 0.0]}) == 'from t = 0.000 s'
        assert client.send('step', steps=800) == 'to t = 3.995 s'
        for values in (
                {f'{simulator}.faults.sonar.{name}': value for name, value in (
                    ('kind', 'missing'), ('start', 4.5), ('duration', 100.0))},
                {'estimator_node.joint.sonar.noise': 0.02}):
            change(**values)
        client.send('resume')
    return path


def test_the_changes_are_recorded_with_their_steps(bag):
    flight = commanded.scenario_of(bag)
    k, node, values, _ = changes.taken(flight)[0]
    assert (k, node, values) == (0, 'controller_node', {'cascaded.k_p': 2.8})
    assert {one.node for one in changes.taken(flight)} == set(changes.NODES)


def test_one_process_flies_them_again_to_the_last_bit(bag, tmp_path):
    assert_one_process_gives(bag, tmp_path)


def test_the_graph_flies_them_again_to_the_last_bit(bag, tmp_path):
    assert_the_graph_gives(bag, tmp_path)


def test_the_estimator_answers_its_samples_again_to_the_last_bit(bag):
    assert 'messages answered bit for bit' in estimate.again(bag)[2]


def test_wind_and_faults_that_begin_in_flight_are_flown_again(disturbed, tmp_path):
    assert_the_graph_gives(disturbed, tmp_path)
    flown = read_bag(disturbed)
    assert flown['sonar/range'].t[-1] < 4.5 < 5.9 < flown['optical_flow'].t[-1]


def test_a_live_replay_changes_the_estimator_at_the_same_step(disturbed, tmp_path):
    replay(disturbed, tmp_path / 'live', 0.0)
    live, flown = read_bag(tmp_path / 'live'), read_bag(disturbed)
    for topic in ('estimate/odom', 'estimator/state'):
        assert live[topic].raw == flown[topic].raw, topic
