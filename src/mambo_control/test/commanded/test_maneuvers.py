"""Paths from a present state: where they end, how long they take, what they keep."""

import math

from mambo_control.commanded import maneuvers as mv
from mambo_control.commanded.command_params import CommandParams
from mambo_model.motion.polynomial import jet, largest
import numpy as np
import pytest

P = CommandParams()
MOVING = np.zeros((4, 5))
MOVING[:, 0], MOVING[:, 1] = (1.0, 2.0, -1.5, 0.2), (1.2, -0.5, 0.3, 0.4)


def end_of(segment):
    return np.array([jet(axis, segment.duration) for axis in segment.coefficients])


def test_a_stop_ends_at_rest_and_within_the_acceleration():
    (segment,), end = mv.stop(MOVING, P)
    np.testing.assert_allclose(end_of(segment), mv.at_rest(end), atol=1e-9)
    assert np.array_equal(segment.coefficients[:, 0], MOVING[:, 0])
    peaks = [largest(-c, segment.duration, 2)[0] for c in segment.coefficients[:2]]
    assert max(peaks) < 0.55 * P.acceleration
    assert mv.stop(mv.at_rest(end), P) == ([], pytest.approx(end))


def test_a_change_of_velocity_peaks_at_the_stated_multiple_of_its_mean():
    (segment, hold, slow), end = mv.fly_on(
        mv.at_rest(np.zeros(4)), np.array([1.5, 0.0, 0.0, 0.0]), 0.5, P)
    peak, _ = largest(segment.coefficients[0], segment.duration, 2)
    assert peak == pytest.approx(35.0 / 16.0 * 1.5 / segment.duration, rel=1e-6)
    assert peak == pytest.approx(0.5 * P.acceleration)
    assert hold.duration == 0.5 and end_of(hold)[0, 1] == pytest.approx(1.5)
    np.testing.assert_allclose(end_of(slow), mv.at_rest(end), atol=1e-9)


def test_no_velocity_needs_no_time_at_it():
    (segment,), end = mv.fly_on(MOVING, np.zeros(4), 0.5, P)
    np.testing.assert_allclose(end_of(segment), mv.at_rest(end), atol=1e-9)


@pytest.mark.parametrize(('goal', 'limit', 'order', 'axis'), [
    ((3.0, 0.0, 0.0, 0.0), 'speed', 1, 0), ((0.0, 0.0, -0.8, 0.0), 'acceleration', 2, 2),
    ((0.0, 0.0, 0.0, math.pi), 'yaw_rate', 1, 3)])
def test_the_least_duration_keeps_a_margin_from_the_limit_that_counts(goal, limit, order, axis):
    start = mv.at_rest(np.zeros(4))
    p = CommandParams(speed=2.0, acceleration=3.0, yaw_rate=1.0)
    duration = mv.least_duration(start, np.array(goal), p)
    segment = mv.move(start, mv.at_rest(np.array(goal)), duration)
    sign = math.copysign(1.0, goal[axis])
    peak, _ = largest(sign * segment.coefficients[axis], duration, order)
    assert peak == pytest.approx(0.8 * getattr(p, limit), rel=1e-6) or duration == mv.SHORTEST


def test_a_state_is_extrapolated_by_its_series():
    state = np.arange(20.0).reshape(4, 5)
    out = mv.extrapolated(state, 0.3)
    for row, before in zip(out, state, strict=True):
        series = before / [math.factorial(k) for k in range(5)]
        np.testing.assert_allclose(row, jet(series, 0.3), rtol=1e-12)


def test_rest_has_one_coefficient_and_no_end():
    segment = mv.rest(np.arange(4.0), 2)
    assert segment.duration == math.inf and segment.coefficients.shape == (4, 1)
    assert mv.is_resting(mv.at_rest(np.arange(4.0))) and not mv.is_resting(MOVING)


