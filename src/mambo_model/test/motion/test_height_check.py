"""A vehicle that lies on the floor while its reference flies has not flown as asked."""

from mambo_model.motion.height_check import (
    ABOVE, distance_fault, flight_fault, height_fault, hits_floor, IDLE, idle_fault, landing_fault,
    LONG, LOW, over_in_the_air, STAND, stand_fault)
from mambo_model.motion.trajectory import blend, GROUND, LANDED, LANDING, TAKEOFF, TRACK
import numpy as np
import pytest

T = np.arange(6.0)
FLIGHT = (GROUND, TAKEOFF, TRACK, TRACK, TRACK, TRACK)
UP = (0.0, 0.5, 1.0, 1.0, 1.0, 1.0)
LANDED_FLIGHT = (GROUND, TRACK, LANDING, LANDED, LANDED, LANDED)


@pytest.mark.parametrize(('height', 'wanted', 'phase', 'said'), [
    (UP, UP, FLIGHT, ''),
    ((0.0,) * 6, UP, FLIGHT, 'the vehicle never took off: on the floor from 1.00 to 5.00 s, up to '
                             '1.00 m below its reference'),
    ((0.0, 0.5, 1.0, 0.4, 0.009, -0.001), UP, FLIGHT,
     'the vehicle was on the floor from 4.00 to 5.00 s, up to 1.00 m below its reference'),
    ((0.0, 0.5, 0.0, 0.0, 1.0, 1.0), UP, FLIGHT,  # and flies again
     'the vehicle was on the floor from 2.00 to 3.00 s, up to 1.00 m below its reference'),
    ((0.0, 0.5, 1.0, 1.0, 0.0, 0.0), (0.0, 0.5, 1.0, 1.0, 0.9, 0.5),
     (GROUND, TAKEOFF, TRACK, LANDING, LANDING, LANDING),  # the motors stopped as it landed
     'the vehicle was on the floor from 4.00 to 5.00 s, up to 0.90 m below its reference'),
    ((0.0, 0.5, 1.0, 0.5, 0.0, 0.0), (0.0, 0.5, 1.0, 0.5, 0.0, 0.0),
     (GROUND, TAKEOFF, TRACK, LANDING, LANDED, LANDED), ''),
    ((0.0,) * 6, (LOW,) * 6, FLIGHT, ''),  # too low to tell
    ((0.0,) * 6, (2 * LOW,) * 6, FLIGHT,
     'the vehicle never took off: on the floor from 1.00 to 5.00 s, up to 0.10 m below its '
     'reference'),
    ((0.0, 0.02, 0.0, 0.0, 0.0, 0.0), (ABOVE,) * 6, FLIGHT, ''),
    ((0.0,) * 6, (0.0,) * 6, (GROUND,) * 6, ''),  # nobody asked it to fly
    ((0.0, 1.4, 100.0, 300.0, 600.0, 900.0), UP, FLIGHT,  # from 2 s on too high
     'the vehicle was up to 899.00 m above its reference, from 2.00 to 5.00 s'),
    ((0.0, 0.5, 1.0, -6.0, -9.0, -9.0), (0.0, 0.5, 0.2, 0.2, 0.2, 0.2), FLIGHT,  # no floor there
     'the vehicle was up to 9.20 m below its reference, from 3.00 to 5.00 s'),
    ((0.0, 0.5, 1.0, 7.0, 7.0, 1.0), UP, FLIGHT, ''),  # for 1 s
    ((0.0, 0.5, 2.1, 2.1, 2.1, 1.0), UP, FLIGHT,  # further off than the flight is high
     'the vehicle was up to 1.10 m above its reference, from 2.00 to 4.00 s'),
    ((0.0, 0.5, 1.9, 1.9, 1.9, 1.9), UP, FLIGHT, ''),
    ((0.0, 0.5, 7.9, 7.9, 7.9, 7.9), (0.0, 0.5, 3.0, 3.0, 3.0, 3.0), FLIGHT,
     'the vehicle was up to 4.90 m above its reference, from 2.00 to 5.00 s'),
    ((0.0, 0.5, 0.0, 3.0, 9.0, 32.0), (0.0, 0.5, 0.0, 0.0, 0.0, 0.0),
     (GROUND, LANDING, LANDED, LANDED, LANDED, LANDED),  # it rises after the landing
     'the vehicle was up to 32.00 m above its reference, from 3.00 to 5.00 s'),
    ((0.0,) + (0.9,) * 5, (0.0,) * 6, (GROUND,) * 6, ''),
    ((0.0,) * 6, UP, (GROUND,) * 6,  # whose phase was forgotten
     'the reference was up to 1.00 m above the vehicle on the floor, from 1.00 to 5.00 s, in '
     'phase GROUND or LANDED, in which the motors stand still: to fly, its phase must be TAKEOFF, '
     'TRACK or LANDING'),
    ((0.0, 0.5, 1.0, 0.0, 0.0, -0.5), UP, (GROUND, TAKEOFF, TRACK, LANDED, LANDED, LANDED),
     'the reference was up to 1.00 m above the vehicle on the floor, from 3.00 to 5.00 s, in '
     'phase GROUND or LANDED, in which the motors stand still: to fly, its phase must be TAKEOFF, '
     'TRACK or LANDING'),
    ((0.0, 0.5, 0.0, 0.0, 0.0, 0.0), UP, (GROUND, TAKEOFF, TRACK, TRACK, LANDED, LANDED),
     'the vehicle was on the floor from 2.00 to 5.00 s, up to 1.00 m below its reference'),
    ((0.0, 0.5, 0.0, -0.4, -0.4, -0.4), (0.0, 0.5, 0.1, 0.0, 0.0, 0.0),  # the floor falls there
     (GROUND, TAKEOFF, LANDING, LANDED, LANDED, LANDED), ''),
    ((0.9,) * 6, (1.0,) * 6, (GROUND,) * 6, ''),  # on a table, or in a hand
    ((np.nan,) * 6, UP, FLIGHT, '')])
