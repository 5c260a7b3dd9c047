"""Corridors and limits: kept at every instant, paid for with energy, one line without a solver."""

from math import factorial
import sys

from mambo_flight.course import constrained as con, minimum_snap as ms
from mambo_model.errors import InputError, JobError
from mambo_model.motion.polynomial import ends, state_at
import numpy as np
import pytest
from scipy.interpolate import BPoly, PPoly
from scipy.optimize import nnls

pytest.importorskip('clarabel', reason='Clarabel is not installed: requirements/courses.txt')

TIMES = np.array([0.0, 1.5, 3.0, 4.5])
POINTS = np.array([[0.0, 0.0, -1.0], [1.0, 0.5, -1.5], [0.5, 1.5, -1.2], [-0.5, 1.0, -1.0]])
WAYPOINTS = ms.from_points(TIMES, POINTS, np.array([0.0, 1.0, np.nan, -1.0]))
INSIDE = 1e-6  # relative, what the solver leaves of a bound


def bounds(**given):
    return con.unbounded(3)._replace(**given)


def path(course, order=0):
    times = np.linspace(0.0, course.total, 3001)[:-1]
    return times, np.array([state_at(course, t)[:, order] for t in times])


def away(point, start, end):
    """Return how far a point is from a straight line between two others."""
    along = end - start
    share = np.clip((point - start) @ along / (along @ along), 0.0, 1.0)
    return np.linalg.norm(point - start - share * along)


