"""The executor works when something is ready, and now and then; otherwise a turn costs little."""

from dataclasses import dataclass

from mambo_ros import topics
from mambo_ros.graph.turns import Turns
from mambo_ros.node import MamboNode
import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile
from ros_helpers import until
from std_srvs.srv import Trigger


@dataclass(frozen=True)
class NoParams:
    """Of a node without parameters."""


@pytest.fixture
def idle(ros, monkeypatch):
    """Return a node, its turns, and the list that grows with each turn of the executor."""
    node, spins = MamboNode('node', NoParams), []
    turns = Turns([node])
    for _ in range(20):  # what the start of a node leaves behind
        turns.take()
    spin = turns._executor.spin_once
    monkeypatch.setattr(
        turns._executor, 'spin_once', lambda **how: spins.append(1) or spin(**how))
    yield node, turns, spins
    turns.close()


def test_nothing_ready_leaves_the_executor_alone_but_for_one_turn_in_eleven(idle):
    _, turns, spins = idle
    assert not turns.ready()
    for _ in range(33):
        turns.take()
    assert len(spins) == 3


def test_a_timer_made_later_is_served_at_once(idle):
    node, turns, spins = idle
    ticks = []
    timer = node.create_timer(0.01, lambda: ticks.append(1))
    until(turns.ready, 'the timer')
    turns.take()
    assert ticks == [1] and len(spins) == 1
    assert not turns.ready()
    node.destroy_timer(timer)
    assert not turns.ready()


def test_a_service_is_served_at_once(idle):
    node, turns, _ = idle
    node.create_service(Trigger, 'ask', lambda request, answer: answer)
    asking = MamboNode('asking', NoParams)
    client = asking.create_client(Trigger, 'ask')
    until(client.service_is_ready, 'the service')
    future = client.call_async(Trigger.Request())
    until(turns.ready, 'the request')
    turns.take()
    theirs = Turns([asking])
    until(lambda: theirs.take() or future.done(), 'the answer')
    theirs.close()


def test_an_event_of_a_publisher_is_seen(idle):
    node, turns, _ = idle
    node.advertise(topics.MOTOR_PWM)
    assert not turns.ready()
    other = MamboNode('other', NoParams)
    other.create_subscription(
        topics.MOTOR_PWM.msg_type, topics.MOTOR_PWM.name, print,
        QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL))
    until(turns.ready, 'the event')
