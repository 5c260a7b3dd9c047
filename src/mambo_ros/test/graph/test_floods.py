"""A process that floods an input is ignored, one that floods a service holds up no node."""

from contextlib import contextmanager
from dataclasses import dataclass
import subprocess
import sys

from mambo_model.motion.rigid_body import State
from mambo_ros import messages, topics
from mambo_ros.graph.publisher_guard import FLOOD, SECOND_PUBLISHER
from mambo_ros.loop import Loop
from mambo_ros.node import MamboNode
import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions
from ros_helpers import until

pytestmark = pytest.mark.usefixtures('ros')
ZERO, ZERO36 = (0.0,) * 3, (0.0,) * 36
PWM, QOS = topics.MOTOR_PWM, QoSProfile(depth=2 * FLOOD)


@dataclass(frozen=True)
class NoParams:
    """Nothing to set."""


@contextmanager
def process(name, *entries):
    """Yield publishers of another participant, as another process would have them."""
    context = Context()
    rclpy.init(context=context, args=[], signal_handler_options=SignalHandlerOptions.NO)
    other = Node(name, namespace='mambo', context=context)
    try:
        yield [other.create_publisher(entry.msg_type, entry.name, QOS) for entry in entries]
    finally:
        other.destroy_node()
        rclpy.shutdown(context=context)


def message(k):
    return messages.motor_pwm(k, (1.0,) * 4, False, 0)


def listener(monkeypatch):
    """Return the guards of commands and estimates, commands used, warnings and the loop."""
    made, used, said = MamboNode('sim', NoParams), [], []
    guard = made.accept(PWM, messages.decode_motor_pwm, lambda t, *_: used.append(t), timed=False)
    monkeypatch.setattr(
        type(made.get_logger()), 'warning', lambda self, text, **_: said.append(text))
    other = made.accept(topics.ESTIMATE, messages.decode_estimate, lambda *_: None, timed=False)
    return guard, other, used, said, Loop(made)


def names(loop, guard):
    """Return the names of a topic's nodes, which are found after their publishers."""
    return {info.node_name for info in loop.nodes[0].get_publishers_info_by_topic(guard.topic)}


def publish(publisher, count, loop):
    for _ in range(count):
        publisher.publish(message(7))
        loop.once(0.0)


def test_a_flooding_process_is_ignored_and_the_other_goes_on(monkeypatch):
    guard, _, used, said, loop = listener(monkeypatch)
    with process('controller', PWM) as (first,), process('stranger', PWM) as (second,):
        until(lambda: names(loop, guard) == {'controller', 'stranger'}, 'both', loop.turn)
        until(lambda: first.publish(message(1)) or used, 'the first', lambda: loop.once(0.01))
        until(lambda: second.publish(message(7)) or guard.refused, 'the second',
              lambda: loop.once(0.01))
        publish(second, 2 * FLOOD, loop)
        until(lambda: len(guard.publishers()) == 1, 'the end of the flood',
              lambda: publish(second, 1, loop))
        assert [line for line in said if '/mambo/stranger floods /mambo/motor_pwm, which' in line]
        for _ in range(20):
            loop.once(0.01)
        refused = guard.refused[SECOND_PUBLISHER]
        publish(second, 20, loop)
        until(lambda: first.publish(message(2)) or used[-1] == 2, 'the first again',
              lambda: loop.once(0.01))
        assert guard.refused[SECOND_PUBLISHER] == refused and set(used) == {1, 2}
    loop.close()


def test_a_process_whose_other_topic_is_accepted_is_not_ignored(monkeypatch):
    guard, other, used, _, loop = listener(monkeypatch)
    with process('a', PWM) as (first,), process('b', PWM, topics.ESTIMATE) as (second, estimate):
        until(lambda: len(guard.publishers()) == 2 and other.publishers(), 'both', loop.turn)
        until(lambda: first.publish(message(1)) or used, 'the first', lambda: loop.once(0.01))
        data = messages.estimate(
            1, State(ZERO, ZERO, (1.0, 0.0, 0.0, 0.0), ZERO), ZERO36, ZERO36)
        until(lambda: estimate.publish(data) or other.accepted, 'the estimate',
              lambda: loop.once(0.01))
        publish(second, 3 * FLOOD, loop)
        until(lambda: guard.refused[SECOND_PUBLISHER] > FLOOD, 'the flood',
              lambda: publish(second, 10, loop))
        assert len(guard.publishers()) == 2
    loop.close()


SERVED = """
import dataclasses
import time
import rclpy
from mambo_ros.graph import loopback
from mambo_ros.loop import Loop
from mambo_ros.node import MamboNode
NoParams = dataclasses.make_dataclass('NoParams', [], frozen=True)
loopback.configure()
rclpy.init()
def running():
    # CPU time of this thread, and its time in the queue for a processor, s
    try:
        with open('/proc/thread-self/schedstat') as file:
            return time.thread_time() + 1e-9 * int(file.read().split()[1])
    except OSError:
        return time.thread_time()


loop, waited = Loop(MamboNode('asked', NoParams)), []
print('served', flush=True)
end = time.monotonic() + 6.0
while time.monotonic() < end:
    began = running(), time.monotonic()
    loop.turn()
    # what a turn waits, without what it computes and others take from it
    waited.append(time.monotonic() - began[1] - (running() - began[0]))
    time.sleep(0.01)
print(sorted(waited)[-2])
"""
ASKING = """
import time
import rclpy
from rcl_interfaces.srv import ListParameters
from rclpy.node import Node
from mambo_ros.graph import loopback
loopback.configure()
rclpy.init()
client = Node('asks').create_client(ListParameters, '/mambo/asked/list_parameters')
assert client.wait_for_service(5.0)
end, asked = time.monotonic() + 4.0, 0
while time.monotonic() < end:
    client.call_async(ListParameters.Request())  # and takes no answer
    asked += 1
    time.sleep(0.001)
assert asked > 500
"""


@pytest.mark.long
def test_a_client_that_takes_no_answers_holds_up_no_node():
    node = subprocess.Popen(
        [sys.executable, '-c', SERVED], stdout=subprocess.PIPE, text=True)
    try:
        assert node.stdout.readline() == 'served\n'
        subprocess.run([sys.executable, '-c', ASKING], timeout=60, check=True)
        waited = float(node.communicate(timeout=60)[0])
    finally:
        node.kill()
    # half of the 0.1 s that the middleware waits unless told otherwise, up to three times here
    # while it finds who reads the answers
    assert waited < 0.05
