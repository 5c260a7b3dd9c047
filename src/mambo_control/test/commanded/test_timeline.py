"""The reference of a commanded flight: smooth, the same from the same commands, safe."""

from bisect import bisect_right
import math

from mambo_control.commanded import script, timeline as tl
from mambo_control.commanded.command_params import CommandParams
from mambo_model.motion import flight_command as fc, uav_trajectories
from mambo_model.motion.flight_command import FlightCommand
from mambo_model.motion.polynomial import Course
from mambo_model.motion.trajectory import GROUND, LANDED, LANDING, TAKEOFF, TRACK
from mambo_model.schema import ParameterError
from mambo_model.vehicle.parameters import Vehicle
import numpy as np
import pytest

P, V = CommandParams(), Vehicle()
S = 10**9
UP = FlightCommand(S, fc.TAKEOFF, height=1.2)


def loop():
    """Return the text of a course: 1 m forward and back, from rest to rest, at a height of 1 m."""
    blend = np.zeros((4, 8))
    blend[0, 4:8] = 35.0, -84.0, 70.0, -20.0  # 0 to 1, three derivatives vanish at both ends
    blend[1, 0], blend[2, 0] = 0.5, -1.0
    back = blend.copy()
    back[0] *= -1.0
    back[0, 0] = 1.0
    scale = 4.0 ** np.arange(8)
    return uav_trajectories.to_text(Course(
        np.array([4.0, 4.0]), np.stack((blend / scale, back / scale))))


def flown(*commands):
    """Return the timeline of commands that must all be accepted."""
    return tl.fold(commands, P, V)


def refused(timeline, command, params=P):
    """Return why a command is refused, and that it changed nothing."""
    after, reason = tl.step(timeline, command, params, V)
    assert after is timeline and reason and '\n' not in reason
    return reason


EVERY = (
    UP, FlightCommand(4 * S, fc.GO_TO, position=(1.0, -0.5, -1.5), yaw=-0.5),
    FlightCommand(5 * S, fc.STOP),
    FlightCommand(8 * S, fc.VELOCITY, velocity=(0.5, 0.2, 0.0), duration=0.5, yaw_rate=0.3),
    FlightCommand(8 * S + 50_000_000, fc.VELOCITY, velocity=(0.5, 0.4, -0.1), duration=0.5),
    FlightCommand(12 * S, fc.SETPOINT, position=(1.5, 0.0, -1.4), yaw=0.1),
    FlightCommand(12 * S + 20_000_000, fc.SETPOINT, position=(1.5, 0.0, -1.39), yaw=0.1),
    FlightCommand(13 * S, fc.FOLLOW, trajectory=loop()),
    FlightCommand(15 * S, fc.GO_TO, position=(0.3, 0.0, 0.2), yaw=3.0, relative=True),
    FlightCommand(17 * S, fc.LAND), FlightCommand(18 * S, fc.STOP),
    FlightCommand(20 * S, fc.LAND, height=0.04))


def test_every_seam_is_continuous_up_to_snap_whenever_a_command_comes():
    """A course of degree 7 alone may jump in snap where it is joined: its own pieces do."""
    line = flown(*EVERY)
    for i in range(1, len(line.begin)):
        before = np.array([[*tl.jet(axis, line.begin[i] - line.begin[i - 1])]
                           for axis in line.coefficients[i - 1]])
        after = np.array([tl.jet(axis, 0.0) for axis in line.coefficients[i]])
        np.testing.assert_allclose(after[:, :4], before[:, :4], rtol=0.0, atol=1e-9)
        np.testing.assert_allclose(after[:, 4], before[:, 4], rtol=0.0, atol=1e-7)
    assert line.begin == tuple(sorted(line.begin))


def test_what_was_flown_before_a_command_stays_to_the_last_bit():
    whole = flown(*EVERY)
    for count in range(1, len(EVERY)):
        part, until = flown(*EVERY[:count]), EVERY[count].t * 1e-9
        for t in np.arange(0.0, until, 0.117):
            (a, phase_a), (b, phase_b) = tl.state_of(part, t), tl.state_of(whole, t)
            assert np.array_equal(a, b) and phase_a == phase_b


