"""Nodes that could not find each other are refused with the remedy."""

import socket

from mambo_model.errors import JobError
from mambo_ros.graph import loopback
import pytest

RANGE = 'ROS_AUTOMATIC_DISCOVERY_RANGE'


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
