"""A smoothed flight in the form of an estimate."""

from hypothesis import given, settings, strategies as st
from mambo_flight.smooth.odometry import odometry
import numpy as np
from scipy.spatial.transform import Rotation
from smoothed_flight import made_up, N, steps


def test_velocity_and_its_covariance_are_in_body_axes():
    s = made_up()
    turn = Rotation.from_euler('z', 90.0, degrees=True)
    s.x[:, 6:10] = turn.as_quat()[[3, 0, 1, 2]]
    made = odometry(s, steps(), 0.01)
    np.testing.assert_allclose(made.state[:, 3:6], [[0.0, -2.0, 0.0]] * N, atol=1e-12)
    twist = made.twist_covariance.reshape(N, 6, 6)[0]
    np.testing.assert_allclose(np.diag(twist)[:3], [5.0, 4.0, 6.0])  # x and y change places
    np.testing.assert_allclose(np.diag(twist)[3:], np.array([10.0, 11.0, 12.0]) + 1e-4)


def test_pose_and_rate_without_bias():
    s = made_up()
    s.x[:, 10:13] = 0.02
    made = odometry(s, steps(), 0.01)
    np.testing.assert_allclose(made.state[:, 10:], 0.08)
    np.testing.assert_array_equal(made.state[:, :3], s.x[:, :3])
    pose = made.pose_covariance.reshape(N, 6, 6)[0]
    np.testing.assert_array_equal(np.diag(pose), [1, 2, 3, 7, 8, 9])


ANGLE = st.floats(-3.0, 3.0)


@given(angles=st.tuples(ANGLE, ANGLE, ANGLE))
@settings(max_examples=30, deadline=None)
def test_any_attitude_turns_the_velocity_and_keeps_its_uncertainty(angles):
    s = made_up()
    turn = Rotation.from_rotvec(angles)
    s.x[:, 6:10] = turn.as_quat()[[3, 0, 1, 2]]
    made = odometry(s, steps(), 0.0)
    np.testing.assert_allclose(turn.apply(made.state[:, 3:6]), s.x[:, 3:6], atol=1e-12)
    twist = made.twist_covariance.reshape(N, 6, 6)[-1]
    np.testing.assert_allclose(twist, twist.T, atol=1e-12)
    np.testing.assert_allclose(np.linalg.eigvalsh(twist[:3, :3]), [4.0, 5.0, 6.0], atol=1e-9)
    np.testing.assert_array_equal(twist[:3, 3:], 0.0)
    inertial = made.pose_covariance.reshape(N, 6, 6)[-1]  # does not turn with the body
    np.testing.assert_array_equal(np.diag(inertial), [1, 2, 3, 7, 8, 9])
