"""A tracker that finds the body with other markers after a gap is found out, a maneuver is not."""

from mambo_signals import motion
from mambo_signals.poses import gap_jumps, outliers
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic import FLIP, loop, make_capture, rocking

T = np.arange(0.0, 15.0, 0.01)
GAPS = [0.13, 0.2, 0.3]


def lost(*gaps, step=1):
    """Return which poses are there: not those from t for dt, in s, and only each of some."""
    there = np.arange(len(T)) % step == 0
    for t, dt in gaps:
        there &= ~((T >= t - 1e-6) & (T < t + dt - 1e-6))
    return there


def flown(there, begin, end, turn=FLIP, rate=0.0):
    """Return the poses of a flight with yaw, turned between two times, and which are."""
    turns = Rotation.from_euler('z', rate * T[:, None]) * rocking(T)
    wrong = (T >= begin) & (T < end)
    q = turns.as_quat()
    q[wrong] = (turns[wrong] * turn).as_quat()
    return (T[there], loop(T)[0][there], q[there]), wrong[there]


@pytest.mark.parametrize('step, gap', [(1, 0.13), (1, 0.3), (10, 0.13)])
@pytest.mark.parametrize('at', [(4.0, 7.0), (4.0,), (7.0,)])
@pytest.mark.parametrize('rate', [0.0, 3.0, -3.0])
def test_poses_flipped_behind_a_gap_are_found_if_they_turn_back(step, gap, at, rate):
    poses, wrong = flown(lost(*((t, gap) for t in at), step=step), 4.0, 7.0, rate=rate)
    found = outliers.sort(*poses)
    np.testing.assert_array_equal(found.wrong, wrong)
    assert not len(found.doubtful)


@pytest.mark.parametrize('gap', [*GAPS, 1.5, 4.5])
def test_a_flip_that_does_not_turn_back_is_told_and_all_poses_are_kept(gap):
    poses, _ = flown(lost((4.0, gap)), 4.0, 15.0)
    found = outliers.sort(*poses)
    assert not found.wrong.any()
    assert poses[0][found.doubtful] == pytest.approx([4.0 + gap])


@pytest.mark.parametrize('gap', [*GAPS, 1.0])
def test_another_sensor_tells_a_flip_from_a_maneuver(gap):
    poses, wrong = flown(lost((4.0, gap)), 4.0, 15.0)
    for by_it, flipped in ((Rotation.identity(), True), (FLIP, False)):
        found = outliers.sort(*poses, turned=lambda *times, by_it=by_it: by_it.as_quat())
        wrong_one = found.wrong if flipped else np.zeros(len(wrong), bool)
        np.testing.assert_array_equal(found.wrong, wrong_one)
        assert (set(map(tuple, zip(found.labels, wrong, strict=True)))
                == ({(0, False), (1, True)} if flipped else {(0, False), (0, True)}))
        assert not len(found.doubtful)
    asked = []
    outliers.sort(*poses, turned=lambda *times: asked.append(times) or np.full(4, np.nan))
    np.testing.assert_allclose(asked, [(3.99, 4.0 + gap)])


@pytest.mark.parametrize('gap', [0.13, 0.3, 0.5, 1.0, 3.0])
@pytest.mark.parametrize('speed', [1.0, 3.0])
def test_a_flight_that_goes_on_in_its_gaps_has_no_jump(gap, speed):
    """At 3 m/s with tilts of 20 degrees, 0.13 to 3 s of poses lost four times."""
    there = lost(*((t, gap) for t in (2.0, 5.0, 8.0, 11.0)))
    found = outliers.sort(T[there], loop(T)[0][there] * speed, rocking(T)[there].as_quat())
    assert not found.wrong.any() and not len(found.doubtful)


def test_a_fast_turn_at_a_steady_rate_is_no_jump():
    """Of 1400 deg/s: half a turn in a gap of 0.13 s."""
    there = lost((4.0, 0.12), (7.0, 0.12))
    turns = Rotation.from_euler('z', 25.0 * T[:, None])
    found = outliers.sort(T[there], loop(T)[0][there], turns[there].as_quat())
    assert not found.wrong.any() and not len(found.doubtful)