def test_who_lies_below_a_flying_reference_is_named(height, wanted, phase, said):
    assert height_fault(T, *map(np.array, (height, wanted, phase))) == said


def test_a_step_of_the_reference_needs_time():
    t = np.arange(100) * 0.005
    for steps, told in ((60, False), (62, True)):
        height = np.where(np.arange(100) < steps, 0.0, 1.0)
        assert bool(height_fault(t, height, np.ones(100), np.full(100, TRACK))) == told
    assert 59 * 0.005 < LONG < 61 * 0.005


def test_without_a_floor_nothing_lies_on_it():
    low, wanted, phase = np.zeros(6), np.ones(6), np.full(6, TRACK)
    assert height_fault(T, low, wanted, phase) and not height_fault(T, low, wanted, phase, False)
    assert 'below its reference' in height_fault(T, low - 5.0, wanted, phase, False)


def test_what_is_far_in_height_depends_on_the_height_flown_so_far():
    t, phase = np.arange(400) * 0.01, np.full(400, TRACK)
    for wanted, off, told in ((0.5, 0.9, False), (0.5, 1.1, True), (3.0, 2.9, False),
                              (3.0, 3.1, True), (9.0, 4.9, False), (9.0, 5.1, True)):
        for sign in (1.0, -1.0):
            assert bool(height_fault(
                t, np.full(400, wanted + sign * off), np.full(400, wanted), phase, False)) == told
    later = np.where(t < 3.0, 0.5, 9.0)  # 2 m above a low reference, before it rises
    assert height_fault(t, later + 2.0 * (t < 3.0), later, phase).endswith('from 0.00 to 2.99 s')


@pytest.mark.parametrize(('beside', 'seconds', 'phase', 'told'), [
    (4.9, 4.0, TRACK, False), (5.1, 4.0, TRACK, True), (5.1, 1.9, TRACK, False),
    (5.1, 2.1, LANDING, True), (5.1, 4.0, GROUND, False)])
