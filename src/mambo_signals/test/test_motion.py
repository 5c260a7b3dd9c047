"""The motion that a topic tells, against scipy's rotations; what cannot be used is named."""

from hypothesis import given, strategies as st
from mambo_bags.reader import BagError, read_bag
from mambo_signals import motion
from mambo_signals.motion import Motion
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from synthetic import make_flight, Maker

RNG = np.random.default_rng(0)
STAMPS = 10_000_000 * np.arange(100)


def some(velocity=True):
    """Return a motion of 1 s."""
    t = STAMPS * 1e-9
    turns = Rotation.from_euler('ZYX', np.column_stack([3.0 * t, 0.2 * np.sin(t), 0.1 * t]))
    return Motion('pose', STAMPS, np.column_stack([np.sin(t), np.cos(t), t]), turns.as_quat(),
                  np.column_stack([np.cos(t), -np.sin(t), np.ones(100)]) if velocity else None)


def same_attitude(p, q):
    return np.abs((p * q).sum(axis=-1)) == pytest.approx(1.0, abs=1e-12)


def test_products_are_scipys():
    p, q = (Rotation.random(50, rng=seed) for seed in (1, 2))
    assert same_attitude(motion.product(p.as_quat(), q.as_quat()), (p * q).as_quat())
    one = p[7].as_quat()
    assert same_attitude(motion.product(one, q.as_quat()), (p[7] * q).as_quat())
    assert same_attitude(motion.product(q.as_quat(), one), (q * p[7]).as_quat())


@given(st.tuples(*[st.floats(-1.8, 1.8)] * 3))
def test_rotation_vectors_are_scipys_and_survive_tiny_angles(v):
    """Lengths of up to 3.12, below half a turn, where the shorter way is the vector itself."""
    q = Rotation.from_rotvec(v).as_quat()[None]
    for one in (q, -q):
        np.testing.assert_allclose(motion.rotation_vectors(one)[0], v, atol=1e-14)


def test_a_rotation_vector_of_nan_is_nan():
    q = np.array([[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, -1.0], [np.nan] * 4])
    out = motion.rotation_vectors(q)
    np.testing.assert_array_equal(out[:2], 0.0)
    assert np.isnan(out[2]).all()


def test_angles_are_scipys_without_jumps_of_a_turn():
    t = np.linspace(0.0, 20.0, 2000)
    yaw = 400.0 * np.sin(0.3 * t) + 30.0 * t  # deg, several turns
    q = Rotation.from_euler('ZYX', np.column_stack([
        yaw, 20.0 * np.sin(t), 170.0 + 0.4 * t]), degrees=True).as_quat()
    q[500:520] = np.nan
    q[::3] *= -1.0
    out = motion.angles(q)
    known = np.isfinite(out).all(axis=1)
    assert np.flatnonzero(~known).tolist() == list(range(500, 520))
    np.testing.assert_allclose(out[known, 2], yaw[known], atol=1e-6)
    np.testing.assert_allclose(out[known, 1], 20.0 * np.sin(t)[known], atol=1e-6)
    np.testing.assert_allclose(out[known, 0], (170.0 + 0.4 * t)[known], atol=1e-6)


