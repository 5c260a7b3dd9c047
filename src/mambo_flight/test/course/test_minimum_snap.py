"""Minimum snap and jerk against closed forms and an independent formulation."""

from mambo_flight.course import minimum_snap as ms
from mambo_model.motion.polynomial import ends, state_at
import numpy as np
import pytest
from scipy.linalg import null_space

RNG = np.random.default_rng(7)
TIMES = np.array([0.0, 0.8, 2.3, 3.1, 4.9])
POINTS = RNG.normal(size=(5, 3)) - [0.0, 0.0, 4.0]
# ascending powers of the share of the time from one rest to the next: Euler's equation x^(2r) = 0
REST_TO_REST = {'snap': [0, 0, 0, 0, 35, -84, 70, -20], 'jerk': [0, 0, 0, 10, -15, 6]}
SQUARES = {'snap': 100800.0, 'jerk': 720.0}  # integral of the squared snap or jerk of these


@pytest.mark.parametrize('minimise', ms.ORDERS)
def test_between_two_points_at_rest_it_is_the_closed_form(minimise):
    T, way = 2.0, np.array([2.0, -1.0, 0.5])
    course = ms.minimum(ms.from_points(
        np.array([3.0, 3.0 + T]), np.array([[0.0, 0.0, -1.0], way - [0.0, 0.0, 1.0]])), minimise)
    shape = np.array(REST_TO_REST[minimise], dtype=float)
    found = course.coefficients[0, :3] * T ** np.arange(len(shape))
    found[2, 0] += 1.0
    # rounding of the inverse of a matrix whose numbers go up to 210
    np.testing.assert_allclose(found, way[:, None] * shape, rtol=0.0, atol=1e-10)
    assert ms.energy(course, minimise) == pytest.approx(
        SQUARES[minimise] * way @ way * T ** (1 - 2 * ms.ORDERS[minimise]), rel=1e-11)
    assert course.duration.tolist() == [T] and not course.coefficients[:, 3].any()


def coefficients(order, times, values):
    """
    Return the coefficients of the optimum on one axis, (legs, 2 r), another way.

    Unknown are the coefficients themselves; constraints are met by a null space of their dense
    matrix, energies are integrals of powers by Gauss and Legendre.
    """
    n, size = len(times) - 1, 2 * order

    def row(leg, t, derivative):
        out = np.zeros(n * size)
        for i in range(derivative, size):
            factor = np.prod(np.arange(i, i - derivative, -1.0))
            out[leg * size + i] = factor * t ** (i - derivative)
        return out

    T, rows, right = np.diff(times), [], []
    for leg in range(n):
        rows += [row(leg, 0.0, 0), row(leg, T[leg], 0)]
        right += [values[leg], values[leg + 1]]
    for derivative in range(1, order):
        rows += [row(0, 0.0, derivative), row(n - 1, T[-1], derivative)]
        rows += [row(leg, T[leg], derivative) - row(leg + 1, 0.0, derivative)
                 for leg in range(n - 1)]
        right += [0.0] * (n + 1)
    nodes, weights = np.polynomial.legendre.leggauss(order)
    Q = np.zeros((n * size, n * size))
    for leg in range(n):
        for node, weight in zip(nodes, weights, strict=True):
            one = row(leg, 0.5 * T[leg] * (1.0 + node), order)
            Q += 0.5 * T[leg] * weight * np.outer(one, one)
    A, N = np.array(rows), null_space(np.array(rows))
    start = np.linalg.lstsq(A, np.array(right), rcond=None)[0]
    best = start - N @ np.linalg.solve(N.T @ Q @ N, N.T @ Q @ start)
    return best.reshape(n, size), float(best @ Q @ best)


@pytest.mark.parametrize('minimise', ms.ORDERS)
def test_the_optimum_is_that_of_an_independent_formulation(minimise):
    order, total = ms.ORDERS[minimise], 0.0
    course = ms.minimum(ms.from_points(TIMES, POINTS), minimise)
    for axis in range(3):
        other, cost = coefficients(order, TIMES, POINTS[:, axis])
        np.testing.assert_allclose(course.coefficients[:, axis], other, rtol=0.0, atol=1e-6)
        total += cost
    assert ms.energy(course, minimise) == pytest.approx(total, rel=1e-9)


@pytest.mark.parametrize('minimise', ms.ORDERS)
def test_it_passes_its_waypoints_and_is_as_smooth_as_euler_s_equation_says(minimise):
    order = ms.ORDERS[minimise]
    course = ms.minimum(ms.from_points(TIMES, POINTS), minimise)
    for t, point in zip(TIMES, POINTS, strict=True):
        np.testing.assert_allclose(state_at(course, t)[:3, 0], point, rtol=0.0, atol=1e-12)
    for state in (state_at(course, 0.0), state_at(course, TIMES[-1])):
        np.testing.assert_allclose(state[:, 1:order], 0.0, atol=1e-9)
    for derivative in range(2 * order - 1):  # 0 to 2 r - 2
        for i, T in enumerate(course.duration[:-1]):
            for axis in range(3):
                before, after = (np.polynomial.Polynomial(c).deriv(derivative) for c in (
                    course.coefficients[i, axis], course.coefficients[i + 1, axis]))
                size = max(1.0, abs(after(0.0)))
                assert before(T) == pytest.approx(after(0.0), abs=1e-7 * size)


def test_freedom_never_costs_energy():
    full = ms.from_points(TIMES, POINTS)
    freer = full.fixed.copy()
    freer[2, 1, 0] = np.nan
    freest = freer.copy()
    freest[3, :3, 0] = np.nan
    costs = [ms.energy(ms.minimum(full._replace(fixed=one)))
             for one in (full.fixed, freer, freest)]
    assert costs[0] > costs[1] > costs[2] > 0.0


def test_velocities_and_yaws_that_are_given_are_taken_and_others_are_free():
    points = ms.from_points(TIMES, POINTS, np.array([0.0, np.nan, 1.0, np.nan, 0.5]))
    points.fixed[1, :3, 1] = [0.3, -0.2, 0.1]
    course = ms.minimum(points)
    at = state_at(course, TIMES[1])
    np.testing.assert_allclose(at[:3, 1], [0.3, -0.2, 0.1], rtol=0.0, atol=1e-10)
    for t, yaw in ((0.0, 0.0), (TIMES[2], 1.0), (TIMES[-1], 0.5)):
        assert state_at(course, t)[3, 0] == pytest.approx(yaw, abs=1e-12)
    assert at[3, 0] not in (0.0, 1.0)


def test_a_thousand_legs_are_planned_in_one_system():
    t = np.cumsum(RNG.uniform(0.5, 2.0, 1001))
    points = np.cumsum(RNG.normal(size=(1001, 3)), axis=0)
    course = ms.minimum(ms.from_points(t, points))
    first, last = ends(course)
    np.testing.assert_allclose(last[:, :3, 0], points[1:], rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(first[1:], last[:-1], rtol=0.0, atol=1e-6)
