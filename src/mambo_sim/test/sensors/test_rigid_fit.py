"""Fit of a body to points: scipy's answer, exact points, textbook noise, no false attitude."""

import itertools

from mambo_sim.sensors.marker_occlusion import MarkerParams
from mambo_sim.sensors.rigid_fit import fit, horn_matrix
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

BODY = MarkerParams().five()
A = np.array(BODY)
ALL = (0, 1, 2, 3, 4)
HALF_TURNS = [Rotation.from_rotvec(np.pi * axis / np.linalg.norm(axis)) for axis in np.array(
    [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [-1, 2, 3]])]


def tuples(x):
    return tuple(map(tuple, np.asarray(x, float).tolist()))


def rotation(q):
    return Rotation.from_quat([*q[1:], q[0]])


def labels_of(indices):
    return tuple(i if i in indices else -1 for i in range(5))


@pytest.mark.parametrize('seed', range(40))
def test_the_fit_is_that_of_scipy(seed):
    # bodies of any shape, noise up to a tenth of their size, any attitude, some points missing
    rng = np.random.default_rng(seed)
    body = rng.uniform(-0.1, 0.1, (5, 3)) + rng.uniform(-1, 1, 3)
    R, rho = Rotation.random(random_state=seed), rng.uniform(-3, 3, 3)
    points = R.apply(body) + rho + rng.normal(0.0, (0.0, 1e-4, 1e-2)[seed % 3], (5, 3))
    used = np.sort(rng.permutation(5)[:3 + seed % 3])
    found = fit(tuples(body), tuples(points), labels_of(used))
    a, b = body[used], points[used]
    expected, _ = Rotation.align_vectors(b - b.mean(axis=0), a - a.mean(axis=0))
    assert found.found
    assert (expected.inv() * rotation(found.q)).magnitude() < 1e-9
    np.testing.assert_allclose(
        found.rho, b.mean(axis=0) - expected.apply(a.mean(axis=0)), rtol=0.0, atol=2e-9)
    miss = np.linalg.norm(b - rotation(found.q).apply(a) - found.rho, axis=1)
    assert found.deviation == pytest.approx(miss.max(), abs=1e-12)
    assert found.square == pytest.approx((miss**2).sum(), abs=1e-14)


@pytest.mark.parametrize('R', [Rotation.identity(), *HALF_TURNS])
@pytest.mark.parametrize('used', [ALL, (0, 1, 2, 3), (0, 1, 4), (0, 2, 4)])
def test_exact_points_give_the_exact_pose_at_half_turns_too(R, used):
    rho = np.array([1.0, -2.0, -1.5])
    found = fit(BODY, tuples(R.apply(A) + rho), labels_of(used))
    # rounding of coordinates of metres, over a lever of centimetres
    assert (R.inv() * rotation(found.q)).magnitude() < 1e-12
    np.testing.assert_allclose(found.rho, rho, atol=1e-13)
    assert found.deviation < 1e-13


def test_points_may_come_in_any_order_if_they_are_labelled():
    rng = np.random.default_rng(5)
    R = Rotation.random(random_state=5)
    points = R.apply(A) + rng.normal(0.0, 1e-3, (5, 3))
    straight = fit(BODY, tuples(points), ALL)
    for order in itertools.permutations(range(5)):
        found = fit(BODY, tuples(points[list(order)]), order)
        np.testing.assert_allclose(found.q, straight.q, atol=1e-13)


def test_the_matrix_is_that_of_the_rotation_it_maximises():
    rng = np.random.default_rng(6)
    S, R = rng.normal(size=(3, 3)), Rotation.random(random_state=6)
    x, y, z, w = R.as_quat()
    q = np.array([w, x, y, z])
    N = np.array(horn_matrix(tuples(S)))
    assert q @ N @ q == pytest.approx(np.trace(R.as_matrix() @ S), abs=1e-13)
    assert np.trace(N) == pytest.approx(0.0, abs=1e-15)


def test_a_mirrored_body_is_no_body():
    found = fit(BODY, tuples(A * [1, 1, -1]), ALL)
    assert found.found and found.deviation > 0.005  # the best rotation leaves the top 1 cm off
    np.testing.assert_allclose(np.linalg.det(rotation(found.q).as_matrix()), 1.0)


@pytest.mark.parametrize('used', [(), (2,), (1, 3)])
def test_fewer_than_three_points_tell_no_pose(used):
    found = fit(BODY, BODY, labels_of(used))
    assert not found.found and np.isnan(found.rho).all() and np.isnan(found.q).all()


@pytest.mark.parametrize('direction', [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, -2, 3]])
@pytest.mark.parametrize('noise', [0.0, 1e-4])
def test_markers_on_a_line_tell_no_pose(direction, noise):
    line = np.outer([-0.05, -0.02, 0.0, 0.03, 0.06], direction)
    points = line + np.random.default_rng(7).normal(0.0, noise, (5, 3))
    assert not fit(tuples(line), tuples(points), ALL).found
    assert not fit(tuples(line), tuples(points), labels_of((0, 2, 4))).found
    spot = tuples(np.ones((5, 3)))
    assert not fit(spot, spot, ALL).found


@pytest.mark.parametrize('wide, found', [(0.2, True), (0.02, False)])
def test_a_narrow_body_is_one_down_to_a_twentieth_of_its_length(wide, found):
    body = np.array([[-1, 0, 0], [1, 0, 0], [0, wide, 0], [0, -wide, 0], [0, 0, 0]]) * 0.05
    assert fit(tuples(body), tuples(body), ALL).found is found


@pytest.mark.long
@pytest.mark.parametrize('used', [ALL, (0, 1, 2, 3), (0, 1, 4)])
def test_noise_of_the_pose_is_that_of_the_textbook(used):
    # first order: attitude in body axes s^2 (sum |a|^2 I - a a^T)^-1, centroid s^2 / n
    s, n, count = 1e-4, len(used), 20_000
    a = A[list(used)] - A[list(used)].mean(axis=0)
    c = A[list(used)].mean(axis=0)
    attitude = s**2 * np.linalg.inv((a**2).sum() * np.eye(3) - a.T @ a)
    skew = np.cross(np.eye(3), c)
    R, rng = Rotation.from_euler('ZYX', [2.0, 0.3, -0.4]), np.random.default_rng(8)
    turns, shifts, squares = [], [], []
    for error in rng.normal(0.0, s, (count, 5, 3)):
        found = fit(BODY, tuples(R.apply(A) + error), labels_of(used))
        turns.append((R.inv() * rotation(found.q)).as_rotvec())
        shifts.append(R.inv().apply(found.rho))
        squares.append(found.square)
    # standard error of a variance from 20000 samples: 1 %
    for samples, expected in ((turns, attitude),
                              (shifts, s**2 / n * np.eye(3) + skew @ attitude @ skew.T)):
        scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
        found = np.cov(np.array(samples).T)
        np.testing.assert_allclose(found / scale, expected / scale, atol=0.05)
        assert (np.abs(np.mean(samples, axis=0)) < 5 * np.sqrt(np.diag(expected) / count)).all()
    assert np.mean(squares) == pytest.approx(s**2 * (3 * n - 6), rel=0.05)