def test_a_moved_motion_is_seen_from_elsewhere_and_moves_back():
    here = some()
    there = here.moved(5, 0.7, np.array([1.0, 2.0, 3.0]))
    turn = Rotation.from_euler('z', 0.7)
    assert (there.stamps - here.stamps).tolist() == [5] * 100
    np.testing.assert_allclose(there.position, turn.apply(here.position) + [1.0, 2.0, 3.0])
    np.testing.assert_allclose(there.velocity, turn.apply(here.velocity))
    assert same_attitude(there.quaternion, (turn * Rotation.from_quat(here.quaternion)).as_quat())
    back = there.moved(-5, -0.7, -turn.inv().apply([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(back.position, here.position, atol=1e-12)
    np.testing.assert_array_equal(back.stamps, here.stamps)
    assert some(velocity=False).moved(0, 1.0, np.zeros(3)).velocity is None


def test_between_its_samples_a_motion_is_interpolated_and_in_a_gap_it_is_not():
    whole = some()
    kept = np.r_[0:40, 60:100]
    lost = Motion('pose', STAMPS[kept], whole.position[kept], whole.quaternion[kept],
                  whole.velocity[kept])
    at = np.array([-1, 5_000_000, 205_000_000, 500_000_000, 995_000_000])
    seen = lost.at(at)
    assert np.isnan(seen.position).all(axis=1).tolist() == [True, False, False, True, True]
    t = at[1:3] * 1e-9
    np.testing.assert_allclose(seen.position[1:3], np.column_stack([np.sin(t), np.cos(t), t]),
                               atol=2e-5)  # dt^2 / 8
    np.testing.assert_allclose(np.linalg.norm(seen.quaternion[1:3], axis=1), 1.0)
    truth = Rotation.from_euler('ZYX', np.column_stack([3.0 * t, 0.2 * np.sin(t), 0.1 * t]))
    off = (truth.inv() * Rotation.from_quat(seen.quaternion[1:3])).magnitude()
    assert off.max() < 1e-5  # a chord, of 0.03 rad a sample
    assert some(velocity=False).at(at).velocity is None
    assert lost.gap == 35_000_000
    np.testing.assert_array_equal(lost.t, lost.stamps * 1e-9)
    assert lost.orientation is lost.quaternion


def recorded(path, samples, topic='estimate/odom'):
    """Write (stamp, position, quaternion, body velocity) and return the bag."""
    maker = Maker(path, [topic])
    for stamp, p, q, v in samples:
        maker.odometry(topic, stamp, p, q, v)
    maker.writer.close()
    return read_bag(path)


def test_a_body_velocity_is_turned_to_the_world(tmp_path):
    turns = Rotation.from_euler('ZYX', RNG.uniform(-1.0, 1.0, (20, 3)))
    speeds = RNG.normal(size=(20, 3))
    bag = recorded(tmp_path / 'b', [
        (k * 10, (k, 0, 0), turns[k].as_quat(), speeds[k]) for k in range(20)])
    found = motion.read(bag, 'estimate/odom')
    np.testing.assert_allclose(found.velocity, turns.apply(speeds), atol=1e-12)
    assert found.name == 'estimate/odom' and found.frame == 'odom' and found.impossible == 0


def test_samples_without_a_position_or_with_a_stamp_twice_are_left_out(tmp_path):
    level, still = (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0)
    bag = recorded(tmp_path / 'b', [
        (10, (1, 0, 0), level, still), (20, (np.nan, 0, 0), level, still),
        (20, (2, 0, 0), level, still), (20, (9, 0, 0), level, still),
        (30, (3, 0, 0), level, still),
        (40, (4, 0, 0), (0.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0))])
    found = motion.read(bag, 'estimate/odom')
    assert found.stamps.tolist() == [10, 20, 30, 40]
    assert found.position[:, 0].tolist() == [1.0, 2.0, 3.0, 4.0]
    # without an attitude a velocity in body axes says nothing
    assert np.isnan(found.quaternion[3]).all() and np.isnan(found.velocity[3]).all()
    assert np.isfinite(found.velocity[:3]).all()


@pytest.mark.parametrize(('count', 'words'), [(0, '0 usable samples'), (1, '1 usable sample of')])
def test_too_few_samples_are_refused_by_topic(tmp_path, count, words):
    sample = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    lost = ((np.nan,) * 3, *sample[1:])
    bag = recorded(tmp_path / 'b', [(k, *(sample if k < count else lost)) for k in range(3)])
    with pytest.raises(BagError, match=f'/mambo/estimate/odom has {words}'):
        motion.read(bag, 'estimate/odom')


def test_a_type_without_a_motion_is_refused_by_name(tmp_path):
    bag = read_bag(make_flight(tmp_path / 'b', 1.0))
    with pytest.raises(BagError, match='sensor_msgs/msg/Imu, which holds no motion; choose a '
                                       'topic of type Odometry, PoseStamped'):
        motion.read(bag, 'imu/data_raw')


def test_the_velocity_of_a_reference_is_inertial(tmp_path):
    maker = Maker(tmp_path / 'b', ['reference', 'estimate/odom'])
    maker.odometry('estimate/odom', 0, (0, 0, 0))  # known as a drone's
    turn = Rotation.from_euler('z', 1.0).as_quat()
    for k in range(3):
        maker.write('reference', k * 10, position=maker.Vector3(k, 0, 0),
                    velocity=maker.Vector3(1, 2, 3), attitude=maker.Quaternion(*turn))
    maker.writer.close()
    found = motion.read(read_bag(tmp_path / 'b'), 'reference')
    assert found.velocity.tolist() == [[1.0, 2.0, 3.0]] * 3
    assert same_attitude(found.quaternion, turn)


@pytest.mark.long
def test_the_best_topic_is_chosen_and_another_one_beside_it(tmp_path):
    bag = read_bag(make_flight(tmp_path / 'a', 1.0))
    few = read_bag(make_flight(tmp_path / 'b', 1.0, leave_out=('ground_truth/odom',)))
    assert motion.candidates(bag) == ['ground_truth/odom', 'optitrack/pose', 'estimate/odom']
    assert motion.choose(bag, None, few, None) == 'optitrack/pose'  # which both have
    assert motion.choose(bag, None, bag, None) == 'ground_truth/odom'
    assert motion.choose(bag, None, bag, 'ground_truth/odom') == 'optitrack/pose'
    assert motion.choose(few, None, bag, 'estimate/odom') == 'estimate/odom'
    assert motion.choose(few, None, bag, 'ground_truth/odom') == 'optitrack/pose'
    assert motion.choose(bag, 'whatever', few, None) == 'whatever'  # the reader refuses it
    still = read_bag(make_flight(tmp_path / 'c', 1.0, leave_out=(
        'ground_truth/odom', 'optitrack/pose', 'estimate/odom')))
    with pytest.raises(BagError, match=r'no topic with a motion .*/mambo/imu/data_raw'):
        motion.choose(still, None, bag, None)


def test_a_foreign_pose_is_a_candidate_too(tmp_path):
    maker = Maker(tmp_path / 'b', ['estimate/odom'])
    maker.writer.add_topic('/hall/pose', 'geometry_msgs/msg/PoseStamped')
    data = maker.message('optitrack/pose', 10, pose=maker.pose((1, 2, 3)))
    maker.writer.write('/hall/pose', data, 10)
    maker.odometry('estimate/odom', 10, (0, 0, 0))
    maker.writer.close()
    assert motion.candidates(read_bag(tmp_path / 'b')) == ['estimate/odom', '/hall/pose']


def test_position_errors_are_at_the_stamps_of_the_signal(tmp_path):
    maker = Maker(tmp_path / 'b', ['estimate/odom', 'ground_truth/odom'])
    for k in range(0, 100):
        if not 40 <= k < 50:
            maker.odometry('ground_truth/odom', k * 10_000_000, (0.1 * k, 0.0, 0.0))
    for k in range(-1, 100):
        maker.odometry('estimate/odom', max(k, 0) * 10_000_000 + 5_000_000 * (k >= 0),
                       (0.1 * k + 0.05 + 0.3, 0.2, 0.0))
    maker.writer.close()
    bag = read_bag(tmp_path / 'b')
    stamps, errors = motion.position_errors(bag['estimate/odom'], bag['ground_truth/odom'])
    np.testing.assert_array_equal(stamps, bag['estimate/odom'].stamp)
    known = np.isfinite(errors).all(axis=1)
    gap = (stamps > 390_000_000) & (stamps < 500_000_000)
    assert not known[gap].any() and not known[-1] and known[~gap][1:-1].all()
    np.testing.assert_allclose(errors[known][1:], np.tile([0.3, 0.2, 0.0], (known.sum() - 1, 1)),
                               atol=1e-12)
