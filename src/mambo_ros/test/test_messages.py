"""
Every message as the middleware reads it: z up, body FLU, quaternion x y z w; hand-made cases.
"""

import math
import struct

from geometry_msgs.msg import PoseStamped
from mambo_interfaces.msg import (
    ControllerState, EstimatorState, MotorPwm, OpticalFlow, Reference, SensorTick)
from mambo_model.motion import flatness
from mambo_model.motion.quaternion import from_euler
from mambo_model.motion.rigid_body import State
from mambo_ros import messages
from mambo_ros.cdr import serialize
from mambo_ros.layout import LayoutError
from nav_msgs.msg import Odometry
import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import FluidPressure, Imu, Range

T = 12_000_000_345  # ns
NAN = math.nan
LEVEL = (1.0, 0.0, 0.0, 0.0)
ZERO3, ZERO36 = (0.0,) * 3, (0.0,) * 36
AWKWARD = (0.1, -0.0, 5e-324, -math.inf, 1.0 + 2**-52, -1e300, 1 / 3)
HALF_TURN = np.diag([1.0, -1.0, -1.0])  # about x: NED to z up, FRD to FLU


def awkward(count, start=0):
    """Return numbers that any arithmetic other than a change of sign would alter."""
    return tuple(AWKWARD[(start + i) % len(AWKWARD)] for i in range(count))


def bits(value):
    """Return the bytes of every number of nested tuples, or the number of an int."""
    if isinstance(value, tuple):
        return b''.join(map(bits, value))
    return struct.pack('d', value) if isinstance(value, float) else str(value).encode()


def xyz(vector):
    return vector.x, vector.y, vector.z


def xyzw(quaternion):
    return quaternion.x, quaternion.y, quaternion.z, quaternion.w


def read(data, kind):
    """Return the message that rclpy makes of our bytes; the stamp must be T."""
    message = deserialize_message(data, kind)
    stamp = message.clock if kind is Clock else message.header.stamp
    assert (stamp.sec, stamp.nanosec) == (12, 345)
    return message


def state(rho=ZERO3, nu=ZERO3, q=LEVEL, omega=ZERO3):
    return State(rho, nu, q, omega)


def odometry(s):
    return read(messages.ground_truth(T, s), Odometry)


def reference(**fields):
    zero = flatness.Reference(*[ZERO3] * 5, LEVEL, ZERO3, ZERO3, 0.667, ZERO3)
    return read(messages.reference(T, zero._replace(**fields), Reference.PHASE_TRACK), Reference)


def estimator_state(**fields):
    values = {
        'status': 2, 'height': 1.5, 'vertical_velocity': 0.1, 'gyro_bias': ZERO3,
        'accel_bias': ZERO3, 'barometer_offset': 0.0, 'sonar': (0.0, 0.0),
        'flow': (0.0, 0.0, 0.0), 'barometer': (0.0, 0.0), 'refused': (0, 0, 0), 'invalid': 0,
        'health': (0,) * 5, 'age': (0.0,) * 5, 'not_finite': (0,) * 5, 'dropped': (0,) * 4}
    return read(messages.estimator_state(T, **{**values, **fields}), EstimatorState)


def controller_state(**fields):
    values = {
        'position_error': ZERO3, 'velocity_error': ZERO3, 'integral': ZERO3,
        'integral_rate': ZERO3, 'virtual_input': ZERO3, 'attitude_desired': LEVEL,
        'attitude_error': 0.0, 'angular_velocity_error': ZERO3, 'thrust': 0.667,
        'torque': ZERO3, 'motor_thrust': (0.1, 0.2, 0.3, 0.4), 'saturated': (False,) * 4}
    return read(messages.controller_state(T, **{**values, **fields}), ControllerState)


def test_above_the_floor_is_positive_on_the_wire():
    assert xyz(odometry(state(rho=(1.0, 2.0, -1.5))).pose.pose.position) == (1.0, -2.0, 1.5)


