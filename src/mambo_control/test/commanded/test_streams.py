"""Joystick and setpoints: what becomes a command, what is left out, and what stops them."""

from collections import Counter
import math

from mambo_control.commanded.command_params import CommandParams, JoystickParams
from mambo_control.commanded.commander import Commander
from mambo_control.commanded.streams import (
    from_wire, Joystick, rehearse, Setpoints, sticks)
from mambo_control.commanded.timeline import state_of
from mambo_model.motion import flight_command as fc
from mambo_model.motion.flight_command import FlightCommand
from mambo_model.motion.trajectory import FlightPlanParams, LANDED, reference_at, TRACK
from mambo_model.vehicle.parameters import Vehicle
import pytest

STEP = 5_000_000
P, V, J = CommandParams(), Vehicle(), JoystickParams()
HELD = [0] * 8
HELD[J.enable] = 1


def axes(forward=0.0, left=0.0, up=0.0, turn=0.0):
    out = [0.0] * 5
    out[J.forward], out[J.left], out[J.up], out[J.turn] = forward, left, up, turn
    return out


class Flight:
    """A commander in the air, and what it was given."""

    def __init__(self, params=P):
        self.commander, self.given = Commander(params, V), []
        self.at = 0
        self.commander.give(FlightCommand(0, fc.TAKEOFF, height=1.2))
        self.go(5.0)

    def go(self, seconds):
        self.at += round(seconds * 1e9)
        self.commander.advance(self.at)

    def give(self, command):
        taken, reason = self.commander.give(command)
        self.given.append((taken, reason))
        return reason

    @property
    def kinds(self):
        return [fc.NAMES[command.kind] for command, reason in self.given if not reason]

    def state(self):
        return state_of(self.commander.timeline, self.at * 1e-9)


@pytest.fixture
def flight():
    return Flight()


@pytest.fixture
def joystick(flight):
    return Joystick(flight.commander, P, flight.give)


def test_sticks_have_a_dead_band_a_full_speed_and_no_more():
    assert sticks(axes(1.0, -1.0, 1.0, -1.0), J) == (J.speed, -J.speed, J.climb, -J.yaw_rate)
    assert sticks(axes(7.0), J)[0] == J.speed and sticks(axes(0.04, -0.04), J) == (0.0,) * 4
    assert sticks(axes(0.525), J)[0] == pytest.approx(0.5 * J.speed)
    assert sticks([0.0] * 4, J) is None and sticks(axes(math.nan), J) is None


def test_nothing_flies_without_the_button(flight, joystick):
    joystick.take(axes(1.0), [0] * 8)
    joystick.take(axes(1.0), [])
    assert not flight.given


def test_the_stick_flies_in_the_direction_of_the_nose_and_a_silent_one_stops(flight, joystick):
    flight.give(FlightCommand(0, fc.GO_TO, position=(0.0, 0.0, -1.2), yaw=math.pi / 2))
    flight.go(10.0)
    for _ in range(400):
        joystick.take(axes(0.5), HELD)
        flight.go(0.01)
    state, _ = flight.state()
    speed = J.speed * (0.5 - J.deadband) / (1.0 - J.deadband)
    assert state[1, 1] == pytest.approx(speed, rel=0.02) and abs(state[0, 0]) < 1e-6
    assert flight.kinds.count('velocity') == 4.0 / J.period  # not one of each message
    flight.go(3.0)  # no message: hover
    state, phase = flight.state()
    assert phase == TRACK and not state[:, 1:].any()


def test_letting_the_button_go_stops_at_once_and_only_then(flight, joystick):
    joystick.take(axes(1.0), HELD)
    joystick.take(axes(1.0), [0] * 8)
    joystick.take(axes(1.0), [0] * 8)
    assert flight.kinds == ['velocity', 'stop']


