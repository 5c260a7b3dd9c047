"""The motion capture of a hall: who hides whose markers, and who is taken for whom."""

import dataclasses

from mambo_model.motion.rigid_body import State
from mambo_model.schema import ParameterError
from mambo_sim.sensors import hall_capture, optitrack
from mambo_sim.sensors.hall_capture import Exchange, HallCaptureParams
from mambo_sim.sensors.optitrack import OptitrackParams
import numpy as np
import pytest

ZERO = (0.0, 0.0, 0.0)
LEVEL = (1.0, 0.0, 0.0, 0.0)
QUIET = OptitrackParams(noise=False)
PLACES = [(0.0, 0.0, 0.0), (0.0, 2.0, 0.0)]
STEP = 5_000_000  # ns
TWO_CAMERAS = HallCaptureParams(
    occlusion=True, cameras=2, camera_height=1.0, body_height=0.1)


def capture(params, places=PLACES):
    return hall_capture.of_hall(params, places, [QUIET] * len(places))


def rows(*positions):
    """Return level poses at positions in each drone's own frame."""
    out = np.zeros((len(positions), 7))
    out[:, :3], out[:, 3] = positions, 1.0
    return out


def all_here(hall, exposure, *positions):
    return hall.frame(exposure, rows(*positions), np.ones(len(positions), dtype=bool)).copy()


def state(*rho):
    return State(rho, ZERO, LEVEL, ZERO)


def test_drones_do_nothing_to_each_other_by_default():
    assert capture(HallCaptureParams()) is None


@pytest.mark.parametrize('given, line', [
    ({'model': 'pose'}, 'model: markers'), ({'rate': 100.0}, 'the same .*rate')])
def test_drones_that_cannot_share_cameras_are_refused(given, line):
    cameras = [QUIET, dataclasses.replace(QUIET, **given)]
    with pytest.raises(ParameterError, match=line):
        hall_capture.of_hall(HallCaptureParams(occlusion=True), PLACES, cameras)


def test_no_more_cameras_can_be_needed_than_there_are():
    with pytest.raises(ParameterError, match='min_cameras = 3 is more than cameras = 2'):
        HallCaptureParams(cameras=2, min_cameras=3)


def test_cameras_stand_around_the_hall():
    at = np.array(HallCaptureParams(cameras=6, camera_distance=4.0).positions())
    np.testing.assert_allclose(np.hypot(*at[:, :2].T), 4.0)
    assert (at[:, 2] == -2.5).all()
    np.testing.assert_allclose(at.mean(axis=0)[:2], 0.0, atol=1e-15)


def test_who_is_seen_gets_its_own_pose_to_the_bit():
    hall = capture(HallCaptureParams(occlusion=True, swap_distance=0.5))
    poses = rows((0.1, 1 / 3, -1.0), (0.2, 0.7, -1.1))
    views = hall.frame(0, poses, np.ones(2, dtype=bool))
    np.testing.assert_array_equal(views[:, :7], poses)
    assert (views[:, 7:] == 1.0).all()


def test_a_drone_above_hides_markers_and_more_cameras_see_past_it():
    """Two cameras on a line with both drones: each sees but one of them, if they are high."""
    hall = capture(TWO_CAMERAS)  # cameras at y = 5 and -5, drones at y = 0 and 0.3
    views = all_here(hall, 0, (0.0, 0.0, -1.0), (0.0, -1.7, -1.0))
    assert (views[:, 7:] == 0.0).any(axis=1).all()
    np.testing.assert_array_equal(views[:, :7], rows((0.0, 0.0, -1.0), (0.0, -1.7, -1.0)))
    far = all_here(capture(TWO_CAMERAS), 0, (0.0, 0.0, -1.0), (0.0, -1.7, -1.4))
    assert (far[:, 7:] == 1.0).all()
    one = capture(dataclasses.replace(TWO_CAMERAS, min_cameras=1))
    assert (all_here(one, 0, (0.0, 0.0, -1.0), (0.0, -1.7, -1.0))[:, 7:] == 1.0).all()
    many = capture(dataclasses.replace(TWO_CAMERAS, cameras=8))
    assert (all_here(many, 0, (0.0, 0.0, -1.0), (0.0, -1.7, -1.0))[:, 7:] == 1.0).all()


def test_who_is_not_there_hides_nothing():
    hall = capture(TWO_CAMERAS)
    poses = rows((0.0, 0.0, -1.0), (0.0, -1.7, -1.0))
    assert (hall.frame(0, poses, np.array([True, False]))[0, 7:] == 1.0).all()