@pytest.mark.parametrize('order', [3, 4])
@pytest.mark.parametrize('derivative', [0, 1, 2, 3])
def test_control_points_are_those_of_scipy(order, derivative):
    T, values = 1.3, np.random.default_rng(1).normal(size=2 * order)
    c = ms.to_course(np.array([0.0, T]), values.reshape(2, 1, order).repeat(4, 1)).coefficients[0]
    one = PPoly(c[0, ::-1, None], [0.0, T])
    other = BPoly.from_power_basis(one.derivative(derivative) if derivative else one).c[:, 0]
    np.testing.assert_allclose(
        con.control_points(order, derivative, T) @ values, other, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize('minimise', ms.ORDERS)
def test_without_bounds_it_is_the_course_of_the_linear_system(minimise):
    free, other = ms.minimum(WAYPOINTS, minimise), con.minimum(WAYPOINTS, bounds(), minimise, 1)
    np.testing.assert_allclose(other.coefficients, free.coefficients, rtol=0.0, atol=1e-6)
    split = con.minimum(WAYPOINTS, bounds(), minimise, 3)
    assert ms.energy(split, minimise) == pytest.approx(ms.energy(free, minimise), rel=1e-6)


def test_a_limit_is_the_optimum_of_an_independent_program():
    """
    Snap that is constant on 200 steps, as the least-norm problem that Lawson and Hanson solve.

    Least |s| with G s >= h follows from the residual r of nonnegative least squares of
    [G^T; h^T] u = (0, 1): s = -r[:-1] / r[-1].
    """
    T, limit, n = 1.0, 1.9, 200
    line = ms.from_points(np.array([0.0, T]), np.array([[0.0, 0.0, -1.0], [1.0, 0.0, -1.0]]))
    course = con.minimum(line, con.unbounded(1)._replace(
        limits=np.array([limit, np.inf, np.inf, np.inf])), 'snap', 8)
    knots = np.linspace(0.0, T, n + 1)

    def after(t, derivative):
        """Return what each step adds to a derivative at t."""
        power = 4 - derivative
        past = np.clip(t - knots, 0.0, None) ** power / factorial(power)
        return past[:-1] - past[1:]

    ends = np.array([after(T, k) for k in range(4)])
    speed = np.array([after(t, 1) for t in knots[1:-1]])
    goal, size = np.array([1.0, 0.0, 0.0, 0.0]), 1e3  # of the snap, for numbers of one size
    G = size * np.vstack((ends, -ends, -speed))
    h = np.concatenate((goal, -goal, np.full(len(speed), -limit)))
    A = np.vstack((G.T, h))
    u, _ = nnls(A, np.eye(n + 1)[-1], maxiter=100 * len(h))
    residual = A @ u - np.eye(n + 1)[-1]
    snap = -size * residual[:-1] / residual[-1]
    assert ends @ snap == pytest.approx(goal, abs=1e-6) and (speed @ snap).max() < limit + 1e-6
    # control points lie above the speed, so that the limit is a little tighter than the true one
    assert ms.energy(course) == pytest.approx(snap @ snap * T / n, rel=0.02)
    assert ms.energy(course) > 1.05 * ms.energy(ms.minimum(line))


def test_a_tube_is_kept_and_a_narrow_one_costs_more():
    costs = [ms.energy(ms.minimum(WAYPOINTS))]
    for radius in (0.2, 0.1, 0.05):
        course = con.minimum(WAYPOINTS, bounds(tube=np.full(3, radius)), pieces=4)
        times, at = path(course)
        legs = np.minimum(np.searchsorted(TIMES, times, 'right') - 1, 2)
        worst = max(away(point[:3], POINTS[leg], POINTS[leg + 1])
                    for point, leg in zip(at, legs, strict=True))
        assert 0.8 * radius < worst <= radius * (1.0 + INSIDE)
        costs.append(ms.energy(course))
    assert costs == sorted(costs) and costs[-1] > 2.0 * costs[0]


def test_more_pieces_never_cost_energy():
    costs = [ms.energy(con.minimum(WAYPOINTS, bounds(tube=np.full(3, 0.15)), pieces=pieces))
             for pieces in (1, 2, 4)]  # each splits those before
    assert costs[0] > costs[1] > costs[2]


def test_a_box_is_kept_on_its_leg():
    box = con.unbounded(3).box
    box[1] = [[0.4, 1.05], [0.45, 1.6], [-1.52, -1.1]]
    free = ms.minimum(WAYPOINTS)
    for course, kept in ((free, False), (con.minimum(WAYPOINTS, bounds(box=box)), True)):
        times, at = path(course)
        on = at[(times >= TIMES[1]) & (times <= TIMES[2]), :3]
        inside = (on >= box[1, :, 0] - 1e-7) & (on <= box[1, :, 1] + 1e-7)
        assert inside.all() == kept


@pytest.mark.parametrize('minimise', ms.ORDERS)
@pytest.mark.parametrize('derivative', [1, 2, 3])
def test_limits_of_derivatives_are_kept_at_every_instant(minimise, derivative):
    _, free = path(ms.minimum(WAYPOINTS, minimise), derivative)
    most = 0.9 * np.linalg.norm(free[:, :3], axis=1).max()
    limits = np.full(4, np.inf)
    limits[derivative - 1] = most
    course = con.minimum(WAYPOINTS, bounds(limits=limits), minimise, 5)
    _, found = path(course, derivative)
    assert 0.9 * most < np.linalg.norm(found[:, :3], axis=1).max() <= most * (1.0 + INSIDE)
    assert ms.energy(course, minimise) > ms.energy(ms.minimum(WAYPOINTS, minimise), minimise)


def test_a_limit_of_the_yaw_rate_is_kept():
    _, free = path(ms.minimum(WAYPOINTS), 1)
    most = 0.9 * np.abs(free[:, 3]).max()
    course = con.minimum(WAYPOINTS, bounds(yaw_rate=most), pieces=5)
    _, found = path(course, 1)
    assert 0.9 * most < np.abs(found[:, 3]).max() <= most * (1.0 + INSIDE)
    for k in (0, 1, 3):
        assert state_at(course, TIMES[k])[3, 0] == pytest.approx(
            WAYPOINTS.fixed[k, 3, 0], abs=1e-7)


@pytest.mark.parametrize(('minimise', 'orders'), [('snap', 5), ('jerk', 4)])
def test_pieces_continue_each_other(minimise, orders):
    course = con.minimum(WAYPOINTS, bounds(tube=np.full(3, 0.1)), minimise, 4)
    first, last = ends(course)
    np.testing.assert_allclose(
        first[1:, :, :orders], last[:-1, :, :orders], rtol=0.0, atol=1e-6)


def test_what_no_course_can_keep_to_is_one_line():
    limits = np.array([np.inf, 0.5, np.inf, np.inf])
    with pytest.raises(JobError, match='no path satisfies its corridor and limits .*lengthen the'):
        con.minimum(WAYPOINTS, bounds(limits=limits))
    with pytest.raises(JobError, match='no yaw satisfies its corridor and limits'):
        con.minimum(WAYPOINTS, bounds(yaw_rate=0.3))


def test_a_missing_solver_is_one_line(monkeypatch):
    monkeypatch.setitem(sys.modules, 'clarabel', None)
    with pytest.raises(InputError, match='need Clarabel: pip install -r requirements/courses.txt'):
        con.minimum(WAYPOINTS, bounds())
