"""Server and client as nodes on loopback, without a graph: several bodies, hostile packets."""

import contextlib
import socket
import time
from unittest.mock import Mock

from diagnostic_msgs.msg import DiagnosticArray
from mambo_mocap import udp
from mambo_mocap.natnet import wire
from mambo_mocap.natnet.frame import encode_frame, Frame, RigidBody, Times
from mambo_mocap.natnet.handshake import encode_server_info
from mambo_mocap.natnet.model import BodyModel, encode_model
from mambo_mocap.natnet_client_node import follow, NatNetClientNode
from mambo_mocap.natnet_server_node import NatNetServerNode
from mambo_mocap.parameters import NatNetServerNodeParams
from mambo_mocap.server import Server, ticks
from mambo_model.motion.rigid_body import State
from mambo_model.schema import ParameterError
from mambo_ros import diagnostics, messages
import numpy as np
import pytest
import rclpy
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message

HERE = '127.0.0.1'
STILL = State((1.0, 2.0, -1.5), (0.0,) * 3, (1.0, 0.0, 0.0, 0.0), (0.0,) * 3)


@pytest.fixture(scope='module', autouse=True)
def ros():
    rclpy.init()
    yield
    rclpy.try_shutdown()


def free_port():
    """Return a port that is free, as the one after it."""
    while True:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one, \
                socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as next_one:
            one.bind((HERE, 0))
            port = one.getsockname()[1]
            with contextlib.suppress(OSError, OverflowError):
                next_one.bind((HERE, port + 1))
                return port


@pytest.fixture
def make():
    """Return a function that makes a node; its reports go to ``reports``."""
    made = []

    def one(kind, **given):
        node = kind(parameter_overrides=[
            Parameter(name, value=value) for name, value in given.items()])
        node.reports = []
        node._diagnostics = lambda data: node.reports.append(
            deserialize_message(data, DiagnosticArray).status[0])
        made.append(node)
        return node

    yield one
    for node in made:
        node.finish()
        node.destroy_node()


def values(status):
    return {one.key: one.value for one in status.values}


def test_a_server_and_a_client_survive_what_strangers_send(make):
    port = free_port()
    server = make(NatNetServerNode, transmission='unicast', command_port=port, data_port=port + 1)
    client = make(NatNetClientNode, command_port=port, stamp='server')
    poses = []
    client._publish['mambo'] = lambda data: poses.append(messages.decode_pose(data))
    rng = np.random.default_rng(1)
    begun = time.monotonic()
    with udp.open_socket(HERE, 0) as stranger:
        for k in range(400):  # 2 s
            for _ in range(5):
                noise = rng.bytes(int(rng.integers(0, 200)))
                udp.send(stranger, noise, (HERE, port))
                udp.send(stranger, b'\7\0' + noise, client._commands.getsockname())
            server._on_truth(0, k * 5_000_000, STILL)
            server.turn()
            client.turn(0.0)
            time.sleep(max(begun + k * 0.005 - time.monotonic(), 0.0))
        limit = time.monotonic() + 3.0  # a busy machine is behind by some frames
        while server._waiting and time.monotonic() < limit:
            time.sleep(min(server.turn(), 0.001))
        server._report(1)
        client._report()
    assert len(poses) > 150 and [t for t, *_ in poses] == sorted({t for t, *_ in poses})
    assert np.abs(np.array([rho for _, rho, _ in poses]) - STILL.rho).max() < 1e-3
    assert int(values(client.reports[-1])['malformed']) > 100
    assert any('malformed packets' in report.message for report in client.reports)
    refused = values(server.reports[-1])
    assert sum(int(n) for key, n in refused.items() if key.startswith('commands')) > 500
    assert int(refused['unicast clients']) <= 32 and not server._waiting


def test_every_body_goes_to_its_topic_by_name_or_number(make):
    client = make(NatNetClientNode, bodies='drone=a/pose, 7=/b/pose, gone=c/pose', up='z')
    names = {output.publisher.topic_name for output in client.outputs}
    assert {'/mambo/a/pose', '/b/pose', '/mambo/c/pose'} < names
    poses = {name: [] for name in client._publish}
    client._publish = {name: poses[name].append for name in poses}
    now = time.time_ns()
    info = Server(NatNetServerNodeParams(transmission='unicast')).info
    client._take(encode_server_info(info), now)
    client._take(encode_model((BodyModel('drone', 3), BodyModel('other', 7)), (4, 1)), now)
    bodies = tuple(RigidBody(number, (float(number), 0.0, 1.0), (0.0, 0.0, 0.0, 1.0), 0.0)
                   for number in (3, 7, 9))
    for k in range(3):
        times = Times(k * 0.01, *(ticks(now + k * 10_000_000),) * 3)
        client._take(encode_frame(Frame(k, times, bodies=bodies), (4, 1)), now + k * 10_000_000)
    # the same times again, in a frame of a new number
    client._take(encode_frame(Frame(3, times, bodies=bodies[:1]), (4, 1)), now + 20_000_000)
    assert client._client.counts['stamps not after the last one'] == 1
    assert [len(found) for found in poses.values()] == [3, 3, 0]
    assert messages.decode_pose(poses['7'][0])[1] == (7.0, 0.0, -1.0)
    client._report()
    assert client.reports[-1].message == (
        'the server does not stream gone; it has: drone, other')
    found = values(client.reports[-1])
    assert found['bodies not asked for'] == '3'  # one in each frame
    assert [found[f'poses of {name}'] for name in poses] == ['3', '3', '0']
    bodies = (bodies[0]._replace(flags=0), *bodies[1:])
    now += 50_000_000
    times = Times(0.1, *(ticks(now),) * 3)
    client._take(encode_frame(Frame(4, times, bodies=bodies), (4, 1)), now)
    client._report()
    assert client.reports[-1].level == diagnostics.WARN
    assert 'no pose of drone for ' in client.reports[-1].message
    assert client.reports[-1].message.endswith(' s: it is not tracked')


