"""Vibration that is taken off the published velocity."""

from joint_states import any_state
from mambo_estimation.health import NEW
from mambo_estimation.joint import vibration
from mambo_estimation.joint.vibration import CALM, LARGEST, LEFT, LEFT_DOWN
from mambo_model.motion.quaternion import rotate_inverse
import numpy as np
import pytest

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
    sensor = NEW._replace(noise=(1.5 * sigma ** 2,) * 3)
    np.testing.assert_allclose(vibration.variance(sensor, DT), np.var(true, axis=0), rtol=0.1)


def left_along_z(thrust, seed=2):
    """Return the variance that is left of a vibration along z, m^2/s^2, and what is stated."""
    x, v, rng = any_state(), CALM, np.random.default_rng(seed)
    draw = 0.92 * rng.standard_normal(len(thrust) + 1)  # 1.3 m/s^2 of vibration
    found, on = [], slice(2000, None)
    for s, push in zip(thrust, np.diff(draw), strict=True):
        v = vibration.shaken(v, x, force_of(x, (0.0, 0.0, s + push)), DT)
        found.append(v.velocity[2])
    return np.var(DT * draw[1:][on] - np.array(found)[on]), vibration.left(v, NEW, DT)[2]


def test_most_of_the_whole_draw_is_taken_off_along_z_while_the_thrust_changes_slowly():
    true, stated = left_along_z(np.zeros(20000))
    # as the Riccati equation says, of the draw that the rectangle rule leaves
    assert true == pytest.approx(0.11 * (0.92 * DT) ** 2, rel=0.25)
    assert 0.5 * stated < true < stated   # LEFT_DOWN allows for a thrust that changes
    t = DT * np.arange(20000)   # a vertical circle of 1 m at 1 rad/s
    true, stated = left_along_z(np.sin(t))
    assert 0.5 * stated < true < 1.3 * stated
    assert stated == pytest.approx(LEFT_DOWN * 1.13 * (0.92 * DT) ** 2, rel=0.3)


def test_after_a_lost_sample_the_thrust_is_followed_on():
    x, v = any_state(), CALM
    for _ in range(100):
        v = vibration.shaken(v, x, force_of(x), DT)
    v = vibration.shaken(v, x, force_of(x, (0.0, 0.0, 2.0)), 0.5)
    assert abs(v.velocity[2]) <= LARGEST and abs(v.slope) < 0.01
    for _ in range(200):
        v = vibration.shaken(v, x, force_of(x), DT)
    assert abs(v.velocity[2]) < 1e-3


def test_a_blow_is_no_vibration():
    x = any_state()
    v = vibration.shaken(CALM, x, force_of(x, (80.0, -80.0, 0.0)), DT)
    np.testing.assert_allclose(v.velocity[:2], (LARGEST, -LARGEST))