@pytest.mark.parametrize('away, found', [(0.5, False), (1.5, True)])
def test_a_body_found_elsewhere_behind_a_gap_is_left_out_until_it_is_back(away, found):
    there = lost((4.0, 0.2), (7.0, 0.2))
    poses, wrong = flown(there, 4.0, 7.0, Rotation.identity())
    elsewhere = poses[1] + away * wrong[:, None] * [0.0, 1.0, 0.0]
    assert elsewhere[wrong].shape == (280, 3) and away < outliers.FASTEST * 0.2
    np.testing.assert_array_equal(
        outliers.sort(poses[0], elsewhere, poses[2]).wrong, wrong & found)


def test_the_steps_show_what_is_beyond_the_motion():
    there = lost((4.0, 0.3))
    (t, position, q), _ = flown(there, 4.0, 15.0, rate=2.0)
    steps = gap_jumps.steps(t, position, Rotation.from_quat(q))
    k = int(np.argmax(np.diff(t)))
    assert steps.suspected.nonzero()[0].tolist() == [k]
    assert (Rotation.from_quat(steps.turns[k]) * FLIP.inv()).magnitude() < 0.2
    assert np.linalg.norm(steps.shifts[k]) < 0.1 < np.linalg.norm(position[k + 1] - position[k])
    assert gap_jumps.largest_shift(np.array([0.3])) == pytest.approx(0.5 + 10.0 * 0.09)


@pytest.mark.parametrize('rate', [0.0, 1.0, 2.0, -3.0])
@pytest.mark.parametrize('mount', [0.0, 1.0, -2.5])
@pytest.mark.parametrize('flip', [FLIP, Rotation.from_euler('z', 180.0, degrees=True)])
def test_another_sensor_tells_a_flip_however_far_the_vehicle_yaws_in_the_gap(rate, mount, flip):
    """Also of a body whose heading on the vehicle is not that of the sensor."""
    poses, wrong = flown(lost((4.0, 0.8)), 4.0, 15.0, flip, rate)
    plain = Rotation.from_euler('z', rate * T[:, None]) * rocking(T)
    seen = Rotation.from_euler('z', mount)

    def turned(begin, end):
        one, other = (seen.inv() * plain[int(round(100.0 * t))] * seen for t in (begin, end))
        return (one.inv() * other).as_quat()
    found = outliers.sort(*poses, turned=turned)
    np.testing.assert_array_equal(found.labels == 1, wrong)
    poses, _ = flown(lost((4.0, 0.8)), 4.0, 4.0, flip, rate)
    assert not outliers.sort(*poses, turned=turned).wrong.any()


@pytest.mark.parametrize('every, size', [(40, 0.5), (20, 0.5), (20, 1.0)])
def test_a_slow_capture_of_a_vehicle_that_yaws_has_no_jump(every, size):
    """Of 2.5 and 5 Hz; a right angle or half a turn in 0.4 s, and back, twice."""
    yaw = sum(sign * 0.5 * size * np.pi * (1.0 + np.tanh(12.0 * (T - t)))
              for t, sign in ((1.0, 1), (5.0, -1), (8.0, 1), (12.0, -1)))
    q = Rotation.from_euler('z', yaw[:, None]).as_quat()
    for k in range(0, every, 4):
        found = outliers.sort(T[k::every], loop(T)[0][k::every], q[k::every])
        assert not found.wrong.any() and not (size == 0.5 and len(found.doubtful))


@pytest.mark.parametrize('seed', range(5))
def test_turns_are_compared_up_to_a_heading(seed):
    one, other = Rotation.random(2, rng=seed)
    heading = Rotation.from_euler('z', 1.0 + seed)
    seen = heading.inv() * one * heading
    assert gap_jumps.between(one.as_quat(), seen.as_quat()) == pytest.approx(0.0, abs=1e-7)
    least = min((one.inv() * turn.inv() * other * turn).magnitude()
                for turn in Rotation.from_rotvec(np.arange(0.0, 6.3, 0.01)[:, None] * [0, 0, 1]))
    assert gap_jumps.between(one.as_quat(), -other.as_quat()) == pytest.approx(least, abs=1e-4)


def test_in_a_long_gap_the_vehicle_may_have_turned_and_turned_back_later():
    poses, _ = flown(lost((4.0, 1.0), (7.0, 1.0)), 4.0, 7.0)
    found = outliers.sort(*poses)
    assert not found.wrong.any()
    assert poses[0][found.doubtful] == pytest.approx([5.0, 8.0])