def test_poses_are_in_the_frame_of_each_drone(make):
    """A server of two drones, and a client that knows where they start."""
    port = free_port()
    several = {'places': '1 2 0; -1 0.5 0', 'command_port': port}
    server = make(
        NatNetServerNode, transmission='unicast', data_port=port + 1,
        bodies='a=/a/ground_truth/odom, b=/b/ground_truth/odom', **several)
    assert {entry.name for entry in server.inputs} == {
        '/a/ground_truth/odom', '/b/ground_truth/odom'}
    client = make(NatNetClientNode, stamp='server', bodies='a=/a/optitrack/pose, b=/b/pose',
                  **several)
    poses = {name: [] for name in client._publish}
    client._publish = {name: poses[name].append for name in poses}
    there = STILL._replace(rho=(-3.0, 0.25, -1.0))
    begun, k = time.monotonic(), 0
    while min(map(len, poses.values())) < 20 and time.monotonic() < begun + 20.0:
        server._on_truth(0, k * 5_000_000, STILL)
        server._on_truth(1, k * 5_000_000, there)
        server.turn()
        client.turn(0.005)
        k += 1
    for name, truth in (('a', STILL), ('b', there)):
        _, rho, _ = messages.decode_pose(poses[name][-1])
        np.testing.assert_allclose(rho, truth.rho, atol=1e-3)


def test_a_client_connects_before_it_takes_part_in_the_graph(make):
    port = free_port()
    client = make(NatNetClientNode, command_port=port, stamp='server', connect_within=20.0)
    given = {'command_port': port, 'data_port': port + 1}
    loop, known = Mock(stopping=False), []

    def once(_):
        known.append((client.connected, client._data is not None))
        loop.stopping = True

    loop.once = once
    server, turn = make(NatNetServerNode, **given), client.turn
    client.turn = lambda wait: (server.turn(), turn(wait))  # a server that answers late
    assert follow(client, loop) == 0 and known == [(True, True)]


def test_a_client_without_a_server_takes_part_in_the_graph_in_the_end(make):
    client = make(NatNetClientNode, command_port=free_port(), connect_within=0.05)
    loop = Mock(stopping=False)
    loop.once = lambda _: setattr(loop, 'stopping', True)
    assert follow(client, loop) == 0 and not client.connected


def test_a_client_without_a_server_says_what_to_look_at(make):
    client = make(NatNetClientNode, command_port=free_port())
    for _ in range(3):
        client.turn(0.01)
    client._report()
    assert 'is streaming switched on there?' in client.reports[-1].message


def test_a_data_port_in_use_is_told(make):
    client = make(NatNetClientNode, command_port=free_port())
    with udp.open_socket(HERE, 0) as other:
        info = Server(NatNetServerNodeParams(
            version='2.9', data_port=other.getsockname()[1])).info
        client._client.info = info
        client._join()
        client._join()
        client._report()
    assert 'cannot be used' in client.reports[-1].message
    client._join()
    assert client._data is None  # not at once again
    client._next_try = 0.0  # a second later
    client._join()
    client._report()
    assert client._data is not None
    assert client.reports[-1].message == 'connected, but no frame comes'


@pytest.mark.parametrize('topics', [
    'a=optitrack/pose, b=/mambo/optitrack/pose', 'a=/diagnostics'])
def test_no_two_bodies_share_a_topic(topics):
    with pytest.raises(ParameterError, match='which this node publishes already: give each body'):
        NatNetClientNode(parameter_overrides=[Parameter('bodies', value=topics)])


def test_packets_that_take_long_leave_the_node_its_turn(make):
    client = make(NatNetClientNode, command_port=free_port())
    taken = []

    def slow(data, arrived):
        taken.append(data)
        time.sleep(0.04)

    client._take = slow
    with udp.open_socket(HERE, 0) as server:
        for k in range(30):
            udp.send(server, bytes([k]), client._commands.getsockname())
        begun = time.monotonic()
        client.turn(1.0)
        spent = time.monotonic() - begun
    assert len(taken) <= 4 and spent < 1.0, spent  # 30 take 1.2 s
    while len(taken) < 30:
        before = len(taken)
        client.turn(1.0)
        assert len(taken) > before
    assert taken == [bytes([k]) for k in range(30)]


def test_a_paced_server_sends_no_two_frames_together(make):
    port = free_port()
    server = make(NatNetServerNode, transmission='unicast', command_port=port, data_port=port + 1,
                  rate=360.0)
    with udp.open_socket(HERE, 0) as client:
        udp.send(client, wire.message(wire.CONNECT, b''), (HERE, port))
        server.turn()
        for k in range(20):
            server._on_truth(0, k * 5_000_000, STILL)  # 0.1 s at once
        arrivals, limit = [], time.monotonic() + 3.0
        while len(arrivals) < 30 and time.monotonic() < limit:
            time.sleep(min(server.turn(), 0.001))
            arrivals += [at for data, _, at in udp.receive(client) if wire.kind(data) == 7]
    assert len(arrivals) >= 30
    # ns; half a period is 1.389 ms. A busy machine may stop the server between looking at the
    # clock and sending, which brings that frame nearer to the next one.
    assert np.sort(np.diff(arrivals))[2] > 1.38e6