def test_a_vehicle_far_beside_its_reference_is_named(beside, seconds, phase, told):
    t = np.arange(401) * 0.01
    off = np.where((t >= 0.5) & (t < 0.5 + seconds), beside, 0.1)
    said = distance_fault(t, off, np.full(401, phase))
    assert said == told * (f'the vehicle was up to {beside:.2f} m beside its reference, from 0.50 '
                           f'to {min(0.49 + seconds, 4.0):.2f} s')
    truth = np.stack((-0.6 * off, 0.8 * off, np.ones(401)), axis=1) + (1.0, 2.0, 0.0)
    wanted = np.zeros((401, 3)) + (1.0, 2.0, 1.0)
    whole = np.full(401, phase), np.ones(401, bool)
    assert flight_fault(t, truth, wanted, *whole) == said
    above = flight_fault(t, truth + (0.0, 0.0, 1.5), wanted, *whole)
    assert 'above its reference' in above and above.endswith(f'; {said}' * told)  # both are named
    assert flight_fault(t, truth + (0.0, 0.0, 1.5), wanted, *whole, ended=True) == said


ON_FLIGHT = (False, True, True, False, False, False)
ON_DOWN = (False, True, True, True, False, False)  # motors of a vehicle that goes on down


@pytest.mark.parametrize(('height', 'phase', 'turning', 'at'), [
    ((0.0, 1.0, 0.5, 0.1, 0.0, 0.0), LANDED_FLIGHT, ON_FLIGHT, None),
    ((0.0, 1.0, 0.9, 0.4, 0.0, 0.0), LANDED_FLIGHT, ON_FLIGHT, (3, 0.4)),
    ((0.0, 1.0, 0.9, 0.4, 0.1, 0.0), LANDED_FLIGHT, ON_DOWN, None),
    ((0.0, 1.0, 0.9, 0.6, 0.3, 0.0), LANDED_FLIGHT, ON_DOWN, (4, 0.3)),
    ((0.0, 1.0, 0.9, 0.8, 0.7, 0.6), LANDED_FLIGHT, (False,) + (True,) * 5, None),
    ((0.0, 1.0, 0.9, 0.8, 0.7, 0.6), (GROUND, TRACK) + (LANDING,) * 4, (True,) * 6, None),
    ((1.0,) * 6, (GROUND,) * 6, (False,) * 6, None)])
def test_a_vehicle_whose_motors_stop_above_the_floor_after_its_landing_is_named(
        height, phase, turning, at):
    assert landing_fault(T, *map(np.array, (height, phase, turning))) == (at and (
        f'the motors stopped at {at[0]:.2f} s, as the reference had landed, with the vehicle '
        f'{at[1]:.2f} m above the floor: it fell from there') or '')


@pytest.mark.parametrize(('phase', 'first', 'last', 'said'), [
    (GROUND, 0.0, 1.5, (1.5, 0.0, 1.5)), (LANDED, 2.0, 2.75, (0.75, 2.0, 2.75)),
    (LANDED, 1.0, 1.0 + IDLE - 0.125, None), (TRACK, 0.0, 3.0, None)])
def test_motors_that_turn_while_none_are_asked_for_are_named(phase, first, last, said):
    t = np.arange(25) * 0.125
    turning = (t >= first) & (t <= last)
    assert idle_fault(t, np.full(25, phase), turning) == ('' if said is None else (
        f'the motors turned for {said[0]:.2f} s while the phase of the reference was GROUND or '
        f'LANDED, in which they must stand still, longest from {said[1]:.2f} to {said[2]:.2f} s: '
        'the controller must answer these phases with PWM 0'))


def landed(phase, end=0.0):
    """Return a flight that lands at 2 s, the height of its reference then, and its phase."""
    t = np.arange(1000) * 0.005
    wanted = np.interp(t, [0.0, 1.0, 2.0], [0.0, 1.0, end])
    flown = np.where(t < 2.0, TRACK, phase)
    return t, np.clip(wanted, 0.0, 1.0), wanted, flown


@pytest.mark.parametrize(('phase', 'told'), [
    (LANDING, True), (TRACK, True), (TAKEOFF, True), (LANDED, False), (GROUND, False)])