@pytest.mark.long
def test_gaps_without_number_are_sorted_in_bounded_time():
    """20,000 steps of 0.1 s, each a suspected jump; a sensor is asked for some of them."""
    count, asked = 20_000, []
    rng = np.random.default_rng(0)
    found = outliers.sort(
        0.1 * np.arange(count), rng.normal(size=(count, 3)),
        Rotation.random(count, rng=0).as_quat(),
        lambda *times: asked.append(times) or Rotation.identity().as_quat())
    assert 500 < len(asked) <= gap_jumps.MANY and len(found.labels) == count


@pytest.mark.parametrize('seed', range(6))
def test_many_gaps_of_which_some_flip_the_body_are_told_apart(seed):
    """Ten gaps of 0.12 to 0.18 s; behind some the body is seen turned, until the next one."""
    rng = np.random.default_rng(seed)
    begins = 0.5 + 1.4 * np.arange(10)
    gaps = rng.uniform(0.12, 0.18, 10).round(2)
    there, wrong = lost(*zip(begins, gaps, strict=True)), np.zeros(len(T), bool)
    kinds = (FLIP, Rotation.from_euler('z', 180, degrees=True),
             Rotation.from_euler('z', 90, degrees=True))
    q, turns = rocking(T).as_quat(), rocking(T)
    for k in rng.choice([1, 3, 5, 7], 3, replace=False):
        part = (begins[k] <= T) & (begins[k + 1] > T)
        q[part] = (turns[part] * kinds[rng.integers(3)]).as_quat()
        wrong |= part
    found = outliers.sort(T[there], loop(T)[0][there], q[there])
    np.testing.assert_array_equal(found.wrong, wrong[there])
    assert not len(found.doubtful)


@pytest.mark.parametrize('begin, end', [(0.01, 15.0), (14.8, 14.99), (0.0, 0.3)])
def test_gaps_beside_the_ends_have_speeds_on_one_side(begin, end):
    """One pose, or none, stands on the other side of the gap."""
    there = (T < begin) | (T >= end)
    poses = T[there], loop(T)[0][there], rocking(T)[there].as_quat()
    found = outliers.sort(*poses)
    assert not found.wrong.any() and not len(found.doubtful)


def test_a_motion_of_a_bag_keeps_what_may_be_a_maneuver(tmp_path):
    """Turned behind a gap of 0.2 s, and back behind another: the import has asked the gyro."""
    bag = make_capture(tmp_path / 'b', set(range(420, 1500)), (3.995, 4.195))
    found = motion.read(bag, 'optitrack/pose')
    assert found.impossible == 0 and len(found.stamps) == 1500 - 20
    poses, wrong = flown(lost((4.0, 0.2), (7.0, 0.2)), 4.0, 7.0)
    assert not outliers.impossible(*poses).any()
    assert (outliers.sort(*poses).wrong == wrong).all()


@pytest.mark.parametrize('seed', range(20))
def test_an_assignment_returns_where_it_stands_again(seed):
    chosen = np.random.default_rng(seed).integers(-1, 6, 1 + seed)
    every = chosen.tolist()
    assert outliers.assignment_returns(chosen).tolist() == [
        every[k] in every[k + 2:] or every[k + 1] in every[:k] for k in range(seed)]


@pytest.mark.parametrize('yaw', [0.0, 1.5, -2.9])
def test_a_flip_that_adds_to_a_turn_is_taken_from_it(yaw):
    """The room may be turned, and quaternions have either sign."""
    poses, wrong = flown(lost((4.0, 0.2), (7.0, 0.2)), 4.0, 7.0, rate=1.0)
    q = (Rotation.from_euler('z', yaw) * Rotation.from_quat(poses[2])).as_quat()
    q[::3] *= -1.0
    path = Rotation.from_euler('z', yaw).apply(poses[1])
    found = outliers.sort(poses[0], path, q)
    np.testing.assert_array_equal(found.wrong, wrong)
    off = Rotation.from_quat(found.turns[1]) * FLIP.inv()
    assert off.magnitude() < 0.2


def test_frames_in_bursts_beside_a_gap_are_no_jumps():
    """Five frames come at once; two bursts are lost."""
    bursts = np.repeat(T[::5], 5) + 1e-5 * np.tile(np.arange(5), 300)
    there = lost((4.0, 0.15), (9.0, 0.15))
    found = outliers.sort(bursts[there], loop(T)[0][there], rocking(T)[there].as_quat())
    assert not found.wrong.any() and not len(found.doubtful)