def test_moving_right_and_down_is_moving_negative_left_and_negative_up():
    message = odometry(state(nu=(0.1, 0.2, 0.3), omega=(1.0, 2.0, 3.0)))
    assert xyz(message.twist.twist.linear) == (0.1, -0.2, -0.3)
    assert xyz(message.twist.twist.angular) == (1.0, -2.0, -3.0)


@pytest.mark.parametrize('euler, axis, points', [
    ((0.0, 0.3, 0.0), (1, 0, 0), (math.cos(0.3), 0.0, math.sin(0.3))),  # nose up
    ((0.3, 0.0, 0.0), (0, 1, 0), (0.0, math.cos(0.3), math.sin(0.3))),  # right side down
    ((0.0, 0.0, 0.3), (1, 0, 0), (math.cos(0.3), -math.sin(0.3), 0.0)),  # nose to the right
])
def test_an_attitude_is_turned_into_the_frame_of_a_viewer(euler, axis, points):
    message = odometry(state(q=from_euler(*euler)))
    turned = Rotation.from_quat(xyzw(message.pose.pose.orientation)).apply(axis)
    np.testing.assert_allclose(turned, points, atol=1e-15)  # rounding of a few products


def test_truth_is_in_map_and_the_estimate_in_odom():
    truth = odometry(state())
    guess = read(messages.estimate(T, state(), ZERO36, ZERO36), Odometry)
    assert (truth.header.frame_id, truth.child_frame_id) == ('map', 'base_link')
    assert (guess.header.frame_id, guess.child_frame_id) == ('odom', 'base_link')
    assert not truth.pose.covariance.any() and not truth.twist.covariance.any()


def test_covariances_turn_with_their_axes():
    rng = np.random.default_rng(1)
    root = rng.normal(size=(2, 6, 6))
    pose, twist = root @ np.swapaxes(root, 1, 2)
    message = read(messages.estimate(
        T, state(), tuple(pose.reshape(-1)), tuple(twist.reshape(-1))), Odometry)
    turn = np.kron(np.eye(2), HALF_TURN)
    for sent, inside in ((message.pose.covariance, pose), (message.twist.covariance, twist)):
        np.testing.assert_array_equal(np.reshape(sent, (6, 6)), turn @ inside @ turn.T)
    x_and_z = 2
    assert message.pose.covariance[x_and_z] == -pose[0, 2]  # further forward and higher


def test_the_variances_of_an_estimate_come_back():
    rng = np.random.default_rng(2)
    pose, twist = np.diag(rng.random(6)), np.diag(rng.random(6))
    for _ in range(2):  # the larger one counts
        data = messages.estimate(
            T, state(), tuple(pose.reshape(-1)), tuple(twist.reshape(-1)))
        p, w = np.diag(pose), np.diag(twist)
        assert messages.decode_estimate(data)[2] == (
            max(p[0], p[1]), p[2], max(w[0], w[1]), max(p[3], p[4]), max(w[3:]))
        pose, twist = pose[::-1, ::-1], twist[::-1, ::-1]


def test_an_imu_at_rest_reads_gravity_upward_and_no_orientation():
    message = read(messages.imu(
        T, (0.1, 0.2, 0.3), (0.0, 0.5, -9.81), (1e-4, 2e-4, 3e-4), (0.01, 0.02, 0.03)), Imu)
    assert message.header.frame_id == 'base_link'
    assert xyz(message.linear_acceleration) == (0.0, -0.5, 9.81)  # REP-145: +g on z at rest
    assert xyz(message.angular_velocity) == (0.1, -0.2, -0.3)
    assert message.orientation_covariance[0] == -1.0  # REP-145: there is no orientation
    assert not message.orientation_covariance[1:].any()
    assert list(message.angular_velocity_covariance) == [1e-4, 0, 0, 0, 2e-4, 0, 0, 0, 3e-4]
    assert list(message.linear_acceleration_covariance) == [0.01, 0, 0, 0, 0.02, 0, 0, 0, 0.03]


