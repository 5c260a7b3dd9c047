"""Vibration that is taken off the published velocity."""

from joint_states import any_state
from mambo_estimation.health import NEW
from mambo_estimation.joint import vibration
from mambo_estimation.joint.vibration import CALM, LARGEST, LEFT
from mambo_model.motion.quaternion import rotate_inverse
import numpy as np

DT, HOVER = 0.005, -9.81


def force_of(x, shake=(0.0, 0.0, 0.0)):
    """Return what the accelerometer reads in hover with drag, bias and vibration."""
    nu = rotate_inverse(x.q, x.v)
    drag = (x.drag[0] * HOVER * nu[0], x.drag[1] * HOVER * nu[1], HOVER)
    return tuple(np.add(np.add(drag, x.accel_bias), shake))


def test_drag_and_bias_are_no_vibration():
    x, v = any_state(), CALM
    for _ in range(100):
        v = vibration.shaken(v, x, force_of(x), DT)
    np.testing.assert_allclose(v.velocity, 0.0, atol=1e-12)


def test_most_of_a_vibration_is_found():
    x, v, rng = any_state(), CALM, np.random.default_rng(1)
    draws, sigma = rng.standard_normal((5001, 3)), 1.0
    sample = sigma * np.sqrt(0.5) * np.diff(draws, axis=0)
    mean = 0.5 * (sample[1:] + sample[:-1])
    true, found = np.cumsum(mean, axis=0) * DT, []
    for push in mean:
        v = vibration.shaken(v, x, force_of(x, push), DT)
        found.append(v.velocity)
    true, found = true[200:] - true[200:].mean(axis=0), np.array(found)[200:]
    left = np.var(true - found, axis=0) / np.var(true, axis=0)
    np.testing.assert_allclose(left[:2], LEFT, rtol=0.2)
    assert left[2] < 0.5  # of the thrust some is taken for motion
    sensor = NEW._replace(noise=(1.5 * sigma ** 2,) * 3)
    np.testing.assert_allclose(vibration.variance(sensor, DT), np.var(true, axis=0), rtol=0.1)


def test_a_blow_is_no_vibration():
    x = any_state()
    v = vibration.shaken(CALM, x, force_of(x, (80.0, -80.0, 0.0)), DT)
    np.testing.assert_allclose(v.velocity[:2], (LARGEST, -LARGEST))
