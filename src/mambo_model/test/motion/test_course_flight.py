"""A flight along a course: its seams, its derivatives by differences, what cannot be flown."""

import math

from mambo_model.motion import polynomial as poly, trajectory as tr, uav_trajectories as uav
from mambo_model.motion.quaternion import to_euler
from mambo_model.schema import ParameterError
from mambo_model.vehicle.parameters import Vehicle
import numpy as np
import pytest

START = np.array([  # of a course that is entered and left in motion
    [0.5, 0.4, -0.3, 0.1, 0.6], [-1.0, -0.2, 0.2, 0.3, -0.4], [-1.2, 0.1, 0.1, -0.2, 0.3],
    [0.7, 0.3, 0.1, 0.0, 0.0]])
END = np.array([
    [2.0, -0.3, 0.1, 0.2, 0.0], [1.0, 0.4, -0.2, 0.0, 0.1], [-1.5, -0.1, 0.2, 0.0, 0.0],
    [-0.4, -0.2, 0.0, 0.1, 0.0]])
MIDDLE = np.hstack((0.5 * (START + END)[:, :1], np.full((4, 4), 0.1)))


def eighth(start, end, duration):
    """Return polynomials of degree 7 with the first four numbers of both states, (4, 8)."""
    low = start[:, :4] * duration ** np.arange(4) / np.array([1.0, 1.0, 2.0, 6.0])
    wanted = end[:, :4] * duration ** np.arange(4) / np.array([1.0, 1.0, 2.0, 6.0])
    binomial = np.array([[math.comb(i, k) for i in range(8)] for k in range(4)], dtype=float)
    high = np.linalg.solve(binomial[:, 4:], (wanted - low @ binomial[:, :4].T).T).T
    return np.hstack((low, high)) / duration ** np.arange(8)


COURSE = poly.Course(np.array([1.5, 2.0]), np.array([
    eighth(START, MIDDLE, 1.5), eighth(MIDDLE, END, 2.0)]))
TEXT = uav.to_text(COURSE)
BEGIN = 8.0  # s, of the course after a smooth take-off


def params(**others):
    return tr.FlightPlanParams(trajectory='course', course=TEXT, **others)


@pytest.mark.long
def test_after_the_approach_the_course_is_flown_to_the_bit():
    values = params(landing_time=20.0).values()
    for t in np.linspace(0.0, COURSE.total, 41)[:-1].tolist():
        at = poly.state_at(COURSE, t)
        *flat, phase = tr.flat_output(BEGIN + t, values)
        np.testing.assert_allclose(flat, at[:3].T, rtol=0.0, atol=1e-10)
        assert phase == tr.TRACK


@pytest.mark.parametrize('takeoff', tr.TAKEOFFS)
@pytest.mark.parametrize('landing', [0.0, 9.0, 10.0, 12.0, 20.0])  # in either piece, after it
def test_derivatives_match_central_differences_in_every_phase(takeoff, landing):
    values, h = params(takeoff=takeoff, landing_time=landing).values(), 1e-5
    jumps = [] if takeoff != 'step' else [1.0, 5.0]
    for t in np.arange(0.0137, 27.0, 0.0511).tolist():
        before, at, after = (tr.flat_output(x, values) for x in (t - h, t, t + h))
        if any(abs(t - jump) < h for jump in jumps):
            continue
        for order in range(1, 5):
            # h^2/6 times a derivative of order 7, below 1e4, and 1e-16/h
            np.testing.assert_allclose(
                at[order], np.subtract(after[order - 1], before[order - 1]) / (2 * h),
                rtol=0.0, atol=1e-6)