def test_a_sonar_message_has_its_kind_and_limits():
    message = read(messages.sonar(T, 1.5, 0.25, 5.25, 1.4), Range)
    assert message.header.frame_id == 'base_link'
    assert message.radiation_type == Range.ULTRASOUND
    assert (message.min_range, message.max_range, message.range) == (0.25, 5.25, 1.5)
    assert message.field_of_view == np.float32(1.4)


@pytest.mark.parametrize('distance, seen', [
    (0.25, 0.25), (5.25, 5.25), (1.5, 1.5),  # the limits are part of the range
    (0.2, NAN), (5.3, NAN), (math.inf, NAN), (-math.inf, NAN), (NAN, NAN), (0.0, NAN)])
def test_an_echo_out_of_the_limits_is_none(distance, seen):
    t, found = messages.decode_sonar(messages.sonar(T, distance, 0.25, 5.25, 1.4))
    assert t == T
    assert found == pytest.approx(seen, abs=0.0, nan_ok=True)


def test_a_limit_that_float32_narrows_is_still_part_of_the_range():
    low, high = 0.43431580, 5.26  # neither is a float32
    for limit in (low, high):
        _, found = messages.decode_sonar(messages.sonar(T, limit, low, high, 1.4))
        assert found == np.float32(limit)


def test_flow_has_the_sign_of_the_motion_of_the_vehicle():
    message = read(messages.optical_flow(T, (0.4, 0.2), 180, 0.5), OpticalFlow)
    assert (message.rate_x, message.rate_y) == (0.4, -0.2)  # forward; right is minus left
    assert (message.quality, message.integration_time) == (180, 0.5)
    assert message.header.frame_id == 'base_link'
    assert messages.decode_optical_flow(serialize(message)) == (T, (0.4, 0.2), 180)


def test_pressure_keeps_its_value_and_variance():
    message = read(messages.pressure(T, 101325.25, 9.0), FluidPressure)
    assert (message.fluid_pressure, message.variance) == (101325.25, 9.0)
    assert message.header.frame_id == 'base_link'
    assert messages.decode_pressure(serialize(message)) == (T, 101325.25)


def test_the_watermark_counts_each_sensor_by_name():
    message = read(messages.sensor_tick(T, 1, 2, 3, 4), SensorTick)
    assert (message.imu, message.sonar, message.optical_flow, message.barometer) == (1, 2, 3, 4)
    assert messages.decode_sensor_tick(serialize(message)) == (T, (1, 2, 3, 4))


def test_the_clock_is_flight_time():
    assert read(messages.clock(T), Clock)


def test_a_pose_of_motion_capture_is_in_map():
    message = read(messages.optitrack(T, (1.0, 2.0, -3.0), (0.5, -0.5, 0.5, -0.5)), PoseStamped)
    assert message.header.frame_id == 'map'
    assert xyz(message.pose.position) == (1.0, -2.0, 3.0)
    assert xyzw(message.pose.orientation) == (-0.5, -0.5, 0.5, 0.5)


@pytest.mark.parametrize('inside, wire', [
    ('rho', 'position'), ('v', 'velocity'), ('a', 'acceleration'), ('j', 'jerk'), ('s', 'snap'),
    ('omega', 'angular_velocity'), ('omega_dot', 'angular_acceleration'), ('tau', 'torque')])
def test_every_vector_of_the_reference_is_in_its_field(inside, wire):
    message = reference(**{inside: (1.0, 2.0, 3.0)})
    assert xyz(getattr(message, wire)) == (1.0, -2.0, -3.0)
    others = {'position', 'velocity', 'acceleration', 'jerk', 'snap', 'angular_velocity',
              'angular_acceleration', 'torque'} - {wire}
    assert not any(any(xyz(getattr(message, name))) for name in others)


def test_thrust_phase_and_attitude_of_the_reference():
    message = reference(q=(0.5, 0.5, -0.5, 0.5), f=0.7)
    assert message.header.frame_id == 'odom'
    assert message.thrust == 0.7  # a length along body up: the same number either way
    assert message.phase == Reference.PHASE_TRACK
    assert xyzw(message.attitude) == (0.5, 0.5, -0.5, 0.5)


