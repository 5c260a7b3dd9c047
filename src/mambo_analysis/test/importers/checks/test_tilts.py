"""Tracked positions beside tracked attitudes: a path whose tilts are computed here by hand."""

import dataclasses

from mambo_analysis.importers.checks import tilts
from mambo_signals.motion import Motion
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

G = 9.81


def attitudes(ax, ay):
    """Return x y z w whose z axis is along the thrust, of accelerations in m/s^2; yaw 0."""
    up = np.stack([ax, ay, np.full_like(ax, G)], 1)
    up /= np.linalg.norm(up, axis=1)[:, None]
    axis = np.cross([0.0, 0.0, 1.0], up)
    angle = np.arccos(up[:, 2])
    size = np.maximum(np.linalg.norm(axis, axis=1), 1e-12)
    return Rotation.from_rotvec(axis * (angle / size)[:, None]).as_quat()


def flight(a=1.0, b=0.7, period=(4.0, 2.7), rate=100.0, length=20.0, drag=0.0):
    """Return a flight along x = a sin, y = b sin, 1 m high, with a drag in 1/s."""
    t = np.arange(0.0, length, 1.0 / rate)
    w, v = (2.0 * np.pi / one for one in period)
    position = np.stack([a * np.sin(w * t), b * np.sin(v * t), np.where(t < 0.5, 0.0, 1.0)], 1)
    q = attitudes(-a * w**2 * np.sin(w * t) + drag * a * w * np.cos(w * t),
                  -b * v**2 * np.sin(v * t) + drag * b * v * np.cos(v * t))
    return Motion('optitrack/pose', np.rint(t * 1e9).astype(int), position, q)


def moved(one, factors):
    """Return a flight with other positions."""
    return dataclasses.replace(one, position=one.position * factors)


def with_angles(one, change):
    """Return a flight with other angles yaw, pitch and roll, (n, 3) rad."""
    angles = Rotation.from_quat(one.quaternion).as_euler('ZYX')
    return dataclasses.replace(
        one, quaternion=Rotation.from_euler('ZYX', change(angles)).as_quat())


def late(one, seconds):
    """Return a flight whose positions come later than its attitudes."""
    position = np.stack([np.interp(one.t - seconds, one.t, x) for x in one.position.T], 1)
    return dataclasses.replace(one, position=position)


def test_a_flight_is_as_its_tilts_say():
    assert tilts.describe(flight()) == ''


@pytest.mark.parametrize('rate', [20.0, 10.0, 9.0, 8.0, 5.0, 1.0])
@pytest.mark.parametrize('jitter', [0.0, 0.003])
def test_a_flight_of_few_poses_is_not_on_its_side(rate, jitter):
    """Steps of 10 Hz are 0.1 s, some a rounding error longer, or later by milliseconds."""
    one = flight(rate=rate, period=(5.0, 4.0), length=30.0)
    late = np.random.default_rng(1).uniform(-jitter, jitter, len(one.stamps))
    one = dataclasses.replace(one, stamps=one.stamps + np.rint(late * 1e9).astype(int))
    assert tilts.describe(one) == ''
    swapped = dataclasses.replace(one, quaternion=one.quaternion[:, [3, 0, 1, 2]])
    assert 'upside down in 100 % of the flight' in tilts.describe(swapped)


def turned(one, angle, where=True):
    """Return a flight that is rolled by an angle in deg as well, where it is said."""
    roll = Rotation.from_euler('x', np.where(where, angle, 0.0)[..., None], degrees=True)
    return dataclasses.replace(
        one, quaternion=(Rotation.from_quat(one.quaternion) * roll).as_quat())


@pytest.mark.parametrize('angle', [178.0, 90.0])
@pytest.mark.parametrize('rate', [500.0, 100.0, 10.0, 5.0, 2.0, 1.0])
@pytest.mark.parametrize('length', [2.0, 3.0, 5.0])
def test_a_short_flight_on_its_side_is_told_at_any_rate(length, rate, angle):
    one = flight(rate=rate, length=length + 0.5 / rate)
    one.position[:, 2] = 1.0 - 0.15 * one.t  # a slow descent is no landing
    assert tilts.describe(one) == ''
    assert 'on its side or upside down' in tilts.describe(turned(one, angle))