@pytest.mark.parametrize('landing', [9.0, 10.0, 12.0, 20.0])
def test_position_to_jerk_and_yaw_are_continuous_at_every_seam(landing):
    values, gap, vehicle = params(landing_time=landing).values(), 1e-9, Vehicle()
    vv = vehicle.values()
    for seam in values.pieces.begin[1:].tolist():
        before, after = (
            tr.reference_step(t, values, vv.mass, vv.inertia, vv.gravity)[0]
            for t in (seam - gap, seam))
        for order in range(4):  # the snap of the course itself jumps
            np.testing.assert_allclose(after[order], before[order], rtol=0.0, atol=1e-6)
        np.testing.assert_allclose(after.q, before.q, rtol=0.0, atol=1e-8)
        np.testing.assert_allclose(after.omega, before.omega, rtol=0.0, atol=1e-7)


def test_the_approach_and_the_exit_meet_the_snap_of_the_course():
    values = params().values()
    for seam, state in ((BEGIN, poly.state_at(COURSE, 0.0)),
                        (BEGIN + COURSE.total, poly.state_at(COURSE, math.inf))):
        for t in (seam - 1e-9, seam + 1e-9):
            assert tr.flat_output(t, values)[4] == pytest.approx(state[:3, 4].tolist(), abs=1e-5)


def test_the_vehicle_comes_to_rest_where_an_even_braking_ends():
    rho, *others, _ = tr.flat_output(BEGIN + COURSE.total + 3.0, params().values())
    assert rho == pytest.approx((END[:3, 0] + 0.5 * 3.0 * END[:3, 1]).tolist(), abs=1e-12)
    assert not np.any(others)


def test_yaw_is_that_of_the_course():
    vehicle = Vehicle()
    for t in np.linspace(0.0, COURSE.total, 21).tolist():
        ref, _ = tr.reference_at(BEGIN + t, params(), vehicle)
        assert to_euler(ref.q)[2] == pytest.approx(poly.state_at(COURSE, t)[3, 0], abs=1e-12)


def test_phases_follow_one_another_and_the_flight_ends_on_the_ground_below_the_end():
    plan = params(landing_time=14.0)
    values = plan.values()
    phases = [tr.flat_output(t, values)[5] for t in (0.0, 0.999, 1.0, 4.9, 5.0, 16.9, 17.0, 20.0)]
    assert phases == [tr.GROUND, tr.GROUND, tr.TAKEOFF, tr.TAKEOFF, tr.TRACK, tr.TRACK,
                      tr.LANDING, tr.LANDED]
    above, below = tr.flat_output(17.0, values)[0], tr.flat_output(20.0, values)[0]
    assert below == pytest.approx((above[0], above[1], 0.0), abs=1e-12)
    for t, point in ((0.5, (0.0, 0.0, 0.0)), (4.5, (0.0, 0.0, -1.2))):
        rho, *others, _ = tr.flat_output(t, values)
        assert rho == pytest.approx(point, abs=1e-12) and not np.any(others)
    climb, fall = (
        [tr.flat_output(t + k, values)[0][2] for k in np.linspace(0.0, 3.0, 31).tolist()]
        for t in (1.0, 17.0))
    assert (np.diff(climb) < 0.0).all() and (np.diff(fall) > 0.0).all()
    assert plan.hover() == (0.0, 0.0, -1.2)


def test_a_step_reaches_the_course_without_climb_and_none_begins_with_it():
    start = START[:3, 0].tolist()
    step, none = params(takeoff='step').values(), params(takeoff='none').values()
    assert tr.flat_output(1.0, step)[0] == pytest.approx((0.0, 0.0, -1.2))
    assert tr.flat_output(5.0, step)[0] == pytest.approx(start)
    assert tr.flat_output(0.0, none)[0] == pytest.approx(start)
    assert tr.flat_output(0.0, none)[5] == tr.TRACK


