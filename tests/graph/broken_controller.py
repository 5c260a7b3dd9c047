"""The controller of the example with rules of its contract broken: those named as arguments."""

from pathlib import Path
import signal
import sys
import time

from mambo_interfaces.msg import MotorPwm
import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

sys.path.insert(0, str(Path(__file__).parents[2] / 'examples/nodes'))
import pd_controller

BROKEN = set(sys.argv[1:])
SHALLOW = QoSProfile(depth=1)
LOSSY = QoSProfile(depth=2000, reliability=ReliabilityPolicy.BEST_EFFORT)


class Outlet:
    """Publishes the answers of a controller, or what is broken of them."""

    def __init__(self, node, publisher):
        self.node, self.publisher, self.count, self.last = node, publisher, 0, None

    def publish(self, command):
        """Publish one."""
        self.count += 1
        if 'stamps' in BROKEN:
            command.header.stamp = self.node.get_clock().now().to_msg()
        if 'order' in BROKEN and self.count % 50 == 0:
            command.header.stamp.nanosec -= min(command.header.stamp.nanosec, 10_000_000)
        if 'values' in BROKEN and self.count % 50 == 7:
            command.pwm[2] = float('nan')
        if 'answers' in BROKEN and self.count % 60 == 3:
            self.publisher.publish(command)
        if 'real time' in BROKEN and self.count > 520:
            time.sleep(0.012)
        self.last = command
        self.publisher.publish(command)


class BrokenController(pd_controller.PdController):
    """The example, but for what is broken."""

    def __init__(self):
        super().__init__()
        if 'backlog' in BROKEN:
            self.change('estimate/odom', pd_controller.Odometry, self.on_estimate)
            self.change('reference', pd_controller.Reference, self.on_reference)
        if 'subscribes' in BROKEN:
            self.change('reference')
        wrong = {'publishes': (MotorPwm, 'pwm', 10), 'type': (String, 'motor_pwm', 10),
                 'qos': (MotorPwm, 'motor_pwm', LOSSY)}
        for kind in BROKEN & set(wrong):
            self.destroy_publisher(self.commands)
            self.commands = self.create_publisher(*wrong[kind])
        if 'one publisher' in BROKEN:
            self.other = rclpy.create_node('other', namespace='mambo')
            self.other.create_publisher(MotorPwm, 'motor_pwm', 10)
        if BROKEN & {'start', 'no timers'}:
            self.create_timer(0.05, self.tick)
        self.commands = Outlet(self, self.commands)

    def change(self, name, kind=None, callback=None):
        """Subscribe with a queue of one, or not at all."""
        self.destroy_subscription(next(
            one for one in self.subscriptions if one.topic_name.endswith(name)))
        if kind:
            self.create_subscription(kind, name, callback, SHALLOW)

    def tick(self):
        """Publish what nobody asked for."""
        last = self.commands.last
        if ('no timers' if last else 'start') in BROKEN:
            self.commands.publisher.publish(last or MotorPwm())

    def on_estimate(self, message):
        if 'ready' not in BROKEN:
            super().on_estimate(message)
            return
        command = MotorPwm()  # it does not wait for the reference
        command.header.stamp = message.header.stamp
        self.commands.publish(command)

    def answer(self):
        if 'missing input' in BROKEN and abs(len(self.estimates) - len(self.references)) == 1 and (
                min(len(self.estimates), len(self.references)) > 0):
            return  # it waits for what is missing, for ever
        super().answer()


rclpy.init()
node = BrokenController()
try:
    if 'SIGINT' in BROKEN:
        # the second ends it, so that a test need not wait until it is killed
        signal.signal(signal.SIGINT, lambda *_: signal.signal(signal.SIGINT, signal.SIG_DFL))
    rclpy.spin(node)
except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
    pass
