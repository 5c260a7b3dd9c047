"""Quaternion algebra (2.1)-(2.16) against matrices, scipy and finite differences."""

import math

from mambo_model.motion import quaternion as quat
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

SEEDS = range(10)


def random_attitude(seed):
    """Return a random attitude as a tuple w x y z and as scipy's Rotation."""
    rotation = Rotation.random(rng=np.random.default_rng(seed))
    return tuple(np.roll(rotation.as_quat(), 1).tolist()), rotation


def random_pair(seed):
    return (tuple(q) for q in np.random.default_rng(seed).normal(size=(2, 4)).tolist())


def random_vector(seed):
    return tuple(np.random.default_rng(seed).normal(size=3).tolist())


@pytest.mark.parametrize(('length', 'unit'), [
    (1.0, True), (1.0004, True), (0.9996, True), (1.0006, False), (0.9994, False), (0.0, False),
    (2.0, False), (math.nan, False), (math.inf, False)])
def test_only_a_quaternion_of_length_one_is_a_unit_quaternion(length, unit):
    q, _ = random_attitude(1)
    assert quat.is_unit(tuple(length * part for part in q)) is unit


def product_matrix(p):
    """Return Q(p) of (2.10): multiply(p, q) = Q(p) q."""
    w, x, y, z = p
    return np.array([[w, -x, -y, -z], [x, w, -z, y], [y, z, w, -x], [z, -y, x, w]])


def matrix_2_1(phi, theta, psi):
    """Build (2.1) as the product of three elementary rotations."""
    (c1, c2, c3), (s1, s2, s3) = np.cos([phi, theta, psi]), np.sin([phi, theta, psi])
    yaw = np.array([[c3, -s3, 0], [s3, c3, 0], [0, 0, 1]])
    pitch = np.array([[c2, 0, s2], [0, 1, 0], [-s2, 0, c2]])
    return yaw @ pitch @ np.array([[1, 0, 0], [0, c1, -s1], [0, s1, c1]])


def test_products_of_the_units_by_hand():
    i, j, k = (0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 0.0, 1.0)
    assert quat.multiply(i, j) == k
    assert quat.multiply(j, i) == (0.0, 0.0, 0.0, -1.0)
    assert quat.multiply(quat.multiply(i, j), k) == (-1.0, 0.0, 0.0, 0.0)


def test_quarter_turn_right_takes_the_nose_from_north_to_east():
    q = quat.from_euler(0.0, 0.0, 0.5 * math.pi)
    np.testing.assert_allclose(quat.rotate(q, (1.0, 0.0, 0.0)), (0.0, 1.0, 0.0), atol=1e-15)


def test_pitch_up_raises_the_nose_and_roll_right_lowers_the_right_side():
    up = quat.rotate(quat.from_euler(0.0, 0.1, 0.0), (1.0, 0.0, 0.0))
    right = quat.rotate(quat.from_euler(0.1, 0.0, 0.0), (0.0, 1.0, 0.0))
    assert up[2] < 0.0 < right[2]  # z is down


@pytest.mark.parametrize('seed', SEEDS)
def test_product_equals_its_matrix_form(seed):
    p, q = random_pair(seed)
    np.testing.assert_allclose(
        quat.multiply(p, q), product_matrix(p) @ q, rtol=0.0, atol=5e-15)