def test_motor_commands_keep_their_order():
    message = read(messages.motor_pwm(
        T, (10.0, 20.0, 30.0, 40.0), True, MotorPwm.REASON_ATTITUDE), MotorPwm)
    assert list(message.pwm) == [10.0, 20.0, 30.0, 40.0]
    assert message.shutdown and message.reason == MotorPwm.REASON_ATTITUDE
    assert messages.decode_motor_pwm(serialize(message)) == (T, (10.0, 20.0, 30.0, 40.0), True)


def test_biases_and_flow_innovation_of_the_estimator_are_in_flu():
    message = estimator_state(
        gyro_bias=(0.1, 0.2, 0.3), accel_bias=(1.0, 2.0, 3.0), flow=(0.4, 0.5, 0.6))
    assert message.header.frame_id == 'base_link'
    assert xyz(message.gyro_bias) == (0.1, -0.2, -0.3)
    assert xyz(message.accel_bias) == (1.0, -2.0, -3.0)
    assert list(message.flow_innovation) == [0.4, -0.5]
    assert message.flow_test_ratio == 0.6


def test_heights_of_the_estimator_are_positive_up_inside_too():
    message = estimator_state(
        height=1.5, vertical_velocity=0.2, barometer_offset=0.3, sonar=(0.01, 0.02),
        barometer=(0.03, 0.04), refused=(5, 6, 7), invalid=8)
    assert (message.height, message.vertical_velocity) == (1.5, 0.2)
    assert message.barometer_offset == 0.3
    assert (message.sonar_innovation, message.sonar_test_ratio) == (0.01, 0.02)
    assert (message.barometer_innovation, message.barometer_test_ratio) == (0.03, 0.04)
    assert (message.sonar_refused, message.flow_refused, message.barometer_refused) == (5, 6, 7)
    assert (message.invalid_samples, message.status) == (8, EstimatorState.STATUS_NOMINAL)


def test_health_of_the_sensors_keeps_its_order():
    message = estimator_state(
        health=(0, 1, 2, 3, 5), age=(0.0, 0.5, 1.0, math.inf, 2.0), not_finite=(1, 2, 3, 4, 5),
        dropped=(6, 7, 8, 9))
    assert list(message.health) == [0, 1, 2, 3, 5]
    assert message.health[EstimatorState.BAROMETER] == EstimatorState.HEALTH_STUCK
    assert message.health[EstimatorState.SONAR] == EstimatorState.HEALTH_MISSING
    assert list(message.age) == [0.0, 0.5, 1.0, math.inf, 2.0]
    assert list(message.not_finite) == [1, 2, 3, 4, 5] and list(message.dropped) == [6, 7, 8, 9]


@pytest.mark.parametrize('name', [
    'position_error', 'velocity_error', 'integral', 'integral_rate', 'virtual_input',
    'angular_velocity_error', 'torque'])
def test_every_vector_of_the_controller_is_in_its_field(name):
    message = controller_state(**{name: (1.0, 2.0, 3.0)})
    assert xyz(getattr(message, name)) == (1.0, -2.0, -3.0)
    assert sum(any(xyz(getattr(message, other))) for other in (
        'position_error', 'velocity_error', 'integral', 'integral_rate', 'virtual_input',
        'angular_velocity_error', 'torque')) == 1


def test_numbers_of_the_controller_keep_their_order():
    message = controller_state(
        attitude_desired=(0.5, 0.5, -0.5, 0.5), attitude_error=0.2,
        saturated=(False, True, False, False))
    assert message.header.frame_id == 'odom'
    assert xyzw(message.attitude_desired) == (0.5, 0.5, -0.5, 0.5)
    assert (message.attitude_error, message.thrust) == (0.2, 0.667)
    assert list(message.motor_thrust) == [0.1, 0.2, 0.3, 0.4]
    assert list(message.saturated) == [False, True, False, False]


