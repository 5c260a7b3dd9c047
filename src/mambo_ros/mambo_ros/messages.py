"""
Convert every message of the graph to and from the tuples that the mathematics uses.

Inside: NED world, FRD body, quaternion w x y z. On the wire: z up, body FLU, quaternion x y z w
(REP-103). The signs are those of ``mambo_model.frames``; this module only maps the fields. A stamp
is an int in nanoseconds.
"""

from __future__ import annotations

from typing import NamedTuple

from geometry_msgs.msg import PoseStamped
from mambo_interfaces.msg import (
    CaptureTick, ControllerState, EstimatorState, MotorPwm, OpticalFlow, Reference, SensorTick)
from mambo_model.frames import body_quaternion, flip_covariance, flip_vector, wire_quaternion
from mambo_model.motion import flatness
from mambo_model.motion.rigid_body import State
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import FluidPressure, Imu, Range

from .layout import Layout

Vec3 = tuple[float, float, float]
Quat = tuple[float, float, float, float]

MAP, ODOM, BASE = 'map', 'odom', 'base_link'
"""Frames of REP-105: motion capture, dead reckoning, vehicle."""

_CLOCK = Layout(Clock)
_IMU = Layout(Imu, header__frame_id=BASE)
_RANGE = Layout(Range, header__frame_id=BASE)
_FLOW = Layout(OpticalFlow, header__frame_id=BASE)
_PRESSURE = Layout(FluidPressure, header__frame_id=BASE)
_TICK = Layout(SensorTick)
_TRUTH = Layout(Odometry, header__frame_id=MAP, child_frame_id=BASE)
_CAPTURE_TICK = Layout(CaptureTick)
_LOCATED = Layout(Odometry, header__frame_id=MAP, child_frame_id=BASE)
_ESTIMATE = Layout(Odometry, header__frame_id=ODOM, child_frame_id=BASE)
_POSE = Layout(PoseStamped, header__frame_id=MAP)
_REFERENCE = Layout(Reference, header__frame_id=ODOM)
_PWM = Layout(MotorPwm)
_ESTIMATOR = Layout(EstimatorState, header__frame_id=BASE)
_CONTROLLER = Layout(ControllerState, header__frame_id=ODOM)

_ZERO36 = (0.0,) * 36
_UNKNOWN9 = (-1.0,) + (0.0,) * 8  # REP-145: first element -1 says "not measured"
ULTRASOUND = Range.ULTRASOUND


def _stamp(numbers: tuple) -> int:
    return numbers[0] * 1_000_000_000 + numbers[1]


def clock(t: int) -> bytes:
    """Encode ``/clock``."""
    return _CLOCK.stamped(t)


def decode_clock(data: bytes) -> tuple[int]:
    """Return (stamp ns,) of ``/clock``."""
    return _stamp(_CLOCK.unpack(data)),


def imu(t: int, gyro: Vec3, accel: Vec3, gyro_variance: Vec3, accel_variance: Vec3) -> bytes:
    """
    Encode an IMU sample (REP-145: no orientation).

    Parameters
    ----------
    t : ns
    gyro : (3,) rad/s, body FRD
    accel : (3,) m/s^2, body FRD
        Specific force.
    gyro_variance, accel_variance : (3,) (rad/s)^2, (m/s^2)^2
        White noise of each axis.

    """
    g, a = gyro_variance, accel_variance
    return _IMU.stamped(
        t, 0.0, 0.0, 0.0, 1.0, *_UNKNOWN9,
        *flip_vector(gyro), g[0], 0.0, 0.0, 0.0, g[1], 0.0, 0.0, 0.0, g[2],
        *flip_vector(accel), a[0], 0.0, 0.0, 0.0, a[1], 0.0, 0.0, 0.0, a[2])


class ImuSample(NamedTuple):
    """Decoded IMU sample, body FRD."""

    t: int  # ns
    gyro: Vec3  # rad/s
    accel: Vec3  # m/s^2, specific force


def decode_imu(data: bytes) -> ImuSample:
    """Decode ``sensor_msgs/Imu``."""
    n = _IMU.unpack(data)
    return ImuSample(_stamp(n), flip_vector(n[15:18]), flip_vector(n[27:30]))


def sonar(t: int, distance: float, low: float, high: float, field_of_view: float) -> bytes:
    """Encode a sonar sample; ``distance`` m along body down, REP-117 infinities out of range."""
    return _RANGE.stamped(t, ULTRASOUND, field_of_view, low, high, distance, 0.0)


def decode_sonar(data: bytes) -> tuple[int, float]:
    """Return (stamp ns, slant range m); NaN without an echo within the limits."""
    n = _RANGE.unpack(data)
    low, high, distance = n[4], n[5], n[6]
    return _stamp(n), distance if low <= distance <= high else float('nan')