def test_size_height_and_rate_change_what_is_flown():
    plan = params(scale_amplitude=0.5, height=2.0, scale_rate=0.8)
    values = plan.values()
    for t in np.linspace(0.0, COURSE.total, 11).tolist():
        at = poly.state_at(COURSE, t)
        wanted = START[:3, 0] + 0.5 * (at[:3, 0] - START[:3, 0]) - [0.0, 0.0, 0.8]
        rho, v, *_ = tr.flat_output(BEGIN + t / 0.8, values)
        np.testing.assert_allclose(rho, wanted, rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(v, 0.4 * at[:3, 1], rtol=0.0, atol=1e-12)
    assert plan.flown_course().total == pytest.approx(COURSE.total / 0.8)


def test_built_in_trajectories_have_no_pieces():
    for name in tr.TRAJECTORIES:
        plan = tr.FlightPlanParams(trajectory=name, course='left over')
        assert plan.values().pieces.begin.size == 0


@pytest.mark.parametrize(('values', 'message'), [
    ({'course': ''}, 'course is empty: trajectory course needs one'),
    ({'course': 'x'}, 'course:1: the header must be'),
    ({'height': 0.02}, r'the trajectory reaches a height of -[\d.]+ m at t = [\d.]+ s of the '
     r'flight, [\d.]+ s of the course: set height'),
    ({'scale_rate': 5.0}, r'asks for [\d.e+]+ m/s\^2 downward at t = .*, limit 9 m/s\^2'),
    ({'climb_duration': 1.0}, r'asks for 11.\d m/s\^2 downward at t = 1.\d+ s of the flight'),
    ({'landing_time': 7.0}, 'landing_time = 7 s is before the trajectory is reached'),
])
def test_flights_that_cannot_be_flown_are_refused_with_the_reason(values, message):
    with pytest.raises(ParameterError, match=message):
        tr.FlightPlanParams(**{'trajectory': 'course', 'course': TEXT, **values})


def resting(duration):
    """Return the text of a course of least snap 1 m along x, from rest to rest 1 m high."""
    piece = np.zeros((1, 4, 8))
    piece[0, 0, 4:] = np.array([35.0, -84.0, 70.0, -20.0]) / duration ** np.arange(4, 8)
    piece[0, 2, 0] = -1.0
    return uav.to_text(poly.Course(np.array([duration]), piece))


@pytest.mark.parametrize('duration', [4.0, 2.0, 1.2, 0.5])
@pytest.mark.parametrize('landing', [0.0, 20.0])
def test_a_course_from_rest_to_rest_is_not_left_before_and_after_it(duration, landing):
    values = tr.FlightPlanParams(
        trajectory='course', course=resting(duration), landing_time=landing).values()
    for t in np.arange(0.0, 30.0, 0.01).tolist():
        x = tr.flat_output(t, values)[0][0]
        if t <= BEGIN or t >= BEGIN + duration:
            assert x == pytest.approx(float(t > BEGIN), abs=1e-9), t
        else:
            assert -1e-9 < x < 1.0 + 1e-9, t


@pytest.mark.parametrize('landing', np.arange(8.05, 9.2, 0.1).tolist())
def test_a_landing_on_the_way_does_not_swing_far_out(landing):
    """The course of 1 m takes 1.2 s; to rest in the whole blend it went to -1.8 and 4.5 m."""
    values = tr.FlightPlanParams(
        trajectory='course', course=resting(1.2), landing_time=landing).values()
    path = np.array([tr.flat_output(t, values)[0] for t in np.arange(8.0, 20.0, 0.01).tolist()])
    stop = path[-1, 0]
    assert path[:, 0].min() > min(0.0, stop) - 0.4 and path[:, 0].max() < max(1.0, stop) + 0.4
    assert -0.4 < stop < 3.5 and path[-1, 2] == 0.0


def test_few_digits_of_a_file_are_rest_too():
    state = np.zeros((4, 5))
    state[:3, 1:] = (5e-4, 5e-3, 5e-2, 50.0)
    assert not poly.settled(state)[:, 1:].any()
    state[1, 1] = 0.01
    assert poly.settled(state) is state
