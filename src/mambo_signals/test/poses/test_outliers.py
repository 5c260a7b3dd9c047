"""Poses that no vehicle can have are found, and only those."""

from mambo_bags.reader import BagError, read_bag
from mambo_signals.motion import read
from mambo_signals.poses import outliers
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic import FLIP, loop, make_capture, Maker, rocking

T = np.arange(0.0, 15.0, 0.01)


def flipped_at(numbers, turn=FLIP):
    """Return the attitudes of the flight, some of them turned."""
    turns = rocking(T).as_quat()
    for k in numbers:
        turns[k] = (Rotation.from_quat(turns[k]) * turn).as_quat()
    return turns


@pytest.mark.parametrize('flipped', [{700}, {0}, {1499}, set(range(600, 640)), {300, 301, 900}])
def test_poses_that_the_tracker_flips_are_found(flipped):
    wrong = outliers.impossible(T, loop(T)[0], flipped_at(flipped))
    assert set(np.flatnonzero(wrong)) == flipped


@pytest.mark.parametrize('place', [(0.0, 0.0, 0.0), (-999.0, -999.0, -999.0)])
def test_a_fixed_position_while_the_body_is_not_seen_is_left_out(place):
    """The attitude goes on, and the vehicle moves by more than a metre meanwhile."""
    position, turns = loop(T)[0] + [0.3, -0.2, 1.0], rocking(T).as_quat()
    wrong = np.zeros(len(T), bool)
    for begin, end in ((200, 301), (500, 501), (700, 860), (1200, 1480)):
        wrong[begin:end] = True
    away = np.linalg.norm(position[860] - position[699])
    assert away > 3 * outliers.SAME_SHIFT
    for part in (wrong, wrong | (T < 0.5), wrong | (T >= 14.0)):
        held = np.where(part[:, None], place, position)
        np.testing.assert_array_equal(outliers.impossible(T, held, turns), part)
        assert outliers.refuse_most('a: b', T, held, turns).sum() == part.sum()


@pytest.mark.parametrize('gap', [1, 5, 30])
def test_a_fixed_position_beside_frames_that_are_missing_is_left_out(gap):
    position, turns = loop(T)[0] + [0.3, -0.2, 1.0], rocking(T).as_quat()
    wrong = (np.arange(len(T)) >= 500) & (np.arange(len(T)) < 700)
    held = np.where(wrong[:, None], 0.0, position)
    there = np.ones(len(T), bool)
    there[500 - gap:500] = there[700:700 + gap] = False
    found = outliers.impossible(T[there], held[there], turns[there])
    np.testing.assert_array_equal(found, wrong[there])
    start = np.where((np.arange(len(T)) < 300)[:, None], 0.0, loop(T)[0] - loop(T)[0][300])
    assert not outliers.impossible(T, start, turns).any()  # at rest at the origin, then away


@pytest.mark.parametrize('seed', range(8))
def test_random_flips_of_random_length_are_found(seed):
    """A third of the flight seen in two other ways: the way that holds longest is the true one."""
    rng = np.random.default_rng(seed)
    turns = (FLIP, Rotation.from_euler('z', 90.0, degrees=True))
    attitudes, wrong = rocking(T).as_quat(), np.zeros(len(T), bool)
    for begin in rng.choice(np.arange(20, 1400, 90), 6, replace=False):
        some = slice(int(begin), int(begin) + int(rng.integers(1, 80)))
        attitudes[some] = (Rotation.from_quat(attitudes[some]) * turns[rng.integers(2)]).as_quat()
        wrong[some] = True
    np.testing.assert_array_equal(outliers.impossible(T, loop(T)[0], attitudes), wrong)


