"""The parts of a flight, by its reference and by its height; what is not told is not made up."""

from mambo_bags.reader import read_bag
from mambo_signals.flight_phases import (
    BLEND as ASSUMED, detect_phases, LEVEL, phases, Phases, SETTLED)
from mambo_signals.motion import Motion
import numpy as np
import pytest
from synthetic import BLEND, LANDING, make_flight, Maker, START

SECOND = 10**9
GROUND, TAKEOFF, TRACK, LAND, LANDED = range(5)  # as in Reference.msg, see the first test
SCENARIO = '/mambo/reference_node:\n  ros__parameters:\n    plan: {blend_duration: 1.25}\n'


def referenced(path, steps, scenario=SCENARIO):
    """Write a reference of (phase, until s) at 10 Hz, and return the bag."""
    # a drone's topics are known by those of its sensors and commands
    maker = Maker(path, ['reference', 'estimate/odom'], attachments={'scenario.yaml': scenario})
    maker.odometry('estimate/odom', 0, (0, 0, 0))
    t = 0.0
    for number, until in steps:
        while t < until - 1e-9:
            maker.write('reference', round(t * SECOND), phase=number)
            t += 0.1
    maker.writer.close()
    return read_bag(path)


@pytest.mark.long
def test_a_flight_has_three_parts_that_share_their_ends(tmp_path):
    bag = read_bag(make_flight(tmp_path / 'b'))
    seen = phases(bag)
    constants = [bag['reference'].constant(f'PHASE_{name}') for name in (
        'GROUND', 'TAKEOFF', 'TRACK', 'LANDING', 'LANDED')]
    assert constants == [GROUND, TAKEOFF, TRACK, LAND, LANDED]
    assert seen.takeoff_end == round((START + BLEND) * SECOND)
    assert seen.landing_start == round(LANDING * SECOND)
    assert seen.liftoff == SECOND
    names = [name for name, _, _ in seen.parts()]
    assert names == ['whole flight', 'take-off', 'after take-off', 'landing']
    (_, first, last), takeoff, after, landing = seen.parts()
    assert (first, last) == (None, None)
    assert takeoff[1:] == (None, seen.takeoff_end)
    assert after[1:] == (takeoff[2], landing[1]) and landing[2] is None


def test_the_blend_is_that_of_the_scenario_in_the_bag(tmp_path):
    bag = referenced(tmp_path / 'b', [(TAKEOFF, 2.0), (TRACK, 8.0)])
    assert phases(bag).takeoff_end == round(3.25 * SECOND)
    assert '1.25 s of blend' in phases(bag).text and 'assumed' not in phases(bag).text


def test_a_blend_missing_in_the_bag_is_assumed_and_reported(tmp_path):
    bag = referenced(tmp_path / 'b', [(TAKEOFF, 2.0), (TRACK, 8.0)], 'a: [1, {b: 2}]\n')
    assert phases(bag).takeoff_end == round((2.0 + ASSUMED) * SECOND)
    assert 'assumed: the bag does not hold it' in phases(bag).text


@pytest.mark.parametrize(('gap', 'known'), [(0.0, True), (0.09, True), (0.112, False)])
def test_a_take_off_that_ends_in_a_gap_has_no_end(tmp_path, gap, known):
    maker = Maker(tmp_path / 'b', ['reference'], attachments={'scenario.yaml': SCENARIO})
    for k in range(1200):
        if 0.0 < (t := 0.005 * k) - 1.96 < gap:
            continue
        maker.write('reference', round(t * SECOND),
                    phase=GROUND if t < 1.0 else TAKEOFF if t < 2.0 else TRACK)
    maker.writer.close()
    seen = phases(read_bag(tmp_path / 'b', namespace='/mambo'))
    assert (seen.takeoff_end is not None) == known and seen.landing_start is None
    assert known or seen.text == (
        'no end of the take-off found: phase TRACK begins between 1.96 and 2.08 s, which was '
        'not recorded')


@pytest.mark.parametrize(('height', 'stood'), [(0.0, True), (0.009, True), (0.02, False)])
def test_a_vehicle_that_stays_on_the_floor_never_took_off(tmp_path, height, stood):
    maker = Maker(tmp_path / 'b', ['reference', 'ground_truth/odom', 'estimate/odom'],
                  attachments={'scenario.yaml': SCENARIO})
    for k, phase in enumerate((GROUND, TAKEOFF, TRACK, TRACK)):
        maker.write('reference', k * SECOND, phase=phase)
        maker.odometry('ground_truth/odom', k * SECOND, (0.1 * k, 0.0, -height * (k == 2)))
        maker.odometry('estimate/odom', k * SECOND, (0.0, 0.0, -float(k)))
    maker.writer.close()
    seen = phases(read_bag(tmp_path / 'b'))
    assert (seen.text == 'the vehicle never took off: it stayed on the floor') is stood
    assert (len(seen.parts()) == 1) is stood


