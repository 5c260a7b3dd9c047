"""
A controller node of your own, with nothing but rclpy and the messages.

    ./run --without controller                # prints the ROS domain, waits
    python3 examples/nodes/pd_controller.py   # in a second shell of env.bash with that domain

A PD law on position and attitude. It answers each estimate, once the reference of the same stamp
is there, with one motor command of that stamp: this is all that lockstep asks of a controller.
"""

from __future__ import annotations

from mambo_interfaces.msg import MotorPwm, Reference
from mambo_model.vehicle.motor_mixer import allocate, limit_pwm, pwm_from_thrust
from mambo_model.vehicle.parameters import preset
from nav_msgs.msg import Odometry
import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile
from scipy.spatial.transform import Rotation

KP, KD = 6.0, 4.0  # 1/s^2, 1/s of the position
KR, KW = 300.0, 35.0  # 1/s^2, 1/s of the attitude
GRAVITY = np.array([0.0, 0.0, 9.81])  # m/s^2, z up
VEHICLE = preset('identified').values()
INERTIA = np.array(VEHICLE.inertia)
QUEUE = QoSProfile(depth=2000)  # reliable


def vector(message) -> np.ndarray:
    """Return x, y, z of a message."""
    return np.array([message.x, message.y, message.z])


def rotation(q) -> Rotation:
    """Return the rotation of a message, body to odom."""
    return Rotation.from_quat([q.x, q.y, q.z, q.w])


def pwm(odometry: Odometry, ref: Reference) -> list[float]:
    """Return the motor command for an estimate and a reference of the same time; z up, FLU."""
    body = rotation(odometry.pose.pose.orientation)
    velocity = body.apply(vector(odometry.twist.twist.linear))
    wanted = (vector(ref.acceleration) + GRAVITY
              + KP * (vector(ref.position) - vector(odometry.pose.pose.position))
              + KD * (vector(ref.velocity) - velocity))
    up = wanted / np.linalg.norm(wanted)
    left = np.cross(up, rotation(ref.attitude).apply([1.0, 0.0, 0.0]))
    left /= np.linalg.norm(left)
    desired = Rotation.from_matrix(np.column_stack([np.cross(left, up), left, up]))
    thrust = VEHICLE.mass * wanted @ body.apply([0.0, 0.0, 1.0])
    error = (body.inv() * desired).as_rotvec()
    rates = vector(ref.angular_velocity) - vector(odometry.twist.twist.angular)
    torque = INERTIA * (KR * error + KW * rates)
    motors = allocate(thrust, (torque[0], -torque[1], -torque[2]), VEHICLE)  # FRD
    return [limit_pwm(pwm_from_thrust(one, VEHICLE), VEHICLE) for one in motors]


class PdController(Node):
    """Answers pairs of estimate and reference."""

    def __init__(self) -> None:
        super().__init__('my_controller', namespace='mambo')
        self.estimates: dict[tuple[int, int], Odometry] = {}
        self.references: dict[tuple[int, int], Reference] = {}
        self.create_subscription(Odometry, 'estimate/odom', self.on_estimate, QUEUE)
        self.create_subscription(Reference, 'reference', self.on_reference, QUEUE)
        self.commands = self.create_publisher(MotorPwm, 'motor_pwm', QUEUE)

    def on_estimate(self, message: Odometry) -> None:
        """Keep an estimate; answer if its reference is there."""
        self.estimates[message.header.stamp.sec, message.header.stamp.nanosec] = message
        self.answer()

    def on_reference(self, message: Reference) -> None:
        """Keep a reference; answer if its estimate is there."""
        self.references[message.header.stamp.sec, message.header.stamp.nanosec] = message
        self.answer()

    def answer(self) -> None:
        """Answer each stamp of which both are there, in order."""
        for stamp in sorted(self.estimates.keys() & self.references.keys()):
            odometry, ref = self.estimates.pop(stamp), self.references.pop(stamp)
            command = MotorPwm()
            command.header.stamp = odometry.header.stamp
            if ref.phase not in (Reference.PHASE_GROUND, Reference.PHASE_LANDED):
                command.pwm = np.array(pwm(odometry, ref))
            self.commands.publish(command)


def main() -> None:
    """Serve until Ctrl-C."""
    rclpy.init()
    node = PdController()
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == '__main__':
    main()
