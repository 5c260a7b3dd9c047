"""Trajectories against the thesis's formulas; the flight plan by differences and at its seams."""

import math

from mambo_model.motion import trajectory as tr
from mambo_model.schema import build, ParameterError
from mambo_model.vehicle.parameters import Vehicle
import numpy as np
import pytest
from scipy.integrate import quad

sin, cos = np.sin, np.cos
# rho_r(t) as printed, equation by equation
PRINTED = {
    'hover': lambda t: [0, 0, -1.5],
    'step': lambda t: [1 if t >= 5 else 0, 0, -1.5],
    'circle': lambda t: [cos(t), sin(t), -1.5],
    'circle_fast': lambda t: [cos(2 * t), sin(2 * t), -1.5],
    'figure_3_3': lambda t: [cos(t), sin(t), -1.5 - sin(t)],
    'circle_bobbing': lambda t: [cos(t), sin(t), -1 - 0.3 * sin(t)],
    'default_circle': lambda t: [0.5 * sin(t), 0.5 * cos(t), -1.5 - 0.5 * sin(t)],
    'y_sine': lambda t: [0, sin(t), -1.5],
    'y_sine_high': lambda t: [0, 0.5 * sin(t), -2.5],
    'circle_rising': lambda t: [sin(t), cos(t), -1.5 - sin(t)],
    'incline': lambda t: [0.5 * sin(t), 0, -1.5 - 0.5 * sin(t)],
    'vertical_circle': lambda t: [0.5 * cos(t), 0, -1.5 - 0.5 * sin(t)],
    'z_sine': lambda t: [0, 0, -2 - sin(2 * t)],
    'hand_loop': lambda t: [cos(t), 0, -1.5 - sin(t)],
    'ramp': lambda t: [0.1 * t, 0, -1.5 - sin(0.5 * t)],
    'vertical_circle_large': lambda t: [cos(t), 0, -1.5 - sin(t)],
}
LANDING = 12.0
SEAMS = (1.0, 4.0, 5.0, 8.0, LANDING, LANDING + 3.0, LANDING + 6.0)
EVERY = [name for name in tr.TRAJECTORIES if name != 'step']  # what is continuous


def plan(name, **others):
    return tr.FlightPlanParams(trajectory=name, **others).values()


def flight(name):
    return plan(name, landing_time=LANDING)


@pytest.mark.parametrize('name', tr.TRAJECTORIES)
def test_without_takeoff_the_reference_is_the_printed_one_from_the_start(name):
    values = plan(name, takeoff='none')
    for t in np.linspace(0.0, 11.0, 45).tolist():
        *flat, phase = tr.flat_output(t, values)
        np.testing.assert_allclose(flat[0], PRINTED[name](t), rtol=0.0, atol=1e-14)
        assert phase == tr.TRACK


@pytest.mark.parametrize('name', EVERY)
def test_after_a_smooth_takeoff_the_trajectory_runs_on_its_own_time(name):
    for t in np.linspace(8.0, 16.0, 33).tolist():
        np.testing.assert_allclose(
            tr.flat_output(t, plan(name))[0], PRINTED[name](t - 5.0), rtol=0.0, atol=1e-14)


@pytest.mark.parametrize('name', tr.TRAJECTORIES)
@pytest.mark.parametrize('takeoff', tr.TAKEOFFS)
def test_derivatives_match_central_differences_in_every_phase(name, takeoff):
    values, h = plan(name, takeoff=takeoff, landing_time=LANDING), 1e-5
    for t in np.arange(0.0137, LANDING + 7.0, 0.0511).tolist():
        before, at, after = (tr.flat_output(x, values) for x in (t - h, t, t + h))
        for order in range(1, 5):
            # h^2/6 times a derivative of order 7, below 1e3, and 1e-16/h
            np.testing.assert_allclose(
                at[order], np.subtract(after[order - 1], before[order - 1]) / (2 * h),
                rtol=0.0, atol=2e-7)


@pytest.mark.parametrize('name', EVERY)
@pytest.mark.parametrize('seam', SEAMS)
def test_position_to_snap_are_continuous_at_every_seam(name, seam):
    gap = 1e-9
    before, after = tr.flat_output(seam - gap, flight(name)), tr.flat_output(seam, flight(name))
    for order in range(5):
        # the fifth derivative, below 500 m/s^5, over the gap
        np.testing.assert_allclose(after[order], before[order], rtol=0.0, atol=1e-6)