@pytest.mark.parametrize(('steps', 'want', 'words'), [
    ([(GROUND, 1.0), (TAKEOFF, 3.0)], (None, None, 1.0), 'never reached'),
    ([(TRACK, 3.0), (LAND, 5.0)], (0.0, 3.0, None), 'no take-off: on the trajectory'),
    ([(GROUND, 1.0), (TAKEOFF, 2.0), (LAND, 3.0)], (None, 2.0, 1.0), 'never reached'),
    ([(LANDED, 1.0), (TAKEOFF, 2.0), (TRACK, 4.0), (LAND, 5.0), (LANDED, 6.0)],
     (3.25, 4.0, 1.0), 'phase TRACK from 2.00 s'),
    ([(LAND, 1.0), (TRACK, 4.0)], (2.25, None, None), 'phase TRACK')])
def test_parts_that_are_not_there_are_none(tmp_path, steps, want, words):
    seen = phases(referenced(tmp_path / 'b', steps))
    stamps = (seen.takeoff_end, seen.landing_start, seen.liftoff)
    assert stamps == tuple(None if t is None else pytest.approx(round(t * SECOND), abs=2)
                           for t in want)
    assert words in seen.text
    assert len(seen.parts()) == 1 + (want[0] is not None) * (2 + (want[1] is not None))


@pytest.mark.parametrize(('steps', 'ends', 'landing', 'words'), [
    # a landing that is cancelled, one after which it takes off again, one that is the last
    ([(TRACK, 7.0), (LAND, 7.5), (TRACK, 24.0), (LAND, 28.0), (LANDED, 30.0)], 3.25, 24.0,
     '; it flies on after a landing begun at 7.00 s'),
    ([(TRACK, 5.0), (LAND, 8.0), (LANDED, 10.0), (TAKEOFF, 12.0), (TRACK, 20.0)], 3.25, None,
     '; it flies on after a landing begun at 5.00 s'),
    ([(TRACK, 2.5), (LAND, 3.0), (TAKEOFF, 5.0), (TRACK, 8.0), (LAND, 9.0)], 2.5, 8.0,
     '1.25 s of blend, cut short by a landing; it flies on after a landing begun at 2.50 s'),
    ([(TRACK, 2.5), (LAND, 9.0)], 2.5, 2.5, '1.25 s of blend, cut short by a landing')])
def test_the_landing_is_the_last_one_and_parts_do_not_overlap(
        tmp_path, steps, ends, landing, words):
    seen = phases(referenced(tmp_path / 'b', [(GROUND, 1.0), (TAKEOFF, 2.0), *steps]))
    assert seen.takeoff_end == pytest.approx(round(ends * SECOND), abs=2)
    assert seen.landing_start == (
        None if landing is None else pytest.approx(round(landing * SECOND), abs=2))
    assert seen.text.endswith(words)
    edges = [edge for _, *part in seen.parts()[1:] for edge in part if edge is not None]
    assert edges == sorted(edges)


def test_a_bag_without_a_reference_has_no_phases(tmp_path):
    bag = read_bag(make_flight(tmp_path / 'b', 1.0, leave_out=('reference',)))
    assert phases(bag) == Phases(None, None, '')


def test_parts_move_with_the_clock(tmp_path):
    assert Phases(5, None, 'x', 3).moved(10) == Phases(15, None, 'x', 13)
    assert Phases(None, 7, 'x').moved(-7) == Phases(None, 0, 'x')
    bag = referenced(tmp_path / 'b', [
        (TAKEOFF, 2.0), (TRACK, 5.0), (LAND, 6.0), (TRACK, 8.0), (LAND, 9.0)])
    assert phases(bag).moved(10 * SECOND).text == (
        'phase TRACK from 12.00 s and 1.25 s of blend; it flies on after a landing begun at '
        '15.00 s')


def height(z, rate=100.0):
    """Return a motion straight up and down, (n,) m."""
    stamps = np.rint(np.arange(len(z)) * SECOND / rate).astype(np.int64)
    return Motion('optitrack/pose', stamps, np.column_stack([0.0 * z, 0.0 * z, z]),
                  np.tile([0.0, 0.0, 0.0, 1.0], (len(z), 1)))


