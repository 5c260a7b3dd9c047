"""The flow as the joint filter predicts it, at its own time, and its derivative."""

from joint_states import any_state, derivative
from mambo_estimation.joint import flow, propagation
from mambo_estimation.joint.joint_parameters import FlowParams
from mambo_estimation.joint.state import LATENCY, SIZE
from mambo_model.motion.quaternion import from_euler, rotate_inverse
import numpy as np
import pytest

G, DT = 9.81, 0.005
VALUES = FlowParams().values()


def flown(seed, latency, steps=40):
    """Return a ring of inertial samples, where its next one goes, the state and those before."""
    x, ring, at, states = any_state(seed, latency), np.zeros((flow.RING, 7)), 0, []
    for k in range(steps):
        states.append(x)
        thrust = -9.81 - np.sin(0.1 * k)
        gyro = tuple(0.5 * np.sin([0.03 * k, 0.05 * k + 1.0, 0.04 * k]) + x.gyro_bias)
        nu = np.array(rotate_inverse(x.q, x.v))
        accel = (*(np.array(x.drag) * thrust * nu[:2] + x.accel_bias[:2]),
                 thrust + x.accel_bias[2])
        at = flow.remember(ring, at, gyro, accel, DT)
        x = propagation.move(x, gyro, accel, DT, G)
    return ring, at, x, states


@pytest.mark.parametrize('seed', range(3))
@pytest.mark.parametrize('latency', [0.0, 0.03, 0.1])
def test_state_of_then_is_found_again(seed, latency):
    ring, at, x, states = flown(seed, latency)
    past = flow.look_back(x, ring, at, G)
    assert past.age == pytest.approx(latency)
    then = states[len(states) - round(latency / DT)] if latency else x
    np.testing.assert_allclose(past.x.p, then.p, atol=1e-4)
    np.testing.assert_allclose(past.x.v, then.v, atol=2e-3)
    np.testing.assert_allclose(past.x.q, then.q, atol=1e-9)


@pytest.mark.parametrize('seed', range(3))
@pytest.mark.parametrize('latency', [0.0, 0.0325, 0.1025])  # between two inertial samples
def test_jacobian_by_finite_differences(seed, latency):
    ring, at, x, _ = flown(seed, latency)
    past, H, size = flow.look_back(x, ring, at, G), np.empty((2, SIZE)), 1e-5
    flow.jacobian(past, x.v, G, VALUES, H)

    def expected(y):
        return np.array(flow.predict(flow.look_back(y, ring, at, G), VALUES))
    found = derivative(expected, x, size)
    if latency == 0.0:  # one-sided: there is no sample of the future
        found[:, LATENCY] = (expected(x._replace(latency=size)) - expected(x)) / size
    others = [i for i in range(SIZE) if i != LATENCY]
    largest = np.abs(found[:, others]).max()
    # left out: third power of the latency, and that the tilt changes meanwhile: 3 % in 0.1 s
    np.testing.assert_allclose(
        H[:, others], found[:, others], atol=(0.03 if latency else 1e-6) * largest)
    # left out: how the rotation that leaks in changes, which a sample of the gyro does not tell
    np.testing.assert_allclose(
        H[:, LATENCY], found[:, LATENCY], atol=0.01 * np.abs(found[:, LATENCY]).max())


def test_factor_is_held_outside_the_calibrated_heights():
    x = any_state(0)
    low = flow.factor_at(VALUES.factor_min_height, x, VALUES)
    assert flow.factor_at(0.1, x, VALUES) == low
    assert flow.factor_at(1.5, x, VALUES) == (x.scale, 0.0)


@pytest.mark.parametrize('change', [
    {'sample': (21.0, 0.0)}, {'quality': 0}, {'height': 0.3}, {'roll': 0.9}])
def test_a_sample_that_cannot_be_trusted_is_not_valid(change):
    x = any_state(0)
    given = {'sample': (0.1, 0.2), 'quality': 255, 'height': 1.0, 'roll': 0.0, **change}
    x = x._replace(p=(0.0, 0.0, -given['height']), q=from_euler(given['roll'], 0.0, 0.0))
    assert not flow.is_valid(given['sample'], x, given['quality'], VALUES)
    good = x._replace(p=(0.0, 0.0, -1.0), q=(1.0, 0.0, 0.0, 0.0))
    assert flow.is_valid((0.1, 0.2), good, 255, VALUES)