def test_a_pose_elsewhere_is_found_and_fast_flight_is_not():
    position, turns = loop(T)[0], rocking(T).as_quat()
    position[500] += [0.0, 1.0, 0.0]
    assert np.flatnonzero(outliers.impossible(T, position, turns)).tolist() == [500]
    flip = Rotation.from_euler('x', 25.0 * T[:, None]).as_quat()  # 1400 deg/s
    assert not outliers.impossible(T, loop(T)[0] * 10.0, flip).any()
    late = np.where(np.arange(len(T)) < 700, T, T + 3.0)  # what turns during a gap is no jump
    assert not outliers.impossible(late, loop(T)[0], rocking(T).as_quat()).any()
    far = loop(T)[0] + np.where(np.arange(len(T)) < 700, 0.0, 2.0)[:, None]  # nor what moves
    assert not outliers.impossible(late, far, rocking(T).as_quat()).any()


@pytest.mark.parametrize(('part', 'jumps'), [(0.97, False), (1.03, True)])
def test_the_limits_are_those_that_are_named(part, jumps):
    t = 0.02 * np.arange(100)
    still = np.zeros((100, 3))
    turn = part * outliers.FASTEST_TURN * 0.02  # in one frame
    turned = Rotation.from_rotvec(np.where(np.arange(100)[:, None] == 60, [turn, 0, 0], 0.0))
    assert outliers.impossible(t, still, turned.as_quat()).any() == jumps
    moved = still.copy()
    moved[60, 1] = part * outliers.FASTEST * 0.02
    assert outliers.impossible(t, moved, np.tile([0.0, 0.0, 0.0, 1.0], (100, 1))).any() == jumps


def test_a_small_jump_is_within_what_the_vehicle_may_really_do():
    """After a jump of less than ``ALIKE_TURN`` and ``ALIKE`` the tracker is of the same mind."""
    t, still = 0.005 * np.arange(100), np.zeros((100, 3))
    turned = Rotation.from_rotvec(np.where(np.arange(100)[:, None] >= 60, [0.3, 0, 0], 0.0))
    assert 0.3 > outliers.FASTEST_TURN * 0.005  # a jump
    assert not outliers.impossible(t, still, turned.as_quat()).any()
    moved = np.where(np.arange(100)[:, None] >= 60, [0.0, 0.25, 0.0], still)
    assert not outliers.impossible(t, moved, np.tile([0.0, 0.0, 0.0, 1.0], (100, 1))).any()


def test_the_sign_of_a_quaternion_is_no_jump():
    turns = rocking(T).as_quat()
    turns[::3] *= -1.0
    assert not outliers.impossible(T, loop(T)[0], turns).any()


def test_stamps_in_bursts_are_no_jumps():
    """A busy machine stamps five frames at once; the vehicle moves 2 cm meanwhile."""
    bursts = np.repeat(T[::5], 5) + 1e-5 * np.tile(np.arange(5), 300)
    poses = bursts, loop(T)[0], rocking(T).as_quat()
    assert not outliers.impossible(*poses).any()
    assert not outliers.refuse_most('a: b', *poses).any()


@pytest.mark.parametrize('count', [0, 1, 2])
def test_too_few_poses_are_all_possible(count):
    turns = np.tile([0.0, 0.0, 0.0, 1.0], (count, 1))
    far = 1e3 * np.arange(count)[:, None] * np.ones(3)
    assert outliers.impossible(T[:count], far, turns).tolist() == [False] * count


def test_a_flipped_pose_is_left_out_of_a_motion_and_counted(tmp_path):
    motion = read(make_capture(tmp_path / 'b', {700, 1100}), 'optitrack/pose')
    assert motion.impossible == 2 and len(motion.stamps) == 1498
    z_up = Rotation.from_quat(motion.quaternion).as_matrix()[:, 2, 2]
    assert z_up.min() > 0.9


def test_an_estimate_may_jump(tmp_path):
    """Only a motion capture is judged: an estimate that jumps is what is to be seen."""
    maker = Maker(tmp_path / 'b', ['estimate/odom'])
    for k in range(50):
        maker.odometry('estimate/odom', k * 10_000_000, (5.0 * (k == 30), 0.0, 0.0))
    maker.writer.close()
    motion = read(read_bag(tmp_path / 'b'), 'estimate/odom')
    assert motion.impossible == 0 and motion.position[30, 0] == 5.0