def test_a_flip_and_a_vehicle_that_lies_on_its_back_are_no_flight_on_its_side():
    one = flight(length=3.0)
    assert tilts.describe(turned(one, 180.0, one.t < 0.6)) == ''
    assert tilts.describe(turned(flight(length=0.7), 180.0)) == ''
    fallen = one.t > 1.2  # 0.5 s on the floor, 0.7 s in the air, then on the floor again
    one.position[fallen, 2] = 0.0
    assert tilts.describe(turned(one, 180.0, fallen)) == ''


def test_a_pose_before_a_gap_does_not_count_for_the_gap():
    one = flight(length=20.0)
    keep = (one.t < 4.0) | (one.t > 18.0)
    one = dataclasses.replace(one, stamps=one.stamps[keep], position=one.position[keep],
                              quaternion=one.quaternion[keep])
    assert tilts.describe(turned(one, 180.0, np.abs(one.t - 4.0) < 0.3)) == ''


def test_an_attitude_that_is_hardly_known_is_not_on_its_side():
    one = flight(length=30.0)
    q = one.quaternion.copy()
    q[np.arange(len(q)) % 40 > 0] = np.nan  # every 0.4 s
    assert tilts.describe(dataclasses.replace(one, quaternion=q)) == ''


@pytest.mark.parametrize('period', [(4.0, 2.7), (6.3, 5.0), (7.5, 7.5)])
def test_drag_is_no_delay(period):
    """At 1 rad/s a drag of 0.54 1/s makes accelerations lead the tilts by 0.5 s."""
    size = 0.9 * (period[0] / 4.0)**2  # the same tilts
    assert tilts.describe(flight(size, 0.8 * size, period, length=30.0, drag=0.54)) == ''


@pytest.mark.parametrize('period', [6.0, 9.0, 12.0])
@pytest.mark.parametrize('way', [1.0, -1.0])
def test_drag_on_a_circle_is_no_turn(period, way):
    w, size, drag, one = 2.0 * np.pi / period, 1.5, 0.54, flight(length=60.0)
    x, y = size * np.cos(w * one.t), way * size * np.sin(w * one.t)
    v_x, v_y = -way * w * y, way * w * x
    circle = dataclasses.replace(
        one, position=np.stack([x, y, one.position[:, 2]], 1),
        quaternion=attitudes(-w**2 * x + drag * v_x, -w**2 * y + drag * v_y))
    assert tilts.describe(circle) == ''


@pytest.mark.parametrize('change, said', [
    (lambda one: moved(one, [3.28, 3.28, 1.0]), 'are 3.3 times those of its tilts'),
    (lambda one: moved(one, [0.5, 0.5, 1.0]), 'are 0.5 times those of its tilts'),
    (lambda one: moved(one, [-1.0, 1.0, 1.0]), 'mirror image'),
    (lambda one: moved(one, [-1.0, -1.0, 1.0]), 'are turned by 180 deg'),
    (lambda one: late(one, 0.3), 'follow its tilts 0.30 s late'),
    (lambda one: late(one, -0.3), 'follow its tilts 0.30 s early'),
    (lambda one: dataclasses.replace(one, quaternion=one.quaternion[:, [3, 0, 1, 2]]),
     'upside down in 100 % of the flight'),
    (lambda one: dataclasses.replace(one, quaternion=flight(period=(3.1, 1.9)).quaternion),
     'do not follow its tilts'),
    (lambda one: with_angles(one, lambda e: 0.0 * e),
     'for which a multirotor tilts by 18 deg, not by 0: check that its attitude was tracked'),
    (lambda one: with_angles(one, np.radians), 'and the unit of its angles'),
    (lambda one: with_angles(one, lambda e: e[:, ::-1]),
     'check the order of the quaternion (x y z w) or of the angles'),
    (lambda one: dataclasses.replace(one, quaternion=one.quaternion[:, [1, 2, 3, 0]]),
     'check the order of the quaternion (x y z w) or of the angles, that'),
], ids=['feet', 'half', 'mirrored', 'turned', 'late', 'early', 'wxyz', 'another flight',
        'constant', 'degrees', 'roll for yaw', 'w first'])