def test_another_command_rules_until_the_button_is_let_go(flight, joystick):
    joystick.take(axes(1.0), HELD)
    flight.give(FlightCommand(0, fc.LAND))
    flight.go(0.2)
    joystick.take(axes(1.0), HELD)
    joystick.take(axes(1.0), [0] * 8)  # and that does not stop the landing
    assert flight.kinds == ['velocity', 'land']
    flight.go(20.0)
    assert flight.state()[1] == LANDED


def test_buttons_take_off_and_land_when_they_are_pressed(flight, joystick):
    land, up = HELD.copy(), HELD.copy()
    land[J.land] = up[J.takeoff] = 1
    for _ in range(3):
        joystick.take(axes(), land)
        flight.go(0.1)
    flight.go(20.0)
    joystick.take(axes(), up)
    assert flight.kinds == ['land', 'takeoff']


def test_at_the_edge_the_vehicle_glides_along_it(flight, joystick):
    flight.give(FlightCommand(0, fc.GO_TO, position=(4.9, 0.0, -1.2)))
    flight.go(30.0)
    for _ in range(300):
        joystick.take(axes(1.0, 1.0), HELD)
        flight.go(0.01)
        assert flight.state()[0][0, 0] <= 5.0
    assert flight.state()[0][1, 0] < -0.5  # left is -y in NED


@pytest.mark.parametrize(('stick', 'axis', 'edge'), [
    ({'up': -1.0}, 2, -0.5), ({'up': 1.0}, 2, -3.0), ({'forward': 1.0}, 0, 5.0),
    ({'left': 1.0}, 1, -5.0), ({'forward': -0.3}, 0, -5.0)])
def test_a_stick_flies_up_to_the_edge_of_the_volume(flight, joystick, stick, axis, edge):
    flight.give(FlightCommand(0, fc.GO_TO, position=(0.0, 0.0, -1.0)))
    flight.go(10.0)
    before, step = len(flight.given), 0.05
    for _ in range(round(30.0 / step)):
        joystick.take(axes(**stick), HELD)
        flight.go(step)
    assert flight.state()[0][axis, 0] == pytest.approx(edge, abs=0.01)
    refused = [reason for _, reason in flight.given[before:] if reason]
    assert len(refused) < 0.1 * (30.0 / step)


def reference(t, **plan):
    return reference_at(t, FlightPlanParams(takeoff='none', **plan), V)[0]


def test_setpoints_of_a_circle_are_followed_to_a_centimetre(flight):
    """From outside: the circle of (5.3), slow; the vehicle goes to its beginning first."""
    plan = {'trajectory': 'circle', 'scale_rate': 0.5, 'scale_amplitude': 0.5}
    begin = reference(0.0, **plan)
    flight.give(FlightCommand(0, fc.GO_TO, position=begin.rho))
    flight.go(10.0)
    setpoints, t0 = Setpoints(flight.commander, P, flight.give), flight.at
    for k in range(1200):
        ref = reference(max((flight.at - t0) * 1e-9, 0.0), **plan)
        # the first second leads in: the stream holds its beginning, then moves off
        setpoints.take(flight.at, ref)
        flight.go(STEP * 1e-9)
        if k > 600:
            state, _ = flight.state()
            want = reference((flight.at - t0) * 1e-9, **plan)
            assert abs(state[:3, 0] - want.rho).max() < 0.01
    assert not [reason for _, reason in flight.given if reason]
    assert flight.kinds.count('setpoint') == 1200 * STEP / (P.setpoint_period * 1e9)


def test_old_setpoints_are_left_out_and_far_ones_refused_for_a_moment(flight):
    setpoints = Setpoints(flight.commander, P, flight.give)
    ref = reference(0.0, trajectory='hover')
    setpoints.take(flight.at - round(P.setpoint_timeout * 1e9) - STEP, ref)
    assert not flight.given
    far = ref._replace(rho=(40.0, 0.0, -1.2))
    said, begin = [], flight.commander.next_step
    for _ in range(20):
        said.append(setpoints.take(flight.at, far))
        flight.go(0.01)
    assert len(flight.given) == 1 and 'leaves the volume' in flight.given[0][1]
    assert said[0] == {f'not followed, the first at t = {begin * 1e-9:.3f} s: '
                       f'{flight.given[0][1]}': 1}
    assert said[1:] == [{}] * 19
    flight.go(0.2)
    assert setpoints.take(flight.at, far._replace(rho=(0.0, 50.0, -1.2))) == said[0]