@pytest.mark.parametrize(('count', 'words'), [(1, '1 impossible pose left out, reached'),
                                              (2, '2 impossible poses left out, reached')])
def test_rejected_poses_are_reported_in_one_line(count, words):
    message = outliers.describe('optitrack/pose', count)
    assert message.startswith(f'optitrack/pose: {words}') and '\n' not in message
    assert '2005 deg/s or 30 m/s' in message


@pytest.mark.parametrize('count', [1, 12])
def test_poses_are_sorted_with_the_turn_of_each_group(count):
    """A mean over many jumps: the vehicle itself turns by up to 1 degree during each."""
    wrong = {k for part in range(count) for k in range(50 + 100 * part, 90 + 100 * part)}
    found = outliers.sort(T, loop(T)[0], flipped_at(wrong))
    assert set(np.flatnonzero(found.labels == 1)) == wrong and found.right == 0
    off = FLIP.inv() * Rotation.from_quat(found.turns[1])
    assert off.magnitude() < np.radians(1.5 / np.sqrt(count))
    assert Rotation.from_quat(found.turns[0]).magnitude() == 0.0


def test_a_body_out_of_sight_has_no_assignment():
    held = np.where((np.arange(len(T)) // 100 == 5)[:, None], 0.0, loop(T)[0] + 1.0)
    labels = outliers.sort(T, held, rocking(T).as_quat()).labels
    np.testing.assert_array_equal(labels, np.where(np.arange(len(T)) // 100 == 5, -1, 0))


@pytest.mark.long
def test_poses_that_all_jump_are_sorted_in_bounded_time():
    rng = np.random.default_rng(0)
    count = 20_000
    wrong = outliers.impossible(
        0.01 * np.arange(count), 1e6 * rng.normal(size=(count, 3)),
        Rotation.random(count, rng=0).as_quat())
    assert wrong.sum() == count - 1


def test_poses_of_which_most_jump_are_refused_though_none_is_impossible_alone():
    """Seconds read as ms: each step is a jump below ``SAME_SHIFT``."""
    turns = np.tile([0.0, 0.0, 0.0, 1.0], (len(T), 1))
    path = np.column_stack([np.sin(T), 0.0 * T, 0.0 * T])
    assert not outliers.refuse_most('a.csv: optitrack/pose', T, path, turns).any()
    assert not outliers.impossible(1e-3 * T, path, turns).any()
    with pytest.raises(BagError, match='^a.csv: optitrack/pose: 14.. of 1499 steps are faster '
                                       'than 2005 deg/s or 30 m/s: wrong times or units$'):
        outliers.refuse_most('a.csv: optitrack/pose', 1e-3 * T, path, turns)


def test_a_recording_of_which_more_than_half_is_impossible_is_refused():
    position, turns = loop(T)[0], rocking(T).as_quat()
    held = position.copy()
    for part in range(4):  # four of five parts are elsewhere, each in another place
        held[300 * part:300 * (part + 1), 0] += 5.0 * (part + 1)
    with pytest.raises(BagError, match='1200 of 1500 poses are impossible, reached faster'):
        outliers.refuse_most('a: b', T, held, turns)
    some = position.copy()
    some[:700, 0] += 5.0
    assert outliers.refuse_most('a: b', T, some, turns).sum() == 700


def test_a_recording_of_which_most_is_wrong_by_a_sensor_is_not_refused():
    position, turns = loop(T)[0], flipped_at(range(500, 1500))
    found = outliers.sort(T, position, turns)._replace(right=0)
    with pytest.raises(BagError, match='1000 of 1500 poses are impossible'):
        outliers.refuse_most('a: b', T, position, turns, found)
    told = found._replace(by='the gyro')
    assert outliers.refuse_most('a: b', T, position, turns, told).sum() == 1000
