"""
A node that publishes wrong messages on every input of a flight, from its second second on.

``stranger.py ROUNDS FLOOD``: so many rounds of every attack, then FLOOD s of thousands of messages
a second.
"""

from contextlib import suppress
import math
import sys
import time

from mambo_model.motion import trajectory
from mambo_model.motion.flatness import Reference
from mambo_model.motion.rigid_body import State
from mambo_ros import cdr, messages, topics
import rclpy
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import QoSProfile

RCLError = rclpy_implementation.RCLError
STEP, FUTURE = 5_000_000, 1_795_307_261_000_000_000  # ns
FAR = (3.0, 4.0, -900.0)
ZERO, LEVEL, ZERO36 = (0.0,) * 3, (1.0, 0.0, 0.0, 0.0), (0.0,) * 36
FLOODED = (topics.CLOCK, topics.MOTOR_PWM, topics.IMU, topics.ESTIMATE, topics.SENSOR_TICK)

BURST = 5  # so that a flood outdoes the quickest flight in lockstep


def state(x):
    return State((x, *FAR[1:]), ZERO, LEVEL, ZERO)


def reference(x):
    return Reference((x, *FAR[1:]), *(ZERO,) * 4, LEVEL, ZERO, ZERO, 1.0, ZERO)


MAKERS = {
    topics.MOTOR_PWM: lambda t, x: messages.motor_pwm(t, (x, 500.0, 500.0, 500.0), False, 0),
    topics.REFERENCE: lambda t, x: messages.reference(t, reference(x), trajectory.TRACK),
    topics.ESTIMATE: lambda t, x: messages.estimate(t, state(x), ZERO36, ZERO36),
    topics.IMU: lambda t, x: messages.imu(t, (x, 0.0, 0.0), ZERO, ZERO, ZERO),
    topics.SONAR: lambda t, x: messages.sonar(t, x, 0.1, 9.0, 1.0),
    topics.OPTICAL_FLOW: lambda t, x: messages.optical_flow(t, (x, 0.0), 200),
    topics.BAROMETER: lambda t, x: messages.pressure(t, x, 1.0),
    topics.SENSOR_TICK: lambda t, x: messages.sensor_tick(t, 1, 1, 1, 1),
    topics.CLOCK: lambda t, x: messages.clock(t)}


def attacks(t):
    """Yield (topic, bytes) of one round at a time of the flight, ns."""
    for topic, make in MAKERS.items():
        for stamp in (t, t + STEP, 0, FUTURE):
            yield topic, make(stamp, 1.0)
        for value in (math.nan, math.inf, 1e30):
            yield topic, make(t + STEP, value)
        data = make(t, 1.0)
        yield topic, data[:7]
        yield topic, b'\xff' * len(data)
        yield topic, data[:12] + b'\xf0\xff\xff\xff' + data[16:]


def flood(publishers, now, seconds):
    """Publish on some topics, at some kHz, one after the other; return the number of messages."""
    count, end = 0, time.monotonic()
    for topic in FLOODED:  # not all at once: a busy machine would leave too little for each
        end += seconds / len(FLOODED)
        while time.monotonic() < end:
            data = MAKERS[topic](now[0] + STEP, 1.0)
            for _ in range(BURST):
                with suppress(RCLError):
                    publishers[topic].publish(data)
            count += BURST
            time.sleep(0.0002)
    return count


def main():
    rclpy.init()
    node = rclpy.create_node('stranger')
    now = [-1]

    def follow(data):
        now[0] = cdr.stamp_ns(data)
    node.create_subscription(
        topics.ESTIMATOR_STATE.msg_type, f'/mambo/{topics.ESTIMATOR_STATE.name}', follow,
        QoSProfile(depth=1), raw=True)
    print('there', flush=True)
    while now[0] < 2_000_000_000:
        rclpy.spin_once(node, timeout_sec=0.02)
    # in flight: a simulator that is not alone with /clock at the start does not fly
    publishers = {topic: node.create_publisher(
        topic.msg_type, topic.name if topic.name.startswith('/') else f'/mambo/{topic.name}',
        QoSProfile(depth=100)) for topic in MAKERS}
    heard = [publishers[topic] for topic in (topics.ESTIMATE, topics.SENSOR_TICK, topics.CLOCK)]
    while not all(publisher.get_subscription_count() for publisher in heard):
        rclpy.spin_once(node, timeout_sec=0.02)
    for _ in range(int(sys.argv[1])):
        for number, (topic, data) in enumerate(attacks(now[0])):
            with suppress(RCLError):  # its queue is full: readers are not that quick
                publishers[topic].publish(data)
            if number % 10 == 0:
                rclpy.spin_once(node, timeout_sec=0.0)
        time.sleep(0.02)
    print('done', flood(publishers, now, float(sys.argv[2])), flush=True)
    time.sleep(60.0)  # still there


main()