def test_drones_that_meet_are_taken_for_each_other_until_they_meet_again():
    hall = capture(HallCaptureParams(swap_distance=0.5))
    apart, near = ((0.0, 0.0, -1.0), (0.0, 0.0, -1.2)), ((0.0, 0.0, -1.0), (0.0, -1.6, -1.2))

    def seen(exposure, positions):
        return all_here(hall, exposure, *positions)[:, :3]

    np.testing.assert_array_equal(seen(0, apart), apart)
    swapped = seen(1, near)
    np.testing.assert_allclose(swapped, [(0.0, 0.4, -1.2), (0.0, -2.0, -1.0)], atol=1e-15)
    np.testing.assert_array_equal(seen(2, near), swapped)  # once for each meeting
    np.testing.assert_allclose(seen(3, apart), [(0.0, 2.0, -1.2), (0.0, -2.0, -1.0)], atol=1e-15)
    np.testing.assert_array_equal(seen(4, near), near)
    assert hall.exchanges == [Exchange(1, (0, 1)), Exchange(4, (0, 1))]


def test_drones_that_begin_near_each_other_are_known():
    hall = capture(HallCaptureParams(swap_distance=3.0))
    all_here(hall, 0, ZERO, ZERO)
    assert not hall.exchanges


def test_after_the_swap_time_every_body_is_known_again():
    hall = capture(HallCaptureParams(swap_distance=0.5, swap_time=2.0))
    near = ((0.0, 0.0, -1.0), (0.0, -1.6, -1.2))
    all_here(hall, 0, ZERO, ZERO)
    all_here(hall, 10**9, *near)
    assert all_here(hall, 3 * 10**9 - 1, *near)[0, 1] == pytest.approx(0.4)
    assert all_here(hall, 3 * 10**9, *near)[0, 1] == 0.0


def test_of_three_drones_the_pair_that_meets_is_exchanged():
    hall = capture(HallCaptureParams(swap_distance=0.5), [*PLACES, (0.0, 4.0, 0.0)])
    all_here(hall, 0, ZERO, ZERO, ZERO)
    views = all_here(hall, 1, ZERO, ZERO, (0.0, -1.6, 0.0))  # the third beside the second
    np.testing.assert_allclose(views[:, 1] + [0.0, 2.0, 4.0], [0.0, 2.4, 2.0])
    views = all_here(hall, 2, (0.0, 2.1, 0.0), ZERO, ZERO)  # the first beside the second
    # the name of the third, which follows the second, now follows the first
    np.testing.assert_allclose(views[:, 1] + [0.0, 2.0, 4.0], [2.0, 4.0, 2.1])


def film(views_of, swap, n=60):
    """Return the poses of two drones that approach each other, on shared or own cameras."""
    hall = capture(HallCaptureParams(occlusion=True, swap_distance=swap))
    p, rngs = OptitrackParams().values(), [np.random.default_rng(k) for k in range(2)]
    memory, before, out = [optitrack.START] * 2, None, ([], [])
    for k in range(n):
        now = k * STEP, [state(0.0, 0.02 * k, -1.0), state(0.0, -0.02 * k, -1.3)]
        before = before or now
        views = views_of(hall, *now)
        for i in range(2):
            memory[i], sample = optitrack.step(
                memory[i], before[0], before[1][i], now[0], now[1][i], rngs[i], p,
                None if views is None else views[i])
            if sample.new:
                out[i].append((sample.stamp, *sample.pose.rho))
        before = now
    return [np.array(poses) for poses in out]


@pytest.mark.long
def test_poses_of_a_shared_motion_capture_are_those_of_each_alone_to_the_bit():
    alone = film(lambda hall, t, states: None, 0.0)
    shared = film(lambda hall, t, states: hall.step(t, states), 0.0)
    for one, other in zip(alone, shared, strict=True):
        assert len(one) > 30
        np.testing.assert_array_equal(one, other)


def test_the_tracker_finds_the_other_drone_where_names_are_exchanged():
    alone = film(lambda hall, t, states: None, 0.5)
    swapped = film(lambda hall, t, states: hall.step(t, states), 0.5)
    # they are 0.5 m apart at a distance of 0.4 m along y: after (2 - 0.4) / 0.04 = 40 steps
    when = alone[0][:, 0] > 40 * STEP
    assert when.sum() > 5
    np.testing.assert_array_equal(swapped[0][~when], alone[0][~when])
    np.testing.assert_allclose(
        swapped[0][when][:, 1:], alone[1][when][:, 1:] + [0.0, 2.0, 0.0], atol=1e-3)


def test_a_sample_that_is_missing_leaves_the_drone_out_of_a_frame():
    hall = capture(TWO_CAMERAS)
    states = [state(0.0, 0.0, -1.0), state(0.0, -1.7, -1.0)]
    assert (hall.step(0, states)[0, 7:] == 0.0).any()
    hall.step(STEP, states)
    views = hall.step(2 * STEP, [states[0], None])
    assert (views[0, 7:] == 1.0).all()
    assert (hall.step(4 * STEP, states)[0, 7:] == 0.0).any()