def test_phases_follow_one_another():
    times = (-1.0, 0.0, 0.999, 1.0, 4.5, 5.0, 11.9, 14.999, 15.0, 17.999, 18.0, 1e6)
    phases = [tr.flat_output(t, flight('circle'))[5] for t in times]
    assert phases == [
        tr.GROUND, tr.GROUND, tr.GROUND, tr.TAKEOFF, tr.TAKEOFF, tr.TRACK, tr.TRACK, tr.TRACK,
        tr.LANDING, tr.LANDING, tr.LANDED, tr.LANDED]
    assert (tr.GROUND, tr.TAKEOFF, tr.TRACK, tr.LANDING, tr.LANDED) == (0, 1, 2, 3, 4)
    assert tr.flat_output(1e6, plan('circle'))[5] == tr.TRACK  # without a landing


@pytest.mark.parametrize('t', [0.0, 0.5, 18.0, 100.0])
def test_on_the_ground_the_reference_rests_at_the_origin_with_hover_thrust(t):
    vehicle = Vehicle(mass=0.07)
    params = tr.FlightPlanParams(trajectory='figure_3_3', landing_time=LANDING)
    ref, phase = tr.reference_at(t, params, vehicle)
    assert phase in (tr.GROUND, tr.LANDED)
    zero = (0.0, 0.0, 0.0)
    assert all(math.copysign(1.0, x) == 1.0 for vector in ref[:5] for x in vector)  # no -0.0
    assert ref == (zero, zero, zero, zero, zero, (1.0, 0.0, 0.0, 0.0), zero, zero,
                   pytest.approx(0.07 * 9.81, rel=1e-15), zero)


@pytest.mark.parametrize('name', tr.TRAJECTORIES)
def test_before_the_start_and_while_landing_it_is_above_the_origin(name):
    height = -PRINTED[name](0.0)[2]
    for t in (4.0, 4.5, 4.999, LANDING + 3.0):
        np.testing.assert_allclose(
            tr.flat_output(t, flight(name))[0], (0.0, 0.0, -height), rtol=0.0, atol=1e-12)
    climb, fall = (
        [tr.flat_output(t + k, flight(name))[0][2] for k in np.linspace(0.0, 3.0, 31).tolist()]
        for t in (1.0, LANDING + 3.0))
    assert (np.diff(climb) < 0.0).all() and (np.diff(fall) > 0.0).all()


@pytest.mark.parametrize('name', tr.TRAJECTORIES)
def test_a_flight_stays_above_the_ground(name):
    times = np.linspace(0.0, 20.0, 801).tolist()
    assert max(tr.flat_output(t, flight(name))[0][2] for t in times) <= 0.0


def test_the_step_jumps_at_the_start_time_of_either_takeoff_and_is_taken_back():
    for takeoff in tr.TAKEOFFS:
        values = plan('step', takeoff=takeoff, start_time=6.0, landing_time=LANDING)
        before, after = tr.flat_output(6.0 - 1e-9, values), tr.flat_output(6.0, values)
        assert before[0] == pytest.approx((0.0, 0.0, -1.5), abs=1e-15)
        assert after[0] == pytest.approx((1.0, 0.0, -1.5), abs=1e-15)
        np.testing.assert_array_equal(after[1:5], 0.0)
        halfway = tr.flat_output(LANDING + 1.5, values)
        assert halfway[0] == pytest.approx((0.5, 0.0, -1.5), abs=1e-15)
        assert halfway[1][0] < 0.0


def test_hand_loop_turns_round_after_two_loops_and_comes_back_over_the_same_points():
    values = plan('hand_loop', takeoff='none')
    turn = values.turn_time
    for dt in (0.1, 0.5, 1.0, 4.0, 12.0):
        out, back = tr.flat_output(turn - dt, values), tr.flat_output(turn + dt, values)
        # the same place, the opposite velocity
        np.testing.assert_allclose(back[0], out[0], rtol=0.0, atol=1e-12)
        np.testing.assert_allclose(back[1], np.negative(out[1]), rtol=0.0, atol=1e-12)
    middle = tr.flat_output(turn, values)
    assert middle[0] == pytest.approx((1.0, 0.0, -1.5), abs=1e-14)  # two whole loops
    assert middle[1] == pytest.approx((0.0, 0.0, 0.0), abs=1e-14)
    times = np.linspace(0.0, 2.0 * turn, 4001).tolist()
    x, _, z = np.transpose([tr.flat_output(t, values)[0] for t in times])
    turned = np.diff(np.unwrap(np.arctan2(-1.5 - z, x)))
    assert turned[turned > 0].sum() == pytest.approx(4.0 * math.pi, abs=1e-9)
    assert turned[turned < 0].sum() == pytest.approx(-4.0 * math.pi, abs=1e-9)