def old_ones(flight, setpoints, count, age, every=0.02):
    """Give setpoints of an age in s; return what is told of them, added up."""
    ref, told = reference(0.0, trajectory='hover')._replace(rho=(0.0, 0.0, -1.25)), Counter()
    for _ in range(count):
        told.update(setpoints.take(flight.at - round(age * 1e9), ref))
        flight.go(every)
    return told


def test_setpoints_that_stay_old_are_told_with_their_number(flight):
    setpoints, begin = Setpoints(flight.commander, P, flight.give), flight.commander.next_step
    told = old_ones(flight, setpoints, 40, 0.6)
    assert told == {f'not followed, the first at t = {begin * 1e-9:.3f} s: stamped 0.605 s '
                    'before, limit 0.5 s: take the time of /clock': 40}
    assert not flight.given
    assert list((told + old_ones(flight, setpoints, 5, 0.6)).values()) == [45]  # of one reason


@pytest.mark.parametrize(('count', 'every'), [(1, 0.02), (2, 3.0), (25, 0.005)])
def test_the_last_setpoints_of_a_stream_or_some_late_ones_are_not_told(flight, count, every):
    setpoints = Setpoints(flight.commander, P, flight.give)
    assert not old_ones(flight, setpoints, 3, 0.0)
    assert not old_ones(flight, setpoints, count, 0.6, every)
    assert not old_ones(flight, setpoints, 3, 0.0)  # and begins anew
    assert not old_ones(flight, setpoints, count, 0.6, every)


def test_old_setpoints_are_not_told_while_another_command_is_in_the_way(flight):
    setpoints = Setpoints(flight.commander, P, flight.give)
    flight.give(FlightCommand(0, fc.LAND))
    assert not old_ones(flight, setpoints, 100, 0.6)


def test_a_setpoint_that_another_command_is_in_the_way_of_is_not_told(flight):
    setpoints = Setpoints(flight.commander, P, flight.give)
    flight.give(FlightCommand(0, fc.GO_TO, position=(2.0, 0.0, -1.2)))
    far = reference(0.0, trajectory='hover')._replace(rho=(40.0, 0.0, -1.2))
    assert not setpoints.take(flight.at, far)
    assert 'another command is being carried out' in flight.given[-1][1]


def test_after_another_command_the_stream_must_pause(flight):
    setpoints = Setpoints(flight.commander, P, flight.give)
    ref = reference(0.0, trajectory='hover')._replace(rho=(0.0, 0.0, -1.25))

    def send(count):
        for _ in range(count):
            setpoints.take(flight.at, ref)
            flight.go(0.02)
    send(5)
    flight.give(FlightCommand(0, fc.STOP))
    send(200)
    assert flight.kinds == ['setpoint'] * 5 + ['stop']
    flight.go(P.setpoint_timeout + 0.1)
    send(1)
    assert flight.kinds[-1] == 'setpoint'


def test_a_goal_on_the_wire_is_z_up():
    assert from_wire((1.0, 2.0, 3.0), 0.5) == ((1.0, -2.0, -3.0), -0.5)


def test_commands_of_every_kind_are_rehearsed(monkeypatch):
    """What they call is compiled then, and not in flight, where it stops the reference."""
    given, give = [], Commander.give

    def noted(self, command):
        out = give(self, command)
        given.append((command.kind, out[1]))
        return out
    monkeypatch.setattr(Commander, 'give', noted)
    rehearse(CommandParams(), Vehicle())
    assert given == [(kind, '') for kind in (
        fc.TAKEOFF, fc.GO_TO, fc.VELOCITY, fc.VELOCITY, fc.SETPOINT, fc.STOP, fc.LAND)]