def test_nan_stays_in_its_field():
    message = read(messages.imu(T, (0.0, NAN, 0.0), (0.0, 0.0, NAN), ZERO3, ZERO3), Imu)
    assert [math.isnan(x) for x in xyz(message.angular_velocity)] == [False, True, False]
    assert [math.isnan(x) for x in xyz(message.linear_acceleration)] == [False, False, True]
    assert math.isnan(read(messages.optical_flow(T, (NAN, 0.1), 0), OpticalFlow).rate_x)
    state = estimator_state(sonar=(NAN, NAN), flow=(NAN, NAN, NAN), barometer_offset=NAN)
    assert math.isnan(state.sonar_innovation) and math.isnan(state.sonar_test_ratio)
    assert np.isnan(state.flow_innovation).all() and math.isnan(state.flow_test_ratio)
    assert math.isnan(state.barometer_offset)
    assert not math.isnan(state.barometer_innovation) and state.height == 1.5
    law = controller_state(position_error=(NAN,) * 3, attitude_desired=(NAN,) * 4)
    assert np.isnan(xyz(law.position_error)).all() and np.isnan(xyzw(law.attitude_desired)).all()
    assert not np.isnan(xyz(law.velocity_error)).any()
    _, pressure = messages.decode_pressure(messages.pressure(T, NAN, 0.0))
    assert math.isnan(pressure)


@pytest.mark.parametrize('start', range(len(AWKWARD)))
def test_a_round_trip_gives_back_every_bit(start):
    three, four = awkward(3, start), awkward(4, start)
    s = State(three, awkward(3, start + 1), four, awkward(3, start + 2))
    ref = flatness.Reference(
        *(awkward(3, start + i) for i in range(5)), four, three, awkward(3, start + 4),
        AWKWARD[start], awkward(3, start + 3))
    for data, decode, want in [
            (messages.ground_truth(T, s), messages.decode_odometry, (T, s)),
            (messages.estimate(T, s, ZERO36, awkward(36, start)), messages.decode_odometry,
             (T, s)),
            (messages.imu(T, three, s.nu, ZERO3, ZERO3), messages.decode_imu, (T, three, s.nu)),
            (messages.optical_flow(T, three[:2], 7), messages.decode_optical_flow,
             (T, three[:2], 7)),
            (messages.pressure(T, three[0], 1.0), messages.decode_pressure, (T, three[0])),
            (messages.optitrack(T, three, four), messages.decode_pose, (T, three, four)),
            (messages.reference(T, ref, 3), messages.decode_reference, (T, ref, 3)),
            (messages.motor_pwm(T, four, False, 0), messages.decode_motor_pwm,
             (T, four, False))]:
        assert bits(tuple(decode(data))) == bits(want), decode.__name__


@pytest.mark.parametrize('t', [0, 1, 999_999_999, 1_000_000_000, 2**31 * 1_000_000_000 - 1])
def test_a_stamp_survives_to_the_nanosecond(t):
    assert messages.decode_pressure(messages.pressure(t, 1.0, 1.0))[0] == t


def test_messages_of_another_driver_are_read_by_their_fields():
    message = Odometry(child_frame_id='drone')
    message.header.frame_id = 'hall'
    message.header.stamp.sec, message.header.stamp.nanosec = 12, 345
    message.pose.pose.position.z = 1.5
    message.pose.pose.orientation.w = 1.0
    message.twist.twist.linear.y = 0.25
    t, s = messages.decode_odometry(serialize_message(message))
    assert (t, s.rho, s.nu, s.q) == (T, (0.0, 0.0, -1.5), (0.0, -0.25, 0.0), LEVEL)


@pytest.mark.parametrize('decode', [
    messages.decode_imu, messages.decode_sonar, messages.decode_optical_flow,
    messages.decode_pressure, messages.decode_sensor_tick, messages.decode_odometry,
    messages.decode_pose, messages.decode_reference, messages.decode_motor_pwm])
def test_bytes_of_something_else_are_refused(decode):
    with pytest.raises(LayoutError, match='bytes are not a'):
        decode(b'\x00\x01\x00\x00\x00')