@pytest.mark.parametrize('name', EVERY)
def test_scaling_changes_size_and_speed_of_the_motion(name):
    half = plan(name, takeoff='none', scale_amplitude=0.5)
    slow = plan(name, takeoff='none', scale_rate=0.5)
    hover = np.array([0.0, 0.0, PRINTED[name](0.0)[2]])
    for t in (0.3, 2.0, 7.0):
        np.testing.assert_allclose(
            tr.flat_output(t, half)[0], hover + 0.5 * (PRINTED[name](t) - hover),
            rtol=0.0, atol=1e-14)
        np.testing.assert_allclose(
            tr.flat_output(t, slow)[0], PRINTED[name](0.5 * t), rtol=0.0, atol=1e-14)


@pytest.mark.parametrize('name', tr.TRAJECTORIES)
def test_a_takeoff_in_a_step_jumps_to_the_hover_point_and_then_to_the_trajectory(name):
    values, height = plan(name, takeoff='step'), -PRINTED[name](0.0)[2]
    for t, phase, where in (
            (0.999, tr.GROUND, (0.0, 0.0, 0.0)), (1.0, tr.TAKEOFF, (0.0, 0.0, -height)),
            (4.999, tr.TAKEOFF, (0.0, 0.0, -height))):
        got = tr.flat_output(t, values)
        assert got[5] == phase and got[0] == pytest.approx(where, abs=1e-15)
        np.testing.assert_array_equal(got[1:5], 0.0)
    for t in (5.0, 6.3, 11.0):
        rho, *_, phase = tr.flat_output(t, values)
        wanted = PRINTED[name](t if name == 'step' else t - 5.0)
        assert phase == tr.TRACK and rho == pytest.approx(wanted, abs=1e-14)


@pytest.mark.parametrize('takeoff', tr.TAKEOFFS)
def test_a_height_moves_the_trajectory_as_a_whole(takeoff):
    as_printed, high = (plan('circle_rising', takeoff=takeoff, height=h) for h in (0.0, 2.5))
    for t in (9.0, 12.5):
        low, up = (tr.flat_output(t, values) for values in (as_printed, high))
        np.testing.assert_allclose(up[0], np.subtract(low[0], (0.0, 0.0, 1.0)), atol=1e-14)
        assert up[1:] == low[1:]


@pytest.mark.parametrize('name', EVERY)
def test_derivatives_scale_with_powers_of_the_rate(name):
    values, h = plan(name, scale_rate=0.7, scale_amplitude=0.8, landing_time=25.0), 1e-5
    for t in np.arange(5.0137, 32.0, 0.1511).tolist():
        before, at, after = (tr.flat_output(x, values) for x in (t - h, t, t + h))
        for order in range(1, 5):
            np.testing.assert_allclose(
                at[order], np.subtract(after[order - 1], before[order - 1]) / (2 * h),
                rtol=0.0, atol=2e-7)


def test_blend_rises_smoothly_from_zero_to_one():
    x = np.linspace(0.0, 1.0, 1001).tolist()
    weights = np.array([tr.blend(v) for v in x])
    assert (np.diff(weights[:, 0]) >= 0.0).all()
    np.testing.assert_allclose(weights[:, 0] + weights[::-1, 0], 1.0, rtol=0.0, atol=5e-16)
    np.testing.assert_array_equal(weights[[0, -1]], [[0, 0, 0, 0, 0], [1, 0, 0, 0, 0]])
    for inner in (1e-12, 1.0 - 1e-12):  # just inside: no jump up to the fourth derivative
        np.testing.assert_allclose(tr.blend(inner)[1:], 0.0, atol=2e-8)
    area = [quad(lambda v: tr.blend(v)[0], 0.0, b, epsabs=1e-13)[0] for b in (0.2, 0.5, 0.9, 1.0)]
    np.testing.assert_allclose(
        [tr.blend_integral(b) for b in (0.2, 0.5, 0.9, 1.0)], area, rtol=0.0, atol=1e-12)
    assert weights[:, 1].max() == pytest.approx(tr.BLEND_SPEED, rel=1e-4)
    assert weights[:, 2].max() == pytest.approx(tr.BLEND_ACCELERATION, rel=1e-4)