def profile(noise=0.0, seed=0, duration=30.0):
    """Climb from 3 s to 5 s by 1.5 m, hold it, sink from 20 s to 24 s."""
    t = np.arange(0.0, duration, 0.01)
    z = np.interp(t, [3.0, 5.0, 20.0, 24.0], [0.0, 1.5, 1.5, 0.0])
    return t, z + noise * np.random.default_rng(seed).standard_normal(len(t))


@pytest.mark.parametrize('noise', [0.0, 0.001])
@pytest.mark.parametrize('floor', [0.0, -7.0])
def test_take_off_and_landing_are_found_in_the_height(noise, floor):
    seen = detect_phases(height(profile(noise)[1] + floor))
    # within what the height moves over the window of the speed, and 2 cm of the ground
    assert seen.liftoff == pytest.approx(3 * SECOND, abs=0.1 * SECOND)
    assert seen.takeoff_end == pytest.approx(5 * SECOND, abs=0.3 * SECOND)
    assert seen.landing_start == pytest.approx(20 * SECOND, abs=0.3 * SECOND)
    assert 'optitrack/pose' in seen.text


@pytest.mark.parametrize(('speed', 'kept'), [(0.8 * LEVEL, True), (1.3 * LEVEL, False)])
def test_a_slow_climb_is_a_height_that_is_kept(speed, kept):
    t, _ = profile()
    z = np.interp(t, [3.0, 5.0, 15.0, 24.0, 26.0], [0.0, 1.5, 1.5 + 10.0 * speed, 1.5, 0.0])
    end = detect_phases(height(z)).takeoff_end
    assert (end is not None and end < 6.0 * SECOND) == kept


@pytest.mark.parametrize(('pause', 'ends'), [(SETTLED - 0.2, False), (SETTLED + 0.3, True)])
def test_a_pause_ends_the_take_off_if_it_lasts(pause, ends):
    t, _ = profile()
    z = np.interp(t, [3.0, 4.5, 4.5 + pause, 6.0 + pause, 20.0, 24.0],
                  [0.0, 1.2, 1.2, 2.2, 2.2, 0.0])
    assert (detect_phases(height(z)).takeoff_end < (4.7 + pause) * SECOND) == ends


def test_a_flight_goes_on_only_where_its_end_is_known_and_later_by_more_than_a_moment():
    parts = Phases(None, None, 'x', end=10**9).moved(10**9)
    assert parts.end == 2 * 10**9
    assert parts.goes_on(1_499_999_999) and not parts.goes_on(1_500_000_000)
    assert not Phases(None, None, 'x').goes_on(0)


def test_phases_missing_in_the_height_are_reported():
    t, z = profile()
    text = detect_phases(height(0.0 * z)).text
    assert text.startswith('no take-off found: the vehicle never leaves')
    flying = (t > 8.0) & (t < 18.0)
    seen = detect_phases(height(z[flying] + 0.4 * np.sin(t[flying])))
    assert seen == Phases(None, None, 'no take-off found: the recording begins in the air')
    restless = z + np.where(z > 0.2, 0.5 * np.sin(6.0 * t), 0.0)
    seen = detect_phases(height(restless))
    assert seen.takeoff_end is None and seen.liftoff is not None
    assert 'no height is kept' in seen.text


def test_a_recording_that_ends_in_the_air_has_no_landing():
    t, z = profile()
    seen = detect_phases(height(z[t < 15.0]))
    assert seen.takeoff_end is not None and seen.landing_start is None
    assert [name for name, _, _ in seen.parts()] == ['whole flight', 'take-off', 'after take-off']


def test_a_climb_from_a_hover_is_no_take_off():
    t, z = profile()
    hover = 0.7 + 0.02 * np.sin(3.0 * t)
    seen = detect_phases(height(z + hover))
    assert seen == Phases(None, None, 'no take-off found: the recording begins in the air')
    assert detect_phases(height(z + 0.7)).liftoff is not None


def test_a_gap_is_no_height_that_is_kept():
    """Where the capture lost the vehicle nothing is level: the take-off ends behind it."""
    t, z = profile()
    motion = height(z)
    kept = (t < 4.9) | (t > 9.0)
    lost = Motion(motion.name, motion.stamps[kept], motion.position[kept],
                  motion.quaternion[kept])
    assert detect_phases(lost).takeoff_end >= 9.0 * SECOND
