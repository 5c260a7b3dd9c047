"""Sensors of any rate: what the nodes publish is finite as soon as the motors turn."""

import os
import subprocess
import sys

from mambo_bags.reader import read_bag
import numpy as np
import pytest

LIMIT = 200.0  # s


def finite(messages, path):
    return np.isfinite(np.asarray(messages[path], dtype=float)).reshape(len(messages), -1).all(1)


@pytest.mark.parametrize('sonar, flow, barometer', [
    (200.0, 200.0, 200.0), (150.0, 70.0, 30.0), (22.0, 200.0, 199.0)])
def test_the_state_of_the_controller_is_nan_only_while_the_motors_are_stopped(
        tmp_path, sonar, flow, barometer):
    bag = tmp_path / 'bag'
    values = {'sonar.rate': sonar, 'optical_flow.rate': flow, 'barometer.rate': barometer}
    done = subprocess.run(
        [sys.executable, '-m', 'mambo_bringup.run', '--composed', '--duration', '3',
         '--no-landing', '--no-report', '--output', str(bag),
         '--set', 'estimator_node.kalman.barometer.enabled=true',
         *(part for name, value in values.items()
           for part in ('--set', f'sim_node.simulator.{name}={value}'))],
        capture_output=True, text=True, timeout=LIMIT, env={**os.environ, 'ROS_DOMAIN_ID': ''})
    assert done.returncode == 0, done.stderr
    flight = read_bag(bag)
    state, estimate = flight['controller/state'], flight['estimate/odom']
    turning = (flight['motor_pwm']['pwm'] > 0.0).any(axis=1)
    assert 300 < turning.sum() < len(turning)
    for name in ('position_error', 'velocity_error', 'virtual_input', 'angular_velocity_error'):
        for axis in 'xyz':
            np.testing.assert_array_equal(finite(state, f'{name}.{axis}'), turning)
    np.testing.assert_array_equal(finite(state, 'attitude_error'), turning)
    for name in ('thrust', 'integral.x', 'torque.z'):
        assert finite(state, name).all()
    for name in ('pose.pose.position.z', 'twist.twist.linear.x', 'pose.covariance'):
        assert finite(estimate, name).all()
