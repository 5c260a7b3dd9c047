"""Optical flow: a pin-hole camera over flat ground, the factor Q, and the rotation of C8."""

import math

from mambo_estimation.measurements import optical_flow
from mambo_estimation.measurements.optical_flow import FlowParams
from mambo_model.schema import ParameterError
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

V = FlowParams().values()
STILL = (0.0, 0.0, 0.0)


def random_state(seed):
    rng = np.random.default_rng(seed)
    R = Rotation.from_rotvec(rng.uniform(-0.4, 0.4, 3))
    return rng.uniform(0.5, 3.0), rng.normal(size=3), R, rng.normal(size=3)


def rows(R):
    return tuple(map(tuple, R.as_matrix().tolist()))


def image_motion(height, v, R, omega):
    """Return the image velocity of the ground point on the optical axis, by projecting it."""
    position = np.array([0.0, 0.0, -height])
    axis = R.as_matrix()[:, 2]
    ground, dt = position + axis * height / axis[2], 1e-5

    def image(t):
        in_camera = (R * Rotation.from_rotvec(omega * t)).inv().apply(ground - position - v * t)
        return in_camera[:2] / in_camera[2]

    return (image(dt) - image(-dt)) / (2 * dt)


@pytest.mark.parametrize('seed', range(10))
def test_flow_of_a_pin_hole_camera_gives_the_body_velocity(seed):
    h, v, R, omega = random_state(seed)
    motion = image_motion(h, v, R, omega)
    flow = -motion + [-omega[1], omega[0]]  # sign of the vehicle, rotation removed
    nu, std = optical_flow.measured_velocity(
        tuple(flow), h, R.as_matrix()[2, 2], STILL, FlowParams(constant=1.0).values())
    # central difference: dt^2 and rounding / dt, both below 1e-8
    np.testing.assert_allclose(nu, R.inv().apply(v)[:2], atol=1e-7)
    assert std == pytest.approx(V.noise * h / R.as_matrix()[2, 2])


@pytest.mark.parametrize('leak', [1.0, -1.0, 0.5])
def test_rotation_left_in_by_the_sensor_is_subtracted(leak):
    h, v, R, omega = random_state(3)
    rotation = np.array([omega[1], -omega[0]])  # as it stands in the image, vehicle's sign
    flow = -image_motion(h, v, R, omega) - rotation + leak * rotation
    nu, _ = optical_flow.measured_velocity(
        tuple(flow), h, R.as_matrix()[2, 2], tuple(omega),
        FlowParams(constant=1.0, rotation_leak=leak).values())
    np.testing.assert_allclose(nu, R.inv().apply(v)[:2], atol=1e-7)


def test_signs_by_hand():
    nu, _ = optical_flow.measured_velocity((0.5, 0.0), 2.0, 1.0, STILL, V)
    assert nu == pytest.approx((1.06, 0.0))  # forward flow: forward
    nu, _ = optical_flow.measured_velocity((0.0, 0.5), 2.0, 1.0, STILL, V)
    assert nu == pytest.approx((0.0, 1.06))  # flow to the right: to the right


@pytest.mark.parametrize(('height', 'expected'), [(1.5, 1.59), (2.5, 2.65)])
def test_multiplier_is_the_height_times_q_of_the_thesis(height, expected):
    assert optical_flow.multiplier(height, 1.0, V) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(('height', 'linear', 'exponential'), [
    (0.75, 0.9725, 0.95 + 0.011 * math.exp(0.75)), (1.0, 0.99, 0.95 + 0.011 * math.e),
    (1.5, 1.025, 0.95 + 0.011 * math.exp(1.5)), (2.5, 1.095, 0.95 + 0.011 * math.exp(2.5)),
    (0.1, 0.955, 0.95 + 0.011 * math.exp(0.5)), (9.0, 1.095, 0.95 + 0.011 * math.exp(2.5)),
])
def test_factor_is_a_function_of_the_height_within_the_calibrated_range(
        height, linear, exponential):
    at = optical_flow.factor_at
    assert at(height, FlowParams(factor='linear').values()) == pytest.approx(linear)
    assert at(height, FlowParams(factor='exponential').values()) == pytest.approx(exponential)
    assert at(height, V) == 1.06