@pytest.mark.parametrize(('values', 'message'), [
    ({'trajectory': 'spiral'}, r"^trajectory = 'spiral' is not one of hover, st"),
    ({'takeoff': 'jump'}, r"^takeoff = 'jump' is not one of smooth, step, none"),
    ({'takeoff': 'step', 'start_time': 0.5}, r'start_time = 0.5 s is .* takeoff_time = 1 s'),
    ({'trajectory': 'z_sine', 'height': 0.9}, r'to the ground: 1 m of motion about 0.9 m'),
    ({'climb_duration': 0.0}, r'^climb_duration = 0.0 s is outside \[0.5, 60\]'),
    ({'start_time': 3.0}, r'start_time = 3 s is before the climb ends, .* = 4 s'),
    ({'landing_time': 7.0}, r'landing_time = 7 s is before the trajectory is reached, .* = 8 s'),
    ({'trajectory': 'step', 'takeoff': 'none', 'landing_time': 3.0},
     r'landing_time = 3 s is before the step, start_time = 5 s'),
    ({'trajectory': 'figure_3_3', 'scale_amplitude': 1.5},
     r'scale_amplitude = 1.5 takes figure_3_3 to the ground: 1.5 m of motion about 1.5 m'),
    ({'trajectory': 'z_sine', 'scale_rate': 2.0},
     r'scale_rate = 2 lets z_sine ask for up to 23.6 m/s\^2 downward, limit 9 m/s\^2: lower it'),
    ({'trajectory': 'hand_loop', 'scale_rate': 2.0, 'takeoff': 'none'},
     r'scale_rate = 2 lets hand_loop ask for up to 13.8 m/s'),
    ({'climb_duration': 1.0}, r'climb_duration = 1 lets circle ask for up to 14.1 m/s\^2 downwar'),
])
def test_plans_that_cannot_be_flown_are_refused_with_the_reason(values, message):
    with pytest.raises(ParameterError, match=message):
        build(tr.FlightPlanParams, values)


def test_limits_of_climbing_and_blending_bind_only_who_climbs_and_blends():
    quick = {'takeoff': 'none', 'climb_duration': 1.0}
    assert tr.FlightPlanParams(**quick).climb_duration == 1.0
    with pytest.raises(ParameterError, match='climb_duration = 1 lets circle'):
        tr.FlightPlanParams(**quick, landing_time=20.0)
    short = {'trajectory': 'z_sine', 'blend_duration': 0.5}
    assert tr.FlightPlanParams(takeoff='none', **short).blend_duration == 0.5
    for blending in ({}, {'takeoff': 'none', 'landing_time': 20.0}):
        with pytest.raises(ParameterError, match='or lengthen blend_duration'):
            tr.FlightPlanParams(**short, **blending)


@pytest.mark.parametrize('name', tr.TRAJECTORIES)
def test_every_trajectory_can_be_flown_at_half_rate_and_half_size_with_a_landing(name):
    tr.FlightPlanParams(
        trajectory=name, scale_rate=0.5, scale_amplitude=0.5, landing_time=30.0)


@pytest.mark.parametrize('name', tr.TRAJECTORIES)
def test_accepted_plans_never_fall_faster_than_the_stated_limit(name):
    for rate in (1.0, 1.1, 1.5, 2.0):
        try:
            values = plan(name, scale_rate=rate, landing_time=LANDING)
        except ParameterError:
            continue
        times = np.linspace(0.0, 40.0, 2001).tolist()
        assert max(tr.flat_output(t, values)[2][2] for t in times) < 9.0


@pytest.mark.parametrize('t', [math.nan, math.inf])
def test_times_that_are_none_are_refused(t):
    with pytest.raises(ValueError, match=f'flight time t = {t} s must be finite'):
        tr.reference_at(t, tr.FlightPlanParams(), Vehicle())