def optical_flow(t: int, flow: tuple[float, float], quality: int, time: float = 0.0) -> bytes:
    """Encode optical flow; ``flow`` (2,) rad/s along body forward and right (FRD)."""
    return _FLOW.stamped(t, flow[0], -flow[1], time, quality)


def decode_optical_flow(data: bytes) -> tuple[int, tuple[float, float], int]:
    """Return (stamp ns, (2,) rad/s body FRD, quality 0..255)."""
    n = _FLOW.unpack(data)
    return _stamp(n), (n[2], -n[3]), n[5]


def pressure(t: int, value: float, variance: float) -> bytes:
    """Encode static pressure in Pa."""
    return _PRESSURE.stamped(t, value, variance)


def decode_pressure(data: bytes) -> tuple[int, float]:
    """Return (stamp ns, pressure Pa)."""
    n = _PRESSURE.unpack(data)
    return _stamp(n), n[2]


def sensor_tick(t: int, imu_count: int, sonar_count: int, flow_count: int,
                barometer_count: int) -> bytes:
    """Encode the watermark of the sensors: samples published since start on each topic."""
    return _TICK.stamped(t, imu_count, sonar_count, flow_count, barometer_count)


def decode_sensor_tick(data: bytes) -> tuple[int, tuple[int, int, int, int]]:
    """Return (stamp ns, (imu, sonar, flow, barometer) counts)."""
    n = _TICK.unpack(data)
    return _stamp(n), n[2:6]


def capture_tick(t: int, poses: int) -> bytes:
    """Encode the watermark of the motion capture: poses published since start."""
    return _CAPTURE_TICK.stamped(t, poses)


def decode_capture_tick(data: bytes) -> tuple[int, int]:
    """Return (stamp ns, count of poses)."""
    n = _CAPTURE_TICK.unpack(data)
    return _stamp(n), n[2]


def _odometry(layout: Layout, t: int, state: State, pose_covariance: tuple,
              twist_covariance: tuple) -> bytes:
    return layout.stamped(
        t, *flip_vector(state.rho), *wire_quaternion(state.q), *pose_covariance,
        *flip_vector(state.nu), *flip_vector(state.omega), *twist_covariance)


def ground_truth(t: int, state: State) -> bytes:
    """Encode the true state as odometry in ``map``."""
    return _odometry(_TRUTH, t, state, _ZERO36, _ZERO36)


def estimate(t: int, state: State, pose_covariance: tuple, twist_covariance: tuple) -> bytes:
    """
    Encode the estimate as odometry in ``odom``.

    The covariances are 36 numbers row major (x, y, z, rotation about X, Y, Z): pose in NED axes,
    twist in FRD axes.
    """
    return _odometry(_ESTIMATE, t, state, flip_covariance(pose_covariance),
                     flip_covariance(twist_covariance))


def located(t: int, state: State, pose_covariance: tuple, twist_covariance: tuple) -> bytes:
    """Encode the estimate as odometry in ``map``; covariances as of :func:`estimate`."""
    return _odometry(_LOCATED, t, state, flip_covariance(pose_covariance),
                     flip_covariance(twist_covariance))


def decode_odometry(data: bytes) -> tuple[int, State]:
    """Return (stamp ns, state) of ``nav_msgs/Odometry``; ignore the covariances."""
    n = _ESTIMATE.unpack(data)
    x, y, z, w = n[5:9]
    return _stamp(n), State(
        flip_vector(n[2:5]), flip_vector(n[45:48]), body_quaternion(x, y, z, w),
        flip_vector(n[48:51]))


def decode_estimate(data: bytes) -> tuple[int, State, tuple[float, ...]]:
    """
    Return (stamp ns, state, variances) of ``nav_msgs/Odometry``.

    Variances: of the horizontal position m^2, of the height m^2, of the velocity along body x
    and y m^2/s^2, of the tilt rad^2, of the body rate rad^2/s^2. Where a quantity has several
    axes, the largest variance. A change of sign between the frames does not change a variance.
    """
    n = _ESTIMATE.unpack(data)
    x, y, z, w = n[5:9]
    return _stamp(n), State(
        flip_vector(n[2:5]), flip_vector(n[45:48]), body_quaternion(x, y, z, w),
        flip_vector(n[48:51])), (
            _larger(n[9], n[16]), n[23], _larger(n[51], n[58]), _larger(n[30], n[37]),
            _larger(_larger(n[72], n[79]), n[86]))


def _larger(a: float, b: float) -> float:
    """Return the larger number; NaN if either is."""
    return a + b if a != a or b != b else max(a, b)