def extent(way):
    """Return the largest distance of a way from its beginning along x, m."""
    return max(np.abs(np.polynomial.polynomial.polyval(
        np.linspace(0.0, one.duration, 200), one.coefficients[0]) - MOVING[0, 0]).max()
        for one in way)


@pytest.mark.parametrize(('goal', 'duration', 'pieces'), [
    ((2.5, 2.0, -1.5, 0.2), 2.0, 1), ((1.4, 1.8, -1.4, 0.3), 8.0, 2),
    ((1.4, 1.8, -1.4, 0.3), 20.0, 2), ((1.4, 1.8, -1.4, 0.3), 0.9, 1)])
def test_a_visit_with_much_time_does_not_overshoot(goal, duration, pieces):
    end = mv.at_rest(np.array(goal))
    way = mv.visit(MOVING, end, duration, P)
    assert len(way) == pieces and sum(one.duration for one in way) == pytest.approx(duration)
    np.testing.assert_allclose(end_of(way[-1]), end, atol=1e-9)
    begin = np.array([jet(axis, 0.0) for axis in way[0].coefficients])
    np.testing.assert_allclose(begin, MOVING, atol=1e-12)
    direct = extent([mv.move(MOVING, end, duration)])
    if pieces == 1:
        assert extent(way) == direct
    else:
        assert extent(way) < 0.9 < 2.0 < direct  # it stops in 0.88 m


@pytest.mark.parametrize('goal', [
    (-3.0, 2.0, -1.5, 0.2), (-3.0, -2.0, -0.8, 0.2), (1.2, 5.0, -2.5, 3.0)])
@pytest.mark.parametrize('longer', [1.0, 1.4])
def test_a_visit_as_fast_as_allowed_leaves_its_way_no_more_than_a_stop(goal, longer):
    end = mv.at_rest(np.array(goal))
    way = mv.visit(MOVING, end, 0.0, P, longer)
    (slowing,), there = mv.stop(MOVING, P)  # no longer way to rest, however long the rest takes
    np.testing.assert_allclose(end_of(way[-1]), end, atol=1e-9)
    assert [one.duration for one in way] == pytest.approx([
        slowing.duration, longer * mv.least_duration(mv.at_rest(there), end[:, 0], P)])
    path = np.concatenate([np.polynomial.polynomial.polyval(
        np.linspace(0.0, one.duration, 200), one.coefficients[:3].T) for one in way], axis=1)
    corners = np.array([MOVING[:3, 0], there[:3], end[:3, 0]])
    assert (path.max(axis=1) < corners.max(axis=0) + 0.01).all()
    assert (path.min(axis=1) > corners.min(axis=0) - 0.01).all()


def test_a_visit_that_leaves_its_way_little_is_one_polynomial():
    ahead = mv.at_rest(MOVING[:, 0] + 3.0 * MOVING[:, 1])
    for goal in (ahead, mv.at_rest(MOVING[:, 0])):
        assert len(mv.visit(MOVING, goal, 0.0, P)) == 1
    goal = ahead
    assert len(mv.visit(mv.at_rest(MOVING[:, 0]), goal, 0.0, P)) == 1


def test_a_way_by_rest_may_take_its_time_to_stop_and_a_straight_one_does_not_stop():
    end = mv.at_rest(np.array([-3.0, 2.0, -1.5, 0.2]))
    fast, slow = (mv.by_rest(MOVING, end, 0.0, P, 1.4, slower) for slower in (1.0, 2.0))
    assert slow[0].duration == pytest.approx(2.0 * fast[0].duration)
    (straight,) = mv.straight(MOVING, end, 0.0, P, 1.4)
    assert straight.duration == pytest.approx(1.4 * mv.least_duration(MOVING, end[:, 0], P))
    (straight,) = mv.by_rest(mv.at_rest(MOVING[:, 0]), end, 0.0, P)
    assert straight.duration == pytest.approx(mv.least_duration(MOVING, end[:, 0], P))
