"""A flight through NatNet: its parameters, and what it refuses."""

import json
import socket

from geometry_msgs.msg import PoseStamped
from mambo_bags.writer import BagWriter
from mambo_bringup.flight import natnet, nodes
from mambo_flight.scenario import override, scenario
from mambo_flight.world.world_file import Hall
from mambo_mocap.parameters import (
    bodies, NatNetClientNodeParams, NatNetServerNodeParams, places)
from mambo_model import schema
from mambo_model.errors import InputError
from mambo_ros import diagnostics, messages
from mambo_sim.sensors.hall_capture import HallCaptureParams
from mambo_sim.world import WorldParams
import pytest
from rclpy.serialization import serialize_message
import yaml


def test_server_and_client_have_the_hall_of_the_flight(tmp_path):
    flight = natnet.scenario(override(scenario(seed=5), {
        'optitrack_node.optitrack.fault': 'lost', 'optitrack_node.optitrack.fault_end': 3.0,
        'optitrack_node.optitrack.markers.occlusion': 0.2}))
    file = natnet.write(tmp_path / 'flight.yaml', flight, 20_000, '/mambo')
    given = yaml.safe_load(file.read_text())
    assert given == json.loads(file.read_text())
    server = schema.build(
        NatNetServerNodeParams, given['/mambo/natnet_server_node']['ros__parameters'])
    client = schema.build(
        NatNetClientNodeParams, given['/mambo/natnet_client_node']['ros__parameters'])
    assert (server.command_port, server.data_port, client.command_port) == (20_000, 20_001, 20_000)
    assert (server.seed, server.fault, server.fault_end) == (5, 'lost', 3.0)
    assert server.markers == flight.optitrack_node.optitrack.markers
    assert client.stamp == 'server' and server.body in client.bodies
    assert client.connect_within == flight.sim_node.patience
    assert (server.address, server.group) == (natnet._HOST, natnet._GROUP)
    assert flight.sim_node.mode == 'realtime'
    assert not flight.estimator_node.waits_for_capture


def test_one_server_and_one_client_are_those_of_all_drones_of_a_hall(tmp_path):
    flight = natnet.scenario(scenario(seed=5))
    hall = Hall(WorldParams(drones=2, capture=HallCaptureParams(occlusion=True, cameras=6)), {
        '/mambo1': (0.0, -1.5, 0.0), '/mambo2': (0.1, 1.5, 0.0)})
    given = yaml.safe_load(natnet.write(
        tmp_path / 'flight.yaml', flight, 20_000, '/mambo1', hall).read_text())
    server = schema.build(
        NatNetServerNodeParams, given['/mambo1/natnet_server_node']['ros__parameters'])
    client = schema.build(
        NatNetClientNodeParams, given['/mambo1/natnet_client_node']['ros__parameters'])
    assert server.topics == {
        'mambo1': '/mambo1/ground_truth/odom', 'mambo2': '/mambo2/ground_truth/odom'}
    assert bodies(client.bodies) == {
        'mambo1': '/mambo1/optitrack/pose', 'mambo2': '/mambo2/optitrack/pose'}
    for one in (server, client):
        assert places(one.places, 2) == list(hall.places.values())
    assert server.capture == hall.params.capture and server.seed == 5


def test_they_stand_in_for_the_mock(tmp_path):
    flight, file = scenario(), tmp_path / 'flight.yaml'
    started = nodes.start_arguments(
        file, tmp_path / 'bag', False, '/mambo', natnet=tmp_path / 'natnet.yaml')
    names = [node for node, _ in started]
    assert natnet.SERVER in names and natnet.CLIENT in names
    assert ('mambo_sim', 'optitrack_node') not in names
    assert str(tmp_path / 'natnet.yaml') in dict(started)[natnet.SERVER]
    waited = nodes.run_parameters(flight, (), natnet=True)['sim_node.wait_for'].split(',')
    assert {natnet.SERVER[1], natnet.CLIENT[1]} < {*waited} and 'optitrack_node' not in waited