def optitrack(t: int, rho: Vec3, q: Quat) -> bytes:
    """Encode a motion-capture pose in ``map``."""
    return _POSE.stamped(t, *flip_vector(rho), *wire_quaternion(q))


def decode_pose(data: bytes) -> tuple[int, Vec3, Quat]:
    """Return (stamp ns, position NED m, quaternion) of ``geometry_msgs/PoseStamped``."""
    n = _POSE.unpack(data)
    return _stamp(n), flip_vector(n[2:5]), body_quaternion(*n[5:9])


def reference(t: int, ref: flatness.Reference, phase: int) -> bytes:
    """Encode the feasible reference (3.14)."""
    return _REFERENCE.stamped(
        t, *flip_vector(ref.rho), *flip_vector(ref.v), *flip_vector(ref.a), *flip_vector(ref.j),
        *flip_vector(ref.s), *wire_quaternion(ref.q), *flip_vector(ref.omega),
        *flip_vector(ref.omega_dot), ref.f, *flip_vector(ref.tau), phase)


def decode_reference(data: bytes) -> tuple[int, flatness.Reference, int]:
    """Return (stamp ns, reference, phase)."""
    n = _REFERENCE.unpack(data)
    return _stamp(n), flatness.Reference(
        flip_vector(n[2:5]), flip_vector(n[5:8]), flip_vector(n[8:11]), flip_vector(n[11:14]),
        flip_vector(n[14:17]), body_quaternion(*n[17:21]), flip_vector(n[21:24]),
        flip_vector(n[24:27]), n[27], flip_vector(n[28:31])), n[31]


def motor_pwm(t: int, pwm: Quat, shutdown: bool, reason: int) -> bytes:
    """Encode the four motor commands."""
    return _PWM.stamped(t, *pwm, shutdown, reason)


def decode_motor_pwm(data: bytes) -> tuple[int, Quat, bool]:
    """Return (stamp ns, (4,) PWM, shutdown flag)."""
    n = _PWM.unpack(data)
    return _stamp(n), n[2:6], n[6]


def decode_motor_state(data: bytes) -> tuple[int, bool, int]:
    """Return (stamp ns, shutdown flag, why the controller does not fly as planned; 0: it does)."""
    n = _PWM.unpack(data)
    return _stamp(n), n[6], n[7]


def estimator_state(t: int, status: int, height: float, vertical_velocity: float,
                    gyro_bias: Vec3, accel_bias: Vec3, barometer_offset: float,
                    sonar: tuple[float, float], flow: tuple[float, float, float],
                    barometer: tuple[float, float], refused: tuple[int, int, int],
                    invalid: int, health: tuple[int, ...], age: tuple[float, ...],
                    not_finite: tuple[int, ...], dropped: tuple[int, ...]) -> bytes:
    """
    Encode the estimator's inner state.

    Parameters
    ----------
    t : ns
    status : int
        ``EstimatorState.STATUS_*``.
    height, vertical_velocity : m, m/s, positive up
    gyro_bias, accel_bias : (3,) rad/s, m/s^2, body FRD
    barometer_offset : m
    sonar, barometer : (innovation m, test ratio)
    flow : (innovation forward m/s, innovation right m/s, test ratio)
    refused : counts of sonar, flow, barometer
    invalid : count
    health : (5,) ``EstimatorState.HEALTH_*`` of gyro, accelerometer, sonar, flow, barometer
    age : (5,) s
    not_finite : (5,) counts
    dropped : (4,) counts of IMU, sonar, flow, barometer

    """
    return _ESTIMATOR.stamped(
        t, status, height, vertical_velocity, *flip_vector(gyro_bias), *flip_vector(accel_bias),
        barometer_offset, *sonar, flow[0], -flow[1], flow[2], *barometer, *refused, invalid,
        *health, *age, *not_finite, *dropped)


def controller_state(t: int, position_error: Vec3, velocity_error: Vec3, integral: Vec3,
                     integral_rate: Vec3, virtual_input: Vec3, attitude_desired: Quat,
                     attitude_error: float, angular_velocity_error: Vec3, thrust: float,
                     torque: Vec3, motor_thrust: Quat,
                     saturated: tuple[bool, bool, bool, bool]) -> bytes:
    """Encode the controller's inner signals; inertial vectors NED, body vectors FRD."""
    return _CONTROLLER.stamped(
        t, *flip_vector(position_error), *flip_vector(velocity_error), *flip_vector(integral),
        *flip_vector(integral_rate), *flip_vector(virtual_input),
        *wire_quaternion(attitude_desired), attitude_error,
        *flip_vector(angular_velocity_error), thrust, *flip_vector(torque), *motor_thrust,
        *saturated)
