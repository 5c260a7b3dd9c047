"""Sensors of any rate: what a flight publishes is finite as soon as the motors turn."""

from mambo_bags.reader import read_bag
from mambo_flight import closed_loop, recording_to_bag
from mambo_flight.scenario import scenario
import numpy as np
import pytest


def finite(messages, path):
    return np.isfinite(np.asarray(messages[path], dtype=float)).reshape(len(messages), -1).all(1)


@pytest.mark.parametrize('sonar, flow, barometer', [
    (200.0, 200.0, 200.0), (150.0, 70.0, 30.0), (22.0, 200.0, 199.0)])
def test_the_state_of_the_controller_is_nan_only_while_the_motors_are_stopped(
        tmp_path, sonar, flow, barometer):
    rates = {'sonar': sonar, 'optical_flow': flow, 'barometer': barometer}
    flown = scenario(duration=3.0, land=False, overrides={
        f'sim_node.simulator.{name}.rate': rate for name, rate in rates.items()})
    # byte for byte what the nodes publish: tests/graph/test_graph.py
    recording_to_bag.write(tmp_path / 'bag', flown, closed_loop.fly(flown, inner=True))
    flight = read_bag(tmp_path / 'bag')
    for name, rate in rates.items():
        topic = {'sonar': 'sonar/range', 'barometer': 'barometer/pressure'}.get(name, name)
        assert len(flight[topic]) == pytest.approx(3.0 * rate, abs=2.0)
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
