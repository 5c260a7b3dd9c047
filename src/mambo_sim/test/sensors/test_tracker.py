"""Telling markers apart: followed however fast, found again, turned where the layout allows it."""

import itertools

from mambo_sim.sensors import tracker
from mambo_sim.sensors.marker_occlusion import ALL, MarkerParams
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

PERIOD = 8_333_333
PARAMS = MarkerParams()
P = PARAMS.values(PERIOD)
SYMMETRIC = MarkerParams(layout='symmetric')
NOBODY = (False,) * 5


def tuples(x):
    return tuple(map(tuple, np.asarray(x, float).tolist()))


def rotation(q):
    return Rotation.from_quat([*q[1:], q[0]])


def quaternion(R):
    x, y, z, w = R.as_quat().tolist()
    return (w, x, y, z)


def view(params, rho, R, rng, order=None):
    """Return the points of a frame with the noise of the parameters, in some order."""
    points = R.apply(params.five()) + rho + rng.normal(0.0, params.noise, (5, 3))
    return tuples(points if order is None else points[list(order)])


def seen(*visible):
    return tuple(i in visible for i in range(5))


def turn(track, R):
    """Return the angle between a track and the truth, rad."""
    return (R.inv() * rotation(track.q)).magnitude()


@pytest.mark.parametrize('used', [
    used for n in (3, 4, 5) for used in itertools.combinations(range(5), n)], ids=str)
def test_an_asymmetric_body_is_found_by_any_three_of_its_markers_in_any_order(used):
    # s^2 (sum |a|^2 I - a a^T)^-1 gives 0.9 mrad at best; three nearly on a line 9 mrad
    rng = np.random.default_rng(1)
    for _ in range(10):
        R, rho = Rotation.random(random_state=rng), rng.uniform(-3.0, 3.0, 3)
        order = rng.permutation(5)
        visible = tuple(bool(marker in used) for marker in order)
        found = tracker.search(view(PARAMS, rho, R, rng, order), visible, P)
        assert found.found and found.deviation < 6 * PARAMS.noise
        assert turn(found, R) < 0.06
        assert np.linalg.norm(found.rho - rho) < 0.003


def test_the_tracker_does_not_know_the_order_of_points():
    rng = np.random.default_rng(2)
    R, rho = Rotation.from_euler('ZYX', [1.0, 0.1, 0.2]), np.array([0.5, 0.0, -1.0])
    points = np.array(view(PARAMS, rho, R, rng))
    start = tracker.define(0, tuple(rho.tolist()), quaternion(R))
    straight = tracker.step(start, PERIOD, tuples(points), ALL, P)
    for order in itertools.permutations(range(5)):
        one = tracker.step(start, PERIOD, tuples(points[list(order)]), ALL, P)
        np.testing.assert_allclose(one.q, straight.q, atol=1e-13)
        np.testing.assert_allclose(one.rho, straight.rho, atol=1e-14)


@pytest.mark.parametrize('params', [PARAMS, SYMMETRIC], ids=['asymmetric', 'symmetric'])
def test_a_moving_body_is_followed_with_three_markers_of_either_layout(params):
    # from rest to 6 m/s (50 mm a frame) and 10 rad/s: farther a frame than half way to the next
    # marker, so that it takes the velocity; which three markers are seen changes all the time
    rng, p = np.random.default_rng(3), params.values(PERIOD)
    triples = list(itertools.combinations(range(5), 3))
    track = None
    for k in range(400):
        t = k * PERIOD * 1e-9
        rho = np.array([1.5 * np.cos(4.0 * t), 0.3 * np.cos(3.0 * t), -1.5])
        R = Rotation.from_rotvec([0.3 * np.sin(5.0 * t), 0.0, 10.0 * t])
        if track is None:
            track = tracker.define(0, tuple(rho.tolist()), quaternion(R))
        visible = ALL if k < 3 else seen(*triples[rng.integers(10)])
        track = tracker.step(track, k * PERIOD, view(params, rho, R, rng), visible, p)
        assert track.tracked and track.exposure == k * PERIOD
        assert np.linalg.norm(track.rho - rho) < 0.003 and turn(track, R) < 0.06


def test_a_fast_body_found_again_is_followed_from_the_second_frame_on():
    rng = np.random.default_rng(11)
    track = tracker.define(0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))._replace(tracked=False)
    for k in range(1, 20):
        rho = np.array([0.1 * k, 0.0, 0.0])  # 12 m/s
        track = tracker.step(
            track, k * PERIOD, view(PARAMS, rho, Rotation.identity(), rng), ALL, P)
        assert track.tracked and np.linalg.norm(track.rho - rho) < 0.0005
        # two positions of 0.06 mm a frame apart: 10 mm/s
        expected = [0.0 if k == 1 else 12.0, 0.0, 0.0]
        np.testing.assert_allclose(track.velocity, expected, atol=0.05)