@pytest.mark.parametrize('seed', SEEDS)
def test_inverse_conjugate_and_norm_agree(seed):
    q, _ = random_pair(seed)
    np.testing.assert_allclose(
        quat.multiply(q, quat.inverse(q)), quat.IDENTITY, rtol=0.0, atol=1e-15)
    assert quat.multiply(q, quat.conjugate(q))[0] == pytest.approx(quat.norm(q)**2, rel=1e-15)
    assert quat.norm(quat.normalise(q)) == pytest.approx(1.0, abs=3e-16)
    np.testing.assert_allclose(
        np.array(quat.normalise(q)) * quat.norm(q), q, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize('seed', SEEDS)
def test_attitudes_behave_as_in_scipy(seed):
    q, rotation = random_attitude(seed)
    p, other = random_attitude(seed + 1000)
    v = random_vector(seed)
    # all of size 1, some ten roundings
    np.testing.assert_allclose(quat.to_matrix(q), rotation.as_matrix(), rtol=0.0, atol=2e-15)
    np.testing.assert_allclose(quat.rotate(q, v), rotation.apply(v), rtol=0.0, atol=5e-15)
    np.testing.assert_allclose(
        quat.rotate_inverse(q, v), rotation.inv().apply(v), rtol=0.0, atol=5e-15)
    np.testing.assert_allclose(
        quat.to_matrix(quat.multiply(q, p)), (rotation * other).as_matrix(), rtol=0.0, atol=2e-15)
    assert quat.angle(q) == pytest.approx(rotation.magnitude(), abs=2e-15)


@pytest.mark.parametrize('seed', SEEDS)
def test_short_rotation_equals_the_double_product(seed):
    q, _ = random_attitude(seed)
    v = random_vector(seed)
    double = quat.multiply(quat.multiply(q, (0.0, *v)), quat.conjugate(q))  # (2.11)
    np.testing.assert_allclose((0.0, *quat.rotate(q, v)), double, rtol=0.0, atol=5e-15)


@pytest.mark.parametrize('seed', range(50))
def test_euler_angles_to_quaternion_to_matrix_and_back(seed):
    angles = tuple(np.random.default_rng(seed).uniform(
        [-math.pi, -1.5, -math.pi], [math.pi, 1.5, math.pi]).tolist())
    q = quat.from_euler(*angles)
    # rounding grows as 1/cos(pitch), at most 14 here
    np.testing.assert_allclose(quat.to_matrix(q), matrix_2_1(*angles), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(quat.to_euler(q), angles, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(
        quat.to_euler(q)[::-1], Rotation.from_matrix(quat.to_matrix(q)).as_euler('ZYX'),
        rtol=0.0, atol=1e-12)


@pytest.mark.parametrize('seed', SEEDS)
def test_opposite_quaternions_are_one_attitude(seed):
    q, _ = random_attitude(seed)
    opposite = tuple(-c for c in q)
    assert quat.to_euler(opposite) == quat.to_euler(q)
    assert quat.to_matrix(opposite) == quat.to_matrix(q)
    assert quat.rotate(opposite, (1.0, 2.0, 3.0)) == quat.rotate(q, (1.0, 2.0, 3.0))
    assert quat.angle(opposite) == quat.angle(q)


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_pitch_of_a_right_angle_survives_rounding(sign):
    h = math.sqrt(0.5) * (1.0 + 4e-16)  # the sine comes out above 1
    assert quat.to_euler((h, 0.0, sign * h, 0.0))[1] == sign * 0.5 * math.pi


def test_angle_lies_between_zero_and_half_a_turn():
    assert quat.angle(quat.IDENTITY) == 0.0
    assert quat.angle((0.0, 0.0, 1.0, 0.0)) == math.pi
    assert quat.angle(quat.exp_map((0.0, 1.5 * math.pi, 0.0))) == pytest.approx(0.5 * math.pi)


def test_derivative_follows_a_tumbling_body():
    def euler(t):
        return 0.7 * math.sin(1.3 * t), 0.5 * math.cos(t), 0.9 * t

    h = 1e-5
    for t in (0.0, 0.4, 2.0):
        q, before, after = (quat.from_euler(*euler(x)) for x in (t, t - h, t + h))
        R = matrix_2_1(*euler(t))
        R_dot = (matrix_2_1(*euler(t + h)) - matrix_2_1(*euler(t - h))) / (2 * h)
        S = R.T @ R_dot  # R_dot = R S(omega)
        q_dot = quat.derivative(q, (float(S[2, 1]), float(S[0, 2]), float(S[1, 0])))
        # two central differences: h^2/6 and 1e-16/h
        np.testing.assert_allclose(q_dot, np.subtract(after, before) / (2 * h), atol=1e-9)


@pytest.mark.parametrize('rotvec', [
    (0.3, -1.2, 0.5), (3.0, 0.5, -0.2), (1e-9, 2e-9, -1e-9), (0.0, 0.0, 0.0), (1e-200, 0.0, 0.0)])
def test_rotation_vectors_as_in_scipy(rotvec):
    expected = np.roll(Rotation.from_rotvec(rotvec).as_quat(canonical=True), 1)
    # relative as well: a tiny rotation keeps its digits
    np.testing.assert_allclose(quat.exp_map(rotvec), expected, rtol=1e-15, atol=0.0)


def rotating(k, h, steps, omega, start, runge_kutta):
    """Integrate (2.15) and return the squared length at the end."""
    def rate(q):
        return np.add(quat.derivative(tuple(q), omega), quat.norm_control(tuple(q), k))

    q = np.array(start)
    for _ in range(steps):
        k1 = rate(q.tolist())
        if runge_kutta:
            k2 = rate((q + 0.5 * h * k1).tolist())
            k3 = rate((q + 0.5 * h * k2).tolist())
            k4 = rate((q + h * k3).tolist())
            q = q + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        else:
            q = q + h * k1
    return float(q @ q)


@pytest.mark.parametrize(('runge_kutta', 'hk', 'stable'), [
    (False, 0.99, True), (False, 1.01, False), (True, 1.35, True), (True, 1.425, False)])
def test_norm_control_is_stable_up_to_its_limit(runge_kutta, hk, stable):
    h, still = 0.005, (0.0, 0.0, 0.0)
    n = rotating(hk / h, h, 2000, still, (1.01, 0.0, 0.0, 0.0), runge_kutta)
    assert (abs(n - 1.0) < 1e-4) == stable


def test_norm_control_under_euler_settles_at_its_known_length():
    h, hk, w = 0.005, 0.5, 3.0
    n = rotating(hk / h, h, 500, (0.0, w, 0.0), quat.IDENTITY, False)
    assert n == pytest.approx(1.0 + (1.0 - math.sqrt(1.0 - h**2 * w**2 / 4.0)) / hk, abs=1e-12)
    assert n > 1.0


@pytest.mark.parametrize('seed', SEEDS)
def test_norm_control_pulls_every_component_towards_unit_length(seed):
    q, _ = random_pair(seed)
    expected = 3.0 * (1.0 - np.dot(q, q)) * np.array(q)  # (2.15), (2.16)
    # terms of size 30 at most
    np.testing.assert_allclose(quat.norm_control(q, 3.0), expected, rtol=0.0, atol=1e-13)


def test_length_drifts_without_norm_control():
    n = rotating(0.0, 0.005, 4000, (0.0, 3.0, 0.0), quat.IDENTITY, False)
    assert math.sqrt(n) == pytest.approx(math.exp(0.005 * 9.0 * 20.0 / 8.0), rel=1e-4)
