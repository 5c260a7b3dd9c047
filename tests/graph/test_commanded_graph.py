"""A commanded flight in the graph: its services, a joystick, a pause; and the same again."""

import subprocess
import sys
import time

from flown_again import assert_one_process_gives, assert_the_graph_gives
from mambo_bags.reader import read_bag
from mambo_control.commanded.commander import SHUT_DOWN
from mambo_flight import commanded
from mambo_interfaces.msg import Command, Reference
from mambo_model.errors import JobError
from mambo_model.motion import flight_command as fc
from mambo_model.motion.trajectory import LANDED
from mambo_ros import topics
from mambo_ros.commands import client
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import Joy

REFUSALS = '/diagnostics'  # tells of the refused commands too, which the second flight has not
BUSY = 240.0  # s that the start may take on a loaded machine
RUN = ('--commanded', '--paused', '--composed', '--estimator', 'ground_truth', '--controller',
       'cascaded', '--duration', '14', '--no-report')


def until(action):
    """Repeat an action until it is carried out; return what it returns."""
    limit = time.monotonic() + BUSY
    while True:
        try:
            return action()
        except JobError as error:
            assert time.monotonic() < limit, error


def refusal():
    """Return why a take-off is refused."""
    with pytest.raises(JobError) as error:
        client.send('takeoff', height=1.2)
    return str(error.value)


def stick(_):
    """Return a joystick, forward with its button held."""
    return Joy(axes=[0.0, 0.0, 0.0, 0.0, 1.0], buttons=[0, 0, 0, 0, 1])


def setpoint(number):
    """Return a setpoint 5 cm above the vehicle, stamped with the last step before the pause."""
    out = Reference()
    out.header.stamp.sec, out.header.stamp.nanosec = 4, 495_000_000 + number
    out.position.z, out.attitude.w = 1.25, 1.0
    return out


def stream(topic, make, kind):
    """Publish messages until a command of a kind is made of them."""
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    node = rclpy.create_node('pilot', context=context, namespace='/mambo')
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    kinds = []
    node.create_subscription(Command, 'command', lambda message: kinds.append(message.kind), 10)
    publisher = node.create_publisher(topic.msg_type, topic.name, 10)
    limit, number = time.monotonic() + BUSY, 0
    while kind not in kinds:
        assert time.monotonic() < limit, f'no command from {topic.name}'
        publisher.publish(make(number))
        number += 1
        executor.spin_once(0.05)
    executor.shutdown()
    rclpy.try_shutdown(context=context)


def start(path, *options):
    """Start a commanded flight that is paused."""
    return subprocess.Popen(
        [sys.executable, '-m', 'mambo_bringup.run', *RUN, '-o', str(path), *options],
        stderr=subprocess.PIPE, text=True)


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Return a flight in lockstep that was commanded while it was paused and while it flew."""
    path = tmp_path_factory.mktemp('graph') / 'commanded'
    process = start(path)
    try:
        assert until(lambda: client.send('takeoff', height=1.2)) == 'from t = 0.000 s'
        with pytest.raises(JobError, match='already'):
            client.send('takeoff', height=1.0)
        with pytest.raises(JobError, match='leaves the volume: x = 9 m'):
            client.send('go_to', goal=(9.0, 0.0, 1.0))
        assert client.send('step', steps=900) == 'to t = 4.495 s'
        stream(topics.SETPOINT, setpoint, fc.SETPOINT)
        stream(topics.JOY, stick, fc.VELOCITY)
        until(lambda: client.send('step', steps=400))  # a loaded machine may answer late
        client.send('go_to', goal=(0.5, -0.5, 1.0), yaw=0.4)
        until(lambda: client.send('step', steps=200))
        time.sleep(1.0)  # so that the landing begins on the way
        client.send('land')
        assert client.send('resume') == 'going on'
        _, errors = process.communicate(timeout=BUSY)
        assert process.returncode == 0, errors
    finally:
        process.kill()
    return path


def test_the_commands_are_recorded_and_the_vehicle_has_landed(bag):
    kinds = [fc.NAMES[command.kind] for command in commanded.commands_of(bag)]
    assert kinds[0] == 'takeoff' and kinds[-2:] == ['go_to', 'land'] and (
        {'velocity', 'setpoint'} < set(kinds))
    assert read_bag(bag)['/mambo/reference']['phase'][-1] == LANDED


def test_one_process_flies_the_recorded_commands_again_to_the_last_bit(bag, tmp_path):
    assert_one_process_gives(bag, tmp_path, REFUSALS)


@pytest.mark.long
def test_the_graph_flies_the_recorded_commands_again_to_the_last_bit(bag, tmp_path):
    assert_the_graph_gives(bag, tmp_path, REFUSALS)
    assert len(read_bag(tmp_path / 'graph')[f'/mambo/{topics.COMMAND.name}'].raw) >= 4


@pytest.mark.long
def test_a_command_after_a_shutdown_is_refused(tmp_path):
    process = start(tmp_path / 'bag', '--set', 'controller_node.cascaded.height_max=0.5')
    try:
        until(lambda: client.send('takeoff', height=1.2))
        client.send('step', steps=900)
        limit = time.monotonic() + BUSY
        while SHUT_DOWN not in (why := refusal()):  # the steps are made after the answer
            assert why.endswith('taking off already') and time.monotonic() < limit, why
        client.send('resume')
        _, errors = process.communicate(timeout=BUSY)
        assert process.returncode == 1 and 'motors shut down' in errors
    finally:
        process.kill()