@pytest.mark.parametrize(('end', 'low'), [(0.0, True), (-0.5, True), (0.03, False)])
def test_motors_that_turn_on_the_floor_below_a_reference_at_rest_are_named(phase, told, end, low):
    flight = landed(phase, end)
    t, height, wanted, flown = flight
    begin = t[np.flatnonzero(wanted == end)[1]]
    expected = (f'the motors turned on the floor from {begin:.2f} to {t[-1]:.2f} s, as the '
                f'reference stood {end:.2f} m high in a phase of flight: there its phase must '
                'be GROUND, or LANDED after a landing') * (told and low)
    turning = np.ones(1000, bool)
    assert stand_fault(*flight, turning) == expected
    paths = (np.column_stack((0.0 * t, 0.0 * t, z)) for z in (height, wanted))
    assert expected in flight_fault(t, *paths, flown, turning)
    assert not stand_fault(*flight, ~turning)


@pytest.mark.parametrize('climb', [0.5, 3.0, 60.0])
def test_a_slow_take_off_or_landing_stands_nowhere(climb):
    t = np.arange(0.0, climb, 0.005)
    wanted = 0.1 * np.array([blend(one / climb)[0] for one in t])
    on_floor, turning = np.zeros(len(t)), np.ones(len(t), bool)
    for up in (wanted, wanted[::-1]):
        assert not stand_fault(t, on_floor, up, np.full(len(t), TAKEOFF), turning)


def test_a_short_stand_is_left_out():
    t, height, wanted, flown = landed(TRACK)
    flown[t > 2.0 + 0.95 * STAND] = LANDED
    assert not stand_fault(t, height, wanted, flown, np.ones(1000, bool))


def test_all_the_time_that_motors_turn_without_need_is_told():
    t = np.arange(49) * 0.125
    phase = np.where(t < 1.0, GROUND, np.where(t < 4.0, TRACK, LANDED))
    said = idle_fault(t, phase, np.ones(49, bool))
    assert 'for 2.88 s' in said and 'longest from 4.00 to 6.00 s' in said


@pytest.mark.parametrize(('speed', 'told'), [(1.9, False), (2.1, True), (4.2, True)])
def test_a_vehicle_that_hits_the_floor_is_named(speed, told):
    t = np.arange(400) * 0.005
    height = np.clip(1.003 - speed * (t - 0.5), 0.0, 1.0)
    at = t[np.flatnonzero(height <= 0.01)[0]]
    rest = np.full(400, LANDING), np.ones(400, bool)
    assert landing_fault(t, height, *rest) == told * (
        f'the vehicle hit the floor at {at:.2f} s with {speed:.1f} m/s')
    steps = zip(height[2:], height[1:], height)
    assert any(hits_floor(*three, 0.005) for three in steps) == told
    assert not landing_fault(t, height[::-1], *rest)  # which leaves it


@pytest.mark.parametrize('speeds', [(2.5, 4.0, 3.0), (4.0, 2.5, 3.0), (2.5, 3.0, 4.0)])
def test_of_several_hits_of_the_floor_the_hardest_is_named(speeds):
    dt, falls = 0.005, [np.clip(0.5 - v * np.arange(100) * 0.005, 0.0, 0.5) for v in speeds]
    height = np.concatenate(falls)
    t, first = np.arange(300) * dt, speeds.index(4.0) * 100
    at = t[first + np.flatnonzero(height[first:] <= 0.01)[0]]
    assert landing_fault(t, height, np.full(300, LANDING), np.ones(300, bool)) == (
        f'the vehicle hit the floor at {at:.2f} s with 4.0 m/s')


@pytest.mark.parametrize(('height', 'turning', 'said'), [
    (1.0, True, True), (0.83, True, True), (1.0, False, False), (0.0, True, False)])
def test_a_flight_that_is_over_before_its_landing_is_named(height, turning, said):
    assert over_in_the_air(height, turning) == (
        f'the flight was over in the air, {height:.2f} m high: no landing ended within its '
        'duration') * said