def test_too_few_markers_are_no_body_and_three_suffice_again():
    rng = np.random.default_rng(4)
    R, rho = Rotation.identity(), np.array([0.0, 0.0, -1.0])
    track = tracker.define(0, (0.0, 0.0, -1.0), (1.0, 0.0, 0.0, 0.0))
    for k, visible in enumerate([(0, 1, 2), (0, 1), (), (4,), (1, 2, 4)], start=1):
        track = tracker.step(track, k * PERIOD, view(PARAMS, rho, R, rng), seen(*visible), P)
        assert track.tracked is (len(visible) >= 3)
    strict = MarkerParams(min_markers=4).values(PERIOD)
    points = view(PARAMS, rho, R, rng)
    assert not tracker.step(track, 6 * PERIOD, points, seen(0, 1, 2), strict).tracked
    assert tracker.step(track, 6 * PERIOD, points, seen(0, 1, 2, 3), strict).tracked


def test_a_body_on_a_line_of_visible_markers_is_lost_not_invented():
    body = ((-0.06, 0.0, 0.0), (-0.01, 0.0, 0.0), (0.06, 0.0, 0.0), (0.0, 0.05, 0.0),
            (0.0, -0.03, 0.02))
    params = MarkerParams(positions=tuple(x for at in body for x in at))
    start = tracker.define(0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    for track in (start, start._replace(tracked=False)):
        lost = tracker.step(track, PERIOD, body, seen(0, 1, 2), params.values(PERIOD))
        assert not lost.tracked and lost.q == start.q


def test_points_that_are_not_the_body_are_not_taken_for_it():
    rng = np.random.default_rng(5)
    start = tracker.define(0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    points = np.array(PARAMS.five())
    for i in range(5):  # a marker bent by twice the deflection and more
        bent = points.copy()
        bent[i] += [0.0, 0.0, 0.012]
        assert not tracker.step(start, PERIOD, tuples(bent), ALL, P).tracked
    assert not tracker.step(start, PERIOD, tuples(rng.uniform(-0.1, 0.1, (5, 3))), ALL, P).tracked
    nothing = tracker.step(start, PERIOD, ((np.nan,) * 3,) * 5, ALL, P)
    assert not nothing.tracked


def found_again(params, visible, count, seed):
    """Return the truth and the track of bodies that were lost, and found by some markers."""
    rng, p, out = np.random.default_rng(seed), params.values(PERIOD), []
    for _ in range(count):
        R = Rotation.from_euler('ZYX', [*rng.uniform(-1, 1, 3) * [np.pi, 0.2, 0.2]])
        track = tracker.define(0, (0.0, 0.0, 0.0), quaternion(R))
        track = tracker.step(track, PERIOD, view(params, np.zeros(3), R, rng), NOBODY, p)
        assert not track.tracked
        points = view(params, np.zeros(3), R, rng)
        out.append((R, tracker.step(track, 2 * PERIOD, points, seen(*visible), p)))
    return out


def test_a_symmetric_body_found_again_is_turned_by_half_a_turn_of_yaw_every_other_time():
    turned = []
    for R, track in found_again(SYMMETRIC, range(5), 400, 6):
        error = (R.inv() * rotation(track.q)).as_rotvec()
        size = np.linalg.norm(error)
        assert size < 0.01 or size > np.pi - 0.01  # nothing in between
        if size > 1.0:
            np.testing.assert_allclose(np.abs(error / size), [0, 0, 1], atol=0.01)
        np.testing.assert_allclose(track.rho, 0.0, atol=0.0005)  # the place is right
        turned.append(size > 1.0)
    # both ways fit alike: a fair coin, standard error 0.025
    assert np.mean(turned) == pytest.approx(0.5, abs=0.1)


def test_an_asymmetric_body_found_again_is_never_turned():
    assert all(turn(track, R) < 0.01 for R, track in found_again(PARAMS, range(5), 200, 7))


def test_four_corners_alone_may_also_be_upside_down():
    # a rectangle has three half turns: which attitude of four is found is a matter of noise
    axes = []
    for R, track in found_again(SYMMETRIC, range(4), 400, 8):
        error = (R.inv() * rotation(track.q)).as_rotvec()
        size = np.linalg.norm(error)
        assert size < 0.02 or size > np.pi - 0.02
        axes.append(3 if size < 1.0 else int(np.abs(error).argmax()))
    shares = np.bincount(axes, minlength=4) / len(axes)
    np.testing.assert_allclose(shares, 0.25, atol=0.09)  # standard error 0.022


def test_a_body_found_turned_is_followed_so_until_it_is_lost_again():
    rng, p = np.random.default_rng(9), SYMMETRIC.values(PERIOD)
    R = Rotation.identity()
    track = tracker.define(0, (0.0, 0.0, 0.0), quaternion(Rotation.from_rotvec([0, 0, np.pi])))
    for k in range(1, 200):
        track = tracker.step(track, k * PERIOD, view(SYMMETRIC, np.zeros(3), R, rng), ALL, p)
        assert turn(track, R) > np.pi - 0.01


def test_the_quaternion_goes_on_without_a_jump_of_sign():
    rng, q = np.random.default_rng(10), None
    track = tracker.define(0, (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0))
    for k in range(300):
        R = Rotation.from_rotvec([0.0, 0.0, 0.05 * k])  # two and a half turns
        track = tracker.step(track, k * PERIOD, view(PARAMS, np.zeros(3), R, rng), ALL, P)
        assert q is None or np.dot(q, track.q) > 0.9
        q = track.q
