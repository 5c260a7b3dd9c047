"""Messages of the middleware with the identity of their publisher."""

import gc

from mambo_ros import messages, topics
from mambo_ros.graph import peers
from mambo_ros.message_taker import MessageTaker
import pytest
from rclpy.node import Node
from rclpy.qos import QoSProfile
from ros_helpers import until

PWM = topics.MOTOR_PWM
QOS = QoSProfile(depth=100)


@pytest.fixture
def ends(ros):
    """Return a node, its subscription and two publishers, linked."""
    node = Node('ends')
    source = node.create_subscription(PWM.msg_type, PWM.name, print, QOS, raw=True)
    first, second = (node.create_publisher(PWM.msg_type, PWM.name, QOS) for _ in range(2))
    until(lambda: source.get_publisher_count() == 2, 'the links')
    yield node, source, first, second
    node.destroy_node()


def message(k, size=4):
    return messages.motor_pwm(k, (1.0,) * 4, False, 0) + bytes(size)


def take_one(take):
    taken = []
    until(lambda: taken.append(take()) or taken[-1] is not None, 'a message')
    return taken[-1]


def test_each_message_is_complete_and_names_its_publisher(ends):
    node, source, first, second = ends
    take = MessageTaker(source.handle, 10_000)
    known = peers.publishers(node, PWM.name)
    assert take() is None and len(known) == 2
    seen = []
    for k, publisher in enumerate((first, second, first)):
        data = message(k, 4 * 1000 ** (k == 1))  # one is longer than the room at the beginning
        publisher.publish(data)
        taken, size, by = take_one(take)
        assert taken == data and size == len(data)
        seen.append(by)
    assert seen[0] == seen[2] != seen[1] and {*seen} == known


def test_only_the_beginning_of_a_long_message_is_copied(ends):
    _, source, first, _ = ends
    take = MessageTaker(source.handle, 100)
    first.publish(message(1, 2_000_000))
    data, size, _ = take_one(take)
    assert len(data) == 100 and size > 2_000_000


def test_a_subscription_is_destroyed_after_its_last_message_taker(ends):
    node, source, first, _ = ends
    take = MessageTaker(source.handle, 100)
    node.destroy_subscription(source)
    first.publish(message(1))
    until(lambda take=take: take() is not None, 'the message')  # and no access to freed memory
    del take
    gc.collect()
    until(lambda: first.get_subscription_count() == 0, 'the end of the subscription')