@pytest.mark.parametrize('given', [{'model': 'pose'}, {'frame_loss': 0.1}, {'stamp': 'arrival'}])
def test_what_no_server_streams_is_refused(given):
    flight = override(scenario(), {
        f'optitrack_node.optitrack.{name}': value for name, value in given.items()})
    with pytest.raises(schema.ParameterError, match='with NatNet optitrack_node.optitrack needs'):
        natnet.scenario(flight)


@pytest.mark.parametrize('posed, level, line', [
    (True, diagnostics.ERROR, ''),
    (False, diagnostics.ERROR, '{}: no optitrack/pose: none came through NatNet: no reply'),
    (False, diagnostics.OK, '{}: no optitrack/pose: none came through NatNet')])
def test_a_flight_without_a_pose_says_so_and_why(tmp_path, posed, level, line):
    second = 1_000_000_000  # ns
    writer = BagWriter(tmp_path / 'bag')
    writer.add_topic('/clock', 'rosgraph_msgs/msg/Clock')
    writer.add_topic('/mambo1/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray')
    writer.add_topic('/mambo1/optitrack/pose', 'geometry_msgs/msg/PoseStamped')
    for t in (second, 2 * second):
        writer.write('/clock', messages.clock(t), t)
        writer.write('/mambo1/diagnostics', diagnostics.report(
            t, 'natnet_client_node', level, 'no reply', {}), t)
    if posed:
        writer.write('/mambo1/optitrack/pose', serialize_message(PoseStamped()), second)
    writer.close()
    assert natnet.missing(tmp_path / 'bag', scenario()) == (
        line.format(tmp_path / 'bag'), not posed)


@pytest.mark.parametrize(('first', 'given', 'words', 'bad'), [
    (0.05, {}, '', False), (0.66, {}, 't = 0.66 s, about 79 are missing before it', False),
    (1.5, {}, 'are missing before it; the vehicle leaves the floor at 1 s', True),
    (1.5, {'reference_node.plan.takeoff_time': 2.0}, 'are missing before it', False),
    (0.5, {'reference_node.plan.takeoff': 'none'}, 'leaves the floor at 0 s', True),
    (5.5, {'reference_node.commands.enabled': True}, 'about 660 are missing before it', False),
    (5.5, {'estimator_node.joint.pose.enabled': False}, 'about 660 are missing before it', False),
    (5.5, {'optitrack_node.optitrack.fault': 'lost',
           'optitrack_node.optitrack.fault_end': 5.5}, '', False)])
def test_poses_that_are_missing_at_the_start_are_said(tmp_path, first, given, words, bad):
    flight = override(scenario(), {
        'optitrack_node.optitrack.rate': 120.0, 'estimator_node.joint.pose.enabled': True,
        **given})
    writer = BagWriter(tmp_path / 'bag')
    writer.add_topic('/mambo/optitrack/pose', 'geometry_msgs/msg/PoseStamped')
    for t in (first, first + 1.0):
        pose = PoseStamped()
        pose.header.stamp.sec, pose.header.stamp.nanosec = int(t), round(t % 1.0 * 1e9)
        writer.write('/mambo/optitrack/pose', serialize_message(pose), round(t * 1e9))
    writer.close()
    line, failed = natnet.missing(tmp_path / 'bag', flight)
    assert line.endswith(words) and bool(line) is bool(words) and failed is bad


@pytest.mark.parametrize(('address', 'ahead'), [('127.0.0.1', 0), ('239.255.42.99', 1)])
def test_a_port_in_use_is_told_before_the_start(address, ahead):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one:
        one.bind((address, 0))
        used = one.getsockname()[1]
        with pytest.raises(InputError, match=f'^--natnet {used - ahead}: UDP port {used} of this'):
            natnet.check_ports(used - ahead)
    natnet.check_ports(used - ahead)
