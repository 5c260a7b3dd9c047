"""Nodes that could not find each other are refused with the remedy; nobody else finds them."""

import contextlib
import os
import socket
import subprocess
import sys

from mambo_model.errors import JobError
from mambo_ros.graph import loopback
import pytest

RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'
PROFILES = 'FASTRTPS_DEFAULT_PROFILES_FILE'
NODE = """
import os
from pathlib import Path
from mambo_ros.graph import loopback
loopback.configure()
import rclpy
rclpy.init()
node = rclpy.create_node('listener')
held = {os.readlink(one)[8:-1] for one in Path('/proc/self/fd').iterdir() if one.is_symlink()
        and os.path.lexists(one) and os.readlink(one).startswith('socket:[')}
for line in Path('/proc/self/net/udp').read_text().splitlines()[1:]:
    words = line.split()
    if words[9] in held:
        print(words[1])
node.destroy_node()
"""


def receivers(monkeypatch, chosen):
    """Return the addresses on which a node receives, in a process with these variables."""
    for name in (RANGE, PROFILES, 'ROS_STATIC_PEERS'):
        monkeypatch.delenv(name, raising=False)
    for name, value in chosen.items():
        monkeypatch.setenv(name, value)
    said = subprocess.run(
        [sys.executable, '-c', NODE], capture_output=True, text=True, timeout=120, check=True)
    first = 7400 + 250 * int(os.environ['ROS_DOMAIN_ID'])  # ports of RTPS 2.5, 9.6.2.3
    found = set()
    for line in said.stdout.split():
        address, _, port = line.partition(':')
        if first <= int(port, 16) < first + 250:
            found.add(socket.inet_ntoa(int(address, 16).to_bytes(4, sys.byteorder)))
    return found


@pytest.mark.parametrize(('chosen', 'addresses'), [
    ({}, {'127.0.0.1'}),
    ({RANGE: 'LOCALHOST', PROFILES: loopback.OPEN}, {'127.0.0.1'}),
    ({RANGE: 'SUBNET', PROFILES: loopback.CLOSED}, {'0.0.0.0'}),
    ({RANGE: 'LOCALHOST', 'ROS_STATIC_PEERS': '127.0.0.1'}, {'0.0.0.0'}),
], ids=['default', 'this machine', 'network', 'a named machine'])
def test_a_node_receives_from_this_machine_only_unless_asked(chosen, addresses, monkeypatch):
    assert receivers(monkeypatch, chosen) == addresses


def test_a_profile_of_the_users_own_is_left_alone(monkeypatch):
    monkeypatch.setenv(RANGE, 'LOCALHOST')
    monkeypatch.setenv(PROFILES, '/etc/fast.xml')
    loopback.configure()
    assert os.environ[PROFILES] == '/etc/fast.xml'


def deaf(*_, **__):
    raise OSError(101, 'Network is unreachable')


def test_a_working_loopback_interface_is_no_obstacle(monkeypatch):
    monkeypatch.setenv(RANGE, 'LOCALHOST')
    loopback.check()


@pytest.mark.parametrize('value', ['', 'LOCALHOST'])
def test_one_that_is_down_is_named_with_the_command_that_helps(monkeypatch, value):
    monkeypatch.setenv(RANGE, value)
    monkeypatch.setattr(socket.socket, 'sendto', deaf)
    with pytest.raises(JobError, match='Network is unreachable.*: ip link set lo up$') as refusal:
        loopback.check()
    assert refusal.value.exit_code == 1


def test_discovery_over_the_network_does_not_need_it(monkeypatch):
    monkeypatch.setenv(RANGE, 'SUBNET')
    monkeypatch.setattr(socket.socket, 'sendto', deaf)
    loopback.check()


@pytest.mark.parametrize(('name', 'value', 'text'), [
    (RANGE, 'localhost', "= 'localhost' is not one of LOCALHOST, SUBNET, OFF, SYSTEM_DEFAULT"),
    (RANGE, 'LOCAL', "= 'LOCAL' is not one of"),
    (PROFILES, '/nowhere/fast.xml', ': /nowhere/fast.xml cannot be read: name the file')])
def test_a_setting_that_the_middleware_would_pass_over_is_refused(monkeypatch, name, value, text):
    monkeypatch.setenv(name, value)
    with pytest.raises(JobError, match=f'^{name}.*{text}'):
        loopback.check()


@pytest.mark.parametrize('ros, enabled, refused', [
    ('wheels', 'true', True), ('wheels', 'false', False), ('system', 'true', False)])
def test_security_that_the_wheels_lack_is_refused(monkeypatch, ros, enabled, refused):
    monkeypatch.setenv('MAMBO_ROS', ros)
    monkeypatch.setenv('ROS_SECURITY_ENABLE', enabled)
    with pytest.raises(JobError, match='no security') if refused else contextlib.nullcontext():
        loopback.check()