def test_what_contradicts_the_tilts_is_told(change, said):
    assert said in tilts.describe(change(flight())).replace('-180', '180')


def test_an_attitude_that_tilts_along_one_direction_alone_is_told():
    """Roll and yaw in each other's place: the pitch, and so the tilt along x, is right."""
    swapped = with_angles(flight(b=0.3), lambda e: e[:, ::-1])
    assert ('follow its tilts, but not along the direction at 90 deg from x (correlation'
            in tilts.describe(swapped))
    assert tilts.describe(flight(b=0.3)) == ''


def test_noisy_positions_of_a_hover_are_no_flight_without_tilt():
    """1 cm of noise: accelerations of 0.6 m/s^2."""
    one = flight(a=0.01, b=0.01)
    noisy = dataclasses.replace(one, position=one.position + np.random.default_rng(0).normal(
        0.0, 0.01, one.position.shape))
    assert tilts.describe(noisy) == ''


@pytest.mark.parametrize('one', [
    flight(length=4.0), flight(a=0.01, b=0.01), moved(flight(a=0.01), [100.0, 0.0, 1.0]),
    dataclasses.replace(flight(), quaternion=np.full_like(flight().quaternion, np.nan)),
], ids=['short', 'hovers', 'hardly tilts', 'no attitude'])
def test_what_shows_too_little_is_not_judged(one):
    assert tilts.describe(one) == '' or one.position[:, 0].max() > 0.5


def test_noisy_positions_are_no_other_scale():
    """1 cm of noise makes the acceleration of this calm flight 1.4 times that of its tilts."""
    one = flight(a=0.3, b=0.2)
    noise = 0.01 * np.random.default_rng(1).standard_normal(one.position.shape)
    noisy = dataclasses.replace(one, position=one.position + noise)
    assert tilts.describe(noisy) == ''


def test_gaps_and_the_floor_do_not_count():
    one = flight()
    keep = (one.t < 6.0) | (one.t > 9.0)
    assert tilts.describe(dataclasses.replace(
        one, stamps=one.stamps[keep], position=one.position[keep],
        quaternion=one.quaternion[keep])) == ''
    rolls = one.t < 14.0  # level, along the floor
    level = np.where(rolls[:, None], [0.0, 0.0, 0.0, 1.0], one.quaternion)
    rolled = dataclasses.replace(one, quaternion=level)
    assert 'do not follow' in tilts.describe(rolled)
    rolled.position[rolls, 2] = 0.0
    assert tilts.describe(rolled) == ''


def test_a_vehicle_that_tips_over_in_its_take_off_is_not_on_its_side_in_flight():
    """2 s upright, a hop of 10 cm onto its back, and 3 s on the floor."""
    t = np.arange(0.0, 5.4, 0.01)
    turned = np.clip((t - 2.0) / 0.4, 0.0, 1.0)
    q = Rotation.from_euler('x', np.pi * turned[:, None]).as_quat()
    hop = 0.03 + 0.1 * np.clip(1.0 - ((t - 2.2) / 0.2)**2, 0.0, None)
    place = np.stack([0.3 * turned, 0.0 * t, hop], 1)
    one = dataclasses.replace(
        flight(), stamps=(1e9 * t).astype(np.int64), position=place, quaternion=q)
    assert tilts.describe(one) == ''
    over = dataclasses.replace(one, quaternion=np.tile(q[-1], (len(t), 1)))
    assert 'upside down in 100 %' in tilts.describe(over)