def test_a_forgetful_timeline_gives_the_same_reference():
    line = tl.initial()
    whole = flown(*EVERY)
    for command in EVERY:
        line, reason = tl.step(tl.forgotten(line, command.t * 1e-9), command, P, V)
        assert not reason
    assert len(line.begin) < 6 < len(whole.begin)
    for t in np.arange(20.0, 30.0, 0.05):
        (a, phase_a), (b, phase_b) = tl.state_of(line, t), tl.state_of(whole, t)
        assert np.array_equal(a, b) and phase_a == phase_b


def test_takeoff_and_landing_have_the_phases_that_start_and_stop_the_motors():
    line = flown(UP, FlightCommand(6 * S, fc.LAND))
    assert tl.state_of(line, 0.999)[1] == GROUND and tl.state_of(line, 1.0)[1] == TAKEOFF
    assert tl.state_of(line, 5.9)[1] == TRACK and tl.state_of(line, 6.0)[1] == LANDING
    state, phase = tl.state_of(line, line.until)
    assert phase == LANDED and np.array_equal(state, np.zeros((4, 5)))
    again, reason = tl.step(line, UP._replace(t=round(line.until * S) + S), P, V)
    assert not reason and tl.state_of(again, again.until)[0][2, 0] == -1.2


def test_a_takeoff_before_the_estimator_can_be_aligned_begins_after_it():
    line = flown(UP._replace(t=0))
    assert tl.state_of(line, 0.999 * tl.ALIGNING)[1] == GROUND
    assert tl.state_of(line, tl.ALIGNING)[1] == TAKEOFF
    later = flown(UP._replace(t=round(tl.ALIGNING * S)))
    for t in np.arange(0.0, 6.0, 0.05):
        assert np.array_equal(tl.state_of(line, t)[0], tl.state_of(later, t)[0])