def test_without_height_scaling_the_flow_is_a_velocity():
    v = FlowParams(height_scaling=False, constant=1.0).values()
    assert optical_flow.measured_velocity((0.3, -0.2), 2.5, 0.9, STILL, v)[0] == (0.3, -0.2)


@pytest.mark.parametrize('seed', range(10))
def test_prediction_is_the_velocity_in_body_axes_and_its_jacobian_fits(seed):
    _, v, R, _ = random_state(seed)
    nu, M = optical_flow.predict(tuple(v), rows(R))
    np.testing.assert_allclose(nu, R.inv().apply(v)[:2], atol=1e-14)
    eps = 1e-6
    for i in range(2):
        d = np.eye(3)[i] * eps
        plus = optical_flow.predict(tuple(v + d), rows(R))[0]
        minus = optical_flow.predict(tuple(v - d), rows(R))[0]
        # the model is linear: only rounding / eps remains
        np.testing.assert_allclose(
            np.array(M)[:, i], (np.array(plus) - minus) / (2 * eps), atol=1e-9)


@pytest.mark.parametrize('seed', range(10))
def test_inertial_velocity_undoes_the_prediction(seed):
    _, v, R, _ = random_state(seed)
    nu = R.inv().apply(v)
    back = optical_flow.inertial_velocity(tuple(nu[:2]), v[2], rows(R))
    np.testing.assert_allclose(back, v[:2], atol=1e-13)


def drift_per_period(rotate):
    """Integrate perfect flow around the vertical circle of fig. C.4 (x, z), W = 1, radius 1 m."""
    t = np.arange(0, 2 * math.pi, 1e-3)
    v = np.stack([-np.sin(t), 0 * t, -np.cos(t)], axis=-1)
    thrust = np.stack([np.cos(t), 0 * t, 9.81 - np.sin(t)], axis=-1)
    pitch = np.arctan2(thrust[:, 0], thrust[:, 2])
    R = Rotation.from_euler('y', pitch[:, None])
    nu = R.inv().apply(v)
    if not rotate:
        return nu[:, 0].sum() * 1e-3
    return 1e-3 * sum(
        optical_flow.inertial_velocity(tuple(n[:2]), w[2], tuple(map(tuple, m)))[0]
        for n, w, m in zip(nu.tolist(), v.tolist(), R.as_matrix().tolist(), strict=True))


def test_velocity_must_be_turned_to_inertial_axes_or_a_vertical_circle_drifts():
    # rectangle rule over one period: 1e-3 of the circumference at most
    assert abs(drift_per_period(rotate=True)) < 2e-3
    # equations.md, drift row C2: 0.321 m per period, pi A B W^2 / g = 0.320
    assert abs(drift_per_period(rotate=False)) == pytest.approx(0.321, abs=3e-3)


@pytest.mark.parametrize(('height', 'cosine', 'quality'), [
    (0.39, 1.0, 255), (math.nan, 1.0, 255), (1.5, 0.69, 255), (1.5, math.nan, 255),
    (1.5, 1.0, 0)])
def test_flow_is_refused_near_the_ground_tilted_or_without_texture(height, cosine, quality):
    assert not optical_flow.is_valid((0.1, 0.1), height, cosine, quality, V)
    assert optical_flow.is_valid((0.1, 0.1), 0.41, 0.71, 1, V)


@pytest.mark.parametrize('flow', [(math.nan, 0.0), (0.0, math.inf), (-1e300, 0.0), (0.0, 20.1)])
def test_impossible_flow_is_refused(flow):
    assert not optical_flow.is_valid(flow, 1.5, 1.0, 255, V)


def test_wrong_parameter_names_itself():
    with pytest.raises(ParameterError, match='^factor'):
        FlowParams(factor='cubic')