def test_while_it_waits_to_take_off_commands_count_as_in_the_take_off():
    line = flown(UP._replace(t=0))
    for command, words in (
            (UP._replace(t=S // 10), 'the vehicle is taking off already'),
            (FlightCommand(S // 10, fc.GO_TO, position=(9.0, 0.0, -1.0)), 'leaves the volume')):
        after, reason = tl.step(line, command, P, V)
        assert words in reason and after is line
    line = flown(UP._replace(t=0), FlightCommand(
        S // 10, fc.GO_TO, duration=4.0, position=(1.0, 0.0, -1.0)))
    assert tl.state_of(line, 0.999 * tl.ALIGNING)[1] == GROUND
    assert line.until == pytest.approx(tl.ALIGNING + 4.0)


@pytest.mark.parametrize('kind', [fc.LAND, fc.STOP])
def test_a_takeoff_that_waits_is_given_up_without_motors(kind):
    line = flown(UP._replace(t=0), FlightCommand(S // 10, kind))
    for t in np.arange(0.0, 6.0, 0.05):
        state, phase = tl.state_of(line, t)
        assert phase == GROUND and not state.any()
    assert 'on the floor' in refused(line, FlightCommand(S // 5, fc.LAND))
    again = flown(UP._replace(t=0), FlightCommand(S // 10, kind), UP._replace(t=S // 5))
    assert np.array_equal(
        tl.state_of(again, 1.0)[0], tl.state_of(flown(UP._replace(t=0)), 1.0)[0])


def test_a_goal_is_reached_at_rest_in_the_given_time_and_the_yaw_goes_the_short_way():
    line = flown(UP, FlightCommand(5 * S, fc.GO_TO, position=(1.0, 2.0, -1.5), yaw=3.0),
                 FlightCommand(15 * S, fc.GO_TO, duration=7.0, position=(0.0, 2.0, -1.5),
                               yaw=-3.0))
    state, phase = tl.state_of(line, 22.0)
    np.testing.assert_allclose(state[:3, 0], (0.0, 2.0, -1.5), atol=1e-12)
    assert phase == TRACK and state[3, 0] == pytest.approx(2.0 * math.pi - 3.0)
    assert line.until == 22.0 and not state[:, 1:].any()


def test_a_relative_goal_is_added_to_the_present_reference():
    line = flown(UP, FlightCommand(5 * S, fc.GO_TO, relative=True, position=(0.5, 0.0, -0.2),
                                   yaw=0.4))
    np.testing.assert_allclose(
        tl.state_of(line, 60.0)[0][:, 0], (0.5, 0.0, -1.4, 0.4), atol=1e-12)


@pytest.mark.parametrize('relative', [False, True])
def test_a_trajectory_is_flown_from_its_beginning_in_its_time(relative):
    line = flown(UP, FlightCommand(5 * S, fc.FOLLOW, relative=relative, timescale=1.5,
                                   trajectory=loop()))
    i = bisect_right(line.begin, 5.0)
    begin = line.begin[i - 1 if relative else i]  # absolute: after an approach
    start = np.array([0.0, 0.0, -1.2] if relative else [0.0, 0.5, -1.0])
    for t, x in ((0.0, 0.0), (3.0, 0.5), (6.0, 1.0), (9.0, 0.5), (12.0, 0.0)):
        np.testing.assert_allclose(
            tl.state_of(line, begin + t)[0][:3, 0], start + (x, 0.0, 0.0), atol=1e-9)


def test_a_velocity_is_reached_kept_and_lost_again_when_nothing_follows():
    line = flown(UP, FlightCommand(5 * S, fc.VELOCITY, velocity=(0.4, 0.0, 0.0), duration=0.5))
    speeds = [tl.state_of(line, t)[0][0, 1] for t in np.arange(5.0, 8.0, 0.01)]
    assert max(speeds) == pytest.approx(0.4) and speeds[-1] == 0.0
    assert sum(speed == pytest.approx(0.4, abs=1e-9) for speed in speeds) >= 49


def test_setpoints_that_stop_are_followed_by_a_hover_and_a_landing():
    line = flown(UP, FlightCommand(5 * S, fc.SETPOINT, position=(0.05, 0.0, -1.2)))
    assert tl.state_of(line, 9.0)[1] == TRACK
    phases = [tl.state_of(line, t)[1] for t in np.arange(5.0, 30.0, 0.1)]
    assert phases == sorted(phases) and phases[-1] == LANDED
    assert phases.index(LANDING) * 0.1 >= P.setpoint_landing


@pytest.mark.parametrize(('command', 'words'), [
    (UP._replace(height=9.0), 'height = 9 m is outside [0.5, 3] m'),
    (UP._replace(height=math.nan), 'not finite'),
    (UP._replace(duration=-1.0), 'outside [0, 120] s'),
    (UP._replace(duration=1e300), 'above 1e+06'),
    (UP._replace(duration=0.05), 'the path needs'),
    (UP._replace(kind=7), 'not a kind'),
    (FlightCommand(S, fc.LAND), 'take off first'),
    (FlightCommand(S, fc.STOP), 'take off first'),
    (FlightCommand(S, fc.VELOCITY, duration=1.0), 'take off first')])
def test_on_the_floor_only_a_sensible_takeoff_is_accepted(command, words):
    assert words in refused(tl.initial(), command)


@pytest.mark.parametrize(('command', 'words'), [
    (FlightCommand(0, fc.TAKEOFF, height=1.0), 'flying already'),
    (FlightCommand(0, fc.GO_TO, position=(6.0, 0.0, -1.0)), 'leaves the volume: x = 6 m, limit 5'),
    (FlightCommand(0, fc.GO_TO, position=(0.0, 6.0, -1.0)), 'volume: y = -6 m'),
    (FlightCommand(0, fc.GO_TO, position=(0.0, 0.0, -4.0)), '4 m high, ceiling 3 m'),
    (FlightCommand(0, fc.GO_TO, position=(0.0, 0.0, -0.1)), 'comes down to 0.1 m'),
    (FlightCommand(0, fc.GO_TO, position=(0.0, 0.0, 1.0)), 'comes down to -1 m'),
    (FlightCommand(0, fc.GO_TO, position=(3.0, 0.0, -1.0), duration=3.0), 'speed'),
    (FlightCommand(0, fc.GO_TO, position=(0.0, 0.0, -1.2), yaw=3.0, duration=2.0), 'turns at'),
    (FlightCommand(0, fc.GO_TO, position=(0.0, math.inf, -1.0)), 'not finite'),
    (FlightCommand(0, fc.GO_TO, position=(0.0, 1e300, -1.0)), 'above 1e+06'),
    (FlightCommand(0, fc.LAND, height=0.5), 'outside [0, 0.1] m'),
    (FlightCommand(0, fc.VELOCITY, velocity=(1.5, 1.5, 0.0), duration=0.1), 'speed'),
    (FlightCommand(0, fc.VELOCITY, velocity=(0.0, 0.0, 1.0), duration=3.0), 'comes down'),
    (FlightCommand(0, fc.SETPOINT, position=(50.0, 0.0, -1.2)), 'leaves the volume'),
    (FlightCommand(0, fc.FOLLOW, trajectory='nonsense'), 'header'),
    (FlightCommand(0, fc.FOLLOW, trajectory='x' * 200_001), 'longer than 200000'),
    (FlightCommand(0, fc.FOLLOW, timescale=0.0, trajectory=loop()), 'timescale = 0'),
    (FlightCommand(0, fc.FOLLOW, timescale=16.0, trajectory=loop()), 'lasts 128 s, limit 120'),
    (FlightCommand(0, fc.FOLLOW, timescale=0.3, trajectory=loop()), 'the path needs acc')])
def test_in_flight_what_is_unsafe_is_refused_in_one_line(command, words):
    assert words in refused(flown(UP), command._replace(t=6 * S))


def test_a_goal_outside_is_named_as_such_in_motion():
    timeline = flown(UP, FlightCommand(8 * S, fc.GO_TO, position=(1.0, 0.0, -1.0)))
    reason = refused(timeline, FlightCommand(8 * S + S // 2, fc.GO_TO, position=(9.0, 0.0, -1.0)))
    assert reason == 'the path leaves the volume: x = 9 m, limit 5 m'


def darting(duration):
    """Return a course that rests for 1 s, goes 1 m ahead and back within a piece, and rests."""
    rest, dart = np.zeros((2, 4, 8))
    rest[2, 0] = dart[2, 0] = -1.2
    dart[0, 3:7] = 64.0 * np.array([1.0, -3.0, 3.0, -1.0]) / duration ** np.arange(3, 7)
    return uav_trajectories.to_text(
        Course(np.array([1.0, duration, 1.0]), np.stack((rest, dart, rest))))


@pytest.mark.parametrize('duration', [0.005, 0.01, 0.02])
@pytest.mark.parametrize('command', [
    FlightCommand(0, fc.LAND), FlightCommand(0, fc.GO_TO, position=(4.0, 0.0, -1.2)),
    FlightCommand(0, fc.GO_TO, position=(0.0, 0.0, -1.2), yaw=3.0)])
def test_what_would_happen_between_two_control_steps_is_refused(command, duration):
    reason = refused(flown(UP), command._replace(t=6 * S, duration=duration))
    assert reason.startswith(('the path needs', 'the path turns at'))


@pytest.mark.parametrize('duration', [0.001, 0.005, 0.05])
def test_a_piece_of_a_course_that_is_shorter_than_a_step_is_checked(duration):
    course = FlightCommand(6 * S, fc.FOLLOW, trajectory=darting(duration))
    assert 'the path needs' in refused(flown(UP), course)
    assert not tl.step(flown(UP), course._replace(trajectory=darting(8.0)), P, V)[1]


@pytest.mark.parametrize('duration', [5e-324, 1e-300, 1e-9, 0.0049])
@pytest.mark.parametrize('command', [UP, FlightCommand(
    S, fc.LAND), FlightCommand(S, fc.VELOCITY)])
def test_a_duration_below_a_control_step_is_refused(recwarn, command, duration):
    line = tl.initial() if command.kind == fc.TAKEOFF else flown(UP)
    assert 'is shorter than a control step, 0.005 s' in refused(
        line, command._replace(t=6 * S, duration=duration))
    assert not recwarn.list


@pytest.mark.parametrize('late', [0, S // 20, S // 2])
def test_a_stop_of_a_takeoff_hovers_where_the_vehicle_may(late):
    line = flown(UP, FlightCommand(UP.t + late, fc.STOP))
    assert tl.state_of(line, UP.t * 1e-9 + late * 1e-9)[1] == TAKEOFF
    state, phase = tl.state_of(line, 60.0)
    assert phase == TRACK and -state[2, 0] == pytest.approx(P.lowest) and not state[:, 1:].any()


def test_a_landing_that_is_too_low_to_hover_goes_on():
    line = flown(UP, FlightCommand(6 * S, fc.LAND))
    low = round((line.until - 0.2) * S)
    assert 'landing and too low to hover' in refused(line, FlightCommand(low, fc.STOP))


def test_a_landing_before_the_first_step_of_a_take_off_gives_it_up():
    line = flown(UP, UP._replace(kind=fc.LAND, height=0.0))
    assert 'on the floor: take off first' in refused(line, FlightCommand(UP.t + 1, fc.STOP))
    assert tl.state_of(line, 60.0)[1] == GROUND
    waits = UP._replace(t=0)  # up to 0.5 s
    line = flown(waits, FlightCommand(S // 2, fc.LAND))
    assert {tl.state_of(line, t)[1] for t in np.arange(0.0, 9.0, 0.1)} == {GROUND}


@pytest.mark.parametrize('after', [0.005, 0.05, 0.25])
def test_a_landing_while_the_reference_has_hardly_left_the_floor_stops_the_motors(after):
    land = UP._replace(t=UP.t + round(after * S), kind=fc.LAND, height=0.0)
    assert 0.0 < -tl.state_of(flown(UP), land.t * 1e-9)[0][2, 0] < 0.01
    line = flown(UP, land)
    for t in (land.t * 1e-9, land.t * 1e-9 + 0.3, 60.0):
        state, phase = tl.state_of(line, t)
        assert phase == LANDED and not state.any()
    again, reason = tl.step(line, UP._replace(t=land.t + S), P, V)
    assert not reason and tl.state_of(again, again.until)[0][2, 0] == -1.2


def test_a_landing_from_a_take_off_that_has_left_the_floor_comes_down():
    line = flown(UP, FlightCommand(UP.t + 2 * S, fc.LAND))
    assert tl.state_of(line, line.until - 0.5)[1] == LANDING


@pytest.mark.parametrize('t', [0, S // 10, S // 2 - S // 200, S // 2])
@pytest.mark.parametrize('command', [
    FlightCommand(0, fc.GO_TO, position=(0.5, 0.0, -1.0)),
    FlightCommand(0, fc.FOLLOW, trajectory=loop()), FlightCommand(0, fc.STOP)])
def test_what_replaces_a_take_off_that_waits_begins_with_a_take_off(t, command):
    """The failsafe then refuses a vehicle that is not aligned."""
    line = flown(UP._replace(t=0), command._replace(t=t))
    phases = [tl.state_of(line, 0.005 * k)[1] for k in range(4000)]
    if command.kind == fc.STOP and t < S // 2:
        assert set(phases) == {GROUND}
        return
    first = next(k for k, phase in enumerate(phases) if phase != GROUND)
    assert phases[first] == TAKEOFF and first * 0.005 == pytest.approx(0.5)
    assert phases[-1] == TRACK


@pytest.mark.parametrize(('late', 'duration', 'taken'), [
    (0.2, 5.0, True), (0.2, 12.0, False), (0.2, 60.0, False), (1.2, 60.0, True)])  # above by then
def test_a_go_to_that_lingers_near_the_floor_is_refused(late, duration, taken):
    line = flown(UP)
    command = FlightCommand(UP.t + round(late * S), fc.GO_TO, position=(0.0, 0.0, -0.9),
                            duration=duration)
    if taken:
        flown(UP, command)
    else:
        assert 'the vehicle would be below the lowest flight, 0.5 m, for' in refused(line, command)
    high = command._replace(t=UP.t + 8 * S)
    flown(UP, high)  # once it is up, a slow one is none


def test_commands_that_do_not_fit_the_moment_are_refused():
    line = flown(UP, FlightCommand(6 * S, fc.LAND))
    assert 'landing already' in refused(line, FlightCommand(7 * S, fc.LAND))
    assert 'earlier' in refused(line, FlightCommand(5 * S, fc.STOP))
    assert 'being carried out' in refused(
        flown(UP), FlightCommand(2 * S, fc.VELOCITY, duration=0.5))
    assert 'comes down to 0 m' in refused(flown(UP), FlightCommand(
        UP.t + S // 50, fc.GO_TO, position=(2.0, 0.0, 0.0)))  # it has hardly begun to rise
    low = round((line.until - 0.2) * S)
    assert 'comes down' in refused(line, FlightCommand(
        low, fc.GO_TO, position=(0.0, 0.0, -0.0)))


def test_a_landing_can_be_broken_off():
    line = flown(UP, FlightCommand(6 * S, fc.LAND), FlightCommand(6 * S + S // 2, fc.STOP))
    state, phase = tl.state_of(line, 60.0)
    assert phase == TRACK and 0.9 < -state[2, 0] < 1.2


def test_a_duration_that_is_not_given_keeps_the_limits_and_uses_them():
    line = flown(UP, FlightCommand(6 * S, fc.GO_TO, position=(4.0, 0.0, -1.2)))
    fastest = max(tl.state_of(line, t)[0][0, 1] for t in np.arange(6.0, line.until, 0.005))
    assert 0.5 * P.speed < fastest <= P.speed


def test_a_script_that_is_refused_names_the_command_and_its_time():
    with pytest.raises(ParameterError, match=r'^land at t = 3 s: the vehicle is on the floor'):
        tl.fold(script.parse('- {time: 3, land: {}}'), P, V)


EDGES = {
    'ceiling': (FlightCommand(S, fc.TAKEOFF, height=3.0),),
    'nearly the ceiling': (FlightCommand(S, fc.TAKEOFF, height=2.9),),
    'edge': (UP, FlightCommand(5 * S, fc.GO_TO, position=(5.0, -5.0, -3.0))),
    'along the ceiling': (FlightCommand(S, fc.TAKEOFF, height=3.0), FlightCommand(
        8 * S, fc.GO_TO, position=(3.0, 2.0, -3.0))),
    'lowest': (UP, FlightCommand(5 * S, fc.GO_TO, position=(1.0, 0.0, -0.5)))}


@pytest.mark.parametrize('kind', [fc.STOP, fc.LAND])
@pytest.mark.parametrize('commands', EDGES.values(), ids=EDGES)
def test_near_every_limit_a_vehicle_may_stop_and_land(commands, kind):
    line = flown(*commands)
    for t in np.arange(commands[-1].t + S // 50, round(line.until * S), S // 25).tolist():
        after, reason = tl.step(line, FlightCommand(t, kind), P, V)
        assert not reason, f'{t * 1e-9:.2f} s: {reason}'
        times = np.arange(t * 1e-9, after.until + 1.0, 0.02)
        path = np.array([tl.state_of(after, x)[0] for x in times])
        assert np.abs(np.diff(path[:, :3, 0], axis=0)).max() < 0.02 * (P.speed + 0.01)
        assert (-path[:, 2, 0]).max() < P.ceiling + 1e-5
        assert np.abs(path[:, :2, 0]).max() < 5.0 + 1e-5
        assert tl.state_of(after, after.until + 1.0)[1] == (TRACK if kind == fc.STOP else LANDED)
        before = tl.state_of(line, t * 1e-9 - 1e-9)[0]
        if tl.state_of(after, t * 1e-9)[1] == LANDED:  # given up at once
            np.testing.assert_allclose(path[0][:, 0], before[:, 0], atol=0.01)
        else:
            np.testing.assert_allclose(path[0][:, :4], before[:, :4], atol=1e-6)


def test_a_stop_that_fits_is_not_put_off():
    line = flown(UP, FlightCommand(5 * S, fc.GO_TO, position=(4.0, 0.0, -1.2)))
    after, _ = tl.step(line, FlightCommand(round(5.8 * S), fc.STOP), P, V)
    assert after.until < line.until and tl.state_of(after, 20.0)[0][0, 0] < 2.0
    far = refused(flown(UP), FlightCommand(6 * S, fc.GO_TO, position=(9.0, 0.0, -1.0)))
    assert 'leaves the volume' in far


@pytest.mark.parametrize('height, duration', [(1.0, 8.5), (1.0, 110.0), (3.0, 20.0)])
def test_a_takeoff_or_landing_that_lingers_near_the_floor_is_refused(height, duration):
    """The sonar is blind there: of 1 m in 30 s a flight ended or was half a metre off."""
    start = FlightCommand(S, fc.TAKEOFF, height=height)
    assert 'below the lowest flight, 0.5 m, for' in refused(
        tl.initial(), start._replace(duration=duration))
    line = flown(start)
    assert 'limit 4 s: give a shorter duration' in refused(
        line, FlightCommand(20 * S, fc.LAND, duration=duration))
    assert flown(start._replace(duration=6.0), FlightCommand(20 * S, fc.LAND, duration=6.0))


@pytest.mark.parametrize('kind', [fc.STOP, fc.LAND])
@pytest.mark.parametrize('at', [1.25, 1.5, 1.75, 2.0, 2.5])
def test_a_stop_or_a_landing_never_climbs_beyond_the_take_off(kind, at):
    line = flown(FlightCommand(S // 2, fc.TAKEOFF, height=1.2), FlightCommand(round(at * S), kind))
    assert min(tl.state_of(line, t)[0][2, 0] for t in np.arange(0.0, 8.0, 0.01)) > -1.2 - 1e-9


@pytest.mark.parametrize(('at', 'end'), [
    (6.5, 0.04), (6.75, 0.21), (7.0, 0.76), (7.25, 1.61), (7.5, 2.0), (8.0, 2.0)])
def test_a_stop_comes_to_rest_by_the_shorter_of_two_ways(at, end):
    """To rest at once, until the way to the goal is shorter."""
    line = flown(FlightCommand(S // 2, fc.TAKEOFF, height=1.2),
                 FlightCommand(6 * S, fc.GO_TO, position=(2.0, 0.0, -1.2)),
                 FlightCommand(round(at * S), fc.STOP))
    x = [tl.state_of(line, t)[0][0, 0] for t in np.arange(6.0, 12.0, 0.01)]
    assert x[-1] == pytest.approx(end, abs=0.01) and max(x) < end + 0.01


@pytest.mark.parametrize('seconds', np.arange(4.2, 7.0, 0.4).tolist())
@pytest.mark.parametrize('goal', [(-2.0, 0.0, -1.2), (0.0, 0.0, -1.2), (-1.0, 2.0, -2.0)])
def test_a_vehicle_that_is_called_back_goes_little_farther_than_by_a_stop(seconds, goal):
    away = flown(UP, FlightCommand(4 * S, fc.GO_TO, position=(2.0, 0.0, -1.2)))
    t = round(seconds * S)

    def farthest(command):
        after, reason = tl.step(away, command, P, V)
        assert not reason
        return max(tl.state_of(after, at)[0][0, 0]
                   for at in np.arange(seconds, after.until, 0.02))
    assert farthest(FlightCommand(t, fc.GO_TO, position=goal)) < 0.7 + farthest(
        FlightCommand(t, fc.STOP))


def test_where_there_is_no_room_to_stop_one_polynomial_is_flown():
    near = flown(UP, FlightCommand(4 * S, fc.GO_TO, position=(5.0, -3.0, -2.0)))
    after, reason = tl.step(near, FlightCommand(
        12_550_000_000, fc.GO_TO, position=(5.0, 3.0, -2.0)), P, V)
    assert not reason
    times = np.arange(12.55, after.until, 0.02)
    assert max(tl.state_of(after, t)[0][0, 0] for t in times) < 5.0 + 1e-9
